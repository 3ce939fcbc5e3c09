// What the render is doing: status, samples, speed, error over time, problems, start and stop.

import { createChart } from "./chart.js";
import { make, readable, readableCount, readableTime, setText } from "./elements.js";

const WORDS = {
  starting: "Starting",
  rendering: "Rendering",
  done: "Done",
  stopped: "Stopped",
  failed: "Failed",
};
const NOTICE_SECONDS = 6;
/** A wait that has ended earlier is not shown: compiled kernels are usually in the cache. */
const STAGE_SECONDS = 0.7;
const STAGE_GAP_SECONDS = 0.2;
const NO_STAGE = { stage: "", text: "" };
const STAGE_WORDS = { opening: "Opening", reading: "Reading", flattening: "Preparing", building: "Building", preparing: "Preparing", compiling: "Compiling" };
const MEANWHILE = "What you change meanwhile is shown afterwards.";
const WAITING = "Waiting for the first image.";
const CONNECTING = "Connecting to the renderer.";
const BLACK = "The image is black: no light reaches the camera. R resets the camera.";

/** The status, the button that starts and stops, and the place of problems. */
export function createStatus(hub) {
  const pill = make("span", { class: "cv-status", role: "status", "aria-live": "polite" }, "Connecting");
  const button = make("button", { type: "button", class: "cv-primary", disabled: true, onclick: toggle }, "Stop");
  const banner = make("div", { class: "cv-banner", role: "alert", hidden: true });
  const hint = make("div", { class: "cv-hint", role: "status", hidden: true });
  const toast = make("div", { class: "cv-toast", role: "status", "aria-live": "polite" });
  let connected = false;
  let wasConnected = false;
  let late = false; // nothing has come for a while: it is said what for
  let farewell = "";
  let [stage, newest] = [NO_STAGE, NO_STAGE];
  let [timer, beginTimer, endTimer] = [null, null, null];

  function toggle() {
    const status = hub.newest("state")?.status;
    hub.send({ type: "run", run: status === "stopped" });
  }

  function update() {
    const state = hub.newest("state");
    const status = connected ? (state?.status ?? "starting") : "lost";
    pill.dataset.status = status;
    const busy = stage.stage !== "" && ["starting", "rendering"].includes(status);
    setText(pill, connected ? (busy ? (STAGE_WORDS[stage.stage] ?? "Waiting") : WORDS[status]) : farewell || "No connection, reconnecting");
    setText(button, status === "stopped" ? "Continue" : "Stop");
    button.disabled = !["rendering", "starting", "stopped"].includes(status);
    button.title = status === "done" ? "All samples are done. Increase the samples per pixel to continue." : "Space";
    const problem = state?.problem ?? null;
    banner.hidden = problem === null;
    if (problem !== null) {
      const heads = { scene: "The scene file has an error; this is the last valid image.", device: "The device failed.", render: "The render failed." };
      banner.replaceChildren(make("strong", {}, heads[problem.where] ?? "Error."), ` ${problem.message}`);
    }
    const words = stage.text.charAt(0).toUpperCase() + stage.text.slice(1);
    const waits = !late ? "" : !wasConnected ? CONNECTING : status === "starting" ? WAITING : "";
    const shown = busy ? `${words}. ${MEANWHILE}` : state?.is_black ? BLACK : waits;
    hint.hidden = (!connected && wasConnected) || problem !== null || shown === "";
    setText(hint, shown);
  }

  setTimeout(() => {
    late = true;
    update();
  }, 1000 * STAGE_SECONDS);

  function say(text) {
    setText(toast, text);
    toast.classList.add("cv-visible");
    clearTimeout(timer);
    timer = setTimeout(() => toast.classList.remove("cv-visible"), NOTICE_SECONDS * 1000);
  }

  hub.on("connection", (now) => {
    connected = now === "open";
    wasConnected = wasConnected || connected;
    if (connected) farewell = "";
    update();
  });
  hub.on("state", update);
  hub.on("compiling", (message) => {
    // Stages that follow each other are one wait, which is shown when it has lasted a while.
    if (message.stage === "") {
      endTimer ??= setTimeout(() => {
        clearTimeout(beginTimer);
        beginTimer = endTimer = null;
        stage = NO_STAGE;
        update();
      }, 1000 * STAGE_GAP_SECONDS);
      return;
    }
    clearTimeout(endTimer);
    endTimer = null;
    newest = message;
    const show = () => {
      beginTimer = null;
      stage = newest;
      update();
    };
    if (stage !== NO_STAGE) show();
    else beginTimer ??= setTimeout(show, 1000 * STAGE_SECONDS);
  });
  hub.on("bye", (message) => {
    farewell = `The renderer has stopped (${message.reason})`;
    update();
  });
  hub.on("refused", (message) => say(message.message));
  hub.on("notice", (message) => say(message.message));
  return { pill, button, banner, hint, toast, say, toggle };
}

/** The strip below the image: how far, how long, how fast, how exact. */
export function createStrip(hub) {
  const bar = make("progress", { max: 1, value: 0, "aria-label": "Samples done" });
  const figure = (label, title) => {
    const value = make("dd", {}, "–");
    return { value, element: make("div", { title }, make("dt", {}, label), value) };
  };
  const samples = figure("samples", "Samples per pixel: taken and requested");
  const time = figure("time", "Elapsed and remaining time of this image");
  const speed = figure("samples/s", "Samples per second, all pixels");
  const error = figure("error", "Relative standard error of the image; requires replicates");
  const measure = make("button", { type: "button", class: "cv-link", hidden: true, onclick: measureErrors }, "measure");
  error.element.append(measure);
  const chart = createChart();
  const element = make(
    "footer",
    { class: "cv-strip" },
    bar,
    make("dl", {}, samples.element, time.element, speed.element, error.element),
    chart.element,
  );
  let revision = null;

  function measureErrors() {
    hub.send({ type: "set", settings: { replicate_spp: replicatesFor(hub) } });
  }

  hub.on("progress", (progress) => {
    if (progress.revision !== revision) chart.clear();
    revision = progress.revision;
    bar.value = Math.min(progress.samples / progress.spp, 1);
    setText(samples.value, `${readable(progress.samples, 4)} / ${progress.spp}`);
    const left = progress.seconds_left === null || progress.sha256 !== null ? "" : ` · ${readableTime(progress.seconds_left)} left`;
    setText(time.value, readableTime(progress.seconds) + left);
    const { width, height } = hub.newest("state") ?? { width: 0, height: 0 };
    const mean = progress.seconds > 0 ? (progress.samples * width * height) / progress.seconds : 0;
    const rate = progress.samples_per_second || mean;
    setText(speed.value, rate > 0 ? readableCount(rate) : "–");
    setText(error.value, progress.error === null ? "–" : `${readable(100 * progress.error, 3)} %`);
    if (progress.error !== null) chart.add(progress.seconds, progress.error);
    element.dataset.sha256 = progress.sha256 ?? "";
  });
  hub.on("state", () => {
    const possible = replicatesFor(hub) !== null;
    measure.hidden = !possible || hub.newest("state").settings.replicate_spp !== null;
  });
  return element;
}

/** A size of replicates that the samples per pixel are a multiple of; null: none, or the integrator has no errors. */
export function replicatesFor(hub) {
  const [hello, state] = [hub.newest("hello"), hub.newest("state")];
  const integrator = hello?.integrators.find((each) => each.name === state?.settings.integrator);
  if (!integrator?.has_errors) return null;
  const spp = state.settings.spp;
  // A few replicates at least, and none so small that its noise hides the rest.
  return [16, 8, 4, 2, 1].find((size) => spp % size === 0 && spp / size >= 4) ?? null;
}
