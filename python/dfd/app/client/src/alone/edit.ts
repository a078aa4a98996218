/** The edit of a page without a server: a value that is replaced by each step, so that steps are undone. */

import { subtract, type Vec3 } from "../posing/affine";
import type { Controls, FixedState, HandleState, Plane, PoseTransform, Transform } from "../protocol/messages";

export interface Edit {
  readonly handles: readonly HandleState[];
  readonly fixed: readonly FixedState[];
  readonly symmetry: Plane | null;
  readonly default: PoseTransform | null;
}

export const NO_EDIT: Edit = { handles: [], fixed: [], symmetry: null, default: null };

/** What is done in the app alone. */
export class Unserved extends Error {
  constructor() {
    super("This takes the app, since this page has no server.");
  }
}

/** Steps that can be undone; a step of the same topic joins the newest one where it says so. */
export class History {
  private before: Edit[] = [];
  private after: Edit[] = [];
  private topic = "";

  constructor(public present: Edit) {}

  get canUndo(): boolean {
    return this.before.length > 0;
  }

  get canRedo(): boolean {
    return this.after.length > 0;
  }

  set(next: Edit, topic = "", merge = false): void {
    if (!merge || topic !== this.topic) this.before.push(this.present);
    this.topic = topic;
    this.after = [];
    this.present = next;
  }

  undo(): void {
    this.step(this.before, this.after);
  }

  redo(): void {
    this.step(this.after, this.before);
  }

  private step(from: Edit[], to: Edit[]): void {
    const next = from.pop();
    if (!next) return;
    to.push(this.present);
    this.present = next;
    this.topic = "";
  }
}

const ORIGIN: Vec3 = [0, 0, 0];
const ONE: Vec3 = [1, 1, 1];
const same = (a: Vec3, b: Vec3) => Math.hypot(...subtract(a, b)) === 0;

/** The edit with one of its handles changed. */
export function withHandle(edit: Edit, id: number, change: (handle: HandleState) => HandleState): Edit {
  if (!edit.handles.some(({ handle }) => handle === id)) throw new Error(`There is no handle ${id}.`);
  return { ...edit, handles: edit.handles.map((handle) => (handle.handle === id ? change(handle) : handle)) };
}

/** A handle with those parts of its transform set that are given. */
export function moved(handle: HandleState, given: Transform): HandleState {
  const { bend, twist, joint, axes, pivot } = given;
  const straight = bend === undefined || bend === null || (typeof bend !== "number" && same(bend, ORIGIN));
  if (!straight || (twist ?? 0) !== 0 || typeof joint === "number" || axes === "normal") throw new Unserved();
  const translation = given.translation ?? handle.translation;
  const rotation = given.rotation ?? handle.rotation;
  const scale = given.scale ?? handle.scale;
  if (rotation.length !== 3) throw new Unserved();
  return {
    ...handle,
    ...pivotOf(handle, pivot ?? null),
    translation,
    rotation,
    scale,
    axes: axes === "auto" ? null : (axes ?? handle.axes),
    moved: !same(translation, ORIGIN) || !same(rotation, ORIGIN) || !same(scale, ONE),
  };
}

function pivotOf(handle: HandleState, pivot: NonNullable<Transform["pivot"]> | null): Partial<HandleState> {
  if (pivot === null) return {};
  if (pivot === "auto") return { pivot: handle.position, pivot_set: false, pivot_at: null };
  if (pivot === "point") return { pivot: handle.position, pivot_set: true, pivot_at: pivot };
  if (typeof pivot === "string") throw new Unserved();
  return { pivot, pivot_set: true, pivot_at: null };
}

/** Where a key pose has a handle. */
export function posed(handle: HandleState, { pivot, axes, ...pose }: PoseTransform): HandleState {
  return moved(handle, { ...pose, pivot: pivot ?? "auto", axes: axes ?? "auto" });
}

export const AT_REST: Transform = { translation: ORIGIN, rotation: ORIGIN, scale: ONE };

/** A handle with those controls set that are given: those by which a column that is there can be weighed. */
export function controlled(handle: HandleState, given: Controls): HandleState {
  const { name, reach, falloff, strength, ...others } = given;
  if (reach === "auto" || Object.values(others).some((value) => (value ?? null) !== null)) {
    throw new Unserved();
  }
  const reachBy = (reach ?? null) === null ? handle.reach_by : reach === "part" ? reach : "number";
  return {
    ...handle,
    name: name ?? handle.name,
    reach: typeof reach === "number" ? reach : handle.reach,
    reach_by: reachBy,
    level: reachBy === "part",
    falloff: falloff ?? handle.falloff,
    strength: strength ?? handle.strength,
  };
}
