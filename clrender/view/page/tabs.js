// Tabs: one of several parts is shown.

import { freshId, make } from "./elements.js";

/**
 * Tabs and their parts.
 * @param {string} label of the list of tabs
 * @param {Array<{name: string, content: Array, class: string}>} parts
 * @param {(index: number) => void} chosen called when another one is shown
 */
export function createTabs(label, parts, chosen) {
  const id = freshId("tab");
  const tabs = parts.map(({ name }, i) =>
    make("button", { type: "button", role: "tab", id: `${id}-${i}`, "aria-controls": `${id}-part-${i}`, onclick: () => choose(i) }, name));
  const panels = parts.map(({ content, class: name }, i) =>
    make("div", { role: "tabpanel", id: `${id}-part-${i}`, "aria-labelledby": `${id}-${i}`, class: name }, ...content));
  const list = make("div", { class: "cv-tabs", role: "tablist", "aria-label": label }, ...tabs);

  function choose(index) {
    tabs.forEach((tab, i) => {
      tab.setAttribute("aria-selected", String(i === index));
      tab.tabIndex = i === index ? 0 : -1;
      panels[i].hidden = i !== index;
    });
    chosen(index);
  }

  list.addEventListener("keydown", (event) => {
    const at = tabs.indexOf(event.target);
    const next = { ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: tabs.length - 1 }[event.key];
    if (at < 0 || next === undefined) return;
    event.preventDefault();
    const index = (next + tabs.length) % tabs.length;
    choose(index);
    tabs[index].focus();
  });
  return { list, panels, choose };
}
