/** Everything that the page shows; what the server says of the edit lies in `edit` as it came. */

import type { Frame, Transform, Vec3 } from "../posing/affine";
import type { Layer } from "../posing/columns";
import type { Payload } from "../protocol/binary_messages";
import type {
  DetailMessage,
  HandleState,
  MeshMessage,
  ProgressMessage,
  ReportMessage,
  SessionMessage,
  SimilarMessage,
  StateMessage,
  Suggestion,
} from "../protocol/messages";
import { createStore } from "./store";

export type Look = "texture" | "clay" | "features" | "heat";
export type Tool = "hold" | "fix" | "paint" | "pivot";
export type GizmoMode = "translate" | "rotate" | "scale";
export type Theme = "system" | "light" | "dark";
/** Whether movement may be drawn coarser than rest. */
export type Quality = "auto" | "full";
/** All of the shape, or its coarse level. */
export type Level = "coarse" | "full";

export interface Instance {
  /** Rows of the orthogonal matrix that turns or mirrors the handle's motion into the instance's. */
  readonly frame: Frame;
  /** Of the handle's counterpart. */
  readonly position: Vec3;
  readonly gain: number;
  readonly share: Layer;
}

export interface ColumnData {
  readonly layer: Layer;
  readonly instances: readonly Instance[];
}

/** What the page knows before the server does: a drag or a slider under way. It ends with a state that includes it. */
export interface Ahead extends Partial<
  Readonly<Pick<HandleState, "reach" | "falloff" | "locality" | "strength"> & { transform: Transform; radius: number }>
> {
  /** The newest request that tells the server of it. */
  readonly request: number;
}

export interface Hover {
  /** The nearest vertex, and a row of the mesh that stands for it. */
  readonly vertex: number;
  readonly row: number;
}

export interface Probe {
  readonly vertex: number;
  readonly layer: Layer;
}

export interface Toast {
  readonly key: number;
  readonly text: string;
  readonly kind: "note" | "problem";
}

/** What the server posed, per vertex: (V, 3) positions and (V, 4) normals. */
export interface Posed {
  readonly positions: Float32Array;
  readonly normals: Int16Array;
}

export interface State {
  readonly link: "connecting" | "open" | "lost" | "closed";
  /** Why the connection is closed for good. */
  readonly ended: string | null;
  readonly session: SessionMessage | null;
  readonly page: "waiting" | "start" | "shape";
  readonly mesh: MeshMessage | null;
  /** The arrays of `mesh`. */
  readonly meshArrays: Payload | null;
  /** The whole of a mesh that came as its coarse level. */
  readonly detail: { readonly message: DetailMessage; readonly arrays: Payload } | null;
  /** (V, 4) colors of the features' main directions. */
  readonly featureColors: Uint8Array | null;
  /** What the server posed, where the shader cannot. */
  readonly posed: Posed | null;
  readonly edit: StateMessage | null;
  readonly columns: ReadonlyMap<number, ColumnData>;
  readonly ahead: ReadonlyMap<number, Ahead>;
  readonly selected: number | null;
  readonly hidden: ReadonlySet<number>;
  readonly hover: Hover | null;
  readonly probe: Probe | null;
  /** What the brush has touched, a bit per vertex and the same as weights. */
  readonly painted: { readonly mask: Uint8Array; readonly layer: Layer; readonly count: number } | null;
  readonly suggestions: readonly Suggestion[];
  /** The places that look like the one that the selected handle holds. */
  readonly similar: SimilarMessage | null;
  readonly progress: ProgressMessage | null;
  readonly uploading: string | null;
  readonly report: ReportMessage | null;
  readonly tool: Tool;
  readonly gizmo: GizmoMode;
  readonly space: "local" | "world";
  readonly snap: boolean;
  readonly uniformScale: boolean;
  readonly dragging: boolean;
  readonly look: Look;
  readonly wireframe: boolean;
  readonly quality: Quality;
  /** What of the shape is seen: all of it, its coarse level, or that because the rest has not come yet. */
  readonly seen: Level | "loading";
  readonly showPlanes: boolean;
  readonly showGhosts: boolean;
  readonly theme: Theme;
  readonly comparing: boolean;
  /** Transforms by handle while the timeline shows a moment; null shows the edit. */
  readonly moment: ReadonlyMap<number, Transform> | null;
  readonly playhead: number;
  readonly playing: boolean;
  readonly timeline: boolean;
  readonly inspector: boolean;
  readonly help: boolean;
  readonly brush: { readonly radius: number; readonly strength: number };
  readonly toasts: readonly Toast[];
  /** How often somebody asked to see the whole shape again. */
  readonly framed: number;
}

/** What is known of a shape and done to it, while none is open. */
export const CLOSED = {
  mesh: null,
  meshArrays: null,
  detail: null,
  featureColors: null,
  posed: null,
  edit: null,
  columns: new Map(),
  ahead: new Map(),
  selected: null,
  hidden: new Set(),
  hover: null,
  probe: null,
  painted: null,
  suggestions: [],
  similar: null,
  report: null,
  tool: "hold",
  comparing: false,
  moment: null,
  playing: false,
} as const satisfies Partial<State>;

const INITIAL: State = {
  ...CLOSED,
  link: "connecting",
  ended: null,
  session: null,
  page: "waiting",
  progress: null,
  uploading: null,
  gizmo: "translate",
  space: "world",
  snap: false,
  uniformScale: false,
  dragging: false,
  look: "texture",
  wireframe: false,
  quality: "auto",
  seen: "full",
  showPlanes: false,
  showGhosts: true,
  theme: "system",
  playhead: 0,
  timeline: false,
  inspector: true,
  help: false,
  brush: { radius: 0.05, strength: 1 },
  toasts: [],
  framed: 0,
};

export const store = createStore(INITIAL);

/** A handle as it acts now: the server's numbers, what the page knows before it, and the timeline's moment. */
export function present(state: State, handle: HandleState): HandleState & { readonly transform: Transform } {
  const ahead = state.ahead.get(handle.handle);
  const own: Transform = {
    translation: handle.translation,
    rotation: handle.rotation,
    scale: handle.scale,
    pivot: handle.own_pivot ? handle.pivot : null,
    axes: handle.axes,
  };
  return {
    ...handle,
    exponent: ahead?.locality ?? handle.exponent,
    // One of locality and radius ends the other.
    radius: ahead?.locality === undefined ? handle.radius : null,
    ...ahead,
    transform: state.moment?.get(handle.handle) ?? ahead?.transform ?? own,
  };
}

export function selectedHandle(state: State): HandleState | null {
  return state.edit?.handles.find((handle) => handle.handle === state.selected) ?? null;
}

/** Whether the shape can be held: its field is there. */
export function ready(state: State): boolean {
  return state.edit?.field.status === "ready";
}

export function handleName({ name, handle }: HandleState): string {
  return name ?? `Handle ${handle}`;
}

export function placeName({ vertex, region }: { readonly vertex: number | null; readonly region: number }): string {
  if (region > 0) return `region of ${region} vertices`;
  return vertex === null ? "point" : `vertex ${vertex}`;
}
