/** Apply the messages of the server to the store. */

import type { Payload, Received, ServerMessage } from "../protocol/binary_messages";
import { surfaceOf } from "../posing/held";
import type { StateMessage } from "../protocol/messages";
import { CLOSED, serverPoses, store, type State } from "../store/state";
import { keep } from "./connection";
import { note, problem } from "./toasts";

/** Stages that report the end of background work. */
const ENDED = ["done", "cancelled", "failed"];

type Kind = ServerMessage["type"];
type Changes = {
  [Type in Kind]?: (message: Extract<ServerMessage, { type: Type }>, payload: Payload) => Partial<State>;
};

/** What each message changes in the state. */
const CHANGES: Changes = {
  session: (session) => ({ session }),
  start: ({ recent }) => ({ ...CLOSED, page: "start", progress: null, recent }),
  mesh: (mesh, payload) => ({
    ...CLOSED,
    // A new shape begins with the gizmo that moves.
    ...(store.get().mesh?.name === mesh.name ? {} : { gizmo: "translate" as const }),
    page: "shape",
    progress: null,
    recent: mesh.recent,
    mesh,
    meshArrays: payload,
    surface: surfaceOf(
      mesh.vertices,
      payload.get("positions", "F32"),
      payload.get("triangles", "U32"),
      payload.get("vertex", "U32"),
    ),
  }),
  state: withEdit,
  saved: ({ saved }) => ({ saved }),
  columns: ({ columns }, payload) => ({ columns: withColumns(columns, payload.get("values", "U16")) }),
  heat: ({ vertex, level, exact }, payload) => {
    const { hover, level: wanted } = store.get();
    const current = vertex !== null && hover?.vertex === vertex && wanted === level;
    return current ? { probe: { vertex, level, exact, weights: payload.get("values", "U16") } } : {};
  },
  progress: (progress) => ({ progress: ENDED.includes(progress.stage) ? null : progress }),
  report: (report) => ({ report }),
  suggestions: ({ suggestions }) => ({ suggestions }),
  similar: (similar) => ({ similar }),
  ladder: (ladder) => ({ ladders: new Map([...store.get().ladders, [ladder.vertex, ladder]]) }),
  axis: (axis) => ({ axis }),
  colors: (_, payload) => ({ featureColors: payload.get("colors", "U8") }),
  positions: (_, payload) =>
    serverPoses(store.get())
      ? { posed: { positions: payload.get("positions", "F32"), normals: payload.get("normals", "I16") } }
      : {},
};

export function receive({ message, payload }: Received): void {
  const change = CHANGES[message.type] as ((message: ServerMessage, payload: Payload) => Partial<State>) | undefined;
  if (change) store.set(change(message, payload));
  if (message.type === "mesh") message.warnings.forEach((warning) => note(warning));
  if (message.type === "saved") keep(message.key);
  if (message.type !== "failure") return;
  problem(message.message);
  hideRefused(message.id);
}

/** Hide the unconfirmed changes of handles if the server refused the request that contains them. */
function hideRefused(request: number): void {
  const { ahead } = store.get();
  const kept = [...ahead].filter(([, part]) => part.request !== request);
  if (kept.length < ahead.size) store.set({ ahead: new Map(kept) });
}

function withEdit(message: StateMessage): Partial<State> {
  const state = store.get();
  if (state.edit?.field.origin === "geometry" && message.field.origin === "distilled")
    note("The features are learned. Handles now move all parts that look alike.");
  if (state.edit?.field.status !== "ready" && message.field.status === "ready" && message.handles.length > 0)
    if (message.steps.length === 0 && !state.edit?.handles.length)
      note("Your edit of this shape is back. Undo begins here.");
  const used = new Set(message.handles.flatMap((handle) => handle.columns.map(({ column }) => column)));
  const present = new Set(message.handles.map((handle) => handle.handle));
  const before = new Set(state.edit?.handles.map((handle) => handle.handle));
  const added = message.handles.filter((handle) => !before.has(handle.handle));
  const kept = state.selected !== null && present.has(state.selected) ? state.selected : null;
  return {
    edit: message,
    ahead: new Map([...state.ahead].filter(([handle, { request }]) => present.has(handle) && request > message.after)),
    columns: new Map([...state.columns].filter(([column]) => used.has(column))),
    // Select a new handle.
    selected: state.edit && added.length === 1 ? added[0].handle : kept,
    page: "shape",
  };
}

/** Return the known columns and the new ones. Row i of `rows` (C, V) has the weights of the column `ids[i]`. */
function withColumns(ids: readonly number[], rows: Uint16Array): Map<number, Uint16Array> {
  const size = rows.length / ids.length;
  const added = ids.map((id, i) => [id, rows.subarray(i * size, (i + 1) * size)] as const);
  return new Map([...store.get().columns, ...added]);
}
