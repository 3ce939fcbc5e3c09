// Tone mapping in the browser, with the operators of clrender/image/tone_map.py: as GLSL, and in JavaScript where
// there is no WebGL. A test compares both with Python's.

export const TONE_MAPS = ["linear", "sqrt", "srgb", "reinhard", "aces", "agx"];

/** Weights of linear Rec. 709 R, G, B in luminance. */
export const LUMINANCE = [0.2126, 0.7152, 0.0722];

const LARGEST = 1e30; // stands for infinity, where no operator overflows
const LARGEST_SHADER = 1e18; // whose square a shader's float holds

const ACES_IN = [
  [0.59719, 0.35458, 0.04823],
  [0.076, 0.90834, 0.01566],
  [0.0284, 0.13383, 0.83777],
];
const ACES_OUT = [
  [1.60475, -0.53108, -0.07367],
  [-0.10208, 1.10813, -0.00605],
  [-0.00327, -0.07276, 1.07602],
];
const AGX_IN = [
  [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
  [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
  [0.0423756549057051, 0.0784336, 0.879142973793104],
];
const AGX_OUT = [
  [1.19687900512017, -0.0980208811401368, -0.0990297440797205],
  [-0.0528968517574562, 1.15190312990417, -0.0989611768448433],
  [-0.0529716355144438, -0.0980434501171241, 1.15107367264116],
];
const AGX_STOPS = [-12.47393, 4.026069];
const AGX_SIGMOID = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];

const clamp01 = (x) => Math.min(Math.max(x, 0), 1);
const times = (rows, v) => rows.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

/** The sRGB transfer function (IEC 61966-2-1) of a value 0..1. */
export function srgbEncode(x) {
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

export function luminanceOf(r, g, b) {
  return LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b;
}

const OPERATORS = {
  linear: (v) => v,
  sqrt: (v) => v.map(Math.sqrt),
  srgb: (v) => v.map((x) => srgbEncode(Math.min(x, 1))),
  reinhard: (v) => {
    const scale = 1 / (1 + luminanceOf(...v));
    return v.map((x) => srgbEncode(clamp01(x * scale)));
  },
  aces: (v) => {
    const curve = (x) => (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.432951) + 0.238081);
    return times(ACES_OUT, times(ACES_IN, v).map(curve)).map((x) => srgbEncode(clamp01(x)));
  },
  agx: (v) => {
    const [low, high] = AGX_STOPS;
    const encoded = times(AGX_IN, v).map((x) => clamp01((Math.log2(Math.max(x, 2 ** low)) - low) / (high - low)));
    return times(AGX_OUT, encoded.map((x) => AGX_SIGMOID.reduce((sum, factor) => sum * x + factor, 0)));
  },
};

/** Display values 0..1 of one pixel's linear radiance; exposure in stops. */
export function displayValues(r, g, b, toneMap, exposure) {
  const scale = 2 ** exposure;
  const cut = (x) => (x > 0 ? Math.min(x * scale, LARGEST) : 0); // also of not-a-number
  return OPERATORS[toneMap]([cut(r), cut(g), cut(b)]).map(clamp01);
}

const float = (x) => (Number.isInteger(x) ? `${x}.0` : String(x));
// GLSL's matrices are given column by column.
const matrix = (rows) => `mat3(${[0, 1, 2].flatMap((c) => rows.map((row) => float(row[c]))).join(", ")})`;

/** GLSL: `vec3 display_values(vec3 radiance, int tone_map, float scale)`; tone_map counts in TONE_MAPS. */
export const TONE_MAP_GLSL = `
const vec3 LUMINANCE = vec3(${LUMINANCE.join(", ")});

vec3 srgb_encode(vec3 x) {
  return mix(1.055 * pow(max(x, 0.0031308), vec3(1.0 / 2.4)) - 0.055, 12.92 * x, vec3(lessThanEqual(x, vec3(0.0031308))));
}

vec3 aces(vec3 x) {
  // Far above white the fit has reached its limit, and its squares must not overflow.
  vec3 v = ${matrix(ACES_IN)} * min(x, 1e6);
  v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081);
  return srgb_encode(clamp(${matrix(ACES_OUT)} * v, 0.0, 1.0));
}

vec3 agx(vec3 x) {
  const float low = ${float(AGX_STOPS[0])}, high = ${float(AGX_STOPS[1])};
  vec3 v = log2(max(${matrix(AGX_IN)} * x, exp2(low)));
  v = clamp((v - low) / (high - low), 0.0, 1.0);
  vec3 sum = vec3(0.0);
  ${AGX_SIGMOID.map((factor) => `sum = sum * v + ${float(factor)};`).join(" ")}
  return ${matrix(AGX_OUT)} * sum;
}

vec3 display_values(vec3 radiance, int tone_map, float scale) {
  // The comparison also takes out what is not a number.
  vec3 x = mix(vec3(0.0), min(radiance * scale, ${LARGEST_SHADER.toExponential(1)}), greaterThan(radiance, vec3(0.0)));
  if (tone_map == 1) x = sqrt(x);
  else if (tone_map == 2) x = srgb_encode(min(x, 1.0));
  else if (tone_map == 3) x = srgb_encode(clamp(x / (1.0 + dot(x, LUMINANCE)), 0.0, 1.0));
  else if (tone_map == 4) x = aces(x);
  else if (tone_map == 5) x = agx(x);
  return clamp(x, 0.0, 1.0);
}
`;
