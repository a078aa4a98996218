import { render } from "preact";

import { followLookAlikes } from "./actions/alike";
import { listen } from "./actions/keyboard";
import { connect } from "./actions/server";
import { App } from "./panels/app";
import { store, type Theme } from "./store/state";
import { exposeForTests } from "./test_hook";
import { Viewer } from "./viewer/viewer";

const THEME_KEY = "dfd-theme";
const QUALITY_KEY = "dfd-quality";

function themed(theme: Theme): void {
  if (theme === "system") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme;
}

function start(): void {
  const root = document.getElementById("app");
  const canvas = document.createElement("canvas");
  const view = document.createElement("div");
  const overlay = document.createElement("div");
  const panels = document.createElement("div");
  view.className = "view";
  overlay.className = "overlay";
  panels.className = "panels";
  canvas.setAttribute("aria-label", "The shape. Handles can also be taken hold of from the keyboard: G suggests some.");
  canvas.tabIndex = 0;
  view.append(canvas, overlay);
  root?.append(view, panels);

  const saved = localStorage.getItem(THEME_KEY);
  const theme: Theme = saved === "light" || saved === "dark" ? saved : "system";
  // Before the viewer reads the theme's colors.
  store.watch(
    (state) => state.theme,
    (chosen) => {
      themed(chosen);
      localStorage.setItem(THEME_KEY, chosen);
    },
  );
  store.watch(
    (state) => state.quality,
    (chosen) => localStorage.setItem(QUALITY_KEY, chosen),
  );
  const quality = localStorage.getItem(QUALITY_KEY) === "full" ? "full" : "auto";
  store.set({ theme, quality, inspector: innerWidth >= 720 });

  let viewer: Viewer;
  try {
    viewer = new Viewer(canvas, overlay);
  } catch {
    const sorry = document.createElement("p");
    sorry.className = "sorry";
    sorry.setAttribute("role", "alert");
    sorry.textContent =
      "This browser has no WebGL 2, which draws the shape. Another browser, or its hardware acceleration switched on, will do.";
    panels.append(sorry);
    return;
  }
  render(<App viewer={viewer} />, panels);
  listen(() => viewer.frame());
  followLookAlikes();
  connect(viewer);
  exposeForTests(viewer);
}

start();
