// What paths from lights brought to a pixel in which the camera sees them: a table, and the light path of the chosen one.

import { make, readable } from "./elements.js";
import { named, number, percent, swatch } from "./path_rows.js";
import { splatParts } from "./path_vertices.js";

const NAMES = [["Light path"], ["Sample"], ["Luminance", "of what it adds to the sum of the pixel"], ["Of the pixel"], ["MIS", "weight"], ["Vertices", "of the light path as far as the one that the camera sees"], ["Light", "", true]];

/**
 * The table with what is chosen below it: `element`, and `clear()`, after which none is.
 *
 * `splats`: of a document; `rows`: as of `splatRows`; `choose(row)` is told which one is chosen, or null.
 */
export function createSplats(splats, rows, choose) {
  let chosen = null;
  const details = make("div", { "aria-live": "polite" });
  const lines = rows.map((row) => {
    const { splat } = row;
    return make("tr", { "data-splat": row.rank, onclick: () => pick(row === chosen ? null : row) },
      make("td", {}, String(splat.path)), make("td", {}, String(splat.sample)), make("td", {}, swatch(splat.value), readable(row.brightness, 4)), make("td", {}, percent(splat.share)),
      make("td", {}, number(splat.weight)), make("td", {}, String(splat.light_vertices)), make("td", { class: "lp-words" }, splat.light_path ? named(splat.light_path) : "–"));
  });
  const body = make("tbody", {}, ...lines);

  function mark() {
    rows.forEach((row, at) => {
      lines[at].setAttribute("aria-current", row === chosen ? "true" : "false");
      lines[at].tabIndex = row === (chosen ?? rows[0]) ? 0 : -1;
    });
  }
  function pick(row) {
    chosen = row;
    mark();
    if (row) lines[row.rank].focus({ preventScroll: false });
    details.replaceChildren(...(row ? splatParts(row) : []));
    choose(row);
  }
  body.addEventListener("keydown", (event) => {
    const at = lines.indexOf(event.target), next = { ArrowDown: at + 1, ArrowUp: at - 1, Enter: at, " ": at }[event.key];
    if (at < 0 || next === undefined || !rows[next]) return;
    event.preventDefault();
    pick(next === at && rows[next] === chosen ? null : rows[next]);
  });

  mark();
  const caption = `${rows.length < splats.count ? `${rows.length} of ${splats.count} splats, those that contribute most` : `All ${splats.count} splats`}. A row shows its light path, and draws it.`;
  const headings = NAMES.map(([name, title, words]) => make("th", { scope: "col", title, class: words && "lp-words" }, name));
  const table = make("div", { class: "lp-scroll lp-samples lp-splats", tabindex: 0, role: "region", "aria-label": "Paths from lights that the camera sees in the pixel" },
    make("table", {}, make("caption", {}, caption), make("thead", {}, make("tr", {}, ...headings)), body));
  return { element: make("section", { class: "lp-part lp-wide" }, make("h2", {}, "Splats"), table, details), clear: () => chosen && pick(null) };
}
