// The live view: an image that refines, the camera in one's hand, everything about a pixel, every control.

import { createCamera, createCameraPanel } from "./camera_panel.js";
import { make, setText } from "./elements.js";
import { createEnvironmentPanel } from "./environment_panel.js";
import { listenToGestures } from "./gestures.js";
import { createHelp } from "./help.js";
import { createHistory } from "./history.js";
import { createHub } from "./hub.js";
import { icon } from "./icons.js";
import { createLightAdding } from "./light_adding.js";
import { createOutline } from "./outline.js";
import { createPathsPanel } from "./paths_panel.js";
import { createPicture } from "./picture.js";
import { createProbe } from "./probe.js";
import { createSavePanel } from "./save_panel.js";
import { createSettingsPanel } from "./settings_panel.js";
import { createStatus, createStrip } from "./status.js";
import { LIGHTS, MATERIALS, createTablePanel } from "./table_panel.js";
import { createTabs } from "./tabs.js";
import { createViewPanel } from "./view_panel.js";

/**
 * Puts a view into an element.
 * @param {HTMLElement} root
 * @param {Object} transport `send(text)`, and where the view sets `onmessage(string | ArrayBuffer)` and
 *   `onstate("open" | "lost")`
 * @param {Object} [options] `shared`: the page has other contents, and the wheel scrolls them while the image has not
 *   the focus; `downloads`: address of the folder of downloads; `drawing`: of `createDisplay`
 */
export function mount(root, transport, { shared = false, downloads = null, drawing = "auto" } = {}) {
  const hub = createHub(transport);
  const choice = { layer: "image", compared: null, toneMap: "srgb", exposure: 0, falseColor: false, alpha: false };
  const status = createStatus(hub);
  const picture = createPicture(hub, choice, drawing);
  const camera = createCamera(hub);
  const environmentPanel = createEnvironmentPanel(hub, status.say);
  const viewPanel = createViewPanel(hub, choice, picture, status.say, environmentPanel);
  const materialPanel = createTablePanel(hub, status.say, MATERIALS);
  const adding = createLightAdding(hub, status.say, (name) => awaitLight(name));
  const lightPanel = createTablePanel(hub, status.say, LIGHTS, adding.content);
  const history = createHistory(hub, status.say);
  const outline = createOutline(hub);
  picture.overlay(outline.element);
  const help = createHelp();
  const focus = createFocus(hub, status.say);
  const pathsPanel = createPathsPanel(hub, picture);
  const probe = createProbe(hub, picture, outline, pathsPanel.trace, (reply) => {
    if (lightPanel.has(reply.object?.place)) chooseLight(reply.object.place);
    if (reply.material === null) return;
    materialPanel.choose(reply.material, reply.parameters);
    sections.material.open = true;
  });
  function chooseLight(name) {
    lightPanel.choose(name);
    sections.light.open = true;
  }
  let awaited = null; // a light that was added, until the scene has it
  function awaitLight(name) {
    awaited = name;
    if (!lightPanel.has(name)) return;
    chooseLight(name);
    awaited = null;
  }
  const cameraPanel = createCameraPanel(hub, status.say, focus.button, camera);
  const sections = {
    view: section("View", true, viewPanel.content),
    render: section("Render", true, createSettingsPanel(hub, status.say)),
    material: section("Material", false, materialPanel.content),
    light: section("Light", false, lightPanel.content),
    environment: section("Environment", false, environmentPanel.content),
    camera: section("Camera", false, cameraPanel.content),
    save: section("Save", false, createSavePanel(hub, choice, picture, status.say, downloads)),
  };

  const tabs = createTabs("Panel", [
    { name: "Controls", content: Object.values(sections) },
    { name: "Light paths", content: pathsPanel.content, class: "lp" },
  ], (index) => {
    root.classList.toggle("cv-wide", index === 1);
    pathsPanel.open(index === 1);
  });

  const commands = {
    " ": () => !status.button.disabled && status.toggle(),
    r: camera.reset,
    c: cameraPanel.copy,
    f: focus.toggle,
    p: () => (probe.isPinned() ? probe.release() : probe.step(0, 0)),
    l: viewPanel.toggleFalseColor,
    b: () => viewPanel.toggleDenoised() || status.say(`The denoiser is not installed. Install it with: ${hub.newest("hello")?.install_denoiser}`),
    t: () => tabs.choose(root.classList.contains("cv-wide") ? 0 : 1),
    h: () => root.classList.toggle("cv-bare"),
    "[": () => viewPanel.changeExposure(-1 / 3),
    "]": () => viewPanel.changeExposure(1 / 3),
    "?": () => help.showModal(),
  };
  const tool = (name, label, key) =>
    make("button", { type: "button", title: `${label} (${key.toUpperCase()})`, "aria-label": label, "aria-keyshortcuts": key, onclick: (event) => used(key, event) }, icon(name));
  const used = (key, event) => {
    if (event.detail > 0) stage.focus(); // with a pointer: what comes next is on the image
    commands[key]();
  };
  const focusTool = tool("focus", "Focus by click", "f");
  hub.on("state", () => (focusTool.hidden = !focus.isPossible()));
  const tools = make(
    "div",
    { class: "cv-tools", role: "toolbar", "aria-label": "Tools" },
    focusTool,
    tool("probe", "Probe by keyboard", "p"),
    tool("paths", "Light paths of a pixel", "t"),
    tool("compare", "Compare before and after denoising", "b"),
    tool("palette", "False colour of luminance", "l"),
    tool("reset", "Reset the camera", "r"),
    tool("panel", "Hide or show the panel", "h"),
    tool("help", "Keys and gestures", "?"),
  );
  const stage = make(
    "div",
    { class: "cv-stage", tabindex: 0, role: "application", "aria-roledescription": "interactive image", "aria-label": "Live view. Arrow keys orbit, plus and minus zoom, P probes a pixel, question mark lists all keys." },
    // One below the other, so that no message covers the probe.
    make("div", { class: "cv-over" }, status.banner, status.hint, probe.card),
    make("div", { class: "cv-room" }, picture.box),
    picture.legend,
    tools,
    status.toast,
  );
  hub.on("scene", () => {
    if (awaited === null || !lightPanel.has(awaited)) return;
    chooseLight(awaited);
    awaited = null;
  });
  const title = make("h1", {}, "clrender");
  const about = make("span", { class: "cv-about" });
  hub.on("scene", (scene) => {
    const file = scene.source.split(/[\\/]/).pop();
    setText(title, scene.title || file);
    const count = (number, word) => `${number.toLocaleString("en")} ${word}${number === 1 ? "" : "s"}`;
    setText(about, `${file} · ${count(scene.shapes, "shape")}`);
  });

  root.classList.add("cv");
  root.append(
    make(
      "div",
      { class: "cv-frame" },
      make("header", { class: "cv-bar" }, title, about, history.buttons, status.pill, status.button),
      stage,
      createStrip(hub),
      make("aside", { class: "cv-panel", "aria-label": "Controls" }, tabs.list, ...tabs.panels),
    ),
    probe.spoken,
    help,
  );

  tabs.choose(0);
  listenToGestures(stage, picture.box, { ...camera, ...picks(probe, [focus, adding]), key: pressed }, shared);
  history.listen(shared ? root : document);
  const armed = () => [focus, adding].find((each) => each.isArmed());
  function pressed(key, shifted) {
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (probe.isPinned() && key in arrows) probe.step(...arrows[key].map((by) => by * (shifted ? 10 : 1)));
    else if (key === "Enter" && armed() !== undefined && probe.isPinned()) armed().at(probe, null);
    else if (key === "Enter" && probe.isPinned()) probe.pickPinned();
    else if (key === "Escape") {
      probe.release();
      pathsPanel.clear();
      focus.disarm();
      adding.disarm();
    } else if (key in commands) commands[key]();
    else return false;
    return true;
  }

  const observer = new ResizeObserver(picture.fit);
  observer.observe(stage);
  return {
    hub,
    camera,
    picture,
    close() {
      observer.disconnect();
      transport.close?.();
      root.replaceChildren();
    },
  };
}

function section(title, open, content) {
  return make("details", { class: "cv-section", open }, make("summary", {}, title), make("div", { class: "cv-content" }, ...content));
}

/** What hovering and clicking do. */
function picks(probe, tools) {
  return {
    hover: probe.hover,
    click(place) {
      const armed = tools.find((each) => each.isArmed());
      if (armed !== undefined) armed.at(probe, place);
      else probe.pick(place);
    },
  };
}

/** Focus by click: armed by a button or key, done by the next click. */
function createFocus(hub, say) {
  const button = make("button", { type: "button", "aria-pressed": "false", onclick: toggle }, "Focus by click");
  let armed = false;

  function set(value) {
    armed = value;
    button.setAttribute("aria-pressed", String(armed));
  }
  const isPossible = () => hub.newest("state")?.camera.focus_distance !== undefined;
  function toggle() {
    set(!armed && isPossible());
    if (armed) say("Click on the object to focus on.");
    else if (!isPossible()) say("With this type of camera everything is in focus.");
  }

  hub.on("state", () => {
    button.hidden = !isPossible();
    if (!isPossible()) set(false);
  });

  return {
    button,
    toggle,
    isPossible,
    isArmed: () => armed,
    disarm: () => set(false),
    at(probe, place) {
      set(false);
      probe.focusAt(place, (distance) => {
        if (distance === null) {
          say("There is no surface to focus on at this pixel.");
          return;
        }
        hub.send({ type: "camera", camera: { focus_distance: distance } });
        const sharp = (hub.newest("state")?.camera.aperture_radius ?? 0) === 0 ? " The aperture radius is 0, so everything is in focus anyway." : "";
        say(`Focused at ${distance.toPrecision(4)} m.${sharp}`);
      });
    },
  };
}
