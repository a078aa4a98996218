/**
 * The server's part where there is none: shapes that were prepared (docs/tools/shapes.py) with what is held of their
 * parts, and the paper's weights by the core itself. It answers what such a page can do, in the server's own messages, and refuses the rest.
 */

import type { Link, LinkEvents } from "../actions/connection";
import type { Vec3 } from "../posing/affine";
import {
  decode,
  NO_ARRAYS,
  withArrays,
  type Numbered,
  type Received,
  type ServerMessage,
} from "../protocol/binary_messages";
import type {
  ColumnsMessage,
  FixedState,
  HandleState,
  HeatMessage,
  KeyPose,
  MeshMessage,
  Plane,
  SessionMessage,
  StateMessage,
} from "../protocol/messages";
import { store } from "../store/state";
import { Features, loadCore, type Core } from "./bind";
import { AT_REST, controlled, History, moved, NO_EDIT, posed, Unserved, withHandle, type Edit } from "./edit";
import { Grips } from "./grips";

/** The largest distance between two features, and the steps of a column. */
const FARTHEST = 2;
const STEPS = 65535;
/** What fixed points must leave of a handle's own weight, for it to be made good. */
const LEAST_LEFT = 0.01;
/** The number that stands for a part is at least this, and so many times how far most of the part differs. */
const LEAST_REACH = 0.1;
const MOST_OF_PART = 0.9;
const AROUND_PART = 2;

export function alone({ opened, received }: LinkEvents): Link {
  store.set({ alone: 'pip install "dfd[app]", then dfd app' });
  const server = new Server(received);
  let last = Promise.resolve();
  queueMicrotask(opened);
  return {
    status: "open",
    unsent: 0,
    send: (request) => void (last = last.then(() => server.answer(request))),
    close: () => undefined,
  };
}

interface Shape {
  readonly name: string;
  readonly mesh: Received;
  readonly features: Features;
  readonly grips: Grips;
  /** As it is at first; its one handle is the pattern of all. */
  readonly state: StateMessage;
  readonly history: History;
  poses: readonly KeyPose[];
}

class Server {
  private core: Promise<Core> | null = null;
  private shape: Shape | null = null;
  private next = 1;
  /** The number of a column, by what it depends on, and those that the page has. */
  private readonly numbers = new Map<string, number>();
  private sent = new Set<number>();

  constructor(private readonly tell: (received: Received) => void) {}

  async answer(request: Numbered): Promise<void> {
    try {
      const answer = await this.handle(request);
      if (answer) this.tell({ ...answer, message: { ...answer.message, id: request.id } });
      else this.say({ type: "done", id: request.id, handle: null });
    } catch (error) {
      const message = error instanceof Error ? error.message : String(error);
      this.say({ type: "failure", id: request.id, message, fatal: false });
    }
  }

  private say(message: ServerMessage): void {
    this.tell({ message, payload: NO_ARRAYS });
  }

  /** What answers a request, if it is more than that it was done. */
  private async handle(request: Numbered): Promise<Received | null> {
    switch (request.type) {
      case "hello":
        await this.hello(request.id);
        return null;
      case "open_sample":
        await this.open(request.name);
        return null;
      case "close_mesh":
        this.close();
        this.say({ type: "start", id: 0 });
        return null;
      case "features":
        return decode(await fetched(`shapes/${this.opened.name}/colors.bin`));
      case "suggest":
        return decode(await (await asked(`shapes/${this.opened.name}/suggestions.json`)).text());
      case "probe":
        return this.heat(vertexOf(request.at));
      case "instances":
        return text({ type: "similar", id: 0, handle: request.handle, places: [] });
      case "axis": {
        const { position } = this.handleOf(request.handle);
        const pivots = { point: position };
        return text({ type: "axis", id: 0, handle: request.handle, pivots, auto: position, base: null, tip: null });
      }
      case "set_poses":
        this.opened.poses = request.poses;
        this.tellState(request.id);
        return null;
      case "undo":
      case "redo":
        this.opened.history[request.type]();
        this.tellState(request.id);
        return null;
      case "add":
        return text({ type: "done", id: 0, handle: this.add(request) });
      default:
        this.change(request);
        return null;
    }
  }

  // --- opening

  private async hello(id: number): Promise<void> {
    const session = (await (await asked("shapes/session.json")).json()) as SessionMessage;
    const wanted = new URLSearchParams(location.search).get("shape");
    this.say({ ...session, id });
    if (session.samples.some(({ name }) => name === wanted)) await this.open(String(wanted));
    else this.say({ type: "start", id: 0 });
  }

  private async open(name: string): Promise<void> {
    const progress = { type: "progress", id: 0, task: "open", done: 0, total: null, seconds_left: null } as const;
    this.say({ ...progress, stage: "read" });
    try {
      this.core ??= fetched("dfd.wasm").then(loadCore);
      const [file, state, features, grips] = await Promise.all([
        fetched(`shapes/${name}/mesh.bin`),
        asked(`shapes/${name}/state.json`).then((response) => response.json() as Promise<StateMessage>),
        fetched(`shapes/${name}/features.bin`),
        fetched(`shapes/${name}/grips.bin`),
      ]);
      const mesh = decode(file);
      const { vertices } = mesh.message as MeshMessage;
      const held = {
        features: new Features(await this.core, vertices, features),
        grips: new Grips(vertices, new Uint8Array(grips)),
      };
      this.close();
      this.shape = { name, mesh, state, ...held, history: new History(NO_EDIT), poses: [] };
      this.tell(mesh);
      this.tellState(0);
    } finally {
      this.say({ ...progress, stage: "done" });
    }
  }

  private close(): void {
    this.shape?.features.dispose();
    this.shape = null;
    this.sent.clear();
    this.numbers.clear();
  }

  private get opened(): Shape {
    if (!this.shape) throw new Error("Open a shape first.");
    return this.shape;
  }

  private handleOf(id: number): HandleState {
    const found = this.opened.history.present.handles.find(({ handle }) => handle === id);
    if (!found) throw new Error(`There is no handle ${id}.`);
    return found;
  }

  /** Where a vertex rests. */
  private position(vertex: number): Vec3 {
    const { message, payload } = this.opened.mesh;
    const row = payload.get("vertex", "uint32").indexOf(vertex);
    if (row < 0) throw new Error(`There is no vertex ${vertex}.`);
    const [x, y, z] = payload.get("positions", "float32").subarray(3 * row);
    const { center } = message as MeshMessage;
    return [x + center[0], y + center[1], z + center[2]];
  }

  // --- changing the edit

  private add({ id, at, transform, controls }: Extract<Numbered, { type: "add" }>): number {
    const { history, state } = this.opened;
    const vertex = vertexOf(at);
    const position = this.position(vertex);
    const fresh: HandleState = { ...state.handles[0], handle: this.next++, vertex, position, pivot: position };
    const added = this.numbered(controlled(moved(fresh, transform ?? {}), controls ?? {}));
    const edit = history.present;
    history.set({ ...edit, handles: [...edit.handles, added] });
    this.tellState(id);
    return added.handle;
  }

  /** Make a change of the edit one step, or a part of the newest one, and tell the page of it. */
  private change(request: Numbered): void {
    const { history } = this.opened;
    const { present } = history;
    const merge = "merge" in request && request.merge;
    const topic = [request.type, "handle" in request && request.handle, "index" in request && request.index].join();
    history.set(this.changed(present, request), topic, merge);
    // The page has drawn the frames of a drag itself.
    if (request.type !== "move" || request.settle || !merge) this.tellState(request.id);
  }

  private changed(edit: Edit, request: Numbered): Edit {
    switch (request.type) {
      case "move":
        return withHandle(edit, request.handle, (handle) =>
          controlled(moved(handle, request.transform), request.controls ?? {}),
        );
      case "pose":
        return request.transforms.reduce(
          (all, pose) => withHandle(all, pose.handle, (handle) => posed(handle, pose)),
          edit,
        );
      case "reset": {
        const { handle = null } = request;
        if (handle !== null) return withHandle(edit, handle, (own) => moved(own, AT_REST));
        return { ...edit, handles: edit.handles.map((own) => moved(own, AT_REST)) };
      }
      case "change":
        if (request.at) throw new Unserved();
        return withHandle(edit, request.handle, (handle) => this.numbered(controlled(handle, request.controls ?? {})));
      case "remove":
        return { ...edit, handles: edit.handles.filter(({ handle }) => handle !== request.handle) };
      case "clear":
        return NO_EDIT;
      case "fix": {
        const vertex = vertexOf(request.at);
        const strength = request.strength ?? 1;
        return { ...edit, fixed: [...edit.fixed, { vertex, position: this.position(vertex), strength, region: 0 }] };
      }
      case "release":
        return { ...edit, fixed: edit.fixed.filter((_, i) => i !== request.index) };
      case "change_fixed": {
        const { index, strength } = request;
        return { ...edit, fixed: edit.fixed.map((place, i) => (i === index ? { ...place, strength } : place)) };
      }
      case "set_symmetry": {
        const plane = this.plane(request.plane);
        return { ...edit, symmetry: plane && { ...plane, band: request.band ?? plane.band ?? 0 } };
      }
      case "set_default": {
        const { translation, rotation, scale, moved: moves } = moved(this.opened.state.handles[0], request.transform);
        const pivot = (this.opened.mesh.message as MeshMessage).center;
        return { ...edit, default: moves ? { handle: 0, translation, rotation, scale, pivot } : null };
      }
      default:
        throw new Unserved();
    }
  }

  /** The handle with the number that comes nearest to the reach "part", to go on from. */
  private numbered(handle: HandleState): HandleState {
    if (handle.reach_by !== "part") return handle;
    const { features, grips } = this.opened;
    const vertex = handle.vertex ?? 0;
    const weights = grips.weights(vertex);
    const near = features.bind([vertex], FARTHEST).filter((_, at) => weights[at] > 0.5);
    const least = near.sort()[Math.floor((1 - MOST_OF_PART) * near.length)];
    return { ...handle, reach: Math.min(Math.max(AROUND_PART * FARTHEST * (1 - least), LEAST_REACH), FARTHEST) };
  }

  private plane(wanted: Plane | "auto" | "x" | "y" | "z" | null): Plane | null {
    const found = this.opened.state.planes.at(0);
    if (wanted === null || typeof wanted !== "string") return wanted;
    if (wanted === "auto") return found ?? null;
    const axis = "xyz".indexOf(wanted);
    const { center } = this.opened.mesh.message as MeshMessage;
    const normal = center.map((_, i) => Number(i === axis)) as unknown as Vec3;
    return { normal, offset: center[axis], band: found?.band ?? 0 };
  }

  // --- telling the page

  private tellState(after: number): void {
    const { state, history, poses } = this.opened;
    const { fixed, ...whole } = history.present;
    const fixedColumn = fixed.length > 0 ? this.number(JSON.stringify(fixed)) : 0;
    const still = fixed.length > 0 ? this.still(fixed) : null;
    const handles = whole.handles.map((handle) => {
      const vertex = handle.vertex ?? 0;
      const left = 1 - (still?.[vertex] ?? 0);
      const own = { ...handle, gain: left >= LEAST_LEFT ? 1 / left : 1 };
      // What is sent as weights depends on all that they do.
      return handle.reach_by === "part"
        ? {
            ...own,
            column: this.number(`part ${vertex} ${handle.strength} ${fixedColumn}`),
          }
        : { ...own, column: this.number(`handle ${vertex}`) };
    });
    this.tellColumns(handles, still, fixedColumn);
    this.say({
      ...state,
      ...whole,
      after,
      handles,
      fixed,
      fixed_column: fixedColumn,
      can_undo: history.canUndo,
      can_redo: history.canRedo,
      poses,
    });
  }

  private number(key: string): number {
    const known = this.numbers.get(key);
    if (known !== undefined) return known;
    this.numbers.set(key, this.numbers.size + 1);
    return this.numbers.size;
  }

  /** Send those columns, by number, that the page has not got. */
  private tellColumns(handles: readonly HandleState[], still: Float32Array | null, fixedColumn: number): void {
    const arrays: Record<string, Uint16Array> = {};
    const columns: ColumnsMessage["columns"][number][] = [];
    const put = (column: number, kind: "distance" | "weight", values: () => Uint16Array) => {
      if (this.sent.has(column) || `values${column}` in arrays) return;
      arrays[`values${column}`] = values();
      const scale = kind === "distance" ? FARTHEST : 1;
      columns.push({ column, kind, values: `values${column}`, scale, geodesic: null });
    };
    for (const handle of handles) {
      if (handle.reach_by === "part") put(handle.column, "weight", () => this.weights(handle, still));
      else put(handle.column, "distance", () => this.distances(handle.vertex ?? 0));
    }
    if (still) put(fixedColumn, "weight", () => Uint16Array.from(still, (weight) => Math.round(weight * STEPS)));
    // The page forgets what the state does not name.
    this.sent = new Set([...handles.map(({ column }) => column), fixedColumn]);
    if (columns.length > 0) this.tell(withArrays<ColumnsMessage>({ type: "columns", id: 0, columns }, arrays));
  }

  /** (V) what follows a handle that holds a part, in steps, with its strength and less what fixed places take away. */
  private weights({ vertex, strength, gain }: HandleState, still: Float32Array | null): Uint16Array {
    const weights = this.opened.grips.weights(vertex ?? 0);
    const left = (weight: number, at: number) => Math.min(weight * (1 - (still?.[at] ?? 0)) * gain, 1);
    return Uint16Array.from(weights, (weight, at) => Math.round(strength * left(weight, at) * STEPS));
  }

  /** (V) from a vertex, in steps of what is farthest: a handle that reaches so far weighs the rest of 1. */
  private distances(vertex: number): Uint16Array {
    const weights = this.opened.features.bind([vertex], FARTHEST);
    return Uint16Array.from(weights, (weight) => Math.round((1 - weight) * STEPS));
  }

  /** (V) what fixed places take away, in Eq. 6. */
  private still(fixed: readonly FixedState[]): Float32Array {
    const weights = this.opened.features.bind(fixed.map(({ vertex }) => vertex ?? 0));
    const count = weights.length / fixed.length;
    return Float32Array.from({ length: count }, (_, vertex) =>
      Math.max(...fixed.map(({ strength }, p) => strength * weights[p * count + vertex])),
    );
  }

  /** Distances of which the page makes, by its falloff, what a new handle would hold: its smooth curve turned round. */
  private heat(vertex: number): Received {
    const { reach } = this.opened.state.new_handle;
    const within = (weight: number) => 0.5 - Math.sin(Math.asin(1 - 2 * weight) / 3);
    const values = Uint16Array.from(this.opened.grips.weights(vertex), (weight) =>
      Math.round((reach / FARTHEST) * (1 - within(weight)) * STEPS),
    );
    return withArrays<HeatMessage>({ type: "heat", id: 0, vertex, scale: FARTHEST }, { values });
  }
}

function text(message: ServerMessage): Received {
  return { message, payload: NO_ARRAYS };
}

function vertexOf(place: Extract<Numbered, { type: "fix" }>["at"]): number {
  if (!("vertex" in place)) throw new Unserved();
  return place.vertex;
}

async function asked(path: string): Promise<Response> {
  const response = await fetch(new URL(path, location.href));
  if (!response.ok) throw new Error(`${path} could not be fetched (${response.status}).`);
  return response;
}

async function fetched(path: string): Promise<ArrayBuffer> {
  return (await asked(path)).arrayBuffer();
}
