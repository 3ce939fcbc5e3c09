// The list of keys and gestures.

import { make } from "./elements.js";

const LINES = [
  ["drag", "orbit around the target"],
  ["right drag, Shift + drag", "pan"],
  ["Alt + drag", "look around"],
  ["wheel, pinch", "zoom"],
  ["click", "probe a pixel, pick what is seen there"],
  ["← ↑ → ↓", "orbit; with Shift pan; with a probe move it (Shift: by 10)"],
  ["+ −", "zoom"],
  ["W A S D, Q E", "fly; down, up"],
  ["F", "focus: then click, or Enter with a probe"],
  ["P", "probe by keyboard; Enter picks, Esc ends"],
  ["R", "camera as in the scene file"],
  ["C", "copy the camera as TOML"],
  ["Space", "stop, go on"],
  ["[ ]", "exposure, by a third of a stop"],
  ["L", "false colour of luminance"],
  ["B", "before and after the denoiser"],
  ["H", "hide or show the panel"],
  ["?", "this list"],
];

/** A dialog; `showModal()` opens it. */
export function createHelp() {
  const rows = LINES.flatMap(([keys, words]) => [make("dt", {}, keys), make("dd", {}, words)]);
  const dialog = make("dialog", { class: "cv-help", "aria-label": "Keys and gestures" });
  const close = make("button", { type: "button", class: "cv-close", "aria-label": "Close", onclick: () => dialog.close() }, "×");
  dialog.append(close, make("h2", {}, "Keys and gestures"), make("p", { class: "cv-note" }, "Keys hold while no field or button has the focus."), make("dl", {}, ...rows));
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return dialog;
}
