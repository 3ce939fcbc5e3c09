// The list of keys and gestures.

import { make } from "./elements.js";

const LINES = [
  ["drag", "orbit around the target"],
  ["right drag, Shift + drag", "pan"],
  ["Alt + drag", "look around"],
  ["wheel, pinch", "zoom"],
  ["click", "probe a pixel and select its material"],
  ["← ↑ → ↓", "orbit; Shift: pan; with an active probe: move it (Shift: by 10 pixels)"],
  ["+ −", "zoom"],
  ["W A S D, Q E", "fly; down, up"],
  ["F", "focus: then click on an object, or press Enter with an active probe"],
  ["P", "probe by keyboard; Enter selects the material, Esc ends"],
  ["T", "light paths of a pixel, or the controls again"],
  ["R", "reset the camera to the scene file"],
  ["C", "copy the camera as TOML"],
  ["Space", "stop, continue"],
  ["Ctrl-Z, Ctrl-Shift-Z", "undo and redo edits"],
  ["[ ]", "change the exposure by 1/3 stop"],
  ["L", "false colour of luminance"],
  ["B", "compare before and after denoising"],
  ["H", "hide or show the panel"],
  ["?", "this list"],
];

/** A dialog; `showModal()` opens it. */
export function createHelp() {
  const rows = LINES.flatMap(([keys, words]) => [make("dt", {}, keys), make("dd", {}, words)]);
  const dialog = make("dialog", { class: "cv-help", "aria-label": "Keys and gestures" });
  const close = make("button", { type: "button", class: "cv-close", "aria-label": "Close", onclick: () => dialog.close() }, "×");
  dialog.append(close, make("h2", {}, "Keys and gestures"), make("p", { class: "cv-note" }, "Keys work while no field or button has the focus."), make("dl", {}, ...rows));
  dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
  return dialog;
}
