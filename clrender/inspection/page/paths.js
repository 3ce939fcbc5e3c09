// The page of light paths: pictures, a sketch of the scene, the samples, and the vertices of one of them.

import { make } from "./elements.js";
import { marks, svg } from "./path_overlay.js";
import { splatWords, triple } from "./path_rows.js";
import { createPathView } from "./path_view.js";

const data = JSON.parse(document.getElementById("paths").textContent);
const around = JSON.parse(document.getElementById("surroundings").textContent);
const view = createPathView(data, around);

function pictures() {
  if (!around) return null;
  const mark = svg("svg", { viewBox: `0 0 ${around.near_size[0]} ${around.near_size[1]}`, "aria-hidden": "true" });
  const [left, top] = data.pixel.map((each, axis) => each - around.near_corner[axis]);
  mark.append(...marks("rect", { x: left, y: top, width: 1, height: 1 }));
  const where = `pixel ${data.pixel.join(",")}`;
  return make("section", { class: "lp-part" }, make("h2", {}, "Image"), make("div", { class: "lp-pictures" },
    make("figure", { class: "lp-image" },
      make("div", { class: "lp-picture" }, make("img", { src: around.image, alt: `The image, with ${where} marked` }), view.overlay),
      make("figcaption", {}, around.camera.projects ? `The image at a low resolution, ${where}, and the paths that are drawn.`
        : `The image at a low resolution, and ${where}.`)),
    make("figure", { class: "lp-near" },
      make("div", { class: "lp-picture" }, make("img", { src: around.near, alt: `Pixels around ${where}` }), mark),
      make("figcaption", {}, `Pixels around it, with ${data.spp} samples each.`))));
}

const facts = [data.integrator + (data.guided ? ", guided" : "") + (data.spectral ? ", wavelengths" : ""), `${data.spp} samples`, `seed ${data.seed}`,
  `${data.width} × ${data.height}`, `radiance ${triple(data.radiance, 5)}`];
if (data.splats) facts.push(splatWords(data));
if (data.nonfinite_samples) facts.push(`${data.nonfinite_samples} samples were not finite and are left out`);
document.getElementById("view").append(
  make("header", { class: "lp-bar" }, make("h1", {}, document.title), make("p", {}, facts.join(" · "))),
  make("div", { class: "lp-parts" }, ...[pictures(), view.stage, view.samples, view.details, view.splats].filter(Boolean)));
