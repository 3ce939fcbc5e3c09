// The environment: none, a constant one, a sky, or a file beside the scene; its strength and rotation; hidden or not.

import { freshId, make } from "./elements.js";
import { createField } from "./fields.js";
import { labelOf } from "./settings_panel.js";

const KINDS = [["scene", "As in the scene file"], ["none", "None"], ["constant", "Constant"], ["sky", "Sun and sky"]];
const PARAMETERS = { radiance: "Uniform light", scale: "Strength", rotate_degrees: "Rotation", sun_direction: "Direction of sun", turbidity: "Haze (turbidity)", visible_to_camera: "Visible" };

/** A panel's content, and `hide(hidden)`: whether the camera sees it. */
export function createEnvironmentPanel(hub, say) {
  const id = freshId("environment");
  const select = make("select", { id, onchange: choose, onfocus: list, onpointerdown: list });
  const values = make("div", { class: "cv-fields" });
  const complaint = make("p", { class: "cv-complaint", role: "alert", hidden: true });
  let files = [];
  let made = "";
  let fields = new Map();
  let waiting = null;

  const now = () => hub.newest("scene")?.environment ?? null;
  const table = () => (now() === null ? null : hub.newest("scene").emitters[now().place]);

  /** Files that are there now; asked for when somebody is about to choose. */
  function list() {
    hub.send({ type: "environments" }, (reply) => {
      if (reply.type !== "environments") return false;
      files = reply.files;
      fill();
      return true;
    });
  }

  function fill() {
    const current = now();
    const value = current === null ? "none" : current.kind === "file" ? `file:${current.file}` : current.kind;
    const named = current?.kind === "file" && !files.includes(current.file) ? [current.file, ...files] : files;
    const options = [...KINDS, ...named.map((name) => [`file:${name}`, name])];
    const key = (all) => all.map((each) => each.join("\t")).join("\n");
    if (key(options) !== key([...select.options].map((each) => [each.value, each.textContent]))) {
      select.replaceChildren(...options.map(([name, words]) => make("option", { value: name }, words)));
    }
    select.value = value;
  }

  function choose() {
    const [kind, ...rest] = select.value.split(":");
    complaint.hidden = true;
    hub.send({ type: "environment", kind, file: rest.join(":") }, (reply) => {
      if (reply.type !== "refused") return false;
      complaint.textContent = reply.message;
      complaint.hidden = false;
      fill();
      return true;
    });
  }

  function change(name, value) {
    if (now() === null) return;
    if (waiting === null) {
      requestAnimationFrame(() => {
        const [place, changed] = waiting;
        waiting = null;
        hub.send({ type: "light", name: place, values: changed }, (reply) => {
          if (reply.type === "refused") fields.get(Object.keys(changed)[0])?.complain(reply.message);
          return true;
        });
      });
    }
    waiting = [now().place, { ...(waiting?.[1] ?? {}), [name]: value }];
  }

  function update() {
    fill();
    const parameters = (table()?.parameters ?? []).filter((each) => each.name in PARAMETERS && each.kind !== "fixed");
    const key = JSON.stringify([now()?.kind, parameters.map(({ name }) => name)]);
    if (key !== made) {
      fields = new Map();
      for (const each of parameters) {
        const about = { ...each, label: PARAMETERS[each.name] ?? labelOf(each.name), strength: each.kind === "color" };
        fields.set(each.name, createField(about, (value) => change(each.name, value)));
      }
      values.replaceChildren(...[...fields.values()].map((field) => field.element));
    }
    made = key;
    for (const each of parameters) fields.get(each.name).show(each.value, false);
  }

  hub.on("scene", update);
  hub.on("connection", (state) => state === "open" && list());
  return {
    content: [make("div", { class: "cv-field" }, make("label", { for: id }, "Environment"), select), complaint, values],
    /** Whether the camera sees it; null: there is none. */
    isVisible: () => table()?.parameters.find(({ name }) => name === "visible_to_camera")?.value ?? null,
    show: (visible) => change("visible_to_camera", visible),
  };
}
