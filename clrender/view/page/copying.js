// Copies texts to the clipboard, or selects them where the browser does not allow that.

import { make } from "./elements.js";

async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false; // not allowed, or no secure context
  }
}

/**
 * A button that copies a text, and the place where the text is shown if the browser does not allow it.
 * @param {Function} say tells people what happened
 * @param {Object} about `label` of the button, `what` is copied (at the beginning of a sentence), `where` it belongs
 * @param {Function} text called with a function that takes the text
 * @returns {{button: HTMLElement, shown: HTMLElement, copy: Function}}
 */
export function createCopyButton(say, { label, what, where }, text) {
  const shown = make("pre", { class: "cv-toml", tabindex: 0, "aria-label": `${what} as text`, hidden: true });
  const copy = () =>
    text(async (content) => {
      const allowed = await copied(content);
      shown.hidden = allowed;
      if (allowed) {
        say(`${what} copied. ${where}`);
        return;
      }
      shown.textContent = content;
      shown.focus();
      getSelection()?.selectAllChildren(shown);
      say("The browser does not allow copying. The text is selected; copy it manually.");
    });
  return { button: make("button", { type: "button", onclick: copy }, label), shown, copy };
}

/** What `createCopyButton` takes for a table that the engine tells: `question` gives `what` and `name`. */
export function tableOf(hub, question) {
  return (take) =>
    hub.send({ type: "copy", ...question() }, (reply) => {
      if (reply.type !== "table") return false;
      take(reply.text);
      return true;
    });
}
