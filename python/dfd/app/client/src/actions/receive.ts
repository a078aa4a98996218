/** Apply the messages of the server to the store. */

import type { Received } from "../protocol/binary_messages";
import { surfaceOf } from "../posing/held";
import type { StateMessage } from "../protocol/messages";
import { CLOSED, serverPoses, store, type State } from "../store/state";
import { keep } from "./connection";
import { note, problem } from "./toasts";

/** Stages that report the end of background work. */
const ENDED = ["done", "cancelled", "failed"];

export function receive({ message, payload }: Received): void {
  switch (message.type) {
    case "session":
      store.set({ session: message });
      break;
    case "start":
      store.set({ ...CLOSED, page: "start", progress: null, recent: message.recent });
      break;
    case "mesh":
      store.set({
        ...CLOSED,
        // A new shape begins with the gizmo that moves.
        ...(store.get().mesh?.name === message.name ? {} : { gizmo: "translate" as const }),
        page: "shape",
        progress: null,
        recent: message.recent,
        mesh: message,
        meshArrays: payload,
        surface: surfaceOf(
          message.vertices,
          payload.get("positions", "F32"),
          payload.get("triangles", "U32"),
          payload.get("vertex", "U32"),
        ),
      });
      message.warnings.forEach((warning) => note(warning));
      break;
    case "state":
      store.set(withEdit(message));
      break;
    case "saved":
      store.set({ saved: message.saved });
      keep(message.key);
      break;
    case "columns":
      store.set({ columns: withColumns(message.columns, payload.get("values", "U16")) });
      break;
    case "heat":
      if (
        message.vertex !== null &&
        store.get().hover?.vertex === message.vertex &&
        store.get().level === message.level
      )
        store.set({
          probe: {
            vertex: message.vertex,
            level: message.level,
            exact: message.exact,
            weights: payload.get("values", "U16"),
          },
        });
      break;
    case "progress":
      store.set({ progress: ENDED.includes(message.stage) ? null : message });
      break;
    case "report":
      store.set({ report: message });
      break;
    case "suggestions":
      store.set({ suggestions: message.suggestions });
      break;
    case "similar":
      store.set({ similar: message });
      break;
    case "ladder":
      store.set({ ladders: new Map([...store.get().ladders, [message.vertex, message]]) });
      break;
    case "axis":
      store.set({ axis: message });
      break;
    case "colors":
      store.set({ featureColors: payload.get("colors", "U8") });
      break;
    case "positions":
      if (serverPoses(store.get()))
        store.set({ posed: { positions: payload.get("positions", "F32"), normals: payload.get("normals", "I16") } });
      break;
    case "failure":
      problem(message.message);
      hideRefused(message.id);
      break;
    case "done":
    case "download":
      break;
  }
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
