// The vertices of one sample: events, throughput, densities, weights and contributions.

import { make, readable } from "./elements.js";
import { COLORS, color, named, number, percent, sentence, swatch, triple } from "./path_rows.js";

const NAMES = ["Vertex", "Event", "At", "Position, m", "Throughput before", "Throughput after", "pdf, 1/sr", "f cos / pdf", "Roulette", "Contribution"];
const WORDS = ["Event", "At"];

/** A cell. Where there is little room rows become cards, whose lines begin with the name. */
const cell = (name, attributes, ...children) =>
  make("td", { role: "cell", "data-name": name, class: WORDS.includes(name) && "lp-words", ...attributes }, ...children);

/** Which object a vertex is on, with its material. */
const placeOf = (vertex) =>
  vertex.material_type ? `${vertex.object ?? ""} ${vertex.material ? `(${vertex.material}, ${vertex.material_type})` : `(${vertex.material_type})`}`.trim() : vertex.object ?? "–";

function vertexRow(vertex, place, mark) {
  const { roulette, guiding } = vertex;
  const played = roulette?.survival === 1 ? "survives" : roulette ? `${readable(roulette.random)} ${roulette.survived ? "<" : "≥"} ${readable(roulette.survival)}: ${roulette.survived ? "goes on" : "ends"}` : "–";
  const what = vertex.again ? `${vertex.event}, next ray` : vertex.event;
  const pdf = vertex.pdf === null ? "–" : vertex.pdf === 0 ? "delta" : number(vertex.pdf);
  const by = guiding && guiding.share > 0 ? `, ${guiding.by_field ? "by field" : "by BSDF"} (${percent(guiding.share)} by field)` : "";
  const contents = [String(place + 1), what + by, placeOf(vertex), triple(vertex.position), color(vertex.throughput_in),
    vertex.ended ? `– (${vertex.ended})` : color(vertex.throughput), pdf, color(vertex.weight), played];
  return make("tr", { role: "row", class: "lp-vertex", onpointerenter: () => mark(place), onpointerleave: () => mark(null) },
    ...contents.map((content, at) => cell(NAMES[at], {}, content)), cell("Contribution", {}, swatch(vertex.contribution), color(vertex.contribution)));
}

function additionRow(addition, isMost) {
  const where = `${addition.strategy} ${named(addition)}${addition.light_group ? ` [${addition.light_group}]` : ""}`;
  const result = addition.order ? "arrives" : addition.shadow_ray ? "blocked" : "nothing to arrive";
  const connects = addition.strategy === "connection", known = addition.light !== null || connects;
  const vertices = addition.light_weight === null && addition.camera_vertices !== null ? ` (${addition.light_vertices} light + ${addition.camera_vertices} camera vertices)` : "";
  const densities = !known ? "" : connects ? `pdf back ${number(addition.light_pdf)}, BSDF ${number(addition.bsdf_pdf)}` : `pdf light ${number(addition.light_pdf)}${addition.light_probability ? ` (choice ${number(addition.light_probability)})` : ""}, BSDF ${addition.in_full ? "–" : number(addition.bsdf_pdf)}`;
  const weights = !known ? "" : addition.light_weight === null ? `MIS ${number(addition.weight)}` : `MIS light ${number(addition.light_weight)}, BSDF ${number(addition.bsdf_weight)}`;
  return make("tr", { role: "row", class: isMost ? "lp-addition lp-most" : "lp-addition" }, cell("", {}),
    cell("Light", { class: "lp-words", colspan: 2 }, where + vertices), cell("At", { class: null }, addition.position ? triple(addition.position) : addition.direction ? `towards ${triple(addition.direction)}` : ""),
    cell("Emitted", { colspan: 2 }, known ? `${connects ? "flux" : "radiance"} ${color(addition.emitted)}` : ""), cell("Weights", { class: "lp-words", colspan: 2 }, `${densities}; ${weights}`.replace(/^; $/, "")),
    cell("Shadow ray", {}, result), cell("Contribution", {}, addition.order ? color(addition.contribution) : "0"));
}

/** The vertices of a connection's path from a light, in its order. */
function lightRows(addition) {
  if (!addition.light_path) return [];
  const { position, direction, flux, number: path, stands_for, vertices } = addition.light_path;
  const line = (what, kind, at, before, after, pdf) => make("tr", { role: "row", class: "lp-addition lp-light" }, cell("", {}), cell("Event", {}, ...what), cell("At", {}, kind),
    cell("Position, m", {}, at), cell("Flux before", {}, before), cell("Flux after", {}, after), cell("pdf, 1/sr", { colspan: 4, class: "lp-words" }, pdf));
  const square = make("span", { class: "lp-swatch", "aria-hidden": "true" });
  square.style.background = COLORS.lightPath;
  return [line([square, `light path ${path}`], named(addition), position ? triple(position) : `towards ${triple(direction)}`, "", `flux ${color(flux)}`, stands_for > 1 ? `counts for ${number(stands_for)} vertices of its path` : ""),
    ...vertices.map((vertex) => line([vertex.event], placeOf(vertex), triple(vertex.position), `flux ${color(vertex.throughput_in)}`,
      vertex.event === "connection" ? "" : color(vertex.throughput), vertex.pdf === null ? "" : vertex.pdf === 0 ? "delta" : `pdf ${number(vertex.pdf)}`))];
}

/** The contents of the part about a splat's row: its light path, from the light on. */
export function splatParts({ splat }) {
  const { light_path: path } = splat;
  if (!path) return [make("p", { class: "lp-sentence" }, `Light path ${splat.path} has more vertices than are recorded.`)];
  const columns = ["", "Event", "At", "Position, m", "Flux before", "Flux after", "pdf, 1/sr"];
  const headings = columns.map((name) => make("th", { scope: "col", role: "columnheader", class: WORDS.includes(name) && "lp-words", colspan: name.startsWith("pdf") && 4 }, name));
  const label = `Light path ${splat.path} of sample ${splat.sample}`;
  return [make("h2", {}, label), make("p", { class: "lp-sentence" }, `The camera sees its last vertex in this pixel, and what arrives there counts with a weight of ${number(splat.weight)} among all ways to make this path.`),
    make("div", { class: "lp-scroll lp-vertices", tabindex: 0, role: "region", "aria-label": `Vertices of light path ${splat.path}` },
      make("table", { role: "table" }, make("thead", { role: "rowgroup" }, make("tr", { role: "row" }, ...headings)), make("tbody", { role: "rowgroup" }, ...lightRows({ ...path, light_path: path }))))];
}

/** The contents of the part about a row's sample; `mark(place)` is told which vertex is pointed at, or null. */
export function vertexParts(row, mark) {
  const { sample, most } = row;
  const fact = (name, value) => make("div", {}, make("dt", {}, name), make("dd", {}, value));
  const facts = make("dl", { class: "lp-facts" }, fact("Value", triple(sample.value, 5)), fact("Of the pixel", percent(sample.share)),
    sample.splat ? fact("Splatted beside it", triple(sample.splat, 5)) : null,
    fact("Vertices", String(row.size)), sample.wavelengths ? fact("Wavelengths, nm", triple(sample.wavelengths, 5)) : null,
    sample.filter_weight !== 1 ? fact("Filter weight", number(sample.filter_weight)) : null,
    sample.rows_left_out ? fact("Not recorded", `${sample.rows_left_out} rows, radiance ${triple(sample.rest)}`) : null);
  const lines = sample.vertices.flatMap((vertex, place) => [vertexRow(vertex, place, mark),
    ...vertex.additions.flatMap((addition) => [additionRow(addition, most !== null && addition === most.addition), ...lightRows(addition)])]);
  const headings = NAMES.map((name, at) => make("th", { scope: "col", role: "columnheader", class: WORDS.includes(name) && "lp-words" }, at === 0 ? "" : name));
  return [make("h2", {}, `Sample ${sample.index}`), make("p", { class: "lp-sentence" }, sentence(row)), facts,
    make("div", { class: "lp-scroll lp-vertices", tabindex: 0, role: "region", "aria-label": `Vertices of sample ${sample.index}` },
      make("table", { role: "table" }, make("thead", { role: "rowgroup" }, make("tr", { role: "row" }, ...headings)), make("tbody", { role: "rowgroup" }, ...lines)))];
}
