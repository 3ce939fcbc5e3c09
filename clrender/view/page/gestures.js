// Turns pointer, wheel and keys on the image into camera moves and picks.

const CLICK_DISTANCE = 4; // pixels: a pointer that moved less was held still
const KEY_STEP = 0.04; // of the image's height, for each press of an arrow key
const WHEEL_RATE = 0.0012;
const OF_ITS_OWN = "button, input, select, textarea, a, summary, pre, dialog, [role=region]"; // what does something else with keys
const FLY_KEYS = { w: [1, 0, 0], s: [-1, 0, 0], d: [0, 1, 0], a: [0, -1, 0], e: [0, 0, 1], q: [0, 0, -1] };

/**
 * Listens on an element that shows an image.
 * @param {HTMLElement} stage takes the keyboard's focus
 * @param {HTMLElement} picture the image in it
 * @param {Object} actions functions: orbit, look, pan (shares of the image's height), zoom (factor), fly (three
 *   directions and seconds), click and hover (places 0..1 in the image; hover null: left), and key (name, whether
 *   with Shift), which says whether it took the key
 * @param {boolean} shared whether the page has other contents, which get the keys and the wheel while the image has not
 *   the focus
 */
export function listenToGestures(stage, picture, actions, shared) {
  const pointers = new Map(); // id -> last place
  let travelled = 0;
  let held = "orbit";

  const placeIn = (event) => {
    const box = picture.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    return x >= 0 && x < 1 && y >= 0 && y < 1 ? [x, y] : null;
  };
  const share = (pixels) => pixels / Math.max(picture.getBoundingClientRect().height, 1);

  stage.addEventListener("contextmenu", (event) => event.preventDefault());

  stage.addEventListener("pointerdown", (event) => {
    if (event.target.closest("button, input, a, .cv-card")) return;
    stage.focus({ preventScroll: true });
    stage.setPointerCapture(event.pointerId);
    if (pointers.size === 0) travelled = 0;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    held = event.button === 2 || event.button === 1 || event.shiftKey ? "pan" : event.altKey ? "look" : "orbit";
    event.preventDefault();
  });

  stage.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (before === undefined) {
      if (event.pointerType === "mouse") actions.hover(placeIn(event));
      return;
    }
    const move = [event.clientX - before[0], event.clientY - before[1]];
    travelled += Math.hypot(...move);
    if (pointers.size === 1) {
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      if (travelled > CLICK_DISTANCE) actions[held](share(move[0]), share(move[1]));
      return;
    }
    // Two fingers: their distance zooms, their middle pans.
    const spread = () => {
      const [a, b] = [...pointers.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    const old = spread();
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (spread() > 0 && old > 0) actions.zoom(old / spread());
    actions.pan(share(move[0]) / 2, share(move[1]) / 2);
  });

  const release = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (pointers.size > 0) return;
    if (travelled <= CLICK_DISTANCE && event.type === "pointerup" && held === "orbit") {
      const place = placeIn(event);
      if (place !== null) actions.click(place);
    }
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);
  stage.addEventListener("pointerleave", () => actions.hover(null));

  stage.addEventListener(
    "wheel",
    (event) => {
      if (event.target.closest(".cv-card") || (shared && !stage.contains(document.activeElement) && !event.ctrlKey)) return;
      event.preventDefault();
      const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
      actions.zoom(Math.exp(WHEEL_RATE * (event.ctrlKey ? 8 : 1) * Math.min(Math.max(pixels, -500), 500)));
    },
    { passive: false },
  );

  listenToKeys(shared ? stage : document, actions);
}

function listenToKeys(target, actions) {
  const flying = new Set();
  let last = 0;
  let stepping = false;

  function step(now) {
    stepping = flying.size > 0;
    if (!stepping) return;
    const seconds = Math.min((now - last) / 1000, 0.1);
    last = now;
    const sum = [0, 0, 0];
    flying.forEach((key) => FLY_KEYS[key].forEach((value, i) => (sum[i] += value)));
    if (sum.some((value) => value !== 0)) actions.fly(sum, seconds);
    requestAnimationFrame(step);
  }

  target.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.target.closest(OF_ITS_OWN) || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const taken = actions.key(key, event.shiftKey) || moved(key, event.shiftKey) || flown(key);
    if (taken) event.preventDefault();
  });

  function moved(key, shifted) {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (key in arrows) actions[shifted ? "pan" : "orbit"](...arrows[key].map((part) => part * KEY_STEP));
    else if (key === "+" || key === "=") actions.zoom(0.9);
    else if (key === "-") actions.zoom(1 / 0.9);
    else return false;
    return true;
  }

  function flown(key) {
    if (!(key in FLY_KEYS)) return false;
    if (!stepping) {
      last = performance.now();
      stepping = true;
      requestAnimationFrame(step);
    }
    flying.add(key);
    return true;
  }

  target.addEventListener("keyup", (event) => flying.delete(event.key.toLowerCase()));
  for (const source of [target, window]) source.addEventListener("blur", () => flying.clear());
}
