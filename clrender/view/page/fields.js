// Input fields for values that JSON Schema describes: a choice, a truth value, a number, several, a colour.

import { freshId, make, readable, setText } from "./elements.js";
import { srgbEncode } from "./tone_map.js";

/**
 * A labelled field.
 * @param {Object} about `label`, `help`, `schema`, `default_words` for null, for colours `kind: "color"` and `strength`
 *   (whether they have one of their own), and for places and directions `kind: "vector"`
 * @param {(value: any) => void} changed called with what the user entered, null where a field was emptied
 * @returns {{element: HTMLElement, show: (value: any, changed: boolean) => void, complain: (text: string) => void}}
 */
export function createField(about, changed) {
  const id = freshId("field");
  const complaint = make("p", { class: "cv-complaint", id: `${id}-complaint`, role: "alert", hidden: true });
  const input = inputFor(about, id, (value) => {
    complaint.hidden = true;
    changed(value);
  });
  const undo = make(
    "button",
    { type: "button", class: "cv-undo", hidden: true, title: "Reset", "aria-label": `${about.label}: reset`, onclick: () => changed(null) },
    "↺",
  );
  const label = make("label", { for: id, title: about.help ?? null }, about.label);
  const control = input.element.id === id ? input.element : input.element.querySelector(`#${id}`);
  control.title = about.help ?? "";
  control.setAttribute("aria-describedby", complaint.id);
  const element = make("div", { class: "cv-field" }, label, input.element, undo, complaint);
  return {
    element,
    show(value, isChanged) {
      undo.hidden = !isChanged;
      element.classList.toggle("cv-changed", Boolean(isChanged));
      // Nobody's typing is overwritten.
      if (!input.element.contains(document.activeElement) || input.element.tagName === "SELECT") input.show(value);
    },
    complain(text) {
      setText(complaint, text);
      complaint.hidden = false;
      input.again();
    },
  };
}

/** The part of a schema that says what a value is, where it may also be null; and whether it may. */
function plainSchema(schema) {
  const parts = schema.anyOf ?? [schema];
  const plain = parts.find((part) => part.type !== "null") ?? schema;
  return { plain, optional: parts.some((part) => part.type === "null") };
}

function inputFor(about, id, changed) {
  const { plain, optional } = plainSchema(about.schema ?? {});
  if (about.kind === "color") return colorInput(about, id, changed);
  if (about.kind === "vector") return seriesInput(["x", "y", "z"], "any", about, id, changed);
  if (plain.type === "array") {
    const parts = plain.prefixItems?.length === 4 ? ["left", "top", "width", "height"] : ["first", "count"];
    return seriesInput(parts, 1, about, id, changed);
  }
  if (plain.enum !== undefined) return choiceInput(plain.enum, optional, about, id, changed);
  if (plain.type === "boolean" || about.kind === "flag") return flagInput(id, changed);
  return numberInput(plain, about, id, changed);
}

function choiceInput(values, optional, about, id, changed) {
  const options = optional ? [null, ...values] : values;
  const words = (value) => (value === null ? (about.default_words ?? "–") : String(value));
  const element = make("select", { id }, ...options.map((value, i) => make("option", { value: i }, words(value))));
  element.addEventListener("change", () => changed(options[Number(element.value)]));
  let last = 0;
  const again = () => (element.value = String(last));
  return {
    element,
    again,
    show(value) {
      last = Math.max(options.findIndex((option) => option === value), 0);
      again();
    },
  };
}

function flagInput(id, changed) {
  const element = make("input", { id, type: "checkbox" });
  let last = false;
  element.addEventListener("change", () => changed(element.checked));
  const again = () => (element.checked = last);
  return {
    element,
    again,
    show(value) {
      last = Boolean(value);
      again();
    },
  };
}

/** A number; between bounds that are near to each other also a slider. */
function numberInput(schema, about, id, changed) {
  const low = schema.minimum ?? schema.exclusiveMinimum;
  const high = schema.maximum ?? schema.exclusiveMaximum;
  const whole = schema.type === "integer";
  const number = make("input", { id, type: "number", min: low, max: high, step: whole ? 1 : "any", inputmode: whole ? "numeric" : "decimal", placeholder: about.default_words ?? "–" });
  const slides = !whole && low !== undefined && high !== undefined && high - low <= 10;
  const slider = slides ? make("input", { type: "range", min: low, max: high, step: (high - low) / 200, "aria-label": about.label }) : null;
  const element = make("span", { class: slides ? "cv-number cv-slides" : "cv-number" }, slider, number);
  let last = null;
  const again = () => {
    number.value = last === null || last === undefined ? "" : whole ? String(last) : String(Number(last.toPrecision(6)));
    if (slider !== null) slider.value = String(last ?? low);
  };
  number.addEventListener("change", () => {
    if (number.validity.badInput) again();
    else changed(number.value === "" ? null : Number(number.value));
  });
  slider?.addEventListener("input", () => {
    number.value = readable(Number(slider.value), 4);
    changed(Number(slider.value));
  });
  return {
    element,
    again,
    show(value) {
      last = value;
      again();
    },
  };
}

const SHORT = { left: "x", top: "y", width: "w", height: "h" }; // for placeholders

/** Several numbers, which count when all are there; null where all are emptied. */
function seriesInput(names, step, about, id, changed) {
  const numbers = names.map((name, i) =>
    make("input", { id: i === 0 ? id : null, type: "number", step, inputmode: "decimal", placeholder: SHORT[name] ?? name, "aria-label": `${about.label}: ${name}` }),
  );
  let last = null;
  const again = () => numbers.forEach((input, i) => (input.value = last === null ? "" : String(Number(last[i].toPrecision(6)))));
  function entered() {
    const texts = numbers.map((each) => each.value);
    if (numbers.some((each) => each.validity.badInput)) again();
    else if (texts.every((text) => text === "")) changed(null);
    else if (texts.every((text) => text !== "")) changed(texts.map(Number));
  }
  numbers.forEach((input) => input.addEventListener("change", entered));
  return {
    element: make("span", { class: "cv-series", role: "group", "aria-label": about.label }, ...numbers),
    again,
    show(value) {
      last = value ?? null;
      again();
    },
  };
}

const srgbDecode = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
const hexadecimal = (x) => Math.round(255 * srgbEncode(Math.min(Math.max(x, 0), 1))).toString(16).padStart(2, "0");

/**
 * A linear colour: the browser's picker, which holds 0..1 in sRGB, and three numbers, which hold any. That of a light
 * has a strength, its largest number, which the picker leaves as it is.
 */
function colorInput(about, id, changed) {
  const picker = make("input", { type: "color", "aria-label": `${about.label}: pick` });
  const numbers = ["red", "green", "blue"].map((name, i) =>
    make("input", { id: i === 0 ? id : null, type: "number", min: 0, step: "any", inputmode: "decimal", "aria-label": `${about.label}: ${name}` }),
  );
  const strength = about.strength ? make("input", { type: "number", min: 0, step: "any", inputmode: "decimal", title: "Its largest number", "aria-label": `${about.label}: strength` }) : null;
  let last = null;
  const brightest = () => (strength === null ? 1 : Math.max(...(last ?? [0])) || 1);
  const again = () => {
    picker.value = `#${(last ?? [0, 0, 0]).map((value) => hexadecimal(value / brightest())).join("")}`;
    numbers.forEach((input, i) => (input.value = last === null ? "" : readable(last[i], 4)));
    if (strength !== null) strength.value = last === null ? "" : readable(Math.max(...last), 4);
  };
  strength?.addEventListener("change", () => {
    if (strength.value === "" || last === null) again();
    else if (Math.max(...last) === 0) changed([1, 1, 1].map(() => Number(strength.value)));
    else changed(last.map((value) => (value / brightest()) * Number(strength.value)));
  });
  picker.addEventListener("input", () => {
    const part = (at) => srgbDecode(parseInt(picker.value.slice(at, at + 2), 16) / 255);
    const linear = [1, 3, 5].map((at) => Number((part(at) * brightest()).toPrecision(4)));
    numbers.forEach((input, i) => (input.value = readable(linear[i], 4)));
    changed(linear);
  });
  numbers.forEach((input) => input.addEventListener("change", () => changed(numbers.map((each) => Number(each.value)))));
  return {
    element: make("span", { class: strength === null ? "cv-color" : "cv-color cv-strong" }, picker, ...numbers, strength),
    again,
    show(value) {
      last = typeof value === "number" ? [value, value, value] : value; // a number is a grey
      again();
    },
  };
}
