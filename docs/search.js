// How the site's search ranks its pages (Sphinx: html_search_scorer): pages that answer stand above lists, and lists above logs.
// tests/host/test_site.py asks it questions.
const PAGE_NAMES = {
  // What readers call the subject of a page, beside the words of its headings
  "docs/start": "install setup begin tutorial quickstart download",
  "docs/troubleshooting": "problem help wrong error crash why",
  "docs/rendering": "render output save options denoiser png jpg",
  "docs/cameras": "camera lens fov field view fisheye panorama orthographic focus bokeh",
  "docs/coming-from": "blender cycles mitsuba pbrt luxcore three threejs convert migrate bounces",
  "docs/cite": "cite citation bibtex doi version commit pin reproduce",
  "docs/materials": "material glass metal plastic paint cloth roughness bsdf brdf mirror hair",
  "docs/lights": "light lamp sun sky environment hdri spot ies emission",
  "docs/media": "fog smoke cloud volume fire liquid medium subsurface skin wax absorption",
  "docs/textures": "texture image normal bump map uv",
  "docs/motion": "animation motion blur shutter frames",
  "docs/hard-light": "caustic firefly speckled guiding manifold",
  "docs/integrators": "integrator bidirectional photon mapping algorithm",
  "docs/errors": "noise error variance converge adaptive samples",
  "docs/layers": "aov layer pass depth normals albedo mask",
  "docs/long-renders": "checkpoint resume shard interrupted",
  "docs/devices": "gpu cpu opencl driver device memory nvidia amd",
  "docs/scaling": "cluster dask network machines distributed",
  "docs/extend": "add new contribute extend developer",
  "docs/scenes": "gltf glb obj ply stl scene import model format instance",
  "docs/wavelengths": "spectral dispersion wavelength prism",
};
const PAGE_LISTS = /^(docs\/(index|settings|scene-file|commands|architecture|report|speed|teaching|notebook)|README|SECURITY|CONTRIBUTING)$/;
const PAGE_LOGS = /^(docs\/notes\/.*|DECISIONS|CHANGELOG|scenes\/.*)$/;
let scored = { query: null, words: [], names: {}, headings: {} };

// The stems of a text's words, but those that no search counts.
const stemsOf = (text) => {
  const stemmer = new Stemmer();
  return splitQuery(text.toLowerCase()).filter((word) => !stopwords.has(word)).map((word) => stemmer.stemWord(word));
};

// Stems of the query, of the names of pages, and of the headings of each page.
const prepare = () => {
  const query = new URLSearchParams(window.location.search).get("q") || "";
  if (scored.query === query) return scored;
  scored = { query, words: stemsOf(query), names: {}, headings: {} };
  for (const [page, text] of Object.entries(PAGE_NAMES)) scored.names[page] = new Set(stemsOf(text));
  for (const [title, places] of Object.entries(Search._index.alltitles))
    for (const [file] of places) (scored.headings[Search._index.docnames[file]] ||= []).push(stemsOf(title));
  return scored;
};

var Scorer = {
  score: ([page, , , , score, , kind]) => {
    const { words, names, headings } = prepare();
    const found = (stems) => words.filter((word) => stems.includes(word)).length / (words.length || 1);
    // The heading that has most of the query, and little else
    const best = Math.max(0, ...(headings[page] || []).map((stems) => found(stems) * (1 + 1 / (1 + stems.length))));
    const named = names[page] ? found([...names[page]]) : 0;
    const rank = PAGE_LOGS.test(page) ? 0.3 : PAGE_LISTS.test(page) ? 0.7 : 1;
    // Objects are functions and options, which a page tells about, too
    return (score + 12 * best + 12 * named) * rank * (kind === "object" ? 0.7 : 1);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
