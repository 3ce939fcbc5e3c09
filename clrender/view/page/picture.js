// The image on its stage: frames as they come, the slider between two layers, the legend of false colours.

import { createDisplay } from "./display.js";
import { make } from "./elements.js";
import { legendOf, lookOf } from "./looks.js";

const LARGEST_SIDE = 2048; // pixels, of frames and of the canvas
const PIXELATED_FROM = 4; // times: from there pixels are shown as squares

/**
 * @param {Object} hub
 * @param {Object} choice what is shown: `layer`, `compared` (a layer or null), `toneMap`, `exposure` (of the slider), `falseColor`,
 *   `alpha` (whether transparent pixels are)
 * @param {string} drawing of `createDisplay`
 */
export function createPicture(hub, choice, drawing) {
  const display = createDisplay(drawing);
  const { canvas } = display;
  for (const [name, value] of Object.entries({ class: "cv-canvas", role: "img", "aria-label": "The image" })) canvas.setAttribute(name, value);
  const split = make("input", { type: "range", class: "cv-split", min: 0, max: 1, step: 0.002, value: 0.5, hidden: true });
  const names = [make("span", { class: "cv-side cv-left", hidden: true }), make("span", { class: "cv-side cv-right", hidden: true })];
  const divider = make("div", { class: "cv-divider", hidden: true });
  const cross = make("div", { class: "cv-cross", hidden: true });
  const box = make("div", { class: "cv-picture cv-empty" }, canvas, divider, ...names, split, cross);
  const legend = make("div", { class: "cv-legend-place" });

  const frames = new Map(); // layer -> newest frame
  const unanswered = new Set(); // numbers of frames to acknowledge when they are drawn
  const drawnListeners = [];
  let scheduled = false;
  let first = true;
  let size = [16, 9];

  const layerNamed = (name) => hub.newest("hello")?.layers.find((layer) => layer.name === name);
  const lookAt = (name) => {
    const stops = hub.newest("state")?.camera_stops ?? 0;
    return lookOf(layerNamed(name), { ...choice, exposure: choice.exposure + stops }, frames.get(name));
  };

  const streamed = () => [...new Set([choice.layer, choice.compared, choice.alpha ? "alpha" : null])].filter((name) => name !== null);

  function draw() {
    scheduled = false;
    if (layerNamed(choice.layer) !== undefined && frames.has(choice.layer)) {
      const compared = choice.compared === null || !frames.has(choice.compared) ? null : { name: choice.compared, look: lookAt(choice.compared), from: Number(split.value) };
      display.draw(choice.layer, lookAt(choice.layer), compared, choice.alpha && frames.has("alpha") ? "alpha" : null);
      drawnListeners.forEach((listener) => listener(frames.get(choice.layer)));
      if (first) performance.mark("clrender-first-image");
      first = false;
      box.classList.remove("cv-empty");
    }
    unanswered.forEach((frame) => hub.send({ type: "ack", frame }));
    unanswered.clear();
  }

  function schedule() {
    if (!scheduled) requestAnimationFrame(draw);
    scheduled = true;
  }

  function show() {
    const layers = [choice.layer, choice.compared].filter((name) => name !== null);
    hub.send({ type: "show", layers: streamed(), max_side: LARGEST_SIDE });
    for (const name of [...frames.keys()].filter((each) => !streamed().includes(each))) {
      frames.delete(name);
      display.removeImage(name);
    }
    const isSplit = choice.compared !== null;
    for (const element of [split, divider, ...names]) element.hidden = !isSplit;
    if (isSplit) layers.forEach((name, i) => (names[i].textContent = layerNamed(name)?.label ?? name));
    split.setAttribute("aria-label", isSplit ? `Divider between ${layers.join(" and ")}` : "Divider");
    refresh();
  }

  function refresh() {
    const layer = layerNamed(choice.layer);
    if (layer !== undefined) {
      const drawn = legendOf(layer, lookAt(choice.layer));
      // A legend that says the same is left alone.
      if (drawn?.outerHTML !== legend.firstChild?.outerHTML) legend.replaceChildren(...(drawn === null ? [] : [drawn]));
    }
    schedule();
  }

  hub.on("frame", (frame) => {
    unanswered.add(frame.frame);
    if (streamed().includes(frame.layer)) {
      frames.set(frame.layer, frame);
      display.setImage(frame.layer, frame);
      fitCanvas(frame);
      if (frame.range !== null) refresh();
    }
    schedule();
  });
  hub.on("state", refresh);

  function fitCanvas(frame) {
    const shrink = Math.min(1, LARGEST_SIDE / Math.max(frame.image_width, frame.image_height));
    const [width, height] = [frame.image_width, frame.image_height].map((side) => Math.max(Math.round(side * shrink), 1));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    if (size[0] !== frame.image_width || size[1] !== frame.image_height) {
      size = [frame.image_width, frame.image_height];
      fitBox();
    }
  }

  function fitBox() {
    const room = box.parentElement;
    if (room === null || room.clientWidth === 0) return;
    // A narrow page makes the room as high as the image is at its width.
    room.style.setProperty("--cv-ratio", String(size[0] / size[1]));
    const scale = Math.min(room.clientWidth / size[0], room.clientHeight / size[1]);
    box.style.width = `${Math.floor(size[0] * scale)}px`;
    box.style.height = `${Math.floor(size[1] * scale)}px`;
    box.classList.toggle("cv-pixelated", scale >= PIXELATED_FROM);
  }

  split.addEventListener("input", () => {
    divider.style.left = `${100 * split.value}%`;
    schedule();
  });

  return {
    box,
    canvas,
    /** Lays an element over the image, below the cross. */
    overlay: (element) => box.insertBefore(element, divider),
    legend,
    method: display.method,
    fit: fitBox,
    show,
    refresh,
    /** Width and height of the image, pixels. */
    size: () => size,
    /** The newest frame of the layer that is shown. */
    frame: () => frames.get(choice.layer),
    /** Whether all layers that are shown are there. */
    isWhole: () => frames.has(choice.layer) && (choice.compared === null || frames.has(choice.compared)),
    onDrawn: (listener) => drawnListeners.push(listener),
    /** What is shown, as a PNG file. */
    snapshot() {
      draw(); // a canvas of WebGL keeps its pixels for as long as this function runs
      return new Promise((resolve) => canvas.toBlob(resolve));
    },
    /** Marks a pixel, or none. */
    mark(pixel) {
      cross.hidden = pixel === null;
      if (pixel === null) return;
      cross.style.left = `${(100 * (pixel[0] + 0.5)) / size[0]}%`;
      cross.style.top = `${(100 * (pixel[1] + 0.5)) / size[1]}%`;
    },
  };
}
