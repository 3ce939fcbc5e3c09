// How each layer is shown: tone-mapped, in false colour with a legend, or as it is.

import { legendTicks, rampGradient } from "./false_color.js";
import { make, readable } from "./elements.js";
import { placeOnScale } from "./display.js";

const UNITS = { depth: "m", samples: "samples", radiance: "W/(sr m²)", stderr: "W/(sr m²)" };
const DARKEST = 2 ** -8; // of false colour, relative to what the exposure makes white
const BRIGHTEST = 2 ** 3;

/**
 * The look of a layer.
 * @param {Object} layer of the engine's hello
 * @param {Object} choice `toneMap`, `exposure` (stops, all told), `falseColor`
 * @param {Object | undefined} frame newest of that layer
 */
export function lookOf(layer, choice, frame) {
  const look = { kind: "radiance", toneMap: choice.toneMap, exposure: choice.exposure, low: 0, high: 1, logarithmic: false };
  const range = frame?.range ?? [0, 1];
  switch (layer.kind) {
    case "radiance": {
      if (!choice.falseColor) return look;
      const white = 2 ** -choice.exposure;
      return { ...look, kind: "luminance", low: DARKEST * white, high: BRIGHTEST * white, logarithmic: true };
    }
    case "color":
      return { ...look, kind: "reflectance" };
    case "vector": {
      const within = range[0] >= -1.001 && range[1] <= 1.001;
      return { ...look, kind: "direction", low: within ? -1 : range[0], high: within ? 1 : Math.max(range[1], range[0] + 1e-6) };
    }
    case "number":
      return { ...look, kind: "label" };
    default:
      return { ...look, kind: frame?.channels === 3 ? "luminance" : "scalar", ...scaleOf(range) };
  }
}

/** A scale for a range of values: round ends, which do not move with each frame; logarithmic where it is wide. */
export function scaleOf([lowest, highest]) {
  const high = highest > 0 ? roundUp(highest) : 1;
  if (lowest < 0) return { low: -roundUp(-lowest), high, logarithmic: false };
  if (lowest > high / 8) return { low: 0, high, logarithmic: false };
  return { low: Math.max(lowest > 0 ? 1 / roundUp(1 / lowest) : 0, high * 1e-4), high, logarithmic: true };
}

/** The next of 1, 2, 5, 10, 20, … */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((step) => step * power >= value * 0.9999);
}

/** The legend of a look, or null where it needs none. */
export function legendOf(layer, look) {
  if (look.kind !== "luminance" && look.kind !== "scalar") return null;
  const ticks = look.logarithmic ? legendTicks(look.low, look.high) : [0, 0.25, 0.5, 0.75, 1].map((part) => look.low + part * (look.high - look.low));
  const unit = UNITS[layer.name] ?? (layer.kind === "radiance" ? UNITS.radiance : "");
  const bar = make("div", { class: "cv-ramp" });
  bar.style.background = rampGradient();
  const marks = ticks.map((value) => {
    const mark = make("span", {}, readable(value, 2));
    mark.style.left = `${100 * placeOnScale(look, value)}%`;
    return mark;
  });
  const name = layer.kind === "radiance" ? `Luminance of ${layer.label.toLowerCase()}` : layer.label;
  return make(
    "figure",
    { class: "cv-legend", role: "img", "aria-label": `${name}: from ${readable(look.low)} to ${readable(look.high)} ${unit}` },
    make("figcaption", {}, unit ? `${name}, ${unit}` : name),
    bar,
    make("div", { class: "cv-ticks" }, ...marks),
  );
}
