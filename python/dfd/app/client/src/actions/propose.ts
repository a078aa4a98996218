/** After each gesture, propose other controls for the moved handle, with pictures of the result. */

import { selectedHandle, store, type Posed } from "../store/state";
import { ask } from "./connection";
import { change } from "./edit";

/** Largest number of vertices for which the server sends other poses: 3 MB for each of three. */
const MOST_VERTICES = 150_000;
/** Milliseconds after a gesture before the server is asked, so that a next gesture is not delayed. */
const PAUSE = 250;

let timer = 0;
let draw: (posed: Posed) => string;

function clear(): void {
  clearTimeout(timer);
  if (store.get().proposals) store.set({ proposals: null });
}

function proposeSoon(): void {
  clear();
  timer = window.setTimeout(() => void propose(), PAUSE);
}

/** Propose when a drag has ended. `drawn` returns a picture of a pose. */
export function proposeAfterDrags(drawn: (posed: Posed) => string): void {
  draw = drawn;
  store.on("dragging", (dragging) => (dragging ? clear() : proposeSoon()));
  store.watch(({ selected, mesh, comparing, tool }) => [selected, mesh, comparing, tool], clear);
  // Another change of the edit makes the pictures wrong. The end of the drag itself changes it once.
  store.watch(
    ({ edit }) => edit?.step,
    () => store.get().proposals && clear(),
  );
}

async function propose(): Promise<void> {
  // Wait for the state after the gesture.
  while (store.get().ahead.size > 0 && !store.get().dragging) await new Promise((next) => setTimeout(next, PAUSE));
  const { mesh, edit, dragging, tool } = store.get();
  const handle = selectedHandle(store.get());
  if (!handle?.moved || !mesh || mesh.vertices > MOST_VERTICES || dragging || tool !== "hold") return;
  const answer = await ask({ type: "propose", handle: handle.handle }, true);
  if (answer?.message.type !== "proposals" || store.get().dragging || store.get().edit?.step !== edit?.step) return;
  const { payload } = answer;
  const choices = answer.message.proposals.map(({ label, controls }, i) => {
    const posed = { positions: payload.get(`positions${i}`, "F32"), normals: payload.get(`normals${i}`, "I16") };
    return { label, controls, picture: draw(posed) };
  });
  store.set({ proposals: choices.length > 0 ? { handle: handle.handle, choices } : null });
}

/** Give the handle the controls of a proposal, and propose again. */
export function take(index: number): void {
  const { proposals } = store.get();
  const choice = proposals?.choices[index];
  if (!proposals || !choice) return;
  change(proposals.handle, choice.controls);
  proposeSoon();
}
