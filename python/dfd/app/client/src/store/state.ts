/** Everything that the page shows; what the server says of the edit lies in `edit` as it came. */

import type { Transform } from "../posing/affine";
import type { Surface } from "../posing/held";
import type { Payload } from "../protocol/binary_messages";
import type {
  AxisMessage,
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
export type Tool = "hold" | "fix" | "paint" | "box" | "pivot";
export type View = "usual" | "front" | "back" | "right" | "left" | "top" | "bottom";
export type GizmoMode = "translate" | "rotate" | "scale" | "bend";

/** What the page knows before the server does: a drag or a slider under way. It ends with a state that includes it. */
export interface Ahead extends Partial<Omit<HandleState, "handle">> {
  readonly transform?: Transform;
  /** The newest request that tells the server of it. */
  readonly request: number;
}

export interface Hover {
  /** The nearest vertex, and a row of the mesh that stands for it. */
  readonly vertex: number;
  readonly row: number;
}

/** What a handle would hold: a new one at a vertex, or the selected one with another part. */
export interface Probe {
  readonly vertex: number | null;
  readonly weights: Uint16Array;
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

/** What is known of a shape and done to it, while none is open. */
export const CLOSED = {
  mesh: null as MeshMessage | null,
  /** The arrays of `mesh`. */
  meshArrays: null as Payload | null,
  /** What of it how much a handle holds is measured on. */
  surface: null as Surface | null,
  /** (V, 4) colors of the features' main directions. */
  featureColors: null as Uint8Array | null,
  /** What the server posed, where the shader cannot. */
  posed: null as Posed | null,
  edit: null as StateMessage | null,
  /** (V) weights times 65535, by the numbers of columns. */
  columns: new Map() as ReadonlyMap<number, Uint16Array>,
  ahead: new Map() as ReadonlyMap<number, Ahead>,
  selected: null as number | null,
  hover: null as Hover | null,
  probe: null as Probe | null,
  /** What the brush has touched, a bit per vertex and the same as weights. */
  painted: null as { readonly mask: Uint8Array; readonly weights: Uint16Array; readonly count: number } | null,
  suggestions: [] as readonly Suggestion[],
  /** The places that look like the one that the selected handle holds. */
  similar: null as SimilarMessage | null,
  /** What the selected handle may turn about, and along what it bends. */
  axis: null as AxisMessage | null,
  report: null as ReportMessage | null,
  tool: "hold" as Tool,
  comparing: false,
  /** Transforms by handle while the timeline shows a moment; null shows the edit. */
  moment: null as ReadonlyMap<number, Transform> | null,
  playing: false,
};

const INITIAL = {
  ...CLOSED,
  link: "connecting" as "connecting" | "open" | "lost" | "closed",
  /** Why the connection is closed for good. */
  ended: null as string | null,
  session: null as SessionMessage | null,
  page: "waiting" as "waiting" | "start" | "shape",
  progress: null as ProgressMessage | null,
  uploading: null as string | null,
  gizmo: "translate" as GizmoMode,
  /** Whether the gizmo has the axes of the handle, not of the world. */
  local: false,
  snap: false,
  dragging: false,
  look: "texture" as Look,
  wireframe: false,
  playhead: 0,
  timeline: false,
  inspector: true,
  help: false,
  /** Of the brush, as part of the shape's size. */
  brush: 0.05,
  toasts: [] as readonly Toast[],
  /** The newest wish to see the shape, the selection, or either from another side; each is an object of its own. */
  framed: null as { readonly what: "shape" | "selection" | View } | null,
  xray: false,
  /** Whether only what the selected handle holds is seen. */
  isolated: false,
  /** Whether the inspector shows what is rarely needed. */
  more: false,
};

export type State = Readonly<typeof INITIAL>;

export const store = createStore<State>(INITIAL);

/** The transform of a handle as the server has it. */
export function transformOf(handle: HandleState): Transform {
  const { translation, rotation, scale, pivot_set, pivot, pivot_at, axes, bend, twist, joint } = handle;
  return { translation, rotation, scale, pivot: pivot_set ? pivot : null, pivotAt: pivot_at, axes, bend, twist, joint };
}

/** A handle as it acts now: the server's numbers, what the page knows before it, and the timeline's moment. */
export function present(state: State, handle: HandleState): HandleState & { readonly transform: Transform } {
  const ahead = state.ahead.get(handle.handle);
  const own = transformOf(handle);
  // What turns for the first time turns about what the server will find.
  const turns = state.gizmo === "rotate" || state.gizmo === "scale";
  const found = turns && !handle.pivot_set && state.axis?.handle === handle.handle;
  const begins: Transform = found ? { ...own, pivot: state.axis.auto, pivotAt: "auto" } : own;
  return {
    ...handle,
    // One of locality and radius ends the other.
    radius: ahead?.locality === undefined ? handle.radius : null,
    ...ahead,
    transform: state.moment?.get(handle.handle) ?? ahead?.transform ?? begins,
  };
}

/** Degrees: larger turns are blended by dual quaternions, which the shader does not do. */
const MOST_LINEAR = 30;

/** Whether the server has to pose: the shader adds linear motions, and bends nothing. */
export function serverPoses(state: State): boolean {
  const { edit } = state;
  if (!edit || state.comparing) return false;
  if (edit.preset === "paper") return true;
  return edit.handles.some((handle) => {
    const { rotation, bend, twist } = present(state, handle).transform;
    return Math.hypot(...rotation) > MOST_LINEAR || twist !== 0 || bend.some((part) => part !== 0);
  });
}

export function selectedHandle(state: State): HandleState | null {
  return state.edit?.handles.find((handle) => handle.handle === state.selected) ?? null;
}

/** Whether the shape can be held: its field is there. */
export function ready({ edit }: Pick<State, "edit">): boolean {
  return edit?.field.status === "ready";
}

/** The color of a handle: hues of the golden angle lie apart however many there are. */
export function handleColor(handle: number): string {
  return `hsl(${(228 + 137.5 * (handle - 1)) % 360} 60% 50%)`;
}

export function handleName({ name, handle }: HandleState): string {
  return name ?? `Handle ${handle}`;
}

export function placeName({ vertex, region }: { readonly vertex: number | null; readonly region: number }): string {
  if (region > 0) return `region of ${region} vertices`;
  return vertex === null ? "point" : `vertex ${vertex}`;
}
