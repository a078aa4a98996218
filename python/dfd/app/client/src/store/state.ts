/** Everything that the page shows; what the server says of the edit lies in `edit` as it came. */

import type { Link } from "../protocol/connection";
import type {
  AlikeMessage,
  HandleState,
  MeshMessage,
  ProgressMessage,
  ReportMessage,
  SessionMessage,
  StateMessage,
  Suggestion,
} from "../protocol/messages";
import type { Frame, Transform, Vec3 } from "../viewer/posing/affine";
import type { Layer } from "../viewer/posing/columns";
import type { Level, Quality } from "../viewer/pace";
import { createStore, type Store } from "./store";

export type Look = "texture" | "clay" | "features" | "heat";
export type Tool = "hold" | "fix" | "paint" | "pivot";
export type GizmoMode = "translate" | "rotate" | "scale";
export type Theme = "system" | "light" | "dark";

export interface Instance {
  readonly instance: number;
  readonly on: boolean;
  readonly pivot: Vec3;
  /** Rows of the orthogonal matrix that turns or mirrors the handle's motion into the instance's. */
  readonly frame: Frame;
  /** Of the handle's counterpart. */
  readonly position: Vec3;
  readonly gain: number;
  readonly share: Layer;
}

/** What came of a column. */
export interface ColumnData {
  readonly layer: Layer;
  readonly instances: readonly Instance[];
}

/** What the page knows before the server does: a drag or a slider under way. It ends with a state that includes it. */
export interface Ahead {
  readonly transform?: Transform;
  readonly reach?: number;
  readonly falloff?: string;
  readonly locality?: number;
  readonly radius?: number;
  readonly strength?: number;
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

export interface State {
  readonly link: Link;
  /** Why the connection is closed for good. */
  readonly ended: string | null;
  readonly session: SessionMessage | null;
  readonly page: "waiting" | "start" | "shape";
  readonly mesh: MeshMessage | null;
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
  readonly alike: AlikeMessage | null;
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
  /** Whether movement may be drawn coarser than rest. */
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
}

export const INITIAL: State = {
  link: "connecting",
  ended: null,
  session: null,
  page: "waiting",
  mesh: null,
  edit: null,
  columns: new Map(),
  ahead: new Map(),
  selected: null,
  hidden: new Set(),
  hover: null,
  probe: null,
  painted: null,
  suggestions: [],
  alike: null,
  progress: null,
  uploading: null,
  report: null,
  tool: "hold",
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
  comparing: false,
  moment: null,
  playhead: 0,
  playing: false,
  timeline: false,
  inspector: true,
  help: false,
  brush: { radius: 0.05, strength: 1 },
  toasts: [],
};

export type AppStore = Store<State>;

export const store: AppStore = createStore(INITIAL);

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
    reach: ahead?.reach ?? handle.reach,
    falloff: ahead?.falloff ?? handle.falloff,
    locality: ahead?.locality ?? handle.locality,
    exponent: ahead?.locality ?? handle.exponent,
    radius: ahead?.radius ?? (ahead?.locality === undefined ? handle.radius : null),
    strength: ahead?.strength ?? handle.strength,
    transform: state.moment?.get(handle.handle) ?? ahead?.transform ?? own,
  };
}

export function selectedHandle(state: State): HandleState | null {
  return state.edit?.handles.find((handle) => handle.handle === state.selected) ?? null;
}

/** Whether the shape can be held: its field is there. */
export function alive(state: State): boolean {
  return state.edit?.field.status === "ready";
}
