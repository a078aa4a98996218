/** The state of the page. `edit` is the server's last state, unchanged. */

import { pickTransform, type Transform, type Vec3 } from "../posing/affine";
import type { Surface } from "../posing/held";
import type { Payload } from "../protocol/binary_messages";
import type {
  AxisMessage,
  HandleState,
  LadderMessage,
  MeshMessage,
  ProgressMessage,
  RecentShape,
  ReportMessage,
  SessionMessage,
  SimilarMessage,
  SimilarPoint,
  StateMessage,
  Suggestion,
} from "../protocol/messages";
import { createStore } from "./store";

export type Look = "texture" | "clay" | "features" | "heat";
export const TOOLS = ["hold", "fix", "paint", "box", "pivot", "marks"] as const;
export type Tool = (typeof TOOLS)[number];
export type View = "usual" | "front" | "back" | "right" | "left" | "top" | "bottom";
export const MODES = ["translate", "rotate", "scale", "bend"] as const;
export type GizmoMode = (typeof MODES)[number];

/** Changes of a handle that are shown before the server confirms them. */
export interface Ahead extends Partial<Omit<HandleState, "handle">> {
  readonly transform?: Transform;
  /** The `id` of the newest request with a change. */
  readonly request: number;
}

/** A picked point of the shape. */
export interface Picked {
  /** The nearest vertex, and one of its rows in the mesh's arrays. A vertex at a texture seam has several rows. */
  readonly vertex: number;
  readonly row: number;
  /** The point on the resting surface, relative to the mesh's center. */
  readonly point: Vec3;
}

export interface Proposals {
  readonly handle: number;
  readonly choices: readonly { readonly label: string; readonly controls: object; readonly picture: string }[];
}

interface Toast {
  readonly key: number;
  readonly text: string;
  /** A button beside the text. */
  readonly action?: { readonly text: string; readonly run: () => unknown } | undefined;
  readonly kind: "note" | "problem";
}

/** The server's pose, per vertex: (V, 3) positions and (V, 4) normals. */
export interface Posed {
  readonly positions: Float32Array;
  readonly normals: Int16Array;
}

/** The entries of the state that belong to the open shape, and their values without an open shape. */
export const CLOSED = {
  mesh: null as MeshMessage | null,
  /** The arrays of `mesh`. */
  meshArrays: null as Payload | null,
  /** Samples of the surface, which measure how much of the surface follows a handle. */
  surface: null as Surface | null,
  /** Whether the shape is visible. */
  drawn: false,
  /** The colors that show the features of the vertices, (V, 4). */
  featureColors: null as Uint8Array | null,
  /** The server's pose, for blends that the shader does not support. */
  posed: null as Posed | null,
  edit: null as StateMessage | null,
  /** The weights of each column times 65535, (V). The keys are the identifiers `column` in `edit`. */
  columns: new Map() as ReadonlyMap<number, Uint16Array>,
  ahead: new Map() as ReadonlyMap<number, Ahead>,
  selected: null as number | null,
  hover: null as Picked | null,
  /** Weights of a new handle at `vertex`. If `vertex` is null, weights of the selected handle with another part. */
  probe: null as {
    readonly vertex: number | null;
    readonly level: number;
    /** Whether the weights are those after a click. Approximate weights are shown until these arrive. */
    readonly exact: boolean;
    readonly weights: Uint16Array;
  } | null,
  /** The level of the part that a click at the pointer holds. */
  level: 0,
  /** The parts at a vertex, by vertex. */
  ladders: new Map() as ReadonlyMap<number, LadderMessage>,
  /** The motion that the user types: its axis, and the characters of the number. */
  typed: null as { readonly axis: number | null; readonly text: string } | null,
  /** The painted region: weights of 0 or 65535, (V), and the number of painted vertices. */
  painted: null as { readonly weights: Uint16Array; readonly count: number } | null,
  /** The pixel of the page at which the newest stroke or box ended. */
  stroked: null as readonly [number, number] | null,
  /** The mark that the user drags, and its target. */
  marked: null as { readonly index: number; readonly target: Vec3 } | null,
  suggestions: [] as readonly Suggestion[],
  /** The places of the selected handle and its counterparts. */
  similar: null as SimilarMessage | null,
  /** The possible pivots of the selected handle, and the axis of its part. */
  axis: null as AxisMessage | null,
  /** How strongly each vertex stays in place, times 65535, (V), while the user fixes points. */
  stays: null as Uint16Array | null,
  /** Other controls for the handle that the user has just moved, with small pictures of the shape. */
  proposals: null as Proposals | null,
  report: null as ReportMessage | null,
  /** Whether the server has stored the newest edit on its disk. */
  saved: true,
  tool: "hold" as Tool,
  comparing: false,
  /** The transform of each handle at the moment that the timeline shows; null if the page shows the edit. */
  moment: null as ReadonlyMap<number, Transform> | null,
  playing: false,
  /** The index of the chosen key pose. */
  pose: 0,
};

const INITIAL = {
  ...CLOSED,
  link: "connecting" as "connecting" | "open" | "lost" | "closed",
  /** Whether the server works on a request for so long that the page says so. */
  busy: false,
  /** Why the page has no connection, and the text of the button that helps; null if no dialog says so. */
  ended: null as { readonly title: string; readonly text: string; readonly button: string | null } | null,
  session: null as SessionMessage | null,
  page: "waiting" as "waiting" | "start" | "shape",
  /** The shapes that were edited last. */
  recent: [] as readonly RecentShape[],
  progress: null as ProgressMessage | null,
  uploading: null as string | null,
  gizmo: "translate" as GizmoMode,
  /** Whether the gizmo uses the axes of the handle instead of the axes of the world. */
  local: false,
  snap: false,
  dragging: false,
  look: "texture" as Look,
  wireframe: false,
  playhead: 0,
  timeline: false,
  inspector: true,
  help: false,
  /** The radius of the brush, as a fraction of the diagonal of the shape's bounding box. */
  brush: 0.05,
  toasts: [] as readonly Toast[],
  /** Whether a file is dragged over the page. */
  dropping: false,
  /** Whether the window is as narrow as a phone. */
  narrow: false,
  orthographic: false,
  /** The newest command for the camera: show the shape or the handle's part, or look from a direction. */
  framed: null as { readonly what: "shape" | "selection" | View } | null,
  xray: false,
  /** Whether the surface that follows the selected handle is always colored. */
  weights: false,
  /** Whether only the part of the selected handle is shown. */
  isolated: false,
  /** Whether the inspector shows rarely used settings. */
  more: false,
};

export type State = Readonly<typeof INITIAL>;

export const store = createStore<State>(INITIAL);

/** Return the transform that a handle has on the server. */
export function transformOf(handle: HandleState): Transform {
  return { ...pickTransform(handle), pivot: handle.pivot_set ? handle.pivot : null };
}

/** Return a handle as the page shows it: the server's state with unconfirmed changes and the timeline's moment. */
export function present(state: State, handle: HandleState): HandleState & { readonly transform: Transform } {
  const ahead = state.ahead.get(handle.handle);
  const own = transformOf(handle);
  // The server sets the pivot at the first rotation or scale. Until then, the gizmo is at the automatic pivot.
  const turns = state.gizmo === "rotate" || state.gizmo === "scale";
  const automatic = turns && !handle.pivot_set && state.axis?.handle === handle.handle;
  const initial: Transform = automatic ? { ...own, pivot: state.axis.auto, pivot_at: "auto" } : own;
  return {
    ...handle,
    // Locality and radius exclude each other.
    radius: ahead?.locality === undefined ? handle.radius : null,
    ...ahead,
    transform: state.moment?.get(handle.handle) ?? ahead?.transform ?? initial,
  };
}

/** Degrees of rotation up to which the shader's linear blend looks like the server's blend of dual quaternions. */
const MOST_LINEAR = 5;

/** Return whether the server must compute the pose: the shader only supports linear blends without bends. */
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

/** Return the counterparts of the selected handle, without the place of the handle itself. */
export function otherPlaces(state: State): readonly SimilarPoint[] {
  const handle = selectedHandle(state);
  const known = handle && state.similar?.handle === handle.handle && handle.follow !== "none";
  return known ? state.similar.places.slice(1) : [];
}

/** Return the index of the step of `level` in a ladder. Levels beyond the ends stand for the last step there. */
export function stepAt({ steps }: LadderMessage, level: number): number {
  const index = steps.findIndex((step) => step.level >= level);
  return index < 0 ? steps.length - 1 : index;
}

/** Return the step of `level` at a vertex in words; empty if the parts there are not known yet. */
export function stepText({ ladders }: Pick<State, "ladders">, vertex: number | null, level: number): string {
  const ladder = vertex === null ? undefined : ladders.get(vertex);
  if (!ladder) return "";
  const index = stepAt(ladder, level);
  return `${index + 1} of ${ladder.steps.length}: ${ladder.steps[index].text}`;
}

/** Return whether handles can be added: the shape has a field. */
export function ready({ edit }: Pick<State, "edit">): boolean {
  return edit?.field.status === "ready";
}

/** Return whether a tool selects vertices by drawing over the shape. */
export function draws(tool: Tool): tool is "paint" | "box" {
  return tool === "paint" || tool === "box";
}

/** Return whether only the surface that follows the selected handle is visible. */
export function isolates({ isolated, selected, painted }: Pick<State, "isolated" | "selected" | "painted">): boolean {
  return isolated && selected !== null && !painted;
}

/** Return whether the view colors the surface that follows the selected handle: while it is chosen, or on request. */
export function colorsHandle(state: State): boolean {
  const handle = selectedHandle(state);
  if (!handle) return false;
  const resized = state.dragging && state.ahead.get(handle.handle)?.level !== undefined;
  return state.look === "heat" || state.weights || resized || (!handle.moved && !state.dragging && !state.moment);
}

/** Return the color of a handle. Hues at multiples of the golden angle are distinct for any number of handles. */
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
