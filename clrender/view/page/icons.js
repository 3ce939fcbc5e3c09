// Icons of the tools on the image, as SVG paths on a grid of 16.

const PATHS = {
  focus: "M8 5.2a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.6M2 5V2h3M11 2h3v3M14 11v3h-3M5 14H2v-3",
  reset: "M3 8a5 5 0 1 0 1.6-3.7M3 2.5v3h3",
  probe: "M8 1.5v4M8 10.5v4M1.5 8h4M10.5 8h4M8 7.5v1M7.5 8h1",
  paths: "M2 13L6.5 4L10 12L14 3M6.5 4h.01M10 12h.01",
  compare: "M8 1.5v13M2 4h4v8H2zM10 4h4v8h-4",
  palette: "M2 12h12M2 12V9M5 12V6M8 12V4M11 12V7M14 12V3",
  panel: "M2 3h12v10H2zM10 3v10",
  help: "M5.8 6a2.2 2.2 0 1 1 3.2 2c-.7.4-1 .8-1 1.6M8 12v.4",
};
const NAMESPACE = "http://www.w3.org/2000/svg";

export function icon(name) {
  const svg = document.createElementNS(NAMESPACE, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(NAMESPACE, "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
