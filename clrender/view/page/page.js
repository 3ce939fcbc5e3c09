// The page of `clrender view`: the viewer over a WebSocket.

import { connect } from "./connection.js";
import { mount } from "./viewer.js";

const scheme = location.protocol === "https:" ? "wss" : "ws";
const transport = connect(`${scheme}://${location.host}/socket${location.search}`);
// `#plain`: without WebGL, to compare, or where a driver draws wrongly; `#webgl`: with it, also where the processor draws.
export const view = mount(document.getElementById("view"), transport, { downloads: "download/", drawing: location.hash.slice(1) || "auto" });
view.hub.on("scene", (scene) => {
  document.title = `${scene.title || scene.source} – clrender`;
});
