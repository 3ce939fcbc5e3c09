// The camera: its numbers, its text for a scene file, and the moves that gestures ask for.

import { fly, look, orbit, pan, zoom, distanceToTarget } from "./camera.js";
import { createCopyButton } from "./copying.js";
import { make } from "./elements.js";
import { createField } from "./fields.js";

const FLY_RATE = 0.6; // of the distance to the target, a second
const NUMBERS = [
  ["vertical_fov", "Field of view", "Vertical, degrees", { type: "number", exclusiveMinimum: 0 }],
  ["height", "Height", "Height of the visible region, metres", { type: "number", exclusiveMinimum: 0 }],
  ["aperture_radius", "Aperture radius", "Metres; 0: everything in focus", { type: "number", minimum: 0 }],
  ["focus_distance", "Focus distance", "Metres; or use Focus by click", { type: "number", exclusiveMinimum: 0 }],
];

/** The camera in motion: what gestures change, sent at once, and then once a screen frame. */
export function createCamera(hub) {
  let camera = null;
  let scheduled = false; // sent for this screen frame
  let unsent = false; // moved since
  let awaited = null; // what was sent, until the engine says the same
  let lastSent = null;

  // A state that comes while one drags is of an earlier camera, and must not throw the view back.
  function settle() {
    const told = hub.newest("state")?.camera;
    if (unsent || told === undefined) return;
    const isTaken = awaited === null || Object.entries(awaited).every(([name, value]) => String(told[name]) === String(value));
    if (!isTaken) return;
    awaited = null;
    camera = told;
  }
  hub.on("state", settle);

  // The engine may be busy for long, as with compiling. A refusal, and a frame of what was sent, say that it was not:
  // what counts then is what the engine says, such as the camera of another viewer.
  hub.on("frame", (frame) => awaited !== null && frame.answers === lastSent && giveUp());
  hub.on("connection", (now) => now === "lost" && (awaited = null));

  function giveUp() {
    awaited = null;
    settle();
  }

  function send() {
    unsent = false;
    const { position, target, up } = camera;
    awaited = { position, target, up, ...(camera.type === "orthographic" ? { height: camera.height } : {}) };
    lastSent = hub.send({ type: "camera", camera: awaited }, () => {
      giveUp(); // the only reply is a refusal
      return false;
    });
  }

  /** Changes the camera by a move that is given in shares of the shown height; of a crop, that is a part of the image's. */
  function drag(change, across, down) {
    if (camera === null) return;
    const { height, settings } = hub.newest("state");
    const part = height / settings.height;
    move((now) => change(now, across * part, down * part, settings));
  }

  function move(change) {
    if (camera === null) return;
    camera = change(camera);
    unsent = true;
    if (!scheduled) sendOnceAFrame();
  }

  function sendOnceAFrame() {
    scheduled = unsent;
    if (!unsent) return;
    send();
    requestAnimationFrame(sendOnceAFrame);
  }

  return {
    orbit: (across, down) => move((now) => orbit(now, across, down)),
    look: (across, down) => drag(look, across, down),
    pan: (across, down) => drag(pan, across, down),
    zoom: (factor) => move((now) => zoom(now, factor)),
    fly: ([ahead, sideways, upward], seconds) =>
      move((now) => {
        const step = FLY_RATE * distanceToTarget(now) * seconds;
        return fly(now, ahead * step, sideways * step, upward * step);
      }),
    /** Of the newest camera that was sent: `answers` of frames tells which one they show. */
    lastSent: () => lastSent,
    reset() {
      awaited = null;
      hub.send({ type: "reset", what: "camera" });
    },
  };
}

/** A panel's content. */
export function createCameraPanel(hub, say, focusButton, camera) {
  const fields = NUMBERS.map(([name, label, help, schema]) => {
    const field = createField({ label, help, schema: { anyOf: [schema, { type: "null" }] } }, (value) => {
      hub.send({ type: "camera", camera: { [name]: value } }, (reply) => {
        if (reply.type === "refused") field.complain(reply.message);
        return true;
      });
    });
    return [name, field];
  });
  const text = make("pre", { class: "cv-toml", tabindex: 0, "aria-label": "The camera as TOML" });
  // The state has it already: it is there to read, and copied without a question.
  const about = { label: "Copy as TOML", what: "Camera", where: "Paste it into the scene file." };
  const copying = createCopyButton(say, about, (take) => take(hub.newest("state")?.camera_toml ?? ""));

  hub.on("state", (state) => {
    for (const [name, field] of fields) {
      const value = state.camera[name];
      field.element.hidden = value === undefined || (value === null && name !== "focus_distance");
      field.show(value ?? null, false);
    }
    if (text.textContent !== state.camera_toml) text.textContent = state.camera_toml;
  });
  return {
    copy: copying.copy,
    content: [
      ...fields.map(([, field]) => field.element),
      make("div", { class: "cv-row" }, focusButton, make("button", { type: "button", onclick: camera.reset }, "Reset")),
      text,
      make("div", { class: "cv-row" }, copying.button),
      copying.shown,
    ],
  };
}
