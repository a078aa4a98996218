/** What a person does to the shape. */

import type { Controls, Plane } from "../protocol/messages";
import { alive, present, store, type Ahead } from "../store/state";
import type { Transform, Vec3 } from "../viewer/posing/affine";
import { gently } from "./gently";
import { ask, congested, tell } from "./server";
import { note } from "./toasts";

/** Frames of a drag that reach the server: enough to lose nothing, few enough for any line. */
const MOVE_INTERVAL = 50;

type Triple = [number, number, number];
const triple = (v: Vec3): Triple => [v[0], v[1], v[2]];

export function hold(vertex: number): void {
  const { edit } = store.get();
  const there = edit?.handles.find((handle) => handle.vertex === vertex);
  if (there) select(there.handle);
  else void ask({ type: "add", at: { vertex } });
}

export function select(handle: number | null): void {
  store.set({ selected: handle, probe: null });
}

export function remove(handle: number): void {
  void ask({ type: "remove", handle });
}

export function rename(handle: number, name: string): void {
  if (name.trim()) void ask({ type: "change", handle, controls: { name: name.trim() } });
}

export function toggleHidden(handle: number): void {
  const hidden = new Set(store.get().hidden);
  if (!hidden.delete(handle)) hidden.add(handle);
  store.set({ hidden });
}

export function fix(vertex: number): void {
  const { edit } = store.get();
  const index = edit?.fixed.findIndex((fixed) => fixed.vertex === vertex) ?? -1;
  if (index >= 0) release(index);
  else void ask({ type: "fix", at: { vertex } });
}

export function release(index: number): void {
  void ask({ type: "release", index });
}

export function setFixedStrength(index: number, strength: number): void {
  gently(`fixed ${index}`, (merge) => void ask({ type: "change_fixed", index, strength, merge }));
}

/** What was painted, a bit per vertex, lowest first. */
function regionOf(mask: Uint8Array): { mask: string } {
  let text = "";
  for (let i = 0; i < mask.length; i += 4096) text += String.fromCharCode(...mask.subarray(i, i + 4096));
  return { mask: btoa(text) };
}

export function fixPainted(mask: Uint8Array, strength: number): void {
  void ask({ type: "fix", at: regionOf(mask), strength });
}

/** Hold what was painted as one handle. */
export function holdPainted(mask: Uint8Array): void {
  void ask({ type: "add", at: regionOf(mask) });
}

/** Let a handle act nowhere but where was painted; null is everywhere again. */
export function limitTo(handle: number, mask: Uint8Array | null): void {
  void ask({ type: "change", handle, controls: { within: mask ? regionOf(mask) : "everywhere" } });
}

/** How far beyond that region the handle fades, mesh units. */
export function softenLimit(handle: number, width: number): void {
  gently(`${handle} within_width`, (merge) => {
    tell({ type: "change", handle, controls: { within_width: width }, merge });
  });
}

// --- a drag, and sliders: shown at once, told in passing

class Drag {
  private told = 0;
  private timer = 0;
  private begun = false;
  private latest: Transform | null = null;

  constructor(readonly handle: number) {}

  move(transform: Transform): void {
    this.latest = transform;
    ahead(this.handle, { transform }, Infinity);
    const wait = this.told + MOVE_INTERVAL - performance.now();
    if (wait <= 0 && !congested()) this.tell(transform, false);
    else if (this.timer === 0) this.timer = window.setTimeout(() => this.late(), Math.max(wait, 1));
  }

  end(): void {
    clearTimeout(this.timer);
    const reach = store.get().ahead.get(this.handle)?.reach;
    if (this.latest) ahead(this.handle, {}, this.tell(this.latest, true, reach));
    else if (reach !== undefined) change(this.handle, { reach });
  }

  private late(): void {
    this.timer = 0;
    if (this.latest) this.move(this.latest);
  }

  private tell(transform: Transform, settle: boolean, reach?: number): number {
    this.told = performance.now();
    const request = tell({
      type: "move",
      handle: this.handle,
      transform: told(transform),
      // What the wheel did under way is part of the same step.
      controls: reach === undefined ? {} : { reach },
      merge: this.begun,
      settle,
    });
    this.begun = true;
    // The shader lacks some ways to blend: then the server poses, as fast as it can.
    if (store.get().edit?.posing === "server" && !settle) tell({ type: "compute" });
    return request;
  }
}

let drag: Drag | null = null;

export function startDrag(handle: number): void {
  drag = new Drag(handle);
  store.set({ dragging: true, probe: null, moment: null, playing: false });
}

export function dragTo(transform: Transform): void {
  drag?.move(transform);
}

export function endDrag(): void {
  drag?.end();
  drag = null;
  store.set({ dragging: false });
}

/** Set a whole transform at once, as numeric fields do. */
export function moveTo(handle: number, transform: Transform): void {
  ahead(handle, { transform }, tell({ type: "move", handle, transform: told(transform), merge: false, settle: true }));
}

/** Set the transforms of several handles, as one step. */
export function poseTo(transforms: ReadonlyMap<number, Transform>): void {
  const request = tell({
    type: "pose",
    transforms: [...transforms].map(([handle, { translation, rotation, scale, pivot, axes }]) => ({
      handle,
      translation: triple(translation),
      rotation: triple(rotation),
      scale: triple(scale),
      pivot: pivot && triple(pivot),
      axes: axes && (axes.map(triple) as [Triple, Triple, Triple]),
    })),
  });
  transforms.forEach((transform, handle) => ahead(handle, { transform }, request));
}

function told(transform: Transform) {
  return {
    translation: triple(transform.translation),
    rotation: triple(transform.rotation),
    scale: triple(transform.scale),
    pivot: transform.pivot ? triple(transform.pivot) : ("auto" as const),
    axes: transform.axes ? (transform.axes.map(triple) as [Triple, Triple, Triple]) : ("auto" as const),
  };
}

/** Scale along the surface's normal at the handle, or along the mesh's axes again. */
export function setAxes(handle: number, axes: "normal" | "auto"): void {
  void ask({ type: "move", handle, transform: { axes }, settle: true });
}

/** While the wheel turns in a drag, the shape follows at once and the server hears of it at the drag's end. */
export function wheelReach(handle: number, factor: number): void {
  const state = store.get();
  const known = state.edit?.handles.find((other) => other.handle === handle);
  if (!known || !state.edit?.controls.includes("reach")) return;
  const reach = Math.min(Math.max(present(state, known).reach * factor, 0.02), 2);
  if (drag) ahead(handle, { reach }, Infinity);
  else slide(handle, { reach });
}

type Slid = "reach" | "locality" | "radius" | "strength";

/** A slider of a handle: shown at once, told in passing. */
export function slide(handle: number, controls: Partial<Readonly<Record<Slid, number>>>): void {
  ahead(handle, controls, Infinity);
  gently(`${handle} ${Object.keys(controls).join()}`, (merge) =>
    ahead(handle, {}, tell({ type: "change", handle, controls, merge })),
  );
}

export function change(handle: number, controls: Controls): void {
  const own = controls.falloff ? { falloff: controls.falloff } : {};
  ahead(handle, own, tell({ type: "change", handle, controls }));
}

/** Show something before the server knows; `request` is what tells it. */
function ahead(handle: number, part: Partial<Ahead>, request: number): void {
  const known = new Map(store.get().ahead);
  known.set(handle, { ...known.get(handle), ...part, request });
  store.set({ ahead: known });
}

// --- the whole shape

export function setSymmetry(plane: Plane | "auto" | "x" | "y" | "z" | null): void {
  void ask({ type: "set_symmetry", plane });
}

/** Half the width over which the sides of the plane blend, mesh units. */
export function setBand(plane: Plane, band: number): void {
  gently("band", (merge) => void ask({ type: "set_symmetry", plane, band, merge }));
}

/** D₀: what happens to what no handle holds; its pivot is the center of the box. */
export function setDefault(transform: Pick<Transform, "translation" | "rotation" | "scale">): void {
  const { translation, rotation, scale } = transform;
  const parts = { translation: triple(translation), rotation: triple(rotation), scale: triple(scale) };
  gently("default", (merge) => void ask({ type: "set_default", transform: parts, merge }));
}

/** Everything that a preset says, in the place of what was there. */
export function setPreset(preset: string): void {
  void ask({ type: "set_preset", preset });
}

export function setOverlap(mode: string): void {
  void ask({ type: "set_overlap", mode });
}

export function setBlend(mode: string): void {
  void ask({ type: "set_blend", mode });
}

export function undo(): void {
  if (store.get().edit?.can_undo) void ask({ type: "undo" });
}

export function redo(): void {
  if (store.get().edit?.can_redo) void ask({ type: "redo" });
}

export function resetOne(handle: number): void {
  void ask({ type: "reset", handle });
}

export function resetAll(): void {
  void ask({ type: "reset", handle: null });
}

export function clear(): void {
  void ask({ type: "clear" });
}

export function suggest(): void {
  if (store.get().suggestions.length > 0) store.set({ suggestions: [] });
  else if (alive(store.get())) void ask({ type: "suggest", count: 12 });
  else note("Handles can be suggested once the shape is ready.");
}

export function distill(): void {
  void ask({ type: "distill" });
}

export function cancel(): void {
  void ask({ type: "cancel" });
}
