// False colour: a quantity on a logarithmic scale as colours of rising lightness, and the legend that says which.

/** Colours at equal distances along the scale, sRGB 0..1: from dark blue over green to nearly white. */
const STEPS = [
  [0.05, 0.03, 0.16],
  [0.2, 0.1, 0.46],
  [0.13, 0.31, 0.66],
  [0.05, 0.52, 0.6],
  [0.14, 0.68, 0.42],
  [0.58, 0.78, 0.2],
  [0.95, 0.75, 0.2],
  [0.99, 0.6, 0.38],
  [1.0, 0.93, 0.86],
];

/** The colour at a place 0..1 of the scale; places beyond are its ends, and not-a-number is magenta. */
export function rampColor(place) {
  if (Number.isNaN(place)) return [1, 0, 1];
  const position = Math.min(Math.max(place, 0), 1) * (STEPS.length - 1);
  const first = Math.min(Math.floor(position), STEPS.length - 2);
  const part = position - first;
  return STEPS[first].map((value, channel) => value + part * (STEPS[first + 1][channel] - value));
}

/** GLSL: `vec3 ramp_color(float place)`. */
export const RAMP_GLSL = `
const vec3 RAMP[${STEPS.length}] = vec3[](${STEPS.map((step) => `vec3(${step.join(", ")})`).join(", ")});

vec3 ramp_color(float place) {
  float position = clamp(place, 0.0, 1.0) * ${STEPS.length - 1}.0;
  int first = min(int(position), ${STEPS.length - 2});
  return mix(RAMP[first], RAMP[first + 1], position - float(first));
}
`;

/** The ramp as a CSS gradient, from left to right. */
export function rampGradient() {
  const stops = STEPS.map((step) => `rgb(${step.map((value) => Math.round(value * 255)).join(" ")})`);
  return `linear-gradient(to right, ${stops.join(", ")})`;
}

/** Values for the legend of a logarithmic scale: powers of ten, and 2 and 5 times them where there is room. */
export function legendTicks(low, high) {
  const decades = Math.log10(high / low);
  const steps = decades > 6 ? [1] : decades > 3 ? [1, 3] : [1, 2, 5];
  const ticks = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power += 1) {
    for (const step of steps) {
      const value = Number(`${step}e${power}`);
      if (value >= low * 0.999 && value <= high * 1.001) ticks.push(value);
    }
  }
  return ticks;
}
