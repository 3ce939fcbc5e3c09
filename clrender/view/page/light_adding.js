// Adds lights: above what is clicked on, or above the probe.

import { freshId, make } from "./elements.js";

const WORDS = { point: "Point", spot: "Spot", sphere: "Sphere", area: "Area", directional: "Directional" };

/**
 * A row of controls, and what a click does while it is armed.
 * @param {(name: string) => void} added called with the place of the new light
 */
export function createLightAdding(hub, say, added) {
  const id = freshId("kind");
  const kind = make("select", { id, onchange: () => armed && arm() });
  const button = make("button", { type: "button", "aria-pressed": "false", title: "Then click on what it is to light, or press Enter with an active probe", onclick: toggle, "aria-label": "Add by click" }, "Add…");
  let armed = false;

  function set(value) {
    armed = value;
    button.setAttribute("aria-pressed", String(armed));
  }
  function arm() {
    set(true);
    say(`Click on what the ${WORDS[kind.value].toLowerCase()} light is to be above.`);
  }
  function toggle() {
    if (armed) set(false);
    else arm();
  }

  hub.on("hello", (hello) => {
    const kinds = hello.light_kinds ?? [];
    if (kind.options.length === kinds.length) return;
    kind.replaceChildren(...kinds.map((name) => make("option", { value: name }, WORDS[name] ?? name)));
  });

  return {
    content: make("div", { class: "cv-field" }, make("label", { for: id }, "New light"), make("span", { class: "cv-pair" }, kind, button)),
    isArmed: () => armed,
    disarm: () => set(false),
    at(probe, place) {
      set(false);
      probe.positionAt(place, (position) => {
        hub.send({ type: "add_light", kind: kind.value, position }, (reply) => {
          if (reply.type !== "added") return false;
          say(position === null ? "Added above what the camera looks at: nothing is at this pixel." : `Added ${WORDS[kind.value].toLowerCase()} light.`);
          added(reply.name);
          return true;
        });
      });
    },
  };
}
