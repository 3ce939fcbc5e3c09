// The material of the picked object, changed while the image is rendered.

import { freshId, make } from "./elements.js";
import { createField } from "./fields.js";
import { labelOf } from "./settings_panel.js";

/** A panel's content, and `choose(name, parameters)` for what is picked in the image. */
export function createMaterialPanel(hub) {
  const id = freshId("material");
  const select = make("select", { id, onchange: () => choose(select.value) });
  const kind = make("p", { class: "cv-note" });
  const values = make("div", { class: "cv-fields" });
  const reset = make("button", { type: "button", onclick: () => hub.send({ type: "reset", what: "materials" }) }, "Reset materials");
  const picked = {}; // name -> material, of those that the scene has too many to list
  let chosen = null;
  let shown = ""; // material and names of the parameters that the fields are made for
  let fields = new Map();
  let waiting = null; // changes to send with the next screen frame

  function change(name, value) {
    if (value === null) return;
    if (waiting === null) requestAnimationFrame(sendChanges);
    waiting = { material: chosen, values: { ...(waiting?.material === chosen ? waiting.values : {}), [name]: value } };
  }

  function sendChanges() {
    const { material, values: changed } = waiting;
    waiting = null;
    hub.send({ type: "material", name: material, values: changed }, (reply) => {
      const field = fields.get(Object.keys(changed)[0]);
      if (reply.type === "refused") field?.complain(reply.message);
      return field !== undefined;
    });
  }

  function choose(name, parameters) {
    const isListed = name in (hub.newest("scene")?.materials ?? {});
    if (!isListed && parameters) picked[name] = { type: "", parameters };
    chosen = name;
    update();
  }

  function update() {
    const materials = { ...picked, ...hub.newest("scene")?.materials };
    const names = Object.keys(materials);
    if (!names.includes(chosen)) chosen = names[0] ?? null;
    const listed = [...select.options].map((option) => option.value);
    if (listed.join("\n") !== names.join("\n")) select.replaceChildren(...names.map((name) => make("option", { value: name }, name)));
    select.value = chosen ?? "";
    select.disabled = names.length === 0;
    const material = materials[chosen];
    kind.textContent = material === undefined ? "This scene has no named materials." : material.type;
    const parameters = material?.parameters ?? [];
    const key = JSON.stringify([chosen, parameters.map((each) => [each.name, each.kind])]);
    if (key !== shown) build(parameters);
    shown = key;
    for (const each of parameters) if (each.kind !== "fixed") fields.get(each.name).show(each.value, false);
  }

  function build(parameters) {
    fields = new Map();
    const rows = parameters.map((each) => {
      if (each.kind === "fixed") {
        return make("div", { class: "cv-field" }, make("span", { title: each.help }, labelOf(each.name)), make("span", { class: "cv-fixed" }, String(each.value)));
      }
      const field = createField({ ...each, label: labelOf(each.name) }, (value) => change(each.name, value));
      fields.set(each.name, field);
      return field.element;
    });
    values.replaceChildren(...rows);
  }

  hub.on("scene", update);
  return {
    choose,
    content: [
      make("p", { class: "cv-note" }, "Click on an object in the image, or select a material:"),
      make("div", { class: "cv-field" }, make("label", { for: id }, "Material"), select),
      kind,
      values,
      make("div", { class: "cv-row" }, reset),
    ],
  };
}
