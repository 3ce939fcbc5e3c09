// The plot of the error over time, both on logarithmic scales: unbiased noise falls on a line.

import { make, readable, readableTime, setText } from "./elements.js";

const WIDTH = 240;
const HEIGHT = 44;
const MOST_POINTS = 400;
const NAMESPACE = "http://www.w3.org/2000/svg";

function shape(tag, attributes) {
  const element = document.createElementNS(NAMESPACE, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

const LEAST_SPAN = Math.log(10) / 2; // of the scale of errors: a level line is not blown up to a mountain

/** A chart with its axes: `element` to place, `add(seconds, error)`, `clear()`. */
export function createChart() {
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const line = shape("polyline", { class: "cv-chart-line", "vector-effect": "non-scaling-stroke" });
  const slope = shape("line", { class: "cv-chart-slope", "vector-effect": "non-scaling-stroke" });
  svg.append(slope, line);
  const label = (place) => make("span", { class: `cv-chart-${place}`, "aria-hidden": "true" });
  const ends = { most: label("most"), least: label("least"), begin: label("begin"), end: label("end") };
  const about = "Relative standard error over the time of the render, both on logarithmic scales; dashed: 1/√time";
  const element = make("div", { class: "cv-chart", role: "img", title: about }, svg, ...Object.values(ends));
  let points = [];

  function draw() {
    element.setAttribute("aria-label", words());
    element.classList.toggle("cv-chart-empty", points.length < 2);
    if (points.length < 2) {
      Object.values(ends).forEach((each) => setText(each, ""));
      line.setAttribute("points", "");
      slope.setAttribute("visibility", "hidden");
      return;
    }
    const [first, last] = [points[0], points[points.length - 1]];
    const errors = points.map((point) => point[1]);
    const [low, high] = [Math.log(Math.min(...errors)), Math.log(Math.max(...errors))];
    const [begin, end] = [Math.log(first[0]), Math.log(last[0])];
    const span = Math.max(high - low, LEAST_SPAN);
    setText(ends.most, `${readable(100 * Math.exp(high), 2)} %`);
    setText(ends.least, `${readable(100 * Math.exp(high - span), 2)} %`);
    setText(ends.begin, readableTime(first[0]));
    setText(ends.end, readableTime(last[0]));
    const x = (seconds) => ((Math.log(seconds) - begin) / Math.max(end - begin, 1e-6)) * WIDTH;
    const y = (error) => 1 + ((high - Math.log(error)) / span) * (HEIGHT - 2);
    line.setAttribute("points", points.map(([seconds, error]) => `${x(seconds).toFixed(1)},${y(error).toFixed(1)}`).join(" "));
    // Where the error falls with the root of the time, as Monte Carlo noise does, through the last point.
    const expected = last[1] * Math.sqrt(last[0] / first[0]);
    for (const [name, value] of Object.entries({ x1: 0, y1: y(expected), x2: WIDTH, y2: y(last[1]), visibility: "visible" })) {
      slope.setAttribute(name, value);
    }
  }

  function words() {
    if (points.length === 0) return "Error over time: no data yet";
    const [seconds, error] = points[points.length - 1];
    return `Error over time: ${readable(100 * error)} % after ${readableTime(seconds)}`;
  }

  draw();
  return {
    element,
    add(seconds, error) {
      const last = points[points.length - 1];
      if (!(seconds > 0 && error > 0) || (last !== undefined && seconds <= last[0])) return;
      points.push([seconds, error]);
      if (points.length > MOST_POINTS) points = points.filter((_, i) => i % 2 === 0 || i === points.length - 1);
      draw();
    },
    clear() {
      points = [];
      draw();
    },
  };
}
