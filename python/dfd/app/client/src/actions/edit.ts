/** Actions of the user that change the shape, except actions that only send one request. */

import { MathUtils } from "three";

import { axisIn, typedMotion, type Transform } from "../posing/affine";
import type { Controls, HandleState, Move, PoseTransform, TakePart } from "../protocol/messages";
import {
  isolates,
  otherPlaces,
  present,
  ready,
  selectedHandle,
  serverPoses,
  stepAt,
  stepText,
  store,
  type Ahead,
} from "../store/state";
import { ask, congested, send } from "./connection";
import { note } from "./toasts";

export type PartChange = TakePart["how"];

export function hold(vertex: number): void {
  const there = store.get().edit?.handles.find((handle) => handle.vertex === vertex);
  if (there) select(there.handle);
  else send({ type: "add", at: vertex, level: store.get().level });
  store.set({ level: 0 });
}

/** Take a smaller (−1) or larger (1) part: for the selected handle, or else for the point under the pointer. */
export function resize(by: -1 | 1): void {
  const { selected, probe } = store.get();
  if (selected !== null) void changePart(by < 0 ? "smaller" : "larger");
  else if (typeof probe?.vertex === "number") preview(probe.vertex, by);
}

/** Show the weights of a handle with a smaller (−1) or larger (1) part at a point, before the user adds it. */
export function preview(vertex: number, by: -1 | 1): void {
  const next = neighbor(vertex, store.get().level, by);
  if (next === null) return;
  store.set({ level: next });
  send({ type: "probe", vertex, level: next });
}

/** Show the weights that a new handle at a vertex would have. */
export function showWeights(vertex: number): void {
  const state = store.get();
  if (!ready(state) || !["hold", "fix"].includes(state.tool) || isolates(state)) return;
  send(state.tool === "fix" ? { type: "stays", vertex } : { type: "probe", vertex, level: state.level });
}

/** Return the level of the next smaller or larger part at a vertex, if there is one and the parts are known. */
function neighbor(vertex: number, level: number, by: -1 | 1): number | null {
  const ladder = store.get().ladders.get(vertex);
  return ladder?.steps[stepAt(ladder, level) + by]?.level ?? null;
}

export function select(handle: number | null): void {
  store.set({ selected: handle, probe: null });
}

export function toggleFixed(vertex: number): void {
  const index = store.get().edit?.fixed.findIndex((fixed) => fixed.vertex === vertex) ?? -1;
  if (index >= 0) send({ type: "release", index });
  else send({ type: "fix", at: vertex });
}

/** Change the part of the selected handle. "add" and "remove" add or remove the part at `vertex`. */
export async function changePart(how: PartChange, vertex: number | null = null): Promise<void> {
  const { edit, selected } = store.get();
  if (selected === null) return;
  if (!edit?.field.parts.includes(how)) {
    note("The server is still finding parts. Try again in a moment.");
    return;
  }
  const resizes = how === "smaller" || how === "larger";
  const taken = await ask({ type: "take_part", handle: selected, how, vertex }, resizes);
  if (!taken && resizes && store.get().link === "open") note(`There is no ${how} part here.`);
}

/** Switch the counterpart at `vertex` on or off. If it is on, it follows the handle. */
export function toggleCounterpart(handle: number, vertex: number): void {
  const off = otherPlaces(store.get()).filter((place) => place.on === (place.vertex === vertex));
  send({ type: "change", handle, controls: { excluded_counterparts: off.map((place) => place.vertex) } });
}

/** Convert painted weights to a region of a request: base64 of one bit per vertex, from the lowest bit of a byte. */
export function regionOf(weights: Uint16Array): { mask: string } {
  const mask = new Uint8Array(Math.ceil(weights.length / 8));
  weights.forEach((weight, vertex) => {
    if (weight > 0) mask[vertex >> 3] |= 1 << (vertex & 7);
  });
  return { mask: btoa(Array.from(mask, (byte) => String.fromCharCode(byte)).join("")) };
}

export function suggest(): void {
  if (store.get().suggestions.length > 0) store.set({ suggestions: [] });
  else if (ready(store.get())) send({ type: "suggest" });
  else note("Handles can be suggested when parts can be held.");
}

const SLIDER_INTERVAL = 80; // milliseconds between two requests while a slider moves
/** Factor of a numeric reach for one notch of the wheel. */
const WHEEL_FACTOR = 1.15;
const DRAG_INTERVAL = 50; // milliseconds between two requests of a drag
/** After this many milliseconds without a request, the next request is a new undo step. */
const GESTURE = 1000;

interface Gesture {
  timer: number;
  sent: number;
  send: (merge: boolean) => unknown;
}

const gestures = new Map<string, Gesture>();

/** Call the newest `request` of `key` at most once per `interval` milliseconds. `merge` joins the last undo step. */
export function throttle(key: string, request: (merge: boolean) => unknown, interval = SLIDER_INTERVAL): void {
  const gesture = gestures.get(key) ?? { timer: 0, sent: -Infinity, send: request };
  gestures.set(key, gesture);
  gesture.send = request;
  const pass = () => {
    gesture.timer = congested() ? window.setTimeout(pass, interval) : 0;
    if (gesture.timer !== 0) return;
    const now = performance.now();
    const merge = now - gesture.sent < GESTURE;
    gesture.sent = now;
    gesture.send(merge);
  };
  gesture.timer ||= window.setTimeout(pass, Math.max(gesture.sent + interval - performance.now(), 0));
}

interface Drag {
  readonly handle: number;
  readonly start: Transform;
  /** Whether the gizmo moves the handle. If not, the user only types numbers. */
  readonly pointer: boolean;
  begun: boolean;
  latest: Transform | null;
  /** Controls that the wheel has changed since the last request. */
  controls: Controls;
}

let drag: Drag | null = null;

export function startDrag(pointer = true): void {
  store.set({ probe: null, moment: null, playing: false });
  const known = selectedHandle(store.get());
  if (!known) return;
  const start = present(store.get(), known).transform;
  drag = { handle: known.handle, start, pointer, begun: false, latest: null, controls: {} };
  store.set({ dragging: true });
}

export function dragTo(transform: Transform): void {
  const own = drag;
  // A typed number replaces the motion of the pointer.
  if (!own || store.get().typed) return;
  own.latest = transform;
  showAhead(own.handle, { transform }, Infinity);
  throttle("drag", () => own === drag && sendDrag(own, false), DRAG_INTERVAL);
}

export function endDrag(): void {
  finish();
  store.set({ dragging: false });
}

/** Keep the motion of the drag. A pointer that is still down does not change it. */
function finish(): void {
  if (drag?.latest) showAhead(drag.handle, {}, sendDrag(drag, true));
  drop();
}

function drop(): void {
  const pointer = drag?.pointer === true;
  drag = null;
  store.set({ typed: null, dragging: pointer });
}

/** Return the handle to where it was before the drag. */
function cancel(own: Drag): void {
  store.set({ ahead: new Map([...store.get().ahead].filter(([handle]) => handle !== own.handle)) });
  if (own.begun) send({ type: "go", by: -1 });
  drop();
}

/** Begin to type a motion of the selected handle. */
export function startTyping(): void {
  if (!selectedHandle(store.get())) note("Click a part first. Then type an axis and a number, such as X 0.2.");
  else if (!drag) {
    startDrag(false);
    store.set({ typed: { axis: null, text: "" } });
  }
}

/** Use a key during a drag: an axis, a character of a number, Enter or Esc. Return whether the key was used. */
export function typeKey(key: string, grabbed: number | null): boolean {
  const own = drag;
  if (!own) return false;
  const { axis, text } = store.get().typed ?? { axis: grabbed, text: "" };
  const named = ["X", "Y", "Z"].indexOf(key);
  if (key === "Esc") cancel(own);
  else if (key === "Enter") finish();
  else if (named >= 0) type(own, named, text);
  else if (/^[\d.,-]$/.test(key)) type(own, axis, text + key.replace(",", "."));
  else if (key === "Delete") type(own, axis, text.slice(0, -1));
  else return store.get().typed !== null;
  return true;
}

function type(own: Drag, axis: number | null, text: string): void {
  const state = store.get();
  const value = text === "" ? NaN : Number(text);
  own.latest = Number.isFinite(value)
    ? typedMotion(own.start, state.gizmo, axisIn(own.start, axis, state.local), value)
    : own.start;
  store.set({ typed: { axis, text } });
  showAhead(own.handle, { transform: own.latest }, Infinity);
  if (serverPoses(store.get())) send({ type: "compute", transforms: [poseTransform([own.handle, own.latest])] });
}

function sendDrag(own: Drag, settle: boolean): number {
  const { handle, latest, controls, begun } = own;
  const transform = latest ? message(handle, latest) : {};
  const request = send({ type: "move", handle, transform, controls, merge: begun, settle });
  own.begun = true;
  own.controls = {};
  // The server computes poses that the shader does not support.
  if (serverPoses(store.get()) && !settle) send({ type: "compute" });
  return request;
}

/** Let the dragged handle move less (−1) or more (1) of the surface, in the same undo step as the drag. */
export function resizeDragged(by: -1 | 1): void {
  const state = store.get();
  const known = selectedHandle(state);
  if (!known || !drag) return;
  const { reach, reach_by, level, origin, mask_part } = present(state, known);
  const next = neighbor(origin, level, by);
  const byNumber = { reach: MathUtils.clamp(reach * WHEEL_FACTOR ** by, 0.02, 2) };
  const changed = reach_by === "number" ? byNumber : next === null ? null : { level: next };
  if (!changed) return;
  drag.controls = mask_part && changed !== byNumber ? { ...changed, mask: "part" } : changed;
  showAhead(drag.handle, changed, Infinity);
  dragTo(drag.latest ?? drag.start);
}

/** Return how much the dragged handle moves, in the mode that its reach has: the step of its part, or a distance. */
export function reachText(handle: HandleState): string {
  const part = handle.reach_by === "part" && handle.region === 0;
  return (part && stepText(store.get(), handle.origin, handle.level)) || `reach ${handle.reach.toFixed(2)}`;
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

/** Set the values that the user typed in the selected handle's transform. */
export function setMotion(part: Partial<Transform>): void {
  const state = store.get();
  const known = selectedHandle(state);
  if (!known) return;
  const transform = { ...present(state, known).transform, ...part };
  showAhead(known.handle, { transform }, move(known.handle, message(known.handle, transform)));
}

/** Set some values of a transform. The server replaces names, such as the pivot "base", by numbers. */
export function move(handle: number, transform: Move["transform"]): number {
  return send({ type: "move", handle, transform, settle: true });
}

/** Convert a transform for a request. The pivot is null if the server already has this pivot. */
function message(handle: number, { pivot_at, pivot, axes, joint, ...rest }: Transform) {
  const known = store.get().edit?.handles.find((other) => other.handle === handle);
  const same = known?.pivot_set && known.pivot.every((x, i) => x === pivot?.[i]);
  return {
    ...rest,
    pivot: same ? null : (pivot_at ?? pivot ?? ("auto" as const)),
    axes: axes ?? ("auto" as const),
    joint: joint ?? ("spread" as const),
  };
}

/** Convert a handle and its transform to an entry of a key pose. */
export function poseTransform([handle, transform]: readonly [number, Transform]): PoseTransform {
  return { handle, ...transform, pivot_at: null };
}

/** Return the transforms at the timeline's moment, or null if the edit is shown. */
export function seenTransforms(): PoseTransform[] | null {
  const { moment, edit } = store.get();
  const present = new Set(edit?.handles.map(({ handle }) => handle));
  return moment && [...moment].filter(([handle]) => present.has(handle)).map(poseTransform);
}

/** Show a change of a handle before the server confirms it. The `id` of the request for this change is `request`. */
export function showAhead(handle: number, part: Partial<Ahead>, request: number): void {
  const ahead = new Map(store.get().ahead);
  ahead.set(handle, { ...ahead.get(handle), ...part, request });
  store.set({ ahead });
}
