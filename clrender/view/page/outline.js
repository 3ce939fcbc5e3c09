// The outline of what is picked, over the image.

const QUIET = 400; // milliseconds without another image, before where the object is now is asked for
const NAMESPACE = "http://www.w3.org/2000/svg";

function shape(tag, attributes) {
  const element = document.createElementNS(NAMESPACE, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/** The outline: `element` to lay over the image, and `show(object)` for an object's number, or null. */
export function createOutline(hub) {
  // Light on dark: one of both is seen before any image.
  const lines = ["cv-outline-edge", "cv-outline-line"].map((name) => shape("path", { class: name, "vector-effect": "non-scaling-stroke" }));
  const element = shape("svg", { class: "cv-outline", preserveAspectRatio: "none", "aria-hidden": "true" });
  element.append(...lines);
  let object = null;
  let place = ""; // camera and size that the outline is of
  let revision = null;
  let timer = null;
  let asked = 0;

  const placeNow = () => {
    const state = hub.newest("state");
    return JSON.stringify([state?.camera, state?.width, state?.height, state?.settings?.crop]);
  };

  function draw(path, width = 1, height = 1) {
    element.setAttribute("viewBox", `0 0 ${width} ${height}`);
    lines.forEach((line) => line.setAttribute("d", path));
  }

  function ask() {
    clearTimeout(timer);
    if (object === null) return;
    asked += 1;
    const [question, about, of] = [asked, object, placeNow()];
    hub.send({ type: "outline", object }, (reply) => {
      if (question !== asked || about !== object || of !== placeNow()) return true; // another one is on its way
      place = of;
      if (reply.type === "outline") draw(reply.path, reply.width, reply.height);
      return true;
    });
  }

  hub.on("state", (state) => {
    if (object === null || state.revision === revision) return;
    revision = state.revision;
    if (placeNow() !== place) draw(""); // it would lie beside the object
    clearTimeout(timer);
    timer = setTimeout(ask, QUIET);
  });
  hub.on("scene", () => (revision = null));

  return {
    element,
    show(number) {
      if (number === object) return;
      object = number;
      draw("");
      revision = hub.newest("state")?.revision ?? null;
      ask();
    },
  };
}
