// Camera moves. A camera is the table of a scene file: position, target, up, and vertical_fov (degrees) or height
// (metres). Every move returns a new one. Shares are parts of the image's height: a drag over all of it is 1.

const STEEPEST = (89.5 * Math.PI) / 180; // seen straight along `up`, a camera has no right

const add = (a, b, scale = 1) => a.map((x, i) => x + scale * b[i]);
const minus = (a, b) => a.map((x, i) => x - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.sqrt(dot(a, a));
const unit = (a) => a.map((x) => x / length(a));

/** Directions of a camera: forward, right, above (of the image), and the world's up, all unit vectors. */
export function directions(camera) {
  const forward = unit(minus(camera.target, camera.position));
  const up = unit(camera.up);
  const sideways = cross(forward, up);
  const right = length(sideways) > 1e-9 ? unit(sideways) : unit(cross(forward, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  return { forward, right, above: cross(right, forward), up };
}

// In a mirrored image, what lies to the right in the scene is on the left.
const mirror = (camera) => (camera.mirrored ? -1 : 1);
const isOrthographic = (camera) => camera.type === "orthographic";

// Vertical, radians; of calibrated cameras, whose numbers may be for the image as it is, it is that without distortion.
function fieldOfView(camera, image) {
  if (camera.type === "panoramic") return Math.PI;
  if (camera.type === "intrinsics") return 2 * Math.atan2(camera.resolution?.[1] ?? image.height, 2 * (camera.fy ?? camera.fx));
  return ((camera.vertical_fov ?? 60) * Math.PI) / 180;
}

// Of what the image shows at the target's distance, metres; angles are what fisheyes and panoramas show evenly.
function visibleHeight(camera, image) {
  if (isOrthographic(camera)) return camera.height;
  const angle = fieldOfView(camera, image);
  const isAngular = camera.type === "panoramic" || camera.type === "fisheye";
  return distanceToTarget(camera) * (isAngular ? angle : 2 * Math.tan(angle / 2));
}

// Of what the image shows across a square, its width as a share of its height.
function squareness(camera, image) {
  if (camera.type === "panoramic") return (2 * image.height) / image.width;
  return camera.type === "intrinsics" ? (camera.fy ?? camera.fx) / camera.fx : 1;
}

export function distanceToTarget(camera) {
  return length(minus(camera.target, camera.position));
}

/** A vector turned about a unit axis (Rodrigues' formula). */
function turned(vector, axis, angle) {
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  const along = dot(axis, vector) * (1 - cosine);
  const side = cross(axis, vector);
  return vector.map((x, i) => x * cosine + side[i] * sine + axis[i] * along);
}

/** A direction turned about up and sideways, as far as it does not pass over the pole. */
function swung(direction, camera, turn, tilt) {
  const { right, up } = directions(camera);
  const elevation = Math.asin(Math.min(Math.max(dot(unit(direction), up), -1), 1));
  // Turning about `right` by a positive angle lifts what lies ahead, and lowers what lies behind.
  const ahead = Math.sign(dot(direction, minus(camera.target, camera.position)));
  const allowed = Math.min(Math.max(elevation + ahead * tilt, -STEEPEST), STEEPEST) - elevation;
  return turned(turned(direction, right, ahead * allowed), up, turn);
}

/** Around the target: a drag to the right turns the scene to the right. */
export function orbit(camera, across, down) {
  const back = minus(camera.position, camera.target);
  return { ...camera, position: add(camera.target, swung(back, camera, -Math.PI * across * mirror(camera), -Math.PI * down)) };
}

/** The head is turned: the position stays. Some cameras show more or less by the `width` and `height` of the image. */
export function look(camera, across, down, image) {
  const ahead = minus(camera.target, camera.position);
  const angle = fieldOfView(camera, image);
  return { ...camera, target: add(camera.position, swung(ahead, camera, -angle * across * squareness(camera, image) * mirror(camera), -angle * down)) };
}

/** Sideways, so that what lies at the target's distance stays under the pointer. */
export function pan(camera, across, down, image) {
  const { right, above } = directions(camera);
  const height = visibleHeight(camera, image);
  const width = height * squareness(camera, image) * mirror(camera);
  const move = add(right.map((x) => -across * width * x), above, down * height);
  return { ...camera, position: add(camera.position, move), target: add(camera.target, move) };
}

/** Nearer to the target (factor below 1), or farther from it. */
export function zoom(camera, factor) {
  if (isOrthographic(camera)) return { ...camera, height: camera.height * factor };
  const back = minus(camera.position, camera.target).map((x) => x * factor);
  return { ...camera, position: add(camera.target, back) };
}

/** Flies by these distances, metres; sideways is to the right of the image. */
export function fly(camera, ahead, sideways, upward) {
  const { forward, right, up } = directions(camera);
  const move = add(add(forward.map((x) => x * ahead), right, sideways * mirror(camera)), up, upward);
  return { ...camera, position: add(camera.position, move), target: add(camera.target, move) };
}
