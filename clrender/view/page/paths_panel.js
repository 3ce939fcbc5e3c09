// The tab of light paths: asks for those of the picked pixel, shows them, and draws them over the image.

import { make, readable, setText } from "./elements.js";
import { createField } from "./fields.js";
import { splatWords, triple } from "./path_rows.js";
import { createPathView } from "./path_view.js";

const QUIET = 600; // milliseconds without another image, before the paths of the new one are asked for
const MOST_SAMPLES = 4096;
const HINT = "Click on a pixel of the image, or press P, move with the arrow keys, and press Enter.";
const LOST = "The connection is lost: the paths of this pixel are traced when it is back.";
const CHANGED = "The image has changed: its paths are traced when it rests.";

/** A panel's content, `trace(x, y)`, `clear()`, and `open(isOpen)`. */
export function createPathsPanel(hub, picture) {
  const samples = createField(
    { label: "Traced samples", help: "The first samples of the pixel, which are traced; those that contribute most are listed", schema: { type: "integer", minimum: 1, maximum: MOST_SAMPLES } },
    (value) => {
      count = Math.min(Math.max(Math.round(value ?? 256), 1), MOST_SAMPLES);
      samples.show(count, false);
      if (pixel !== null) ask();
    },
  );
  const status = make("p", { class: "lp-status", role: "status", "aria-live": "polite" }, HINT);
  const stop = make("button", { type: "button", hidden: true, onclick: cancel }, "Cancel");
  const shown = make("div", { class: "lp-parts" });
  let count = 256;
  let pixel = null;
  let asked = null; // the question that waits for its answer
  let isOpen = false;
  let timer = null;
  let overlay = null;
  let revision = null; // that the paths are of
  let isLost = false; // the connection
  samples.show(count, false);

  function say(text, isBad = false) {
    setText(status, text);
    status.classList.toggle("lp-bad", isBad);
  }

  function waits(question) {
    asked = question;
    stop.hidden = question === null;
    shown.setAttribute("aria-busy", String(question !== null));
  }

  function ask() {
    clearTimeout(timer);
    const [x, y] = pixel;
    hideOverlay();
    say(`Tracing the paths of pixel ${x}, ${y}.`);
    const question = hub.send({ type: "paths", x, y, samples: count }, (reply) => {
      if (question !== asked) return true; // another one is on its way
      waits(null);
      if (reply.type === "paths") show(reply);
      else refuse(reply.message);
      return true;
    });
    waits(question);
  }

  function refuse(message) {
    shown.replaceChildren();
    say(`${message[0].toUpperCase()}${message.slice(1)}.`, true);
  }

  function show({ paths, around, crop, revision: traced, x, y }) {
    revision = traced;
    const view = createPathView(paths, around, crop);
    shown.replaceChildren(...[view.stage, view.samples, view.details, view.splats].filter(Boolean));
    overlay = view.overlay;
    overlay.classList.add("cv-paths");
    if (isOpen && hub.newest("state")?.revision === revision) picture.overlay(overlay);
    const [first] = paths.samples;
    const of = hub.newest("state")?.settings.spp ?? paths.spp;
    const which = paths.spp < of ? `The first ${paths.spp} of ${of} samples` : `All ${paths.spp} samples`;
    const most = first?.finite ? ` Sample ${first.index} contributes most: ${readable(100 * first.share, 3)} % of the pixel.` : "";
    const lost = paths.nonfinite_samples ? ` ${paths.nonfinite_samples} samples were not finite and are left out.` : "";
    const flat = around.camera.projects ? "" : " Paths are not drawn over the image of this kind of camera.";
    const splatted = paths.splats ? `, ${splatWords(paths)}` : "";
    say(`${which} of pixel ${x}, ${y}, mean radiance ${triple(paths.radiance, 4)}${splatted}.${most}${lost}${flat}`);
    if (hub.newest("state")?.revision !== revision) changed();
  }

  function hideOverlay() {
    overlay?.remove();
  }

  function cancel() {
    clearTimeout(timer);
    if (asked !== null) hub.send({ type: "stop_paths" });
    waits(null);
    say(HINT);
  }

  function clear() {
    if (pixel === null) return;
    pixel = null;
    cancel();
    hideOverlay();
    shown.replaceChildren();
  }

  /** There is another image: what is drawn would lie beside what it shows. */
  function changed() {
    if (pixel === null || !isOpen) return;
    hideOverlay();
    if (asked === null) say(CHANGED);
    clearTimeout(timer);
    timer = setTimeout(() => pixel !== null && isOpen && ask(), QUIET);
  }

  let seen = null;
  hub.on("state", (state) => {
    if (state.revision === seen) return;
    seen = state.revision;
    if (asked !== null || revision !== seen) changed();
  });
  hub.on("tracing", (message) => {
    if (message.question !== asked || asked === null || message.text === "") return;
    say(`Tracing the paths of pixel ${pixel.join(", ")}: ${message.text}.`);
  });
  hub.on("connection", (now) => {
    if (now === "open" && isLost) {
      isLost = false;
      if (pixel !== null && isOpen) ask();
    } else if (now === "lost") {
      isLost = true;
      clearTimeout(timer);
      waits(null);
      if (pixel !== null && isOpen) say(LOST);
    }
  });

  return {
    content: [samples.element, make("div", { class: "lp-line" }, status, stop), shown],
    trace(x, y) {
      pixel = [x, y];
      if (isOpen) ask();
    },
    clear,
    /** The tab is shown, or hidden: nothing is traced then, nor drawn over the image. */
    open(open) {
      if (open === isOpen) return;
      isOpen = open;
      if (!open) {
        if (asked !== null) cancel();
        hideOverlay();
      } else if (pixel !== null) ask();
    },
  };
}
