// Input fields for values that JSON Schema describes: a choice, a truth value, a number, several, a colour.

import { freshId, make, readable, setText } from "./elements.js";
import { srgbEncode } from "./tone_map.js";

const QUIET = 400; // milliseconds after an entry in which the engine may still tell of earlier ones

/**
 * A labelled field.
 * @param {Object} about `label`, `help`, `schema`, `default_words` for null, `optional` (false: it cannot be emptied;
 *   true: it may be without a value), for colours `kind: "color"` and `strength` (whether they have one of their own),
 *   and for places and directions `kind: "vector"`
 * @param {(value: any) => void} changed called with what the user entered, null where a field was emptied
 * @returns {{element: HTMLElement, show: (value: any, changed: boolean) => void, complain: (text: string) => void}}
 */
export function createField(about, changed) {
  const id = freshId("field");
  const complaint = make("p", { class: "cv-complaint", id: `${id}-complaint`, role: "alert", hidden: true });
  const input = inputFor(about, id, enter);
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
  let told = null; // the newest value of the engine
  let isTyping = false; // a text that is not entered yet, which is not overwritten
  let quiet = null; // timer after an entry
  let missed = false; // the engine has told a value since

  /** What a control takes for entered; undefined: nothing that could be a value. */
  function enter(value) {
    isTyping = false;
    if (value === undefined || (value === null && about.optional === false)) {
      input.again();
      return;
    }
    complaint.hidden = true;
    // What is entered next, such as a strength beside a colour, is of this value, whatever the engine has told so far.
    if (value !== null) input.remember(value);
    clearTimeout(quiet);
    quiet = setTimeout(endQuiet, QUIET);
    changed(value);
  }

  function endQuiet() {
    quiet = null;
    if (missed) catchUp();
  }

  function catchUp() {
    missed = false;
    input.remember(told);
    if (!isTyping) input.again();
  }

  input.element.addEventListener("input", (event) => (isTyping = event.target.type === "number"));
  input.element.addEventListener("focusout", (event) => {
    // Another window, or another number of this field, does not end what is typed.
    if (input.element.contains(event.relatedTarget) || !document.hasFocus()) return;
    isTyping = false;
    input.again();
  });
  return {
    element,
    show(value, isChanged) {
      undo.hidden = !isChanged;
      element.classList.toggle("cv-changed", Boolean(isChanged));
      told = value;
      if (quiet === null) catchUp();
      else missed = true;
    },
    complain(text) {
      setText(complaint, text);
      complaint.hidden = false;
      isTyping = false;
      catchUp();
    },
  };
}

/** Writes a text into a control; a cursor in it stays where it is if that is the same. */
function write(control, text) {
  if (control.value !== text) control.value = text;
}

/** The part of a schema that says what a value is, where it may also be null; and whether it may. */
function plainSchema(schema) {
  const parts = schema.anyOf ?? [schema];
  const plain = parts.find((part) => part.type !== "null") ?? schema;
  return { plain, optional: parts.some((part) => part.type === "null") };
}

/** A control: its `element`, `remember(value)` for what it is to show, and `again()`, which shows that. */
function inputFor(about, id, enter) {
  const { plain, optional } = plainSchema(about.schema ?? {});
  if (about.kind === "color") return colorInput(about, id, enter);
  if (about.kind === "vector") return seriesInput(["x", "y", "z"], "any", about, id, enter);
  if (plain.type === "array") {
    const parts = plain.prefixItems?.length === 4 ? ["left", "top", "width", "height"] : ["first", "count"];
    return seriesInput(parts, 1, about, id, enter);
  }
  if (plain.enum !== undefined) return choiceInput(plain.enum, optional || about.optional === true, about, id, enter);
  if (plain.type === "boolean" || about.kind === "flag") return flagInput(id, enter);
  return numberInput(plain, about, id, enter);
}

function choiceInput(values, optional, about, id, enter) {
  const options = optional ? [null, ...values] : values;
  const words = (value) => (value === null ? (about.default_words ?? "–") : String(value));
  const element = make("select", { id }, ...options.map((value, i) => make("option", { value: i }, words(value))));
  let last = 0;
  element.addEventListener("change", () => enter(options[Number(element.value)]));
  return {
    element,
    remember: (value) => (last = Math.max(options.indexOf(value ?? null), 0)),
    again: () => write(element, String(last)),
  };
}

function flagInput(id, enter) {
  const element = make("input", { id, type: "checkbox" });
  let last = false;
  element.addEventListener("change", () => enter(element.checked));
  return {
    element,
    remember: (value) => (last = Boolean(value)),
    again: () => (element.checked = last),
  };
}

/** A number; between bounds that are near to each other also a slider. */
function numberInput(schema, about, id, enter) {
  const low = schema.minimum ?? schema.exclusiveMinimum;
  const high = schema.maximum ?? schema.exclusiveMaximum;
  const whole = schema.type === "integer";
  const number = make("input", { id, type: "number", min: low, max: high, step: whole ? 1 : "any", inputmode: whole ? "numeric" : "decimal", placeholder: about.default_words ?? "–" });
  const slides = !whole && low !== undefined && high !== undefined && high - low <= 10;
  const slider = slides ? make("input", { type: "range", min: low, max: high, step: (high - low) / 200, "aria-label": about.label }) : null;
  const element = make("span", { class: slides ? "cv-number cv-slides" : "cv-number" }, slider, number);
  let last = null;
  number.addEventListener("change", () => {
    if (number.validity.badInput) enter(undefined);
    else enter(number.value === "" ? null : Number(number.value));
  });
  slider?.addEventListener("input", () => {
    number.value = readable(Number(slider.value), 4);
    enter(Number(slider.value));
  });
  return {
    element,
    remember: (value) => (last = value ?? null),
    again() {
      write(number, last === null ? "" : whole ? String(last) : String(Number(last.toPrecision(6))));
      if (slider !== null) write(slider, String(last ?? low));
    },
  };
}

const SHORT = { left: "x", top: "y", width: "w", height: "h" }; // for placeholders

/**
 * Controls of several numbers that are one value: what they hold is rounded, and a number whose text is as it was shown
 * stays exactly what it was.
 * @param {(values: number[] | null | undefined) => void} enter as of `createField`; nothing while some are missing
 * @param {boolean} waits whether a number that was emptied waits for the others to be emptied, too
 */
function numbersTogether(numbers, shownText, waits, enter) {
  let last = null;
  let shown = numbers.map(() => "");

  function entered() {
    const texts = numbers.map((each) => each.value);
    const given = texts.filter((text) => text !== "").length;
    if (numbers.some((each) => each.validity.badInput)) enter(undefined);
    else if (given === 0) enter(null);
    else if (given < texts.length) {
      if (last !== null && !waits) enter(undefined);
    } else {
      const values = texts.map((text, i) => (last !== null && shown[i] !== "" && Number(text) === Number(shown[i]) ? last[i] : Number(text)));
      shown = texts;
      enter(values);
    }
  }
  numbers.forEach((input) => input.addEventListener("change", entered));
  return {
    last: () => last,
    remember: (values) => (last = values ?? null),
    again() {
      shown = numbers.map((_, i) => (last === null ? "" : shownText(last[i])));
      numbers.forEach((input, i) => write(input, shown[i]));
    },
  };
}

/** Several numbers, which count when all are there; null where all are emptied. */
function seriesInput(names, step, about, id, enter) {
  const numbers = names.map((name, i) =>
    make("input", { id: i === 0 ? id : null, type: "number", step, inputmode: "decimal", placeholder: SHORT[name] ?? name, "aria-label": `${about.label}: ${name}` }),
  );
  const together = numbersTogether(numbers, (value) => String(Number(value.toPrecision(6))), about.optional !== false, enter);
  return {
    element: make("span", { class: "cv-series", role: "group", "aria-label": about.label }, ...numbers),
    remember: together.remember,
    again: together.again,
  };
}

const srgbDecode = (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
const hexadecimal = (x) => Math.round(255 * srgbEncode(Math.min(Math.max(x, 0), 1))).toString(16).padStart(2, "0");

/**
 * A linear colour: the browser's picker, which holds 0..1 in sRGB, and three numbers, which hold any. That of a light
 * has a strength, its largest number, which the picker leaves as it is.
 */
function colorInput(about, id, enter) {
  const picker = make("input", { type: "color", "aria-label": `${about.label}: pick` });
  const numbers = ["red", "green", "blue"].map((name, i) =>
    make("input", { id: i === 0 ? id : null, type: "number", min: 0, step: "any", inputmode: "decimal", "aria-label": `${about.label}: ${name}` }),
  );
  const strength = about.strength ? make("input", { type: "number", min: 0, step: "any", inputmode: "decimal", title: "Its largest number", "aria-label": `${about.label}: strength` }) : null;
  const together = numbersTogether(numbers, (value) => readable(value, 4), about.optional === true, (values) => {
    enter(values);
    if (values) again();
  });
  const { last } = together;
  const brightest = () => (strength === null ? 1 : Math.max(...(last() ?? [0])) || 1);
  function showOthers() {
    if (strength !== null) write(strength, last() === null ? "" : readable(Math.max(...last()), 4));
    together.again();
  }
  function again() {
    write(picker, `#${(last() ?? [0, 0, 0]).map((value) => hexadecimal(value / brightest())).join("")}`);
    showOthers();
  }
  strength?.addEventListener("change", () => {
    const value = Number(strength.value);
    if (strength.value === "" || last() === null) enter(undefined);
    else if (Math.max(...last()) === 0) enter([value, value, value]);
    else enter(last().map((each) => (each / brightest()) * value));
    again();
  });
  picker.addEventListener("input", () => {
    const part = (at) => srgbDecode(parseInt(picker.value.slice(at, at + 2), 16) / 255);
    enter([1, 3, 5].map((at) => Number((part(at) * brightest()).toPrecision(4))));
    showOthers();
  });
  return {
    element: make("span", { class: strength === null ? "cv-color" : "cv-color cv-strong" }, picker, ...numbers, strength),
    remember: (value) => together.remember(typeof value === "number" ? [value, value, value] : value), // a number is a grey
    again,
  };
}
