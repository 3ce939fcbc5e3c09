// A sketch of the scene in three dimensions: points that the camera sees, and paths among them.

import { make } from "./elements.js";

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => {
  const size = Math.hypot(...a) || 1;
  return [a[0] / size, a[1] / size, a[2] / size];
};
/** A vector turned about a unit axis (Rodrigues). */
const turned = (a, axis, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add([c * a[0], c * a[1], c * a[2]], cross(axis, a), s), axis, dot(axis, a) * (1 - c));
};

const STEP = 0.12;
const KEYS = { ArrowLeft: [STEP, 0], ArrowRight: [-STEP, 0], ArrowUp: [0, STEP], ArrowDown: [0, -STEP] };

/**
 * A canvas that shows points and lines from a viewpoint that the mouse and the keys move.
 *
 * `cloud`: points (3 n), colors (3 n, bytes) and the rows of the grid that they are of; `pose`: position, right, up, forward, fov; `reach`:
 * distance of what is turned about.
 * `lines()` gives [{ from, to, color, width, dash }], and `dots()` [{ at, color, size, text }], in world space.
 */
export function sketch(cloud, pose, reach, lines, dots) {
  const canvas = make("canvas");
  const stage = make("div", {
    class: "lp-stage", tabindex: 0, role: "application",
    "aria-label": "Scene in three dimensions. Arrow keys turn it, plus and minus move closer and away, 0 returns to the camera.",
  }, canvas);
  const context = canvas.getContext("2d");
  let view, asked = false;

  const reset = () => {
    const target = add(pose.position, pose.forward, reach);
    view = { target, distance: reach, right: unit(pose.right), up: unit(pose.up), forward: unit(pose.forward) };
  };
  const eye = () => add(view.target, view.forward, -view.distance);
  const project = (point, from, focal, width, height) => {
    const to = add(point, from, -1), depth = dot(to, view.forward);
    return [width / 2 + focal * dot(to, view.right) / depth, height / 2 - focal * dot(to, view.up) / depth, depth];
  };
  const orbit = (across, upward) => {
    const axis = unit(pose.up);
    for (const name of ["right", "up", "forward"]) view[name] = unit(turned(view[name], axis, across));
    for (const name of ["up", "forward"]) view[name] = unit(turned(view[name], view.right, upward));
  };
  const move = (x, y) => {
    view.target = add(add(view.target, view.right, -x * view.distance), view.up, y * view.distance);
  };
  const zoom = (factor) => {
    view.distance = Math.min(Math.max(view.distance * factor, reach * 1e-3), reach * 1e3);
  };

  const draw = () => {
    asked = false;
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * scale)), height = Math.max(1, Math.round(canvas.clientHeight * scale));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const from = eye(), focal = height / 2 / Math.tan((Math.min(pose.fov, 150) * Math.PI) / 360);
    const picture = context.createImageData(width, height), words = new Uint32Array(picture.data.buffer);
    words.fill(0xff141414);
    const depths = new Float32Array(width * height).fill(Infinity);
    const near = view.distance * 1e-3, { points, colors } = cloud;
    // Seen from the camera points are somewhat larger than their grid is wide, as each is anywhere in its cell
    const side = Math.max(1, Math.min(Math.round((1.6 * (height / Math.max(cloud.rows, 1)) * reach) / view.distance), 8));
    const [r, u, f] = [view.right, view.up, view.forward];
    for (let i = 0; i < points.length; i += 3) {
      const x = points[i] - from[0], y = points[i + 1] - from[1], z = points[i + 2] - from[2];
      const depth = x * f[0] + y * f[1] + z * f[2];
      if (depth < near) continue;
      const column = Math.round(width / 2 + (focal * (x * r[0] + y * r[1] + z * r[2])) / depth);
      const row = Math.round(height / 2 - (focal * (x * u[0] + y * u[1] + z * u[2])) / depth);
      // Points are dimmer than the paths, which have to be seen
      const color = 0xff000000 | ((colors[i + 2] * 0.6) << 16) | ((colors[i + 1] * 0.6) << 8) | (colors[i] * 0.6);
      for (let dy = 0; dy < side; dy += 1) for (let dx = 0; dx < side; dx += 1) {
        const [px, py] = [column + dx, row + dy];
        if (px < 0 || py < 0 || px >= width || py >= height || depth >= depths[py * width + px]) continue;
        depths[py * width + px] = depth;
        words[py * width + px] = color;
      }
    }
    context.putImageData(picture, 0, 0);
    context.lineCap = "round";
    for (const line of lines()) {
      // Cut off what lies behind the viewer
      let [a, b] = [line.from, line.to];
      const [da, db] = [dot(add(a, from, -1), f), dot(add(b, from, -1), f)];
      if (da < near && db < near) continue;
      if (da < near) a = add(b, add(a, b, -1), (db - near) / (db - da));
      if (db < near) b = add(a, add(b, a, -1), (da - near) / (da - db));
      const [p, q] = [project(a, from, focal, width, height), project(b, from, focal, width, height)];
      context.strokeStyle = line.color;
      context.lineWidth = line.width * scale;
      context.setLineDash((line.dash || []).map((length) => length * scale));
      context.beginPath();
      context.moveTo(p[0], p[1]);
      context.lineTo(q[0], q[1]);
      context.stroke();
    }
    context.setLineDash([]);
    context.font = `600 ${11 * scale}px system-ui, sans-serif`;
    for (const each of dots()) {
      const [x, y, depth] = project(each.at, from, focal, width, height);
      if (depth < near) continue;
      context.fillStyle = each.color;
      context.strokeStyle = "#000";
      context.lineWidth = scale;
      context.beginPath();
      context.arc(x, y, each.size * scale, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
      if (!each.text) continue;
      context.lineWidth = 3 * scale;
      context.strokeText(each.text, x + 6 * scale, y - 5 * scale);
      context.fillText(each.text, x + 6 * scale, y - 5 * scale);
    }
  };
  const redraw = () => {
    if (!asked) requestAnimationFrame(draw);
    asked = true;
  };

  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    stage.focus({ preventScroll: true });
  });
  stage.addEventListener("pointermove", (event) => {
    if (!stage.hasPointerCapture(event.pointerId)) return;
    const [x, y] = [event.movementX / stage.clientHeight, event.movementY / stage.clientHeight];
    if (event.shiftKey || event.buttons & 6) move(x, y);
    else orbit(-3 * x, -3 * y);
    redraw();
  });
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0015));
    redraw();
  }, { passive: false });
  stage.addEventListener("keydown", (event) => {
    if (KEYS[event.key] && event.shiftKey) move(-KEYS[event.key][0], -KEYS[event.key][1]);
    else if (KEYS[event.key]) orbit(...KEYS[event.key]);
    else if (event.key === "+" || event.key === "=") zoom(0.85);
    else if (event.key === "-") zoom(1 / 0.85);
    else if (event.key === "0" || event.key === "Home") reset();
    else return;
    event.preventDefault();
    redraw();
  });
  stage.addEventListener("dblclick", () => {
    reset();
    redraw();
  });
  new ResizeObserver(redraw).observe(stage);
  reset();
  return { element: stage, redraw, reset };
}
