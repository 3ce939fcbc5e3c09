// The view in a notebook: the viewer over the messages of a widget.

import { mount } from "./viewer.js";

const ALIVE = 20000; // milliseconds between signs of life: a display that gives none is sent nothing any more

/**
 * Shows a widget in an output of a cell; a widget may have several. Without a kernel nothing is shown, and the picture
 * below it, which is hidden while the view is live, stays.
 * @param {Object} context `model` of the widget, and `el` to show it in
 * @returns {Function} to be called when the output goes
 */
export function render({ model, el }) {
  const display = Math.random().toString(36).slice(2);
  const transport = { send: (text) => send({ text }), onmessage: () => {}, onstate: () => {} };
  const still = document.createElement("style");
  const root = document.createElement("div");
  let view = null;

  function send(content) {
    try {
      model.send({ display, ...content });
    } catch {
      // There is no kernel any more.
    }
  }

  function open() {
    const picture = `[data-clrender-still="${model.get("still")}"]`;
    still.textContent = `${picture}, .jp-OutputArea-child:has(${picture}) { display: none; }`;
    document.head.append(still);
    root.style.height = `${model.get("height")}px`;
    root.style.colorScheme = frontEndScheme();
    // Keys on the view are not the notebook's: there, "d d" deletes the cell.
    root.dataset.lmSuppressShortcuts = "true";
    root.addEventListener("keydown", (event) => event.stopPropagation());
    el.append(root);
    view = mount(root, transport, { shared: true });
    transport.onstate("open");
  }

  function hear(content, buffers) {
    if (content.display !== display) return;
    if (content.ended) {
      close();
      return;
    }
    if (view === null) open();
    transport.onmessage(content.text ?? arrayBuffer(buffers[0]));
  }

  function close() {
    clearInterval(alive);
    model.off("msg:custom", hear);
    view?.close();
    root.remove();
    still.remove();
  }

  model.on("msg:custom", hear);
  const alive = setInterval(send, ALIVE, {});
  send({});
  return () => {
    send({ leaves: true });
    close();
  };
}

/** The colours of JupyterLab or VS Code, whatever the system's are; empty where the front end does not say. */
function frontEndScheme() {
  const { jpThemeLight, vscodeThemeKind } = document.body.dataset;
  if (jpThemeLight !== undefined) return jpThemeLight === "true" ? "light" : "dark";
  return vscodeThemeKind === undefined ? "" : vscodeThemeKind.includes("light") ? "light" : "dark";
}

/** A copy that begins where its numbers do: what comes may be a part of a larger buffer. */
function arrayBuffer(view) {
  return new Uint8Array(view.buffer, view.byteOffset, view.byteLength).slice().buffer;
}
