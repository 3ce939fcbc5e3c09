// What the search of a built site finds: node scripts/site_search.js SITE QUERY…; prints a JSON list of pages for each query.
"use strict";
const fs = require("fs"), path = require("path"), vm = require("vm");
const [site, ...queries] = process.argv.slice(2);
// As much of a browser as the search needs that has not yet shown anything
const element = { appendChild: () => element, lastChild: null };
const page = { getElementById: () => element, addEventListener: () => {}, querySelectorAll: () => [], readyState: "loading" };
const browser = vm.createContext({ document: page, window: {}, SPHINX_HIGHLIGHT_ENABLED: false, _: (text) => text, _ready: () => {}, URLSearchParams, console });
browser.window = browser;
const scripts = ["_static/base-stemmer.js", "_static/english-stemmer.js", "_static/language_data.js", "_static/searchtools.js", "searchindex.js"];
const text = scripts.map((name) => path.join(site, name)).filter(fs.existsSync).map((name) => fs.readFileSync(name, "utf8")).join("\n");
vm.runInContext(text + "\nglobalThis.found = (query) => Search._performSearch(...Search._parseQuery(query)).reverse();", browser);
const found = queries.map((query) => {
  browser.location = { search: "?q=" + encodeURIComponent(query) };
  return browser.found(query).map(([name, title, anchor, , score]) => ({ page: name, title, anchor, score }));
});
console.log(JSON.stringify(found));
