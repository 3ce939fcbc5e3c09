// Saves the image and the scene: as downloads of the browser, and the image to the files that the command line named.

import { make } from "./elements.js";

const DOWNLOADS = [
  ["image.png", ".png", "Tone-mapped, 8 bits"],
  ["image.exr", ".exr", "Linear radiance, with layers"],
  ["image.film", ".film", "Exact sums, to resume, merge and verify"],
];

/**
 * A panel's content.
 * @param {Object} choice whose `toneMap` and `exposure` .png files get
 * @param {string | null} address of the downloads' folder; null: there are none
 */
export function createSavePanel(hub, choice, picture, say, address) {
  const links = DOWNLOADS.map(([name, label, title]) => make("a", { class: "cv-button", href: "#", download: "", title }, label));

  function aim() {
    links.forEach((link, i) => {
      const name = DOWNLOADS[i][0];
      const query = new URLSearchParams(name.endsWith(".png") ? { tone_map: choice.toneMap, exposure: choice.exposure } : {});
      if (choice.alpha && !name.endsWith(".film")) query.set("alpha", "1");
      link.href = `${address}${name}?${query}`;
    });
  }
  // The choice may have changed since: the address is made when it is used.
  links.forEach((link) => ["pointerdown", "keydown", "click"].forEach((event) => link.addEventListener(event, aim)));

  const files = make("div", { class: "cv-row" });
  const shown = make("button", { type: "button", title: "Includes false colours and the divider", onclick: saveShown }, "Current view, .png");

  async function saveShown() {
    const link = make("a", { download: `${hub.newest("scene")?.title || "image"}.png` });
    link.href = URL.createObjectURL(await picture.snapshot());
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  hub.on("hello", (hello) => {
    files.replaceChildren(
      ...hello.saves.map((name) => make("button", { type: "button", onclick: () => save(name) }, `Save ${name}`)),
    );
  });

  function save(name) {
    const message = { type: "save", name, tone_map: choice.toneMap, exposure: choice.exposure, alpha: choice.alpha };
    hub.send(message, (reply) => {
      if (reply.type !== "saved") return false;
      say(`Saved ${reply.name}: ${(reply.bytes / 1e6).toFixed(2)} MB.`);
      return true;
    });
  }

  const scene = make("a", { class: "cv-button", href: `${address}scene.zip`, download: "scene.zip", title: "A scene file with all edits, its files, and the command that renders this image" }, "Download scene");
  const kept = make("p", { class: "cv-note" }, "The scene with all edits and its files:");
  const downloads = address === null ? [] : [kept, make("div", { class: "cv-row" }, scene), make("p", { class: "cv-note" }, "Download the image so far:"), make("div", { class: "cv-row" }, ...links)];
  return [...downloads, make("div", { class: "cv-row" }, shown), files];
}
