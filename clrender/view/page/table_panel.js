// One of several tables of the scene, a material or a light, changed while the image is rendered.

import { createCopyButton, tableOf } from "./copying.js";
import { freshId, make, setText } from "./elements.js";
import { createField } from "./fields.js";
import { labelOf } from "./settings_panel.js";

export const MATERIALS = {
  message: "material",
  label: "Material",
  reset: "materials",
  hint: "Click on an object in the image, or select a material:",
  none: "This scene has no named materials.",
  others: "Click on an object for another one.",
  listed: (scene) => scene?.materials ?? {},
  count: (scene) => scene?.material_count,
};
export const LIGHTS = {
  message: "light",
  label: "Light",
  reset: "lights",
  hint: "Lights of the scene and shapes that shine:",
  none: "This scene has no lights.",
  others: "Change others in the scene file.",
  listed: (scene) => scene?.emitters ?? {},
  count: (scene) => scene?.emitter_count,
};

/**
 * A panel's content, and `choose(name, parameters)` for what is picked in the image.
 * @param {Object} hub
 * @param {Function} say
 * @param {Object} about `MATERIALS` or `LIGHTS`
 * @param {HTMLElement | null} adding controls that make another one
 */
export function createTablePanel(hub, say, about, adding = null) {
  const id = freshId(about.message);
  const select = make("select", { id, onchange: () => choose(select.value) });
  const kind = make("p", { class: "cv-note" });
  const values = make("div", { class: "cv-fields" });
  const reset = make("button", { type: "button", onclick: () => hub.send({ type: "reset", what: about.reset }) }, `Reset ${about.reset}`);
  const copying = createCopyButton(
    say,
    { label: `Copy ${about.message} as TOML`, what: about.label, where: "Paste it into the scene file." },
    tableOf(hub, () => ({ what: about.message, name: chosen })),
  );
  const remove = make("button", { type: "button", hidden: about !== LIGHTS, onclick: removeChosen }, "Remove light");
  const picked = new Map(); // name -> table, of those that the scene has too many to list
  const note = make("p", { class: "cv-note", hidden: true });
  let chosen = null;
  let shown = ""; // table and names of the parameters that the fields are made for
  let fields = new Map();
  let waiting = null; // changes to send with the next screen frame

  function change(name, value) {
    if (waiting === null) requestAnimationFrame(sendChanges);
    waiting = { table: chosen, values: { ...(waiting?.table === chosen ? waiting.values : {}), [name]: value } };
  }

  function sendChanges() {
    const { table, values: changed } = waiting;
    waiting = null;
    hub.send({ type: about.message, name: table, values: changed }, (reply) => {
      const field = fields.get(Object.keys(changed)[0]);
      if (reply.type === "refused") field?.complain(reply.message);
      return field !== undefined;
    });
  }

  function removeChosen() {
    hub.send({ type: "remove_light", name: chosen }, (reply) => {
      if (reply.type === "refused") say(reply.message);
      return true;
    });
  }

  function choose(name, parameters) {
    if (!has(name) && parameters) picked.set(name, { type: "", parameters });
    chosen = name;
    update();
  }

  const has = (name) => Object.hasOwn(about.listed(hub.newest("scene")), name);

  function update() {
    const scene = hub.newest("scene");
    const tables = { ...Object.fromEntries(picked), ...about.listed(scene) };
    const names = Object.keys(tables);
    const count = about.count(scene) ?? 0;
    note.hidden = count <= names.length;
    setText(note, `${names.length} of ${count} are listed. ${about.others}`);
    if (!names.includes(chosen)) chosen = names[0] ?? null;
    const labels = names.map((name) => tables[name].label ?? name);
    const listed = [...select.options].map((option) => `${option.value}\t${option.textContent}`);
    if (listed.join("\n") !== names.map((name, i) => `${name}\t${labels[i]}`).join("\n")) {
      select.replaceChildren(...names.map((name, i) => make("option", { value: name }, labels[i])));
    }
    select.value = chosen ?? "";
    select.disabled = copying.button.disabled = names.length === 0;
    const table = tables[chosen];
    remove.disabled = !table?.removable;
    remove.title = table && !table.removable ? "A shape of the scene file; set its emission to 0 instead" : "";
    kind.textContent = table === undefined ? about.none : table.type.replaceAll("_", " ");
    const parameters = table?.parameters ?? [];
    const key = JSON.stringify([chosen, parameters.map((each) => [each.name, each.kind])]);
    if (key !== shown) build(parameters);
    shown = key;
    for (const each of parameters) if (each.kind !== "fixed") fields.get(each.name).show(each.value, false);
  }

  function build(parameters) {
    fields = new Map();
    copying.shown.hidden = true; // it was of another one
    const rows = parameters.map((each) => {
      if (each.kind === "fixed") {
        return make("div", { class: "cv-field" }, make("span", { title: each.help }, labelOf(each.name)), make("span", { class: "cv-fixed" }, String(each.value)));
      }
      const strength = about === LIGHTS && each.kind === "color";
      const field = createField({ ...each, strength, label: labelOf(each.name) }, (value) => change(each.name, value));
      fields.set(each.name, field);
      return field.element;
    });
    values.replaceChildren(...rows);
  }

  hub.on("scene", () => {
    // It lists what was picked or edited before: of what it does not list, the values may be of earlier.
    for (const name of picked.keys()) if (name !== chosen || has(name)) picked.delete(name);
    update();
  });
  hub.on("state", (state) => {
    const prefixes = about === LIGHTS ? ["lights[", "shapes["] : ["materials."];
    reset.disabled = !(state.changed ?? []).some((name) => prefixes.some((prefix) => name.startsWith(prefix)));
  });
  return {
    choose,
    has,
    content: [
      ...(adding === null ? [] : [adding]),
      make("p", { class: "cv-note" }, about.hint),
      make("div", { class: "cv-field" }, make("label", { for: id }, about.label), select),
      note,
      kind,
      values,
      make("div", { class: "cv-row" }, copying.button, remove, reset),
      copying.shown,
    ],
  };
}
