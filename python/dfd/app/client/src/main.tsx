import { render } from "preact";

import { ask, start as connect, drop } from "./actions/connection";
import { takeDrops } from "./actions/files";
import { listen } from "./actions/keyboard";
import { receive } from "./actions/receive";
import { followPosed } from "./actions/edit";
import { followAxis, followSimilar } from "./actions/similar";
import { App } from "./panels/app";
import { posePoint } from "./posing/columns";
import { store } from "./store/state";
import { sceneOf } from "./viewer/scene";
import { Viewer } from "./viewer/viewer";

const MORE_KEY = "dfd-more";

function element(tag: "div" | "canvas" | "p", name: string): HTMLElement {
  return Object.assign(document.createElement(tag), { className: name });
}

function start(): void {
  const canvas = element("canvas", "") as HTMLCanvasElement;
  const [view, overlay, panels] = ["view", "overlay", "panels"].map((name) => element("div", name));
  canvas.setAttribute("aria-label", "The shape. Handles can also be taken hold of from the keyboard: G suggests some.");
  canvas.tabIndex = 0;
  view.append(canvas, overlay);
  document.getElementById("app")?.append(view, panels);

  store.set({ inspector: innerWidth >= 720, more: localStorage.getItem(MORE_KEY) === "true" });
  store.on("more", (more) => localStorage.setItem(MORE_KEY, String(more)));

  let viewer: Viewer;
  try {
    viewer = new Viewer(canvas, overlay);
  } catch {
    const sorry = element("p", "sorry");
    sorry.setAttribute("role", "alert");
    sorry.textContent =
      "This browser has no WebGL 2, which draws the shape. Another browser, or its hardware acceleration switched on, will do.";
    panels.append(sorry);
    return;
  }
  render(<App viewer={viewer} />, panels);
  listen();
  takeDrops();
  followSimilar();
  followAxis();
  followPosed();
  connect(receive);
  // Access for tests.
  if (new URLSearchParams(location.search).has("test")) {
    Object.assign(window, { dfd: { store, viewer, ask, drop, posePoint, sceneOf } });
  }
}

start();
