/** Actions of the user that change the shape and consist of more than one request. */

import type { Transform } from "../posing/affine";
import type { Controls, PoseTransform, TakePart } from "../protocol/messages";
import { present, ready, serverPoses, store, type Ahead } from "../store/state";
import { ask, congested, send } from "./connection";
import { note } from "./toasts";

export type PartChange = TakePart["how"];

export function hold(vertex: number): void {
  const there = store.get().edit?.handles.find((handle) => handle.vertex === vertex);
  if (there) select(there.handle);
  else send({ type: "add", at: vertex });
}

export function select(handle: number | null): void {
  store.set({ selected: handle, probe: null });
}

export function toggleFixed(vertex: number): void {
  const index = store.get().edit?.fixed.findIndex((fixed) => fixed.vertex === vertex) ?? -1;
  if (index >= 0) send({ type: "release", index });
  else send({ type: "fix", at: vertex });
}

/** Let the selected handle hold another part, or add or remove the part at a vertex. */
export function changePart(how: PartChange, vertex: number | null = null): void {
  const { edit, selected } = store.get();
  if (selected === null) return;
  if (!edit?.field.parts.includes(how)) note("Parts are being found: try again in a moment.");
  else if (how === "smaller" || how === "larger") void resize(selected, how);
  else send({ type: "take_part", handle: selected, how, vertex });
}

/** Hold the next smaller or larger part, if there is one. */
async function resize(handle: number, how: "smaller" | "larger"): Promise<void> {
  const taken = await ask({ type: "take_part", handle, how }, true);
  if (!taken && store.get().link === "open") note(`There is no ${how} part here.`);
}

let previewed: PartChange | null = null;

/** Show what the selected handle would hold, until the next call; return false if there is no such part. */
export async function previewPart(how: PartChange | null): Promise<boolean> {
  const { selected } = store.get();
  if (previewed) store.set({ probe: null });
  previewed = how;
  if (how === null || selected === null) return true;
  const answer = await ask({ type: "take_part", handle: selected, how, preview: true }, true);
  if (answer && previewed === how && store.get().selected === selected)
    store.set({ probe: { vertex: null, weights: answer.payload.get("values", "U16") } });
  return answer !== null;
}

/** Convert a painted mask, one bit per vertex, lowest first, to a region for requests. */
export function regionOf(mask: Uint8Array): { mask: string } {
  let text = "";
  for (let i = 0; i < mask.length; i += 4096) text += String.fromCharCode(...mask.subarray(i, i + 4096));
  return { mask: btoa(text) };
}

export function suggest(): void {
  if (store.get().suggestions.length > 0) store.set({ suggestions: [] });
  else if (ready(store.get())) send({ type: "suggest" });
  else note("Handles can be suggested once the shape is ready.");
}

// --- sliders and drags: shown at once, sent at intervals

/** Milliseconds between two requests of a slider, and of a drag. */
const SLIDER_INTERVAL = 80;
const DRAG_INTERVAL = 50;
/** Milliseconds after which another move of a slider is a new step of undo. */
const GESTURE = 1000;

interface Gesture {
  timer: number;
  sent: number;
  send: (merge: boolean) => unknown;
}

const gestures = new Map<string, Gesture>();

/** Send the newest value of a slider. With `merge`, it joins the previous step of the same `key`. */
export function throttle(key: string, request: (merge: boolean) => unknown): void {
  const gesture = gestures.get(key) ?? { timer: 0, sent: -Infinity, send: request };
  gestures.set(key, gesture);
  gesture.send = request;
  gesture.timer ||= window.setTimeout(() => {
    const now = performance.now();
    const merge = now - gesture.sent < GESTURE;
    gesture.timer = 0;
    gesture.sent = now;
    gesture.send(merge);
  }, SLIDER_INTERVAL);
}

interface Drag {
  readonly handle: number;
  sent: number;
  timer: number;
  begun: boolean;
  latest: Transform | null;
  /** Controls that the wheel changed and that were not sent yet. */
  controls: Controls;
}

let drag: Drag | null = null;

export function startDrag(): void {
  const { selected } = store.get();
  if (selected === null) return;
  drag = { handle: selected, sent: 0, timer: 0, begun: false, latest: null, controls: {} };
  store.set({ dragging: true, probe: null, moment: null, playing: false });
}

export function dragTo(transform: Transform): void {
  const own = drag;
  if (!own) return;
  own.latest = transform;
  showAhead(own.handle, { transform }, Infinity);
  const wait = own.sent + DRAG_INTERVAL - performance.now();
  if (wait <= 0 && !congested()) {
    sendDrag(own, transform, false);
    return;
  }
  own.timer ||= window.setTimeout(
    () => {
      own.timer = 0;
      if (own === drag && own.latest) dragTo(own.latest);
    },
    Math.max(wait, 1),
  );
}

export function endDrag(): void {
  if (drag) {
    const { handle, latest, timer } = drag;
    clearTimeout(timer);
    if (latest) showAhead(handle, {}, sendDrag(drag, latest, true));
  }
  drag = null;
  store.set({ dragging: false });
}

function sendDrag(own: Drag, transform: Transform, settle: boolean): number {
  own.sent = performance.now();
  const request = send({
    type: "move",
    handle: own.handle,
    transform: message(own.handle, transform),
    controls: own.controls,
    merge: own.begun,
    settle,
  });
  own.begun = true;
  own.controls = {};
  // The shader does not support all blends; the server then poses as fast as it can.
  if (serverPoses(store.get()) && !settle) send({ type: "compute" });
  return request;
}

/** A change by the wheel during a drag is part of the same step. */
export function wheelReach(handle: number, factor: number): void {
  const state = store.get();
  const known = state.edit?.handles.find((other) => other.handle === handle);
  if (!known) return;
  const reach = Math.min(Math.max(present(state, known).reach * factor, 0.02), 2);
  if (drag?.latest) {
    drag.controls = { reach };
    showAhead(handle, { reach }, Infinity);
    dragTo(drag.latest);
  } else slide(handle, { reach });
}

/** Set a control by a slider. */
export function slide(handle: number, controls: Partial<Record<string, number>>): void {
  showAhead(handle, controls, Infinity);
  throttle(`${handle} ${Object.keys(controls).join()}`, (merge) =>
    showAhead(handle, {}, send({ type: "change", handle, controls, merge })),
  );
}

export function change(handle: number, controls: Controls): void {
  const { falloff } = controls;
  showAhead(handle, falloff ? { falloff } : {}, send({ type: "change", handle, controls }));
}

/** Set a whole transform at once, for numeric fields. */
export function moveTo(handle: number, transform: Transform): void {
  const request = send({ type: "move", handle, transform: message(handle, transform), settle: true });
  showAhead(handle, { transform }, request);
}

/** Set the transforms of several handles, as one step. */
export function poseTo(transforms: ReadonlyMap<number, Transform>): void {
  const request = send({ type: "pose", transforms: [...transforms].map(poseTransform) });
  transforms.forEach((transform, handle) => showAhead(handle, { transform }, request));
}

/** Set D₀, the transform of everything that no handle holds; its pivot is the center of the box. */
export function setDefault({ translation, rotation, scale }: Transform): void {
  throttle("default", (merge) => send({ type: "set_default", transform: { translation, rotation, scale }, merge }));
}

/** Convert a transform for a request; the pivot is sent only if the server has another one. */
function message(handle: number, { pivotAt, pivot, axes, joint, ...rest }: Transform) {
  const known = store.get().edit?.handles.find((other) => other.handle === handle);
  const same = known?.pivot_set && known.pivot.every((x, i) => x === pivot?.[i]);
  return {
    ...rest,
    pivot: same ? null : (pivotAt ?? pivot ?? ("auto" as const)),
    axes: axes ?? ("auto" as const),
    joint: joint ?? ("spread" as const),
  };
}

/** Convert a transform to a part of a key pose. */
export function poseTransform([handle, transform]: readonly [number, Transform]): PoseTransform {
  const { translation, rotation, scale, pivot, axes, bend, twist, joint } = transform;
  return { handle, translation, rotation, scale, pivot, axes, bend, twist, joint };
}

/** Return the transforms at the timeline's moment, or null to show the edit. */
export function seenTransforms(): PoseTransform[] | null {
  const { moment, edit } = store.get();
  const present = new Set(edit?.handles.map(({ handle }) => handle));
  return moment && [...moment].filter(([handle]) => present.has(handle)).map(poseTransform);
}

/** Let the server pose if the shader cannot, after every change; drags request it themselves. */
export function followPosed(): void {
  store.watch(serverPoses, (on) => {
    if (!on) store.set({ posed: null });
  });
  const compute = () => serverPoses(store.get()) && send({ type: "compute", transforms: seenTransforms() });
  store.on("edit", compute);
  store.on("comparing", compute);
  store.on("moment", () => throttle("compute", compute));
}

/** Show a change before the server confirms it; `request` is the number of the request that contains it. */
function showAhead(handle: number, part: Partial<Ahead>, request: number): void {
  const ahead = new Map(store.get().ahead);
  ahead.set(handle, { ...ahead.get(handle), ...part, request });
  store.set({ ahead });
}
