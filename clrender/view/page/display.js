// Draws linear images on a canvas, tone-mapped or in false colour: with WebGL 2, or pixel by pixel where there is none.

import { RAMP_GLSL, rampColor } from "./false_color.js";
import { TONE_MAPS, TONE_MAP_GLSL, displayValues, luminanceOf, srgbEncode } from "./tone_map.js";

/**
 * How an image is shown.
 * @typedef {Object} Look
 * @property {string} kind "radiance": tone-mapped; "luminance" and "scalar": the luminance, or the first channel, in
 *   false colour; "reflectance": sRGB without exposure; "direction": low..high as 0..1; "label": a colour each
 * @property {string} toneMap one of TONE_MAPS
 * @property {number} exposure stops
 * @property {number} low, high the ends of the scale of colours
 * @property {boolean} logarithmic of that scale
 */

const KINDS = ["radiance", "luminance", "scalar", "reflectance", "direction", "label"];

/** The chequerboard behind transparent pixels: side of its squares, pixels of the image, and their greys. */
const SQUARE = 8;
const LIGHT_SQUARE = 0.6;
const DARK_SQUARE = 0.45;

const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0), 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D image, alpha_image;
uniform bool has_alpha;
uniform ivec2 canvas_size;
uniform int kind, tone_map;
uniform float scale, low, high;
uniform bool logarithmic;
out vec4 color;
${TONE_MAP_GLSL}
${RAMP_GLSL}

vec3 label_color(float number) {
  uint hash = (uint(number) + 1u) * 2654435769u;
  hash = (hash ^ (hash >> 15u)) * 2246822519u;
  hash ^= hash >> 13u;
  return 0.2 + 0.7 * vec3(hash & 255u, (hash >> 8u) & 255u, (hash >> 16u) & 255u) / 255.0;
}

vec3 shown(vec3 value) {
  if (kind == 0) return display_values(value, tone_map, scale);
  if (kind == 3) return srgb_encode(clamp(value, 0.0, 1.0));
  if (kind == 4) return clamp((value - low) / (high - low), 0.0, 1.0);
  if (kind == 5) return value.x < 0.0 ? vec3(0.0) : label_color(value.x);
  float number = kind == 2 ? value.x : dot(value, LUMINANCE);
  if (isnan(number)) return vec3(1.0, 0.0, 1.0);
  return ramp_color(logarithmic ? log(max(number, 1e-30) / low) / log(high / low) : (number - low) / (high - low));
}

vec3 texel(ivec2 place, ivec2 size) {
  return texelFetch(image, clamp(place, ivec2(0), size - 1), 0).rgb;
}

float alpha_at(vec2 pixel) {
  ivec2 size = textureSize(alpha_image, 0);
  ivec2 place = ivec2(pixel * vec2(size) / vec2(canvas_size));
  return clamp(texelFetch(alpha_image, clamp(place, ivec2(0), size - 1), 0).r, 0.0, 1.0);
}

vec3 chequered(vec2 pixel) {
  ivec2 square = ivec2(pixel) / ${SQUARE};
  return vec3((square.x + square.y) % 2 == 0 ? ${LIGHT_SQUARE} : ${DARK_SQUARE});
}

// Colours of the image are multiplied by alpha already, those that are shown are not: as files with alpha have them.
vec3 covered(vec2 pixel, vec3 value) {
  float alpha = alpha_at(pixel);
  return mix(chequered(pixel), alpha > 0.0 ? shown(value / alpha) : vec3(0.0), alpha);
}

void main() {
  ivec2 size = textureSize(image, 0);
  vec2 pixel = vec2(gl_FragCoord.x, float(canvas_size.y) - gl_FragCoord.y);
  if (has_alpha && kind == 0) {
    ivec2 near = ivec2(pixel * vec2(size) / vec2(canvas_size));
    color = vec4(covered(pixel, texel(near, size)), 1.0);
    return;
  }
  if (size == canvas_size) {
    color = vec4(shown(texel(ivec2(pixel), size)), 1.0);
    return;
  }
  // A coarse image is interpolated after tone mapping, so that lamps do not bleed.
  vec2 place = pixel * vec2(size) / vec2(canvas_size) - 0.5;
  ivec2 corner = ivec2(floor(place));
  vec2 part = place - floor(place);
  vec3 above = mix(shown(texel(corner, size)), shown(texel(corner + ivec2(1, 0), size)), part.x);
  vec3 below = mix(shown(texel(corner + ivec2(0, 1), size)), shown(texel(corner + 1, size)), part.x);
  color = vec4(kind == 5 ? shown(texel(ivec2(place + 0.5), size)) : mix(above, below, part.y), 1.0);
}`;

/**
 * A canvas and what draws on it.
 * @param {string} [drawing] "webgl", also where the processor draws for it; "plain", without it; else whichever is fast
 */
export function createDisplay(drawing = "auto") {
  const canvas = document.createElement("canvas");
  const wanted = { alpha: false, antialias: false, failIfMajorPerformanceCaveat: drawing !== "webgl" };
  const context = drawing === "plain" ? null : canvas.getContext("webgl2", wanted);
  if (context === null) return plainDisplay(canvas);
  if (drawing !== "webgl" && isSoftware(context)) return plainDisplay(document.createElement("canvas"));
  try {
    return shaderDisplay(canvas, context);
  } catch (error) {
    console.warn(error.message);
    return plainDisplay(document.createElement("canvas")); // the first one is WebGL's for good
  }
}

/** Whether the processor draws for WebGL, of which a browser that was started for it does not warn. */
function isSoftware(context) {
  const about = context.getExtension("WEBGL_debug_renderer_info");
  const renderer = context.getParameter(about === null ? context.RENDERER : about.UNMASKED_RENDERER_WEBGL);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(renderer));
}

/** The display values 0..1 of one pixel, as the shader has them. */
function shownValues(look, r, g, b) {
  switch (look.kind) {
    case "radiance":
      return displayValues(r, g, b, look.toneMap, look.exposure);
    case "reflectance":
      return [r, g, b].map((x) => srgbEncode(Math.min(Math.max(x, 0), 1)));
    case "direction":
      return [r, g, b].map((x) => Math.min(Math.max((x - look.low) / (look.high - look.low), 0), 1));
    case "label":
      return labelColor(r);
    default:
      return rampColor(placeOnScale(look, look.kind === "scalar" ? r : luminanceOf(r, g, b)));
  }
}

/** Where a value lies on the scale of a look: 0 at its low end, 1 at its high end. */
export function placeOnScale(look, value) {
  if (!look.logarithmic) return (value - look.low) / (look.high - look.low);
  return Math.log(Math.max(value, 1e-30) / look.low) / Math.log(look.high / look.low);
}

function labelColor(number) {
  if (number < 0) return [0, 0, 0];
  let hash = Math.imul(number + 1, 2654435769) >>> 0;
  hash = Math.imul(hash ^ (hash >>> 15), 2246822519) >>> 0;
  hash ^= hash >>> 13;
  return [hash & 255, (hash >>> 8) & 255, (hash >>> 16) & 255].map((byte) => 0.2 + (0.7 * byte) / 255);
}

function shaderDisplay(canvas, gl) {
  const images = new Map(); // name -> {width, height, channels, data}
  let textures = new Map();
  let program = compiled(gl);
  let last = null;

  function upload(name) {
    const { width, height, channels, data } = images.get(name);
    if (!textures.has(name)) textures.set(name, gl.createTexture());
    gl.bindTexture(gl.TEXTURE_2D, textures.get(name));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const half = data instanceof Uint16Array;
    const inside = half ? [gl.R16F, gl.RG16F, gl.RGB16F] : [gl.R32F, gl.RG32F, gl.RGB32F];
    const outside = [gl.RED, gl.RG, gl.RGB][channels - 1];
    gl.texImage2D(gl.TEXTURE_2D, 0, inside[channels - 1], width, height, 0, outside, half ? gl.HALF_FLOAT : gl.FLOAT, data);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
  }

  function drawOne(name, look, alpha) {
    const place = (uniform) => gl.getUniformLocation(program, uniform);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, textures.get(alpha ?? name));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, textures.get(name));
    gl.uniform1i(place("image"), 0);
    gl.uniform1i(place("alpha_image"), 1);
    gl.uniform1i(place("has_alpha"), alpha === null ? 0 : 1);
    gl.uniform2i(place("canvas_size"), canvas.width, canvas.height);
    gl.uniform1i(place("kind"), KINDS.indexOf(look.kind));
    gl.uniform1i(place("tone_map"), TONE_MAPS.indexOf(look.toneMap));
    gl.uniform1f(place("scale"), 2 ** look.exposure);
    gl.uniform1f(place("low"), look.low);
    gl.uniform1f(place("high"), look.high);
    gl.uniform1i(place("logarithmic"), look.logarithmic ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  function draw(name, look, compared = null, alpha = null) {
    last = [name, look, compared, alpha];
    if (gl.isContextLost() || !textures.has(name)) return;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.useProgram(program);
    gl.disable(gl.SCISSOR_TEST);
    drawOne(name, look, alpha);
    if (compared !== null && textures.has(compared.name)) {
      const first = Math.round(canvas.width * compared.from);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(first, 0, canvas.width - first, canvas.height);
      drawOne(compared.name, compared.look, alpha);
    }
  }

  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => {
    program = compiled(gl);
    textures = new Map();
    images.forEach((_, name) => upload(name));
    if (last !== null) draw(...last);
  });

  return {
    canvas,
    method: "WebGL 2",
    setImage(name, image) {
      images.set(name, image);
      if (!gl.isContextLost()) upload(name);
    },
    removeImage(name) {
      images.delete(name);
      gl.deleteTexture(textures.get(name) ?? null);
      textures.delete(name);
    },
    draw,
  };
}

function compiled(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`The page's shader was refused: ${gl.getShaderInfoLog(shader)}`);
    }
  }
  gl.linkProgram(program);
  return program;
}

/** The grey of the chequerboard at a pixel of the canvas. */
function chequered(x, y) {
  return (Math.floor(x / SQUARE) + Math.floor(y / SQUARE)) % 2 === 0 ? LIGHT_SQUARE : DARK_SQUARE;
}

/** Whether a look shows each channel by itself, so that a table of all half floats can tell what becomes of them. */
function byChannel(look) {
  return look.kind === "reflectance" || (look.kind === "radiance" && ["linear", "sqrt", "srgb"].includes(look.toneMap));
}

function plainDisplay(canvas) {
  const context = canvas.getContext("2d", { alpha: false });
  const images = new Map();
  let table = { key: "", bytes: new Uint8ClampedArray(1 << 16) };

  /** Display bytes of all half floats, in such a look. */
  function bytesOf(look) {
    const key = `${look.kind} ${look.toneMap} ${look.exposure}`;
    if (table.key !== key) {
      for (let half = 0; half < 1 << 16; half += 1) {
        const x = halfToNumber(half);
        table.bytes[half] = shownValues(look, x, x, x)[0] * 255; // rounded by the array
      }
      table.key = key;
    }
    return table.bytes;
  }

  /** The same as below for most images, in a twentieth of the time. */
  function fill(pixels, data, bytes) {
    for (let i = 0, j = 0; i < data.length; i += 3, j += 4) {
      pixels[j] = bytes[data[i]];
      pixels[j + 1] = bytes[data[i + 1]];
      pixels[j + 2] = bytes[data[i + 2]];
      pixels[j + 3] = 255;
    }
  }

  const numbersOf = (data) => (data instanceof Uint16Array ? Float32Array.from(data, halfToNumber) : data);

  function picture(name, look, over) {
    const { width, height, channels, data } = images.get(name);
    const layer = over === null || look.kind !== "radiance" ? null : images.get(over);
    const pixels = new ImageData(width, height);
    if (layer === null && channels === 3 && data instanceof Uint16Array && byChannel(look)) {
      fill(pixels.data, data, bytesOf(look));
    } else {
      fillEach(pixels, look, numbersOf(data), channels, layer);
    }
    const drawn = Object.assign(document.createElement("canvas"), { width, height });
    drawn.getContext("2d").putImageData(pixels, 0, 0);
    return drawn;
  }

  function fillEach(pixels, look, values, channels, layer) {
    const { width, height } = pixels;
    const alphas = layer === null ? null : numbersOf(layer.data);
    for (let i = 0, j = 0; i < values.length; i += channels, j += 4) {
      const at = j / 4;
      const [x, y] = [at % width, Math.floor(at / width)];
      const part = alphas === null ? 1 : Math.min(Math.max(alphas[Math.floor((y * layer.height) / height) * layer.width + Math.floor((x * layer.width) / width)], 0), 1);
      const divided = (value) => (part > 0 ? value / part : 0);
      const straight = [values[i], channels > 1 ? values[i + 1] : 0, channels > 2 ? values[i + 2] : 0].map(divided);
      const grey = part < 1 ? chequered((x * canvas.width) / width, (y * canvas.height) / height) : 0;
      const [r, g, b] = shownValues(look, ...straight).map((value) => grey + part * ((part > 0 ? value : 0) - grey));
      pixels.data[j] = r * 255; // rounded by the array
      pixels.data[j + 1] = g * 255;
      pixels.data[j + 2] = b * 255;
      pixels.data[j + 3] = 255;
    }
  }

  function drawOne(name, look, from, alpha) {
    context.save();
    context.beginPath();
    context.rect(from, 0, canvas.width - from, canvas.height);
    context.clip();
    context.drawImage(picture(name, look, alpha), 0, 0, canvas.width, canvas.height);
    context.restore();
  }

  return {
    canvas,
    method: "2D canvas",
    setImage(name, image) {
      images.set(name, image);
    },
    removeImage(name) {
      images.delete(name);
    },
    draw(name, look, compared = null, alpha = null) {
      if (!images.has(name)) return;
      drawOne(name, look, 0, alpha);
      if (compared !== null && images.has(compared.name)) {
        drawOne(compared.name, compared.look, Math.round(canvas.width * compared.from), alpha);
      }
    },
  };
}

/** The number of a half's 16 bits (IEEE 754 binary16). */
export function halfToNumber(bits) {
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  const sign = bits & 32768 ? -1 : 1;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}
