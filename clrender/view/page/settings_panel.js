// Settings of the render and the device, made from the table that the engine sends.

import { createCopyButton, tableOf } from "./copying.js";
import { make } from "./elements.js";
import { createField } from "./fields.js";

/** What people change most; the others are folded away. */
const FIRST = ["integrator", "guiding", "spp", "width", "height", "crop", "max_depth", "light_sampler", "shadow_rays", "replicate_spp"];

export function labelOf(name) {
  const words = name.replaceAll("_", " ").replace(/\bspp\b/, "samples");
  return words[0].toUpperCase() + words.slice(1);
}

/** A panel's content: a field for each setting that the integrator in force takes. */
export function createSettingsPanel(hub, say) {
  const common = make("div", { class: "cv-fields" });
  const others = make("div", { class: "cv-fields" });
  const device = make("div", { class: "cv-fields" });
  const about = make("p", { class: "cv-note", hidden: true });
  const reset = make("button", { type: "button", onclick: () => hub.send({ type: "reset", what: "settings" }) }, "Reset settings");
  const asCommand = { label: "Copy as command", what: "Command", where: "It renders the scene file, without edits of its camera, materials and lights." };
  const copying = createCopyButton(say, asCommand, tableOf(hub, () => ({ what: "settings" })));
  const restart = make("button", { type: "button", onclick: () => hub.send({ type: "restart" }) }, "Restart");
  let fields = new Map(); // name -> {setting, field}
  let deviceField = null;
  let deviceChoices = "";
  let made = ""; // settings that the fields are made for

  function sent(name, value) {
    hub.send({ type: "set", settings: { [name]: value } }, (reply) => {
      if (reply.type === "refused") fields.get(name).field.complain(reply.message);
      return true;
    });
  }

  hub.on("hello", (hello) => {
    // It comes again after a reconnection; nobody's field is taken away for that.
    const key = JSON.stringify(hello.settings);
    if (key !== made) makeFields(hello);
    made = key;
    if (hub.newest("state") !== undefined) update(hub.newest("state"));
  });

  function makeFields(hello) {
    fields = new Map();
    for (const setting of hello.settings) {
      const described = { ...setting, label: setting.label ?? labelOf(setting.name) };
      fields.set(setting.name, { setting, field: createField(described, (value) => sent(setting.name, value)) });
    }
    const placed = FIRST.filter((name) => fields.has(name));
    common.replaceChildren(...placed.map((name) => fields.get(name).field.element));
    others.replaceChildren(...[...fields].filter(([name]) => !placed.includes(name)).map(([, { field }]) => field.element));
  }

  /** The devices that are known, and what renders now, which may be several of them. */
  function updateDevices(state) {
    const known = hub.newest("devices")?.devices ?? hub.newest("hello").devices;
    const words = ({ index, name }) => `${index}: ${name}`;
    const current = known.find(({ name }) => name === state.device);
    const shown = current === undefined ? state.device : words(current);
    const choices = current === undefined ? [shown, ...known.map(words)] : known.map(words);
    if (choices.join("\n") !== deviceChoices) {
      deviceField = createField({ label: "Device", schema: { enum: choices }, help: "Device that renders" }, chooseDevice);
      device.replaceChildren(deviceField.element);
    }
    deviceChoices = choices.join("\n");
    deviceField.show(shown, false);
  }

  function chooseDevice(words) {
    const index = parseInt(words, 10);
    if (Number.isNaN(index)) return; // what renders now
    hub.send({ type: "device", device: index }, (reply) => {
      if (reply.type === "refused") deviceField.complain(reply.message);
      return true;
    });
  }

  function update(state) {
    for (const [name, { setting, field }] of fields) {
      field.element.hidden = setting.integrator !== null && setting.integrator !== state.settings.integrator;
      field.show(state.settings[name], state.changed.includes(name));
    }
    updateDevices(state);
    const integrator = hub.newest("hello")?.integrators.find((each) => each.name === state.settings.integrator);
    about.hidden = integrator === undefined || integrator.has_errors;
    about.textContent = about.hidden ? "" : `${integrator.name} is ${integrator.bias}.`;
    reset.disabled = !state.changed.some((name) => fields.has(name));
  }

  hub.on("state", update);
  hub.on("devices", () => hub.newest("state") !== undefined && updateDevices(hub.newest("state")));
  return [
    common,
    about,
    device,
    make("details", { class: "cv-more" }, make("summary", {}, "More settings"), others),
    make("div", { class: "cv-row" }, copying.button, restart, reset),
    copying.shown,
  ];
}
