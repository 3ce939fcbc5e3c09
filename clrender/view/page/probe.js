// The pixel probe: what is known of the pixel under the pointer, of one that was clicked, or of one that keys move to.

import { make, readable, setText } from "./elements.js";

const LEAST_WAIT = 100; // milliseconds between two questions
const QUIET = 500; // milliseconds that the probe must rest before it is read aloud

/**
 * The probe: its card, and what gestures tell it. `picking` is told at once of a pixel that is picked, and `picked` gets
 * the answer.
 */
export function createProbe(hub, picture, outline, picking, picked) {
  const rows = new Map(
    ["pixel", "depth", "object", "material", "radiance", "error"].map((name) => [name, make("dd", { class: `cv-${name}` })]),
  );
  const words = { pixel: "Pixel", radiance: "Radiance", error: "Std. error", object: "Object", material: "Material", depth: "Depth" };
  const close = make("button", { type: "button", class: "cv-close", "aria-label": "Close the probe", onclick: release }, "×");
  const list = make("dl", {}, ...[...rows].flatMap(([name, value]) => [make("dt", {}, words[name]), value]));
  const card = make("section", { class: "cv-card cv-probe", hidden: true, "aria-label": "Pixel probe" }, close, list);
  const spoken = make("div", { class: "cv-hidden", role: "status", "aria-live": "polite" });
  let pixel = null; // shown
  let pinned = false; // by a click or by keys
  let asked = false;
  let last = 0;
  let again = false;
  let speech = null;

  const pixelAt = ([x, y]) => picture.size().map((side, i) => Math.min(Math.floor([x, y][i] * side), side - 1));

  function ask(answered) {
    if (pixel === null) return;
    if (asked && answered === undefined) {
      again = true;
      return;
    }
    asked = true;
    const question = pixel;
    setTimeout(
      () =>
        hub.send({ type: "probe", x: question[0], y: question[1] }, (reply) => {
          asked = false;
          last = performance.now();
          if (reply.type !== "probe") return answered === undefined; // the image has become smaller, or the like
          if (pixel !== null && reply.x === pixel[0] && reply.y === pixel[1]) show(reply);
          answered?.(reply);
          if (again) {
            again = false;
            ask();
          }
          return true;
        }),
      answered === undefined ? Math.max(0, last + LEAST_WAIT - performance.now()) : 0,
    );
  }

  function show(reply) {
    const triple = (values) => values.map((value) => readable(value, 4)).join("  ");
    card.hidden = false;
    card.dataset.probe = JSON.stringify(reply);
    setText(rows.get("pixel"), `${reply.x}, ${reply.y}`);
    setText(rows.get("radiance"), reply.radiance === null ? "no sample yet" : triple(reply.radiance));
    setText(rows.get("error"), reply.standard_error === null ? "–" : triple(reply.standard_error));
    setText(rows.get("object"), reply.object === null ? "–" : reply.object.name || `${reply.object.type} ${reply.object.index}`);
    setText(rows.get("material"), reply.material ?? "–");
    setText(rows.get("depth"), reply.depth === null ? "–" : `${readable(reply.depth, 4)} m`);
  }

  function chosen(reply) {
    if (pinned) outline.show(reply.object?.index ?? null);
    picked(reply);
  }

  function aloud() {
    clearTimeout(speech);
    speech = setTimeout(() => {
      const [object, radiance] = [rows.get("object").textContent, rows.get("radiance").textContent];
      setText(spoken, `Pixel ${rows.get("pixel").textContent}: ${object}, radiance ${radiance}`);
    }, QUIET);
  }

  function pick() {
    picking(...pixel);
    ask(chosen);
  }

  function release() {
    pinned = false;
    pixel = null;
    card.hidden = true;
    picture.mark(null);
    outline.show(null);
  }

  function pin(place) {
    pinned = true;
    pixel = place;
    picture.mark(place);
  }

  // Numbers of the pixel change as samples come.
  hub.on("progress", () => ask());
  hub.on("connection", () => {
    asked = again = false;
  });

  return {
    card,
    spoken,
    isPinned: () => pinned,
    release,
    hover(place) {
      if (pinned) return;
      if (place === null) release();
      else {
        pixel = pixelAt(place);
        ask();
      }
    },
    /** A click: the pixel is kept, and what is seen there picked. */
    pick(place) {
      pin(pixelAt(place));
      pick();
    },
    pickPinned: () => pinned && pick(),
    /** Begins in the middle of the image, or moves on by some pixels. */
    step(across, down) {
      const size = picture.size();
      const from = pinned ? pixel : size.map((side) => Math.floor(side / 2));
      pin([across, down].map((by, i) => Math.min(Math.max(from[i] + by, 0), size[i] - 1)));
      ask();
      aloud();
    },
    /** The position of what is seen at a place (null: at the probe) to a function; null: nothing is there. */
    positionAt(place, answered) {
      if (place !== null) pin(pixelAt(place));
      ask((reply) => answered(reply.position));
    },
    /** The focus distance of what is seen at a place (null: at the probe) to a function; null: nothing is there. */
    focusAt(place, answered) {
      if (place !== null) pin(pixelAt(place));
      ask((reply) => answered(reply.focus_distance));
    },
  };
}
