// Light paths of a pixel: the sketch of the scene, the samples, and the vertices of the chosen one, which belong together.

import { make } from "./elements.js";
import { createOverlay } from "./path_overlay.js";
import { COLORS, linesOf, linesOfSplat, reachOf, rowsOf, splatRows } from "./path_rows.js";
import { createSamples } from "./path_samples.js";
import { createSplats } from "./path_splats.js";
import { sketch } from "./sketch.js";
import { vertexParts } from "./path_vertices.js";

function decoded(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

/** A pose for the sketch where no camera is known: along the ray of a sample. */
function poseOf({ origin, direction }) {
  const forward = direction, side = Math.abs(forward[1]) < 0.99 ? [0, 1, 0] : [0, 0, 1];
  const crossed = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = Math.hypot(...crossed(forward, side)), right = crossed(forward, side).map((each) => each / size);
  return { position: origin, forward, right, up: crossed(right, forward), fov: 45 };
}

/**
 * The parts of a page: `overlay`, `stage`, `samples`, `details` and `splats`, elements or null.
 *
 * `data`: a document of light paths; `around`: camera, points and colours of the scene, or null; `part`: as of
 * `createOverlay`.
 */
export function createPathView(data, around, part) {
  const rows = rowsOf(data), reach = around ? around.reach : reachOf(rows);
  const state = { rows, spp: data.spp, splats: data.splats !== null, chosen: rows[0] ?? null, drawn: new Set(rows.length ? [0] : []) };
  let marked = null, splat = null; // what is pointed at, and which path from a light is drawn

  const shownRows = () => rows.filter((row) => state.drawn.has(row.rank) && row !== state.chosen).concat(state.chosen ? [state.chosen] : []);
  const lines = () => [...shownRows().flatMap((row) => linesOf(row, row === state.chosen && !splat, reach)), ...(splat ? linesOfSplat(splat, rows[0].sample.origin, reach) : [])];
  const dots = () => !state.chosen || splat ? [] : state.chosen.sample.vertices.map((vertex, place) => ({ vertex, place })).filter(({ vertex }) => vertex.position && !vertex.again)
    .map(({ vertex, place }) => ({
      at: vertex.position, color: place === marked ? "#fff" : COLORS.path, size: place === marked ? 6 : 4, text: String(place + 1),
    }));

  const overlay = around ? createOverlay(data, around, part) : null;
  const cloud = around ? { points: decoded(around.points, Float32Array), colors: decoded(around.colors, Uint8Array), rows: around.rows }
    : { points: new Float32Array(0), colors: new Uint8Array(0), rows: 0 };
  const scene = rows.length ? sketch(cloud, around ? around.camera : poseOf(rows[0].sample), around ? around.middle : reach, lines, dots) : null;
  const details = make("section", { class: "lp-part lp-wide", "aria-live": "polite" });
  const samples = createSamples(state, choose, redraw);
  const splatted = splatRows(data);
  const splats = splatted.length && rows.length ? createSplats(data.splats, splatted, (row) => {
    splat = row;
    redraw();
  }) : null;

  function key(color, text, kind = "") {
    const line = make("i", { class: kind });
    line.style.borderColor = color;
    return make("li", {}, line, text);
  }

  function mark(place) {
    marked = place;
    scene?.redraw();
  }
  function redraw() {
    scene?.redraw();
    overlay?.draw(lines());
  }
  function fillDetails() {
    details.replaceChildren(...(state.chosen ? vertexParts(state.chosen, mark) : []));
  }
  function choose(row) {
    // Where only the chosen one is drawn, the next takes its place
    if (state.drawn.size === 1) state.drawn.delete(state.chosen.rank);
    state.chosen = row;
    state.drawn.add(row.rank);
    marked = null;
    splats?.clear();
    samples.update();
    row.line.focus({ preventScroll: false });
    fillDetails();
    redraw();
  }

  fillDetails();
  redraw();
  return {
    overlay: overlay?.element ?? null,
    stage: scene && make("section", { class: around ? "lp-part" : "lp-part lp-wide" }, make("h2", {}, "Scene"), scene.element,
      make("ul", { class: "lp-key" }, key(COLORS.path, "path"), key(COLORS.light, "shadow ray, light arrives"),
        key(COLORS.blocked, "shadow ray, blocked", "lp-blocked"), key(COLORS.escape, "leaves the scene"),
        data.splats && key(COLORS.lightPath, "path from a light"), key(COLORS.other, "other paths")),
      make("p", { class: "cv-note" }, "Drag or arrow keys turn, with Shift they shift; wheel, + and − zoom; 0 or a double click returns to the camera.")),
    samples: make("section", { class: "lp-part lp-wide" }, make("h2", {}, "Samples"), samples.element),
    details,
    splats: splats?.element ?? null,
  };
}
