/** Pictures of the view: a screenshot, and a turntable as a film. */

import { saveBlob, stem } from "../actions/files";
import { note, problem } from "../actions/toasts";
import { store } from "../store/state";
import type { Viewer } from "./viewer";

const TURN_SECONDS = 6;
const FRAMES_PER_SECOND = 30;

/** Save what the view shows, without marks. */
export async function screenshot({ stage, helpers }: Viewer): Promise<void> {
  const show = hidden(helpers);
  stage.draw();
  // Whatever is drawn is gone after this task: the copy is made now.
  const picture = copied(stage.canvas);
  show();
  stage.invalidate();
  const blob = await new Promise<Blob | null>((resolve) => picture.toBlob(resolve, "image/png"));
  if (blob) saveBlob(blob, `${stem()}.png`);
  else problem("The browser could not make a picture of this size.");
}

/** Turn once around the shape and save the film. */
export async function turntable({ stage, helpers }: Viewer): Promise<void> {
  const type = ["video/webm;codecs=vp9", "video/webm", "video/mp4"].find(
    (candidate) => typeof MediaRecorder !== "undefined" && MediaRecorder.isTypeSupported(candidate),
  );
  if (!type) {
    problem("This browser cannot record films.");
    return;
  }
  const film = document.createElement("canvas");
  film.width = stage.canvas.width - (stage.canvas.width % 2);
  film.height = stage.canvas.height - (stage.canvas.height % 2);
  const recorder = new MediaRecorder(film.captureStream(FRAMES_PER_SECOND), {
    mimeType: type,
    videoBitsPerSecond: 12e6,
  });
  const parts: Blob[] = [];
  recorder.ondataavailable = (event) => parts.push(event.data);
  const finished = new Promise<void>((resolve) => (recorder.onstop = () => resolve()));
  const show = hidden(helpers);
  note("Recording one turn…");
  const start = { position: stage.camera.position.clone(), target: stage.orbit.target.clone() };
  const offset = start.position.clone().sub(start.target);
  recorder.start();
  const begun = performance.now();
  await new Promise<void>((resolve) => {
    const frame = () => {
      const part = Math.min((performance.now() - begun) / (1000 * TURN_SECONDS), 1);
      const turned = offset.clone().applyAxisAngle(stage.camera.up, 2 * Math.PI * part);
      stage.camera.position.copy(start.target).add(turned);
      stage.camera.lookAt(start.target);
      stage.draw();
      film.getContext("2d")?.drawImage(stage.canvas, 0, 0);
      if (part < 1) requestAnimationFrame(frame);
      else resolve();
    };
    requestAnimationFrame(frame);
  });
  recorder.stop();
  await finished;
  show();
  stage.camera.position.copy(start.position);
  stage.orbit.update();
  stage.invalidate();
  saveBlob(new Blob(parts, { type }), `${stem()}.${type.startsWith("video/mp4") ? "mp4" : "webm"}`);
}

/** Hide what pictures leave out; returns how to show it again. */
function hidden(helpers: Viewer["helpers"]): () => void {
  const shown = helpers.filter((helper) => helper.visible);
  shown.forEach((helper) => (helper.visible = false));
  return () => shown.forEach((helper) => (helper.visible = true));
}

function copied(canvas: HTMLCanvasElement): HTMLCanvasElement {
  const copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  copy.getContext("2d")?.drawImage(canvas, 0, 0);
  return copy;
}

/** "Heat map of …" is what a person shares: switch to it, keep it for the picture, go back. */
export async function heatPicture(viewer: Viewer): Promise<void> {
  const { look, selected } = store.get();
  if (selected === null) {
    note("Select a handle first: the heat map is that of a handle.");
    return;
  }
  store.set({ look: "heat" });
  await screenshot(viewer);
  store.set({ look });
}
