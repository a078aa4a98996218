import { render } from "preact";

import { ask, start as connect, drop } from "./actions/connection";
import { takeDrops } from "./actions/files";
import { follow } from "./actions/follow";
import { listen } from "./actions/keyboard";
import { keepPictures } from "./actions/pictures";
import { proposeAfterDrags } from "./actions/propose";
import { receive } from "./actions/receive";
import { App } from "./panels/app";
import { posePoint } from "./posing/columns";
import { store } from "./store/state";
import { Pointer } from "./viewer/pointer";
import { sceneOf } from "./viewer/scene";
import { Viewer } from "./viewer/viewer";

const MORE_KEY = "dfd-more";

function start(): void {
  const [canvas] = document.getElementsByTagName("canvas");
  const [overlay, box, panels] = ["overlay", "box", "panels"].map(
    (name) => document.getElementsByClassName(name)[0] as HTMLElement,
  );
  const phone = matchMedia("(width < 600px)");
  const measure = () => store.set({ narrow: phone.matches });
  phone.addEventListener("change", measure);
  measure();
  store.set({ inspector: innerWidth >= 720, more: localStorage.getItem(MORE_KEY) === "true" });
  store.on("more", (more) => localStorage.setItem(MORE_KEY, String(more)));

  let viewer: Viewer;
  try {
    viewer = new Viewer(canvas, overlay, box);
    new Pointer(canvas, viewer);
  } catch {
    const text = "This browser does not support WebGL 2. Use another browser, or switch on hardware acceleration.";
    render(<p role="alert">{text}</p>, panels);
    return;
  }
  render(<App viewer={viewer} />, panels);
  listen(() => viewer.gizmo.grabbed);
  takeDrops();
  follow();
  proposeAfterDrags((posed) => viewer.thumbnail(posed));
  keepPictures(() => viewer.thumbnail());
  connect(receive);
  // Access for tests.
  if (new URLSearchParams(location.search).has("test")) {
    Object.assign(window, { dfd: { store, viewer, ask, drop, posePoint, sceneOf } });
  }
}

start();
