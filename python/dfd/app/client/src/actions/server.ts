/** The one connection of the page, and what it does to the store. */

import { Connection, Dropped, Refused } from "../protocol/connection";
import type { Payload, Received, Request } from "../protocol/frames";
import type {
  ColorsMessage,
  ColumnsMessage,
  DetailMessage,
  InstancesMessage,
  MeshMessage,
  PositionsMessage,
  StateMessage,
} from "../protocol/messages";
import { store, type ColumnData } from "../store/state";
import { note, problem } from "./toasts";

export const PROTOCOL = 1;
const SESSION_KEY = "dfd-session";

/** What arrives in arrays and goes to the GPU, not to the store. */
export interface Arrivals {
  mesh(message: MeshMessage, payload: Payload): void;
  detail(message: DetailMessage, payload: Payload): void;
  colors(message: ColorsMessage, payload: Payload): void;
  positions(message: PositionsMessage, payload: Payload): void;
}

let connection: Connection | null = null;

export function connect(arrivals: Arrivals): void {
  const address = new URL("ws", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.search = address.hash = "";
  connection = new Connection(address.href, {
    received: (received, awaited) => receive(received, awaited, arrivals),
    linked: (link) => store.set({ link }),
    opened: () => void hello(),
    failed: (error) => problem(`A message of the server could not be read: ${error.message}`),
    dismissed: (ended) => store.set({ ended }),
  });
}

async function hello(): Promise<void> {
  await ask({ type: "hello", version: PROTOCOL, session: sessionStorage.getItem(SESSION_KEY) });
}

/** Send, and tell the person in the server's own words if it is refused; null then. */
export async function ask(request: Request): Promise<Received | null> {
  try {
    return await (connection?.ask(request) ?? null);
  } catch (error) {
    if (error instanceof Refused) problem(error.message);
    else if (!(error instanceof Dropped)) throw error;
    return null;
  }
}

/** Send without waiting; a refusal still shows. Returns the request's number, 0 where there is no connection. */
export function tell(request: Request): number {
  return connection?.send(request) ?? 0;
}

export function drop(): void {
  connection?.drop();
}

/** Whether frames of a drag pile up unsent. */
export function congested(): boolean {
  return (connection?.queued ?? 0) > 16_384;
}

function receive({ message, payload }: Received, awaited: boolean, arrivals: Arrivals): void {
  switch (message.type) {
    case "session":
      sessionStorage.setItem(SESSION_KEY, message.session);
      store.set({ session: message });
      if (message.version !== PROTOCOL) problem("The page is of another version than the server: reload it.");
      break;
    case "start":
      store.set({ ...CLOSED, page: "start" });
      break;
    case "mesh":
      if (!payload) break;
      store.set({ ...CLOSED, page: "shape", mesh: message });
      arrivals.mesh(message, payload);
      message.warnings.forEach((warning) => note(warning));
      break;
    case "detail":
      if (payload) arrivals.detail(message, payload);
      break;
    case "state":
      store.set(followed(message));
      break;
    case "columns":
      if (payload) store.set({ columns: new Map([...store.get().columns, ...columnsOf(message, payload)]) });
      break;
    case "instances":
      if (payload) store.set({ columns: withInstances(message, payload) });
      break;
    case "heat": {
      const { hover } = store.get();
      if (!payload || message.vertex === null || hover?.vertex !== message.vertex) break;
      const layer = {
        values: payload.sixteen("values"),
        scale: message.scale,
        kind: "distance",
        geodesic: null,
      } as const;
      store.set({ probe: { vertex: message.vertex, layer } });
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
    case "alike":
      store.set({ alike: message });
      break;
    case "colors":
      if (payload) arrivals.colors(message, payload);
      break;
    case "positions":
      if (payload) arrivals.positions(message, payload);
      break;
    case "failure":
      if (!awaited) problem(message.message);
      takeBack(message.id);
      if (message.fatal) store.set({ ended: message.message });
      break;
    case "done":
    case "download":
    case "script":
      break;
  }
}

/** What no shape has. */
const CLOSED = {
  mesh: null,
  edit: null,
  columns: new Map<number, ColumnData>(),
  ahead: new Map(),
  selected: null,
  hidden: new Set<number>(),
  hover: null,
  probe: null,
  painted: null,
  suggestions: [],
  alike: null,
  report: null,
  moment: null,
  playing: false,
  comparing: false,
  tool: "hold",
} as const;

/** What was shown before the server refused it. */
function takeBack(request: number): void {
  const { ahead } = store.get();
  const kept = [...ahead].filter(([, part]) => part.request !== request);
  if (kept.length < ahead.size) store.set({ ahead: new Map(kept) });
}

function followed(message: StateMessage): Partial<ReturnType<typeof store.get>> {
  const state = store.get();
  const named = new Set([message.fixed_column, ...message.handles.map((handle) => handle.column)]);
  const living = new Set(message.handles.map((handle) => handle.handle));
  const ahead = new Map(
    [...state.ahead].filter(([handle, { request }]) => living.has(handle) && request > message.after),
  );
  const before = new Set(state.edit?.handles.map((handle) => handle.handle));
  const fresh = message.handles.filter((handle) => !before.has(handle.handle));
  const kept = state.selected !== null && living.has(state.selected) ? state.selected : null;
  return {
    edit: message,
    ahead,
    columns: new Map([...state.columns].filter(([column]) => named.has(column))),
    // One that has just come is what the person wants to move.
    selected: state.edit && fresh.length === 1 ? fresh[0].handle : kept,
    page: "shape",
  };
}

function columnsOf(message: ColumnsMessage, payload: Payload): [number, ColumnData][] {
  return message.columns.map((entry) => {
    const geodesic = entry.geodesic === null ? null : payload.sixteen(entry.geodesic);
    const layer = { values: payload.sixteen(entry.values), scale: entry.scale, kind: entry.kind, geodesic };
    return [entry.column, { layer, instances: [] }];
  });
}

/** The columns, with the instances of some of them. */
function withInstances(message: InstancesMessage, payload: Payload): Map<number, ColumnData> {
  const columns = new Map(store.get().columns);
  for (const entry of message.columns) {
    const data = columns.get(entry.column);
    const instances = entry.instances.map(({ share, ...rest }) => ({
      ...rest,
      share: { values: payload.sixteen(share), scale: 1, kind: "weight", geodesic: null } as const,
    }));
    if (data) columns.set(entry.column, { ...data, instances });
  }
  return columns;
}
