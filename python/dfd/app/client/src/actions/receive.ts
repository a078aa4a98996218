/** What the server's messages do to the store. */

import type { Payload, Received } from "../protocol/binary_messages";
import { weightLayer } from "../posing/columns";
import { surfaceOf } from "../posing/held";
import type { ColumnsMessage, CounterpartsMessage, StateMessage } from "../protocol/messages";
import { CLOSED, serverPoses, store, type ColumnData, type State } from "../store/state";
import { PROTOCOL } from "./connection";
import { note, problem } from "./toasts";

export function receive({ message, payload }: Received): void {
  switch (message.type) {
    case "session":
      store.set({ session: message });
      if (message.version !== PROTOCOL) problem("The page is of another version than the server: reload it.");
      break;
    case "start":
      store.set({ ...CLOSED, page: "start" });
      break;
    case "mesh":
      store.set({
        ...CLOSED,
        page: "shape",
        mesh: message,
        meshArrays: payload,
        surface: surfaceOf(
          message.vertices,
          payload.get("positions", "float32"),
          payload.get("triangles", "uint32"),
          payload.get("vertex", "uint32"),
        ),
      });
      message.warnings.forEach((warning) => note(warning));
      break;
    case "state":
      store.set(followed(message));
      break;
    case "columns":
      store.set({ columns: new Map([...store.get().columns, ...columnsOf(message, payload)]) });
      break;
    case "counterparts":
      store.set({ columns: withCounterparts(message, payload) });
      break;
    case "heat": {
      if (message.vertex === null || store.get().hover?.vertex !== message.vertex) break;
      store.set({ probe: { vertex: message.vertex, layer: weightLayer(payload.get("values", "uint16")) } });
      break;
    }
    case "progress": {
      const ended = ["done", "cancelled", "failed"].includes(message.stage);
      store.set({ progress: ended ? null : message });
      break;
    }
    case "report":
      store.set({ report: message });
      break;
    case "suggestions":
      store.set({ suggestions: message.suggestions });
      break;
    case "similar":
      store.set({ similar: message });
      break;
    case "axis":
      store.set({ axis: message });
      break;
    case "colors":
      store.set({ featureColors: payload.get("colors", "uint8") });
      break;
    case "positions":
      if (!serverPoses(store.get())) break;
      store.set({
        posed: { positions: payload.get("positions", "float32"), normals: payload.get("normals", "int16") },
      });
      break;
    case "failure":
      problem(message.message);
      takeBack(message.id);
      if (message.fatal) store.set({ ended: message.message });
      break;
    case "done":
    case "download":
      break;
  }
}

/** Take back what was shown before the server refused it. */
function takeBack(request: number): void {
  const { ahead } = store.get();
  const kept = [...ahead].filter(([, part]) => part.request !== request);
  if (kept.length < ahead.size) store.set({ ahead: new Map(kept) });
}

function followed(message: StateMessage): Partial<State> {
  const state = store.get();
  const used = new Set([message.fixed_column, ...message.handles.map((handle) => handle.column)]);
  const present = new Set(message.handles.map((handle) => handle.handle));
  const before = new Set(state.edit?.handles.map((handle) => handle.handle));
  const added = message.handles.filter((handle) => !before.has(handle.handle));
  const kept = state.selected !== null && present.has(state.selected) ? state.selected : null;
  return {
    edit: message,
    ahead: new Map([...state.ahead].filter(([handle, { request }]) => present.has(handle) && request > message.after)),
    columns: new Map([...state.columns].filter(([column]) => used.has(column))),
    // One that was just added is what the person wants to move.
    selected: state.edit && added.length === 1 ? added[0].handle : kept,
    page: "shape",
  };
}

function columnsOf(message: ColumnsMessage, payload: Payload): [number, ColumnData][] {
  return message.columns.map(({ column, values, scale, kind, geodesic }) => {
    const along = geodesic === null ? null : payload.get(geodesic, "uint16");
    return [
      column,
      { layer: { values: payload.get(values, "uint16"), scale, kind, geodesic: along }, counterparts: [] },
    ];
  });
}

/** The columns, with the counterparts of some of them. */
function withCounterparts(message: CounterpartsMessage, payload: Payload): Map<number, ColumnData> {
  const columns = new Map(store.get().columns);
  for (const entry of message.columns) {
    const data = columns.get(entry.column);
    if (!data) continue;
    const counterparts = entry.counterparts.map(({ share, ...rest }, i) => ({
      ...rest,
      share: share === null ? data.counterparts[i].share : weightLayer(payload.get(share, "uint16")),
    }));
    columns.set(entry.column, { ...data, counterparts });
  }
  return columns;
}
