// The table of the samples of a pixel, sorted by what they contribute.

import { make, readable } from "./elements.js";
import { brought, percent, swatch } from "./path_rows.js";

const ALL_COLUMNS = [
  { name: "Draw" },
  { name: "Sample", key: (row) => row.sample.index, up: true },
  { name: "Luminance", key: (row) => Math.abs(row.brightness), title: "of what the sample adds to the sum of the pixel" },
  { name: "Of the pixel", key: (row) => row.sample.share },
  { name: "Splatted", key: (row) => Math.abs(row.splatted), title: "luminance that paths from lights add beside it as part of this sample", splats: true },
  { name: "Vertices", key: (row) => row.size },
  { name: "Brought mostly by", key: (row) => brought(row.most), words: true, up: true },
  { name: "Ends by", key: (row) => row.last?.ended ?? "", words: true, up: true },
];

/** A bar of a sample's part of the pixel. */
function share(rem) {
  const element = make("span", { class: "lp-share", "aria-hidden": "true" });
  element.style.width = `${rem}rem`;
  return element;
}

/**
 * The table: `element`, and `update()` after another one was chosen or others are drawn.
 *
 * `state`: rows, spp, splats (whether there are any), chosen, drawn (ranks); `choose(row)`, `redraw()`.
 */
export function createSamples(state, choose, redraw) {
  const COLUMNS = ALL_COLUMNS.filter((column) => state.splats || !column.splats);
  let order = { column: 2, up: false };
  const body = make("tbody");
  const headings = COLUMNS.map((column) => make("th", { scope: "col", class: column.words && "lp-words", title: column.title }, column.key ? null : column.name));
  headings.forEach((cell, at) => {
    if (!COLUMNS[at].key) return;
    cell.append(make("button", { type: "button", onclick: () => {
      order = { column: at, up: order.column === at ? !order.up : Boolean(COLUMNS[at].up) };
      fillSamples();
    } }, COLUMNS[at].name));
  });

  function fillSamples() {
    const { key } = COLUMNS[order.column], sign = order.up ? 1 : -1;
    const sorted = [...state.rows].sort((a, b) => {
      const [x, y] = [key(a), key(b)];
      return x === y ? a.rank - b.rank : sign * (x < y ? -1 : 1);
    });
    headings.forEach((cell, at) => {
      if (COLUMNS[at].key) cell.setAttribute("aria-sort", at !== order.column ? "none" : order.up ? "ascending" : "descending");
    });
    body.replaceChildren(...sorted.map((row) => {
      const { sample } = row, bar = Math.max(0, Math.min(sample.share, 1)) * 5;
      row.box = make("input", { type: "checkbox", "aria-label": `Draw sample ${sample.index}`, onclick: (event) => event.stopPropagation(), onchange: (event) => {
        if (event.target.checked) state.drawn.add(row.rank);
        else state.drawn.delete(row.rank);
        redraw();
      } });
      row.line = make("tr", { "data-sample": sample.index, onclick: () => choose(row) },
        make("td", {}, row.box), make("td", {}, String(sample.index)), make("td", {}, swatch(sample.value), sample.finite ? readable(row.brightness, 4) : "not finite"),
        make("td", {}, percent(sample.share), share(bar)),
        state.splats ? make("td", {}, swatch(sample.splat), readable(row.splatted, 4)) : null,
        make("td", {}, String(row.size)), make("td", { class: "lp-words" }, brought(row.most)), make("td", { class: "lp-words" }, row.last?.ended ?? ""));
      return row.line;
    }));
    markRows();
  }

  /** Which row is chosen, and which are drawn; a key reaches the chosen one. */
  function markRows() {
    for (const row of state.rows) {
      row.line.setAttribute("aria-current", row === state.chosen ? "true" : "false");
      row.line.tabIndex = row === state.chosen ? 0 : -1;
      row.box.checked = state.drawn.has(row.rank);
    }
  }

  body.addEventListener("keydown", (event) => {
    const line = event.target.closest("tr");
    const steps = { ArrowDown: "nextElementSibling", ArrowUp: "previousElementSibling" }[event.key];
    const next = event.target === line && steps ? line[steps] : null;
    if (!next) return;
    event.preventDefault();
    choose(state.rows.find((row) => row.line === next));
  });

  const left = state.spp - state.rows.length;
  const caption = `${left ? `${state.rows.length} of ${state.spp} samples, those that contribute most` : `All ${state.spp} samples`}. A row shows its vertices below.`;
  const element = make("div", { class: "lp-scroll lp-samples", tabindex: 0, role: "region", "aria-label": "Samples of the pixel" },
    make("table", {}, make("caption", {}, caption), make("thead", {}, make("tr", {}, ...headings)), body));
  fillSamples();
  return { element, update: markRows };
}
