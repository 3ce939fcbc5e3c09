// What is shown and how: layer, comparison, exposure, tone curve, false colour. Nothing here is rendered anew.

import { createCopyButton } from "./copying.js";
import { freshId, make, setText } from "./elements.js";
import { TONE_MAPS } from "./tone_map.js";
import { replicatesFor } from "./status.js";

const MOST_STOPS = 128;
const SLIDER_STOPS = 10;
const TONE_MAP_WORDS = { linear: "Linear", sqrt: "Square root", srgb: "sRGB", reinhard: "Reinhard", aces: "ACES", agx: "AgX" };

/** A row: a label of a control, which may stand in an element with others. */
function labelled(label, control, title, row = control) {
  control.id = freshId("view");
  return make("div", { class: "cv-field" }, make("label", { for: control.id, title }, label), row);
}

/**
 * A panel's content.
 * @param {Object} choice as `createPicture` takes it; changed here
 * @param {Object} picture
 * @param {Function} say
 * @param {Object} environment as `createEnvironmentPanel` returns it
 */
export function createViewPanel(hub, choice, picture, say, environment) {
  const layer = make("select", { onchange: () => chooseLayer(layer.value) });
  const compared = make("select", { onchange: () => chooseCompared(compared.value) });
  const toneMap = make("select", { onchange: () => set("toneMap", toneMap.value) }, ...TONE_MAPS.map((name) => make("option", { value: name }, TONE_MAP_WORDS[name])));
  const slider = make("input", { type: "range", min: -SLIDER_STOPS, max: SLIDER_STOPS, step: 0.1, "aria-label": "Exposure, stops" });
  const stops = make("input", { type: "number", min: -MOST_STOPS, max: MOST_STOPS, step: "any" });
  const falseColor = make("input", { type: "checkbox", onchange: () => set("falseColor", falseColor.checked) });
  const alpha = make("input", { type: "checkbox", onchange: chooseAlpha });
  const hidden = make("input", { type: "checkbox", onchange: () => environment.show(!hidden.checked) });
  const hint = make("p", { class: "cv-note", hidden: true });
  const turnOn = make("button", { type: "button", hidden: true, onclick: measure }, "Estimate errors");

  const asOptions = { label: "Copy as options", what: "Options", where: "Add them to clrender render." };
  const copying = createCopyButton(say, asOptions, (take) => take(`--tone-map ${choice.toneMap} --exposure ${Number(choice.exposure.toFixed(2))}`));

  toneMap.value = choice.toneMap;
  setStops(choice.exposure);
  slider.addEventListener("input", () => setStops(Number(slider.value)));
  stops.addEventListener("change", () => setStops(Number(stops.value)));

  function set(name, value) {
    choice[name] = value;
    picture.refresh();
  }

  function setStops(value) {
    const kept = Math.min(Math.max(value, -MOST_STOPS), MOST_STOPS);
    slider.value = String(kept);
    stops.value = String(Number(kept.toFixed(2)));
    set("exposure", kept);
  }

  let hides = ""; // whether alpha is what has hidden the environment: "asked" for that, and then "hidden"

  /** With alpha the environment is hidden, as by --alpha, and seen again without, where it was seen before. */
  function chooseAlpha() {
    choice.alpha = alpha.checked;
    if (alpha.checked) {
      hides = environment.isVisible() === true ? "asked" : "";
      if (hides) environment.show(false);
    } else if (hides) {
      hides = "";
      environment.show(true);
    }
    picture.show();
  }

  /** Alpha ends when the environment that it has hidden is shown again, by whatever. */
  function followEnvironment(visible) {
    if (hides !== "" && visible !== true) hides = "hidden";
    else if (hides === "hidden") {
      hides = "";
      choice.alpha = alpha.checked = false;
      picture.show();
    }
  }

  function measure() {
    hub.send({ type: "set", settings: { replicate_spp: replicatesFor(hub) } });
  }

  function chooseLayer(name) {
    choice.layer = name;
    if (choice.compared === name) choice.compared = null;
    picture.show();
    update();
  }

  function chooseCompared(name) {
    choice.compared = name === "" || name === choice.layer ? null : name;
    picture.show();
    update();
  }

  function update() {
    const hello = hub.newest("hello");
    if (hello === undefined) return;
    const measured = (hub.newest("state")?.settings.replicate_spp ?? null) !== null;
    const option = ({ name, label, needs }) => {
      const missing = needs === "denoise" ? " (not installed)" : "";
      return make("option", { value: name, disabled: needs === "denoise" }, label + missing);
    };
    fill(layer, hello.layers.map(option), choice.layer);
    fill(compared, [make("option", { value: "" }, "Nothing"), ...hello.layers.map(option)], choice.compared ?? "");
    const shown = hello.layers.filter(({ name }) => name === choice.layer || name === choice.compared);
    const unmeasured = shown.some(({ needs }) => needs === "replicates") && !measured;
    const possible = replicatesFor(hub) !== null;
    hint.hidden = turnOn.hidden = !unmeasured;
    turnOn.hidden = !unmeasured || !possible;
    setText(hint, possible ? "Error estimates require replicates. Enabling them restarts the image." : "Errors are not available for this integrator or sample count.");
  }

  function fill(select, options, value) {
    const key = (list) => list.map((each) => `${each.value}\t${each.textContent}`).join("\n");
    if (key([...select.options]) !== key(options)) select.replaceChildren(...options);
    select.value = value;
  }

  let begun = false; // what the first greeting says is how to begin; after a reconnection the choice stays
  hub.on("hello", (hello) => {
    if (!begun && hello.look !== undefined) {
      set("toneMap", (toneMap.value = hello.look.tone_map));
      setStops(hello.look.exposure);
    }
    begun = true;
    // After a reconnection the engine may have other layers.
    const known = (name) => hello.layers.some((each) => each.name === name && each.needs !== "denoise");
    if (!known(choice.layer)) choice.layer = hello.layers[0].name;
    if (choice.compared !== null && !known(choice.compared)) choice.compared = null;
    picture.show();
    update();
  });
  hub.on("state", update);
  hub.on("scene", () => {
    const visible = environment.isVisible();
    hidden.disabled = visible === null;
    hidden.checked = visible === false;
    followEnvironment(visible);
  });
  return {
    changeExposure: (by) => setStops(choice.exposure + by),
    toggleFalseColor() {
      falseColor.checked = !falseColor.checked;
      set("falseColor", falseColor.checked);
    },
    /** Turns the comparison with the denoised image on or off; says whether it could. */
    toggleDenoised() {
      const denoised = hub.newest("hello")?.layers.find((each) => each.name === "denoised");
      if (denoised === undefined || denoised.needs === "denoise") return false;
      chooseCompared(choice.compared === "denoised" ? "" : "denoised");
      return true;
    },
    content: [
      labelled("Exposure", stops, "Stops, added to the exposure of the camera", make("span", { class: "cv-number cv-slides" }, slider, stops)),
      labelled("Tone curve", toneMap),
      labelled("False colour", falseColor, "False colours of the luminance"),
      labelled("Layer", layer),
      labelled("Compare with", compared, "Shows both layers with a divider between them"),
      labelled("Hide environment", hidden, "The environment lights the scene, and the camera does not see it"),
      labelled("Alpha", alpha, "Shows what is transparent over a chequerboard, and hides the environment; .png and .exr files get alpha"),
      hint,
      turnOn,
      make("div", { class: "cv-row" }, copying.button),
      copying.shown,
    ],
  };
}
