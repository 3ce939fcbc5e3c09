// Samples of a pixel as rows of a table, and what their paths consist of, in words and as lines in space.

import { make, readable } from "./elements.js";

export const COLORS = { path: "#5db2ff", light: "#ffd45c", blocked: "#ff7a6b", other: "#7f93a8", escape: "#9fe08a", lightPath: "#d29bff" };
const luminance = (color) => (color.includes(null) ? Infinity : 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]);
export const number = (value, digits = 4) => (value === null ? "not finite" : readable(value, digits));
export const triple = (values, digits = 3) => (values === null ? "–" : values.map((each) => number(each, digits)).join("  "));
/** A colour for reading: one number if it is grey. */
export const color = (values, digits = 3) => (values !== null && values.every((each) => each === values[0]) ? number(values[0], digits) : triple(values, digits));
export const percent = (share) => `${readable(100 * share, 3)} %`;

/** A square of a colour, as bright as can be. */
export function swatch(values) {
  const most = Math.max(...values.map((each) => Math.abs(each ?? 0)), 1e-30);
  const shown = values.map((each) => Math.round(255 * Math.sqrt(Math.max(each ?? 0, 0) / most)));
  const element = make("span", { class: "lp-swatch", "aria-hidden": "true" });
  element.style.background = `rgb(${shown.join(",")})`; // a page of the view takes no attribute `style`
  return element;
}

/** The addition of a sample that brings most, and its vertex. */
function mostOf(sample) {
  let most = null;
  sample.vertices.forEach((vertex, place) => vertex.additions.forEach((addition) => {
    const brings = Math.abs(luminance(addition.contribution));
    if (addition.order && (most === null || brings > most.brings)) most = { addition, place, brings };
  }));
  return most;
}

/** The rows of a document's samples, by rank. */
export function rowsOf(data) {
  return data.samples.map((sample, rank) => {
    const most = mostOf(sample);
    const last = sample.vertices[sample.vertices.length - 1];
    return { sample, rank, most, last, brightness: luminance(sample.value), splatted: sample.splat ? luminance(sample.splat) : 0, size: sample.vertices.length };
  });
}

/** The rows of a document's splats, by rank. */
export const splatRows = (data) => (data.splats?.paths ?? []).map((splat, rank) => ({ splat, rank, brightness: luminance(splat.value) }));

export const named = (addition) => addition.object ?? addition.light_kind ?? "";
export const brought = (most) => (most ? `${most.addition.strategy} ${named(most.addition)}`.trim() : "nothing");

/** How much of a pixel paths from lights splatted, in words; empty where the integrator has none. */
export const splatWords = (data) => (data.splats ? `${triple(data.splats.splatted, 4)} of it splatted by paths from lights` : "");

/** Length of rays that leave the scene, metres, where no surroundings say it. */
export const reachOf = (rows) => Math.max(...rows.flatMap((row) => row.sample.vertices.map((vertex) => vertex.distance ?? 0)), 1);

/** Lines of a path from a light; from far away its first one begins beyond the scene. */
function lightLines(path, further) {
  const back = path.direction.map((each) => -each), ends = path.vertices.map((vertex) => vertex.position);
  const starts = [path.position ?? further(ends[0], back), ...ends];
  return ends.map((to, at) => ({ from: starts[at], to, color: COLORS.lightPath, width: 1.8 }));
}

/** Lines of a sample's path: `main` with the shadow rays of its vertices. */
export function linesOf(row, main, reach) {
  const found = [];
  const further = (from, direction) => from.map((each, axis) => each + direction[axis] * reach * 0.6);
  let from = row.sample.origin;
  for (const vertex of row.sample.vertices) {
    const escapes = vertex.position === null, to = escapes ? further(from, vertex.direction_in) : vertex.position;
    // One that came back has been drawn
    if (!vertex.again) found.push({ from, to, color: escapes ? COLORS.escape : main ? COLORS.path : COLORS.other, width: main ? 2.5 : 1.2 });
    if (escapes) break;
    from = vertex.position;
    for (const addition of main ? vertex.additions : []) {
      const sampled = addition.strategy === "light sample" || addition.strategy === "light centre" || addition.strategy === "connection";
      if (!sampled || !addition.shadow_ray) continue;
      if (addition.light_path) found.push(...lightLines(addition.light_path, further));
      const end = addition.position ?? further(from, addition.direction);
      found.push({ from, to: end, color: addition.arrives ? COLORS.light : COLORS.blocked, width: 1.2, dash: addition.arrives ? null : [4, 4] });
    }
  }
  return found;
}

/** Lines of a splat: its light path, and from there to the camera. */
export function linesOfSplat({ splat }, camera, reach) {
  if (!splat.light_path) return [];
  const further = (from, direction) => from.map((each, axis) => each + direction[axis] * reach * 0.6);
  const lines = lightLines(splat.light_path, further);
  return [...lines, { from: lines[lines.length - 1].to, to: camera, color: COLORS.light, width: 1.8 }];
}

/** Why a sample is as bright as it is, in a sentence. */
export function sentence(row) {
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
  const emitted = most.addition.light !== null && most.addition.strategy !== "connection" ? `, where it meets radiance ${number(Math.max(...most.addition.emitted.map((each) => each ?? Infinity)))}` : "";
  const grown = top && top.gain > 1.5 ? ` The throughput grew most at vertex ${top.at + 1}, by a factor of ${number(top.gain)}.` : "";
  const alone = most.addition.in_full && most.place > 0 && most.addition.strategy === "emission"
    ? " No light sample could have found it, as the path came from a delta, so it counts in full." : "";
  return `Most light is added at vertex ${most.place + 1} by ${brought(most)}: the path arrives there with a throughput of ${number(through)}${emitted}.${part}${alone}${grown}`;
}
