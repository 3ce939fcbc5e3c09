// Paths over a picture of the scene, as a perspective camera sees them.

/** An element of SVG. */
export function svg(tag, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/** Marks of a shape that are seen before any image: white over black. */
export function marks(tag, attributes) {
  return [["#000", 4], ["#fff", 1.5]].map(([color, width]) =>
    svg(tag, { ...attributes, fill: "none", stroke: color, "stroke-width": width, "vector-effect": "non-scaling-stroke" }));
}

/** Where a point is in the image, from 0 to 1, and its depth; only of perspective cameras. */
function inImage(camera, aspect, point) {
  const { position, right, up, forward, fov } = camera, to = point.map((each, axis) => each - position[axis]);
  const along = (axis) => to[0] * axis[0] + to[1] * axis[1] + to[2] * axis[2];
  const half = Math.tan((fov * Math.PI) / 360), depth = along(forward);
  return [0.5 + along(right) / (depth * half * 2 * aspect), 0.5 - along(up) / (depth * half * 2), depth];
}

/**
 * A layer to lay over a picture: `element`, and `draw(lines)`.
 *
 * `data`: width, height and pixel of the image; `around`: camera and reach; `part`: left, top, width and height of what
 * the picture shows of the image.
 */
export function createOverlay(data, around, part = [0, 0, data.width, data.height]) {
  const element = svg("svg", { viewBox: part.join(" "), "aria-hidden": "true", preserveAspectRatio: "none" });
  const camera = around.camera, place = (point) => inImage(camera, data.width / data.height, point);

  function draw(lines) {
    element.replaceChildren();
    for (const line of camera.projects ? lines : []) {
      const least = 1e-3 * around.reach;
      let [a, b] = [line.from, line.to];
      const [da, db] = [place(a)[2], place(b)[2]];
      if (da < least && db < least) continue;
      const between = (share) => a.map((each, axis) => each + (b[axis] - each) * share);
      if (da < least) a = between((least - da) / (db - da));
      else if (db < least) b = between((da - least) / (da - db));
      const [[x1, y1], [x2, y2]] = [place(a), place(b)];
      element.append(svg("line", {
        x1: x1 * data.width, y1: y1 * data.height, x2: x2 * data.width, y2: y2 * data.height, stroke: line.color,
        "stroke-width": line.width, "vector-effect": "non-scaling-stroke", ...(line.dash ? { "stroke-dasharray": "4 4" } : {}),
      }));
    }
    const [x, y] = data.pixel.map((each) => each + 0.5), size = Math.max(part[2], part[3]) / 50;
    element.append(...marks("circle", { cx: x, cy: y, r: size }));
  }
  return { element, draw };
}
