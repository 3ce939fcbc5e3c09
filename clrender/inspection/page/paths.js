// The page of light paths: pictures, a sketch of the scene, the samples, and the vertices of one of them.

import { make, readable } from "./elements.js";
import { sketch } from "./sketch.js";

const data = JSON.parse(document.getElementById("paths").textContent);
const around = JSON.parse(document.getElementById("surroundings").textContent);

const COLORS = { path: "#5db2ff", light: "#ffd45c", blocked: "#ff7a6b", other: "#7f93a8", escape: "#9fe08a" };
const luminance = (color) => (color.includes(null) ? Infinity : 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]);
const number = (value, digits = 4) => (value === null ? "not finite" : readable(value, digits));
const triple = (values, digits = 3) => (values === null ? "–" : values.map((each) => number(each, digits)).join("  "));
/** A colour for reading: one number if it is grey. */
const color = (values, digits = 3) => (values !== null && values.every((each) => each === values[0]) ? number(values[0], digits) : triple(values, digits));
const percent = (share) => `${readable(100 * share, 3)} %`;
const heading = (text, extra = {}) => make("th", { scope: "col", ...extra }, text);

/** The addition of a sample that brings most, and its vertex. */
function mostOf(sample) {
  let most = null;
  sample.vertices.forEach((vertex, place) => vertex.additions.forEach((addition) => {
    const brings = Math.abs(luminance(addition.contribution));
    if (addition.order && (most === null || brings > most.brings)) most = { addition, place, brings };
  }));
  return most;
}

const rows = data.samples.map((sample, rank) => {
  const most = mostOf(sample);
  const last = sample.vertices[sample.vertices.length - 1];
  return { sample, rank, most, last, brightness: luminance(sample.value), size: sample.vertices.length };
});
const named = (addition) => addition.object ?? addition.light_kind ?? "";
const brought = (most) => (most ? `${most.addition.strategy} ${named(most.addition)}`.trim() : "nothing");

let chosen = rows[0] ?? null;
let marked = null;
const drawn = new Set(chosen ? [chosen.rank] : []);

// What is drawn

/** Length of rays that leave the scene, metres. */
const reach = around ? around.reach : Math.max(...rows.flatMap((row) => row.sample.vertices.map((vertex) => vertex.distance ?? 0)), 1);
const further = (from, direction) => from.map((each, axis) => each + direction[axis] * reach * 0.6);

function linesOf(row) {
  const main = row === chosen, found = [];
  let from = row.sample.origin;
  for (const vertex of row.sample.vertices) {
    const escapes = vertex.position === null, to = escapes ? further(from, vertex.direction_in) : vertex.position;
    // One that came back has been drawn
    if (!vertex.again) found.push({ from, to, color: escapes ? COLORS.escape : main ? COLORS.path : COLORS.other, width: main ? 2.5 : 1.2 });
    if (escapes) break;
    from = vertex.position;
    for (const addition of main ? vertex.additions : []) {
      const sampled = addition.strategy === "light sample" || addition.strategy === "light centre";
      if (!sampled || !addition.shadow_ray) continue;
      const end = addition.position ?? further(from, addition.direction);
      found.push({ from, to: end, color: addition.arrives ? COLORS.light : COLORS.blocked, width: 1.2, dash: addition.arrives ? null : [4, 4] });
    }
  }
  return found;
}
const shownRows = () => rows.filter((row) => drawn.has(row.rank) && row !== chosen).concat(chosen ? [chosen] : []);
const lines = () => shownRows().flatMap(linesOf);
const dots = () => !chosen ? [] : chosen.sample.vertices.map((vertex, place) => ({ vertex, place })).filter(({ vertex }) => vertex.position && !vertex.again)
  .map(({ vertex, place }) => ({
    at: vertex.position, color: place === marked ? "#fff" : COLORS.path, size: place === marked ? 6 : 4, text: String(place + 1),
  }));

// The pictures

const svg = (tag, attributes = {}) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};

/** Where a point is in the image, from 0 to 1, and its depth; only of perspective cameras. */
function inImage(point) {
  const { position, right, up, forward, fov } = around.camera, to = point.map((each, axis) => each - position[axis]);
  const along = (axis) => to[0] * axis[0] + to[1] * axis[1] + to[2] * axis[2];
  const half = Math.tan((fov * Math.PI) / 360), depth = along(forward);
  return [0.5 + along(right) / (depth * half * 2 * (data.width / data.height)), 0.5 - along(up) / (depth * half * 2), depth];
}

let overlay = null;
function drawOverlay() {
  if (!overlay) return;
  overlay.replaceChildren();
  for (const line of around.camera.projects ? lines() : []) {
    const least = 1e-3 * reach;
    let [a, b] = [line.from, line.to];
    const [da, db] = [inImage(a)[2], inImage(b)[2]];
    if (da < least && db < least) continue;
    const between = (share) => a.map((each, axis) => each + (b[axis] - each) * share);
    if (da < least) a = between((least - da) / (db - da));
    else if (db < least) b = between((da - least) / (da - db));
    const [[x1, y1], [x2, y2]] = [inImage(a), inImage(b)];
    overlay.append(svg("line", {
      x1: x1 * data.width, y1: y1 * data.height, x2: x2 * data.width, y2: y2 * data.height, stroke: line.color,
      "stroke-width": line.width, "vector-effect": "non-scaling-stroke", ...(line.dash ? { "stroke-dasharray": "4 4" } : {}),
    }));
  }
  const [x, y] = data.pixel.map((each) => each + 0.5), size = Math.max(data.width, data.height) / 50;
  for (const [color, width] of [["#000", 4], ["#fff", 1.5]]) {
    overlay.append(svg("circle", { cx: x, cy: y, r: size, fill: "none", stroke: color, "stroke-width": width, "vector-effect": "non-scaling-stroke" }));
  }
}

function pictures() {
  if (!around) return null;
  overlay = svg("svg", { viewBox: `0 0 ${data.width} ${data.height}`, "aria-hidden": "true" });
  const mark = svg("svg", { viewBox: `0 0 ${around.near_size[0]} ${around.near_size[1]}`, "aria-hidden": "true" });
  const [left, top] = data.pixel.map((each, axis) => each - around.near_corner[axis]);
  for (const [color, width] of [["#000", 4], ["#fff", 1.5]]) {
    mark.append(svg("rect", { x: left, y: top, width: 1, height: 1, fill: "none", stroke: color, "stroke-width": width, "vector-effect": "non-scaling-stroke" }));
  }
  const where = `pixel ${data.pixel.join(",")}`;
  return make("section", { class: "lp-part" }, make("h2", {}, "Image"), make("div", { class: "lp-pictures" },
    make("figure", { class: "lp-image" },
      make("div", { class: "lp-picture" }, make("img", { src: around.image, alt: `The image, with ${where} marked` }), overlay),
      make("figcaption", {}, around.camera.projects ? `The image at a low resolution, ${where}, and the paths that are drawn.`
        : `The image at a low resolution, and ${where}.`)),
    make("figure", { class: "lp-near" },
      make("div", { class: "lp-picture" }, make("img", { src: around.near, alt: `Pixels around ${where}` }), mark),
      make("figcaption", {}, `Pixels around it, with ${data.spp} samples each.`))));
}

function decoded(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

const cloud = around ? { points: decoded(around.points, Float32Array), colors: decoded(around.colors, Uint8Array), rows: around.rows }
  : { points: new Float32Array(0), colors: new Uint8Array(0), rows: 0 };
function poseWithoutCamera() {
  const { origin, direction } = rows[0].sample;
  const forward = direction, side = Math.abs(forward[1]) < 0.99 ? [0, 1, 0] : [0, 0, 1];
  const crossed = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = Math.hypot(...crossed(forward, side)), right = crossed(forward, side).map((each) => each / size);
  return { position: origin, forward, right, up: crossed(right, forward), fov: 45 };
}
const scene = rows.length ? sketch(cloud, around ? around.camera : poseWithoutCamera(), around ? around.middle : reach, lines, dots) : null;

function stage() {
  if (!scene) return null;
  const key = (color, text, kind = "") => make("li", {}, make("i", { style: `border-color:${color}`, class: kind }), text);
  return make("section", { class: around ? "lp-part" : "lp-part lp-wide" }, make("h2", {}, "Scene"), scene.element,
    make("ul", { class: "lp-key" }, key(COLORS.path, "path"), key(COLORS.light, "shadow ray, light arrives"),
      key(COLORS.blocked, "shadow ray, blocked", "lp-blocked"), key(COLORS.escape, "leaves the scene"), key(COLORS.other, "other paths")),
    make("p", { class: "cv-note" }, "Drag or arrow keys turn, with Shift they shift; wheel, + and − zoom; 0 or a double click returns to the camera."));
}

// The samples

const COLUMNS = [
  { name: "Draw" },
  { name: "Sample", key: (row) => row.sample.index, up: true },
  { name: "Luminance", key: (row) => Math.abs(row.brightness), title: "of what the sample adds to the sum of the pixel" },
  { name: "Of the pixel", key: (row) => row.sample.share },
  { name: "Vertices", key: (row) => row.size },
  { name: "Brought mostly by", key: (row) => brought(row.most), words: true, up: true },
  { name: "Ends by", key: (row) => row.last?.ended ?? "", words: true, up: true },
];
let order = { column: 2, up: false };
const body = make("tbody");
const headings = COLUMNS.map((column, at) => !column.key ? heading(column.name) : heading("", { class: column.words && "lp-words", title: column.title }));
headings.forEach((cell, at) => {
  if (!COLUMNS[at].key) return;
  cell.append(make("button", { type: "button", onclick: () => {
    order = { column: at, up: order.column === at ? !order.up : Boolean(COLUMNS[at].up) };
    fillSamples();
  } }, COLUMNS[at].name));
});

function swatch(color) {
  const most = Math.max(...color.map((each) => Math.abs(each ?? 0)), 1e-30);
  const shown = color.map((each) => Math.round(255 * Math.sqrt(Math.max(each ?? 0, 0) / most)));
  return make("span", { class: "lp-swatch", style: `background:rgb(${shown.join(",")})`, "aria-hidden": "true" });
}

function fillSamples() {
  const { key } = COLUMNS[order.column], sign = order.up ? 1 : -1;
  const sorted = [...rows].sort((a, b) => {
    const [x, y] = [key(a), key(b)];
    return x === y ? a.rank - b.rank : sign * (x < y ? -1 : 1);
  });
  headings.forEach((cell, at) => {
    if (COLUMNS[at].key) cell.setAttribute("aria-sort", at !== order.column ? "none" : order.up ? "ascending" : "descending");
  });
  body.replaceChildren(...sorted.map((row) => {
    const { sample } = row, bar = Math.max(0, Math.min(sample.share, 1)) * 5;
    row.box = make("input", { type: "checkbox", "aria-label": `Draw sample ${sample.index}`, onclick: (event) => event.stopPropagation(), onchange: (event) => {
      if (event.target.checked) drawn.add(row.rank);
      else drawn.delete(row.rank);
      redraw();
    } });
    row.line = make("tr", { "data-sample": sample.index, onclick: () => choose(row) },
      make("td", {}, row.box), make("td", {}, String(sample.index)), make("td", {}, swatch(sample.value), sample.finite ? readable(row.brightness, 4) : "not finite"),
      make("td", {}, percent(sample.share), make("span", { class: "lp-share", style: `width:${bar}rem`, "aria-hidden": "true" })),
      make("td", {}, String(row.size)), make("td", { class: "lp-words" }, brought(row.most)), make("td", { class: "lp-words" }, row.last?.ended ?? ""));
    return row.line;
  }));
  markRows();
}

/** Which row is chosen, and which are drawn; a key reaches the chosen one. */
function markRows() {
  for (const row of rows) {
    row.line.setAttribute("aria-current", row === chosen ? "true" : "false");
    row.line.tabIndex = row === chosen ? 0 : -1;
    row.box.checked = drawn.has(row.rank);
  }
}

body.addEventListener("keydown", (event) => {
  const line = event.target.closest("tr");
  const steps = { ArrowDown: "nextElementSibling", ArrowUp: "previousElementSibling" }[event.key];
  const next = event.target === line && steps ? line[steps] : null;
  if (!next) return;
  event.preventDefault();
  choose(rows.find((row) => row.line === next));
});

function samplesPart() {
  const left = data.spp - rows.length;
  return make("section", { class: "lp-part lp-wide" }, make("h2", {}, "Samples"),
    make("div", { class: "lp-scroll lp-samples", tabindex: 0, role: "region", "aria-label": "Samples of the pixel" },
      make("table", {}, make("caption", {}, `${left ? `${rows.length} of ${data.spp} samples, those that contribute most` : `All ${data.spp} samples`}. A row shows its vertices below.`),
        make("thead", {}, make("tr", {}, ...headings)), body)));
}

// The vertices of one sample

const details = make("section", { class: "lp-part lp-wide", "aria-live": "polite" });
const VERTEX_COLUMNS = ["", "Event", "At", "Position, m", "Throughput before", "after", "pdf, 1/sr", "f cos / pdf", "Roulette", "Contribution"];

function vertexRow(vertex, place) {
  const { roulette, guiding } = vertex;
  const played = roulette?.survival === 1 ? "survives" : roulette ? `${readable(roulette.random)} ${roulette.survived ? "<" : "≥"} ${readable(roulette.survival)}: ${roulette.survived ? "goes on" : "ends"}` : "–";
  const what = vertex.again ? `${vertex.event}, next ray` : vertex.event;
  const kind = vertex.material_type ? `${vertex.object ?? ""} ${vertex.material ? `(${vertex.material}, ${vertex.material_type})` : `(${vertex.material_type})`}`.trim() : vertex.object ?? "–";
  const pdf = vertex.pdf === null ? "–" : vertex.pdf === 0 ? "delta" : number(vertex.pdf);
  const by = guiding && guiding.share > 0 ? `, ${guiding.by_field ? "by field" : "by BSDF"} (${percent(guiding.share)} by field)` : "";
  return make("tr", { onpointerenter: () => mark(place), onpointerleave: () => mark(null) },
    make("td", {}, String(place + 1)), make("td", { class: "lp-words" }, what + by), make("td", { class: "lp-words" }, kind), make("td", {}, triple(vertex.position)),
    make("td", {}, color(vertex.throughput_in)), make("td", {}, vertex.ended ? `– (${vertex.ended})` : color(vertex.throughput)),
    make("td", {}, pdf), make("td", {}, color(vertex.weight)), make("td", {}, played), make("td", {}, swatch(vertex.contribution), color(vertex.contribution)));
}

function additionRow(addition, isMost) {
  const where = `${addition.strategy} ${named(addition)}${addition.light_group ? ` [${addition.light_group}]` : ""}`;
  const result = addition.order ? "arrives" : addition.shadow_ray ? "blocked" : "nothing to arrive";
  const known = addition.light !== null;
  const densities = !known ? "" : `pdf light ${number(addition.light_pdf)}${addition.light_probability ? ` (choice ${number(addition.light_probability)})` : ""}, BSDF ${addition.in_full ? "–" : number(addition.bsdf_pdf)}`;
  const weights = !known ? "" : `MIS light ${number(addition.light_weight)}, BSDF ${number(addition.bsdf_weight)}`;
  return make("tr", { class: isMost ? "lp-addition lp-most" : "lp-addition" }, make("td", {}),
    make("td", { class: "lp-words", colspan: 2 }, where), make("td", {}, addition.position ? triple(addition.position) : addition.direction ? `towards ${triple(addition.direction)}` : ""),
    make("td", { colspan: 2 }, known ? `radiance ${color(addition.emitted)}` : ""), make("td", { class: "lp-words", colspan: 2 }, `${densities}; ${weights}`.replace(/^; $/, "")),
    make("td", {}, result), make("td", {}, addition.order ? color(addition.contribution) : "0"));
}

/** Why a sample is as bright as it is, in a sentence. */
function sentence(row) {
  const { sample, most } = row;
  if (!sample.finite) return "This sample is not finite, or brighter than 2⁴³, and is left out of the pixel.";
  if (!most) return "This sample found no light.";
  const vertex = sample.vertices[most.place], through = Math.max(...vertex.throughput_in.map((each) => each ?? Infinity));
  let top = null, index = 1;
  sample.vertices.slice(0, most.place).forEach((each, at) => {
    if (!each.weight) return;
    // Radiance is divided by the squared index, which no light gets lost by
    const gain = (Math.max(...each.weight.map((one) => one ?? Infinity)) * each.index_squared) / index / (each.roulette ? each.roulette.survival : 1);
    index = each.index_squared;
    if (top === null || gain > top.gain) top = { gain, at };
  });
  const part = row.brightness ? ` That is ${percent(most.brings / Math.abs(row.brightness))} of the sample.` : "";
  const emitted = most.addition.light !== null ? `, where it meets radiance ${number(Math.max(...most.addition.emitted.map((each) => each ?? Infinity)))}` : "";
  const grown = top && top.gain > 1.5 ? ` The throughput grew most at vertex ${top.at + 1}, by a factor of ${number(top.gain)}.` : "";
  const alone = most.addition.in_full && most.place > 0 && most.addition.strategy === "emission"
    ? " No light sample could have found it, as the path came from a delta, so it counts in full." : "";
  return `Most light is added at vertex ${most.place + 1} by ${brought(most)}: the path arrives there with a throughput of ${number(through)}${emitted}.${part}${alone}${grown}`;
}

function fillDetails() {
  if (!chosen) return;
  const { sample, most } = chosen;
  const fact = (name, value) => make("div", {}, make("dt", {}, name), make("dd", {}, value));
  const facts = make("dl", { class: "lp-facts" }, fact("Value", triple(sample.value, 5)), fact("Of the pixel", percent(sample.share)),
    fact("Vertices", String(chosen.size)), sample.wavelengths ? fact("Wavelengths, nm", triple(sample.wavelengths, 5)) : null,
    sample.filter_weight !== 1 ? fact("Filter weight", number(sample.filter_weight)) : null,
    sample.rows_left_out ? fact("Not recorded", `${sample.rows_left_out} rows, radiance ${triple(sample.rest)}`) : null);
  const lines_ = sample.vertices.flatMap((vertex, place) => [vertexRow(vertex, place),
    ...vertex.additions.map((addition) => additionRow(addition, most !== null && addition === most.addition))]);
  details.replaceChildren(make("h2", {}, `Sample ${sample.index}`), make("p", { class: "lp-sentence" }, sentence(chosen)), facts,
    make("div", { class: "lp-scroll lp-vertices", tabindex: 0, role: "region", "aria-label": `Vertices of sample ${sample.index}` },
      make("table", {}, make("thead", {}, make("tr", {}, ...VERTEX_COLUMNS.map((name, at) => heading(name, { class: (at === 1 || at === 2) && "lp-words" })))), make("tbody", {}, ...lines_))));
}

function mark(place) {
  marked = place;
  scene?.redraw();
}
function redraw() {
  scene?.redraw();
  drawOverlay();
}
function choose(row) {
  // Where only the chosen one is drawn, the next takes its place
  if (drawn.size === 1) drawn.delete(chosen.rank);
  chosen = row;
  drawn.add(row.rank);
  marked = null;
  markRows();
  row.line.focus({ preventScroll: false });
  fillDetails();
  redraw();
}

const facts = [data.integrator + (data.guided ? ", guided" : "") + (data.spectral ? ", wavelengths" : ""), `${data.spp} samples`, `seed ${data.seed}`,
  `${data.width} × ${data.height}`, `radiance ${triple(data.radiance, 5)}`];
if (data.nonfinite_samples) facts.push(`${data.nonfinite_samples} samples were not finite and are left out`);
document.getElementById("view").append(
  make("header", { class: "lp-bar" }, make("h1", {}, document.title), make("p", {}, facts.join(" · "))),
  make("div", { class: "lp-parts" }, ...[pictures(), stage(), samplesPart(), details].filter(Boolean)));
fillSamples();
fillDetails();
redraw();
