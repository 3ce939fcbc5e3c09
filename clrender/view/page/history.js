// Undo and redo of edits: two buttons, and their keys.

import { make } from "./elements.js";

const TYPED_INTO = "textarea, input:not([type=range], [type=checkbox], [type=color], [type=button])";

/**
 * The buttons. The engine keeps the edits of all viewers in one list.
 * @param {Object} hub
 * @param {Function} say
 */
export function createHistory(hub, say) {
  const button = (type, words, sign, keys) =>
    make("button", { type: "button", disabled: true, class: "cv-step", "aria-label": words, "aria-keyshortcuts": keys, onclick: () => step(type) }, sign);
  const undo = button("undo", "Undo", "↶", "Control+Z");
  const redo = button("redo", "Redo", "↷", "Control+Shift+Z");

  function step(type) {
    const words = type === "undo" ? "Undone" : "Redone";
    hub.send({ type }, (reply) => {
      if (reply.unsent) return false;
      if (reply.type === "refused") say(type === "undo" ? "There is nothing to undo." : "There is nothing to redo.");
      else say(`${words}: ${reply.label}.`);
      return true;
    });
  }

  hub.on("state", (state) => {
    for (const [element, words, label, keys] of [
      [undo, "Undo", state.undo ?? null, "Ctrl-Z"],
      [redo, "Redo", state.redo ?? null, "Ctrl-Shift-Z"],
    ]) {
      // A button that has the focus and is disabled loses it, and keys go nowhere: it says so instead.
      element.setAttribute("aria-disabled", String(label === null));
      element.disabled = label === null && element !== document.activeElement;
      element.title = label === null ? `Nothing to ${words.toLowerCase()}` : `${words}: ${label} (${keys})`;
      element.setAttribute("aria-label", label === null ? words : `${words}: ${label}`);
    }
  });

  return {
    buttons: make("div", { class: "cv-steps", role: "group", "aria-label": "Edits" }, undo, redo),
    /** Listens to the keys on an element, except where a text is typed, which has an undo of its own. */
    listen(target) {
      target.addEventListener("keydown", (event) => {
        if (!(event.ctrlKey || event.metaKey) || event.altKey || event.target.closest(TYPED_INTO)) return;
        const key = event.key.toLowerCase();
        if (key !== "z" && !(key === "y" && !event.shiftKey)) return;
        event.preventDefault();
        step(key === "y" || event.shiftKey ? "redo" : "undo");
      });
    },
  };
}
