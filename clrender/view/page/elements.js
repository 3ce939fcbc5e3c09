// Makes elements of the page with few words.

/** An element. Attributes by name; those that begin with "on" are listeners; false, null and undefined leave one out. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** Sets a text only where it changed: what did not change is not laid out, nor read aloud, again. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

let elementCount = 0;

/** An id that no other element of the document has, also with several views in one notebook. */
export function freshId(word) {
  elementCount += 1;
  return `clrender-${word}-${elementCount}`;
}

/** A number for reading: a few digits, and powers of ten where it is far from 1. */
export function readable(value, digits = 3) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "not a number" : value > 0 ? "infinite" : "-infinite";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}

/** A large count for reading: 3.2 M. */
export function readableCount(value) {
  for (const [limit, word] of [[1e12, " T"], [1e9, " G"], [1e6, " M"], [1e3, " k"]]) {
    if (value >= limit) return `${(value / limit).toPrecision(3)}${word}`;
  }
  return String(Math.round(value));
}

/** Seconds for reading: 0.42 s, 12 s, 3:05, 1:02:03, 4 days. */
export function readableTime(seconds) {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.round(seconds)} s`;
  const whole = Math.round(seconds);
  const two = (number) => String(number).padStart(2, "0");
  if (whole >= 48 * 3600) return `${Math.round(whole / 86400)} days`;
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}
