// Made by `npm run protocol` from protocol.schema.json.

export type JsonValue = unknown;

export interface Protocol {
  client: Client;
  server: Server;
}
/**
 * Any message of the page.
 */
export interface Client {
  message:
    | Hello
    | OpenSample
    | CloseMesh
    | Distill
    | Cancel
    | Probe
    | Add
    | Move
    | Pose
    | Change
    | Remove
    | Fix
    | Release
    | ChangeFixed
    | SetSymmetry
    | SetPreset
    | SetOverlap
    | SetBlend
    | SetDefault
    | Undo
    | Redo
    | Reset
    | Clear
    | Apply
    | SetPoses
    | Compute
    | Features
    | Suggest
    | Instances
    | Export
    | Script;
}
/**
 * First of all; with the `session` of before, a tab goes on where it was. Answer: `session`, then all there is.
 */
export interface Hello {
  id: number;
  session?: string | null;
  type: "hello";
  version: number;
}
/**
 * Open one of the samples that `session` lists.
 */
export interface OpenSample {
  id: number;
  name: string;
  type: "open_sample";
}
/**
 * Go back to the start page; the edit is lost.
 */
export interface CloseMesh {
  id: number;
  type: "close_mesh";
}
/**
 * Make the shape's field, in the background: `progress`, then `state` and `columns`.
 */
export interface Distill {
  id: number;
  type: "distill";
}
/**
 * Stop the distillation; what is done is kept for the next one.
 */
export interface Cancel {
  id: number;
  type: "cancel";
}
/**
 * The column that a handle at `at` would have; a newer one overtakes it unanswered. Answer: `heat`.
 */
export interface Probe {
  at: VertexPlace | PointPlace;
  id: number;
  type: "probe";
}
/**
 * At a vertex.
 */
export interface VertexPlace {
  vertex: number;
}
/**
 * At any point, mesh units.
 */
export interface PointPlace {
  /**
   * @minItems 3
   * @maxItems 3
   */
  point: [number, number, number];
}
/**
 * Take hold. Answer: `done` with the `handle`.
 */
export interface Add {
  at: VertexPlace | PointPlace | RegionPlace;
  controls?: Controls;
  id: number;
  transform?: Transform;
  type: "add";
}
/**
 * A set of vertices as one: `mask` is a bit per vertex, lowest bit first, in bytes written as base64.
 */
export interface RegionPlace {
  mask: string;
}
/**
 * What a handle holds and how; null leaves a control as it is, or at its default where the handle is new.
 */
export interface Controls {
  falloff?: string | null;
  instances?: string | null;
  level?: boolean | null;
  locality?: number | null;
  more?: {
    [k: string]: JsonValue;
  } | null;
  name?: string | null;
  radius?: number | string | null;
  reach?: number | "auto" | null;
  strength?: number | null;
  within?: RegionPlace | "everywhere" | null;
  within_width?: number | null;
  without_instances?: number[] | null;
}
/**
 * Scale along `axes`, then rotation, then translation, about the pivot.
 *
 * Null leaves a part as it is, or at rest where it is new. `rotation` is a rotation vector in degrees or a quaternion;
 * `axes` are one a row. "auto" returns a pivot to the handle's own position and axes to the mesh's, and "normal" is a
 * frame whose third axis is the surface's normal at the handle.
 */
export interface Transform {
  axes?: [[number, number, number], [number, number, number], [number, number, number]] | ("normal" | "auto") | null;
  pivot?: [number, number, number] | "auto" | null;
  rotation?: [number, number, number] | [number, number, number, number] | null;
  scale?: [number, number, number] | null;
  translation?: [number, number, number] | null;
}
/**
 * Set parts of a handle's transform, from the resting shape.
 *
 * A drag is a plain move, then moves with `merge`, one step of undo; those are answered by `done` alone, the last one,
 * with `settle`, by `state` and `report` as well. That one may bring `controls` that were changed on the way.
 */
export interface Move {
  controls?: Controls1;
  handle: number;
  id: number;
  merge?: boolean;
  settle?: boolean;
  transform: Transform1;
  type: "move";
}
/**
 * What a handle holds and how; null leaves a control as it is, or at its default where the handle is new.
 */
export interface Controls1 {
  falloff?: string | null;
  instances?: string | null;
  level?: boolean | null;
  locality?: number | null;
  more?: {
    [k: string]: JsonValue;
  } | null;
  name?: string | null;
  radius?: number | string | null;
  reach?: number | "auto" | null;
  strength?: number | null;
  within?: RegionPlace | "everywhere" | null;
  within_width?: number | null;
  without_instances?: number[] | null;
}
/**
 * Scale along `axes`, then rotation, then translation, about the pivot.
 *
 * Null leaves a part as it is, or at rest where it is new. `rotation` is a rotation vector in degrees or a quaternion;
 * `axes` are one a row. "auto" returns a pivot to the handle's own position and axes to the mesh's, and "normal" is a
 * frame whose third axis is the surface's normal at the handle.
 */
export interface Transform1 {
  axes?: [[number, number, number], [number, number, number], [number, number, number]] | ("normal" | "auto") | null;
  pivot?: [number, number, number] | "auto" | null;
  rotation?: [number, number, number] | [number, number, number, number] | null;
  scale?: [number, number, number] | null;
  translation?: [number, number, number] | null;
}
/**
 * Set the transforms of several handles, as one step.
 */
export interface Pose {
  id: number;
  /**
   * @maxItems 1000
   */
  transforms: PoseTransform[];
  type: "pose";
}
/**
 * A handle's part of a key pose; everything as in `Transform`, and nothing left out.
 */
export interface PoseTransform {
  axes?: [[number, number, number], [number, number, number], [number, number, number]] | null;
  handle: number;
  pivot?: [number, number, number] | null;
  /**
   * @minItems 3
   * @maxItems 3
   */
  rotation: [number, number, number];
  /**
   * @minItems 3
   * @maxItems 3
   */
  scale: [number, number, number];
  /**
   * @minItems 3
   * @maxItems 3
   */
  translation: [number, number, number];
}
/**
 * Set what a handle holds, or where it sits; with `merge`, one step with a change of that handle just before.
 */
export interface Change {
  at?: VertexPlace | PointPlace | RegionPlace | null;
  controls?: Controls2;
  handle: number;
  id: number;
  merge?: boolean;
  type: "change";
}
/**
 * What a handle holds and how; null leaves a control as it is, or at its default where the handle is new.
 */
export interface Controls2 {
  falloff?: string | null;
  instances?: string | null;
  level?: boolean | null;
  locality?: number | null;
  more?: {
    [k: string]: JsonValue;
  } | null;
  name?: string | null;
  radius?: number | string | null;
  reach?: number | "auto" | null;
  strength?: number | null;
  within?: RegionPlace | "everywhere" | null;
  within_width?: number | null;
  without_instances?: number[] | null;
}
/**
 * Let go of a handle.
 */
export interface Remove {
  handle: number;
  id: number;
  type: "remove";
}
/**
 * Hold a place, and what looks like it.
 */
export interface Fix {
  at: VertexPlace | PointPlace | RegionPlace;
  id: number;
  strength?: number | null;
  type: "fix";
}
/**
 * Take back a fixed place: the `index` among those of `state`.
 */
export interface Release {
  id: number;
  index: number;
  type: "release";
}
/**
 * Set how much the fixed place at `index` takes away; with `merge`, one step with such a change just before.
 */
export interface ChangeFixed {
  id: number;
  index: number;
  merge?: boolean;
  strength: number;
  type: "change_fixed";
}
/**
 * Let handles act on both sides of a plane; with `merge`, one step with such a request just before.
 */
export interface SetSymmetry {
  band?: number | null;
  id: number;
  merge?: boolean;
  plane: Plane | ("auto" | "x" | "y" | "z") | null;
  type: "set_symmetry";
}
/**
 * The plane {p : normal · p = offset}; one that was found tells how alike its sides are.
 */
export interface Plane {
  band?: number;
  name?: string | null;
  /**
   * @minItems 3
   * @maxItems 3
   */
  normal: [number, number, number];
  offset: number;
  score?: number | null;
}
/**
 * Put everything that a preset says in the place of what was there, as one step: a name of `state.presets`.
 */
export interface SetPreset {
  id: number;
  preset: string;
  type: "set_preset";
}
/**
 * What happens where handles overlap: a name of `state.overlaps`.
 */
export interface SetOverlap {
  id: number;
  mode: string;
  type: "set_overlap";
}
/**
 * How transforms blend: a name of `state.blends`.
 */
export interface SetBlend {
  id: number;
  mode: string;
  type: "set_blend";
}
/**
 * Set D₀, what happens to what no handle holds; all null is nothing. `merge` is as in `set_symmetry`.
 */
export interface SetDefault {
  id: number;
  merge?: boolean;
  transform: Transform1;
  type: "set_default";
}
/**
 * Take the newest step back.
 */
export interface Undo {
  id: number;
  type: "undo";
}
/**
 * Take a step again that was taken back.
 */
export interface Redo {
  id: number;
  type: "redo";
}
/**
 * Return a handle to rest, or with null all of them, as one step.
 */
export interface Reset {
  handle?: number | null;
  id: number;
  type: "reset";
}
/**
 * Let go of everything, as one step.
 */
export interface Clear {
  id: number;
  type: "clear";
}
/**
 * Replace everything by an edit document, as one step.
 */
export interface Apply {
  edit: {
    [k: string]: JsonValue;
  };
  id: number;
  type: "apply";
}
/**
 * Replace the key poses; they are no part of the edit and of its undo.
 */
export interface SetPoses {
  id: number;
  /**
   * @maxItems 1000
   */
  poses: KeyPose[];
  type: "set_poses";
}
/**
 * A stored pose on the timeline.
 */
export interface KeyPose {
  name: string;
  seconds: number;
  /**
   * @maxItems 1000
   */
  transforms: PoseTransform[];
}
/**
 * The posed shape from the kernel. Answer: `positions`; a newer one overtakes it unanswered.
 */
export interface Compute {
  id: number;
  type: "compute";
}
/**
 * Colors of the features' main directions. Answer: `colors`.
 */
export interface Features {
  id: number;
  type: "features";
}
/**
 * Good places for handles. Answer: `suggestions`.
 */
export interface Suggest {
  count?: number;
  id: number;
  type: "suggest";
}
/**
 * The places that look like the one a handle holds, and whether each moves along. Answer: `alike`.
 */
export interface Instances {
  handle: number;
  id: number;
  type: "instances";
}
/**
 * Write what was done; "animation" is a GLB with the key poses, on joints. Answer: `download`.
 */
export interface Export {
  format: "glb" | "obj" | "ply" | "stl" | "animation" | "edit" | "field";
  id: number;
  type: "export";
}
/**
 * What was done as Python and as a command. Answer: `script`.
 */
export interface Script {
  id: number;
  type: "script";
}
/**
 * Any message of the server, or the header of one that is binary.
 */
export interface Server {
  message:
    | SessionMessage
    | StartMessage
    | StateMessage
    | DoneMessage
    | FailureMessage
    | ProgressMessage
    | ReportMessage
    | SuggestionsMessage
    | AlikeMessage
    | DownloadMessage
    | ScriptMessage
    | MeshMessage
    | DetailMessage
    | ColumnsMessage
    | InstancesMessage
    | HeatMessage
    | PositionsMessage
    | ColorsMessage;
}
/**
 * Who the tab is, and what the server can do.
 */
export interface SessionMessage {
  dfd: string;
  formats: string[];
  id: number;
  resumed: boolean;
  samples: SampleEntry[];
  session: string;
  type: "session";
  upload_bytes: number;
  version: number;
}
/**
 * A sample of the start page.
 */
export interface SampleEntry {
  faces: number;
  name: string;
  title: string;
}
/**
 * There is no mesh: the start page.
 */
export interface StartMessage {
  id: number;
  type: "start";
}
/**
 * The whole present state, after every change.
 */
export interface StateMessage {
  after: number;
  blend: string;
  blends: string[];
  can_redo: boolean;
  can_undo: boolean;
  controls: string[];
  default: PoseTransform | null;
  edit: {
    [k: string]: JsonValue;
  };
  falloffs: string[];
  field: FieldState;
  fixed: FixedState[];
  fixed_column: number;
  handles: HandleState[];
  id: number;
  instances: string[];
  new_handle: NewHandle;
  overlap: string;
  overlaps: string[];
  planes: Plane[];
  poses: KeyPose[];
  posing: "shader" | "server";
  preset: string;
  presets: string[];
  symmetry: Plane | null;
  type: "state";
}
/**
 * Whether the shape has a field, where it came from, and what its distillation does.
 */
export interface FieldState {
  origin: string | null;
  settings: {
    [k: string]: JsonValue;
  };
  status: "none" | "distilling" | "preparing" | "ready";
}
/**
 * A fixed place.
 */
export interface FixedState {
  /**
   * @minItems 3
   * @maxItems 3
   */
  position: [number, number, number];
  region: number;
  strength: number;
  vertex: number | null;
}
/**
 * A live handle: the numbers of the edit, and how the page turns its column into weights.
 */
export interface HandleState {
  axes: [[number, number, number], [number, number, number], [number, number, number]] | null;
  column: number;
  controls: {
    [k: string]: JsonValue;
  };
  exponent: number;
  falloff: string;
  gain: number;
  handle: number;
  instances: string;
  kind: "distance" | "weight";
  level: boolean;
  locality: number;
  moved: boolean;
  name: string | null;
  own_pivot: boolean;
  /**
   * @minItems 3
   * @maxItems 3
   */
  pivot: [number, number, number];
  /**
   * @minItems 3
   * @maxItems 3
   */
  position: [number, number, number];
  radius: number | null;
  reach: number;
  region: number;
  /**
   * @minItems 3
   * @maxItems 3
   */
  rotation: [number, number, number];
  /**
   * @minItems 3
   * @maxItems 3
   */
  scale: [number, number, number];
  strength: number;
  /**
   * @minItems 3
   * @maxItems 3
   */
  translation: [number, number, number];
  vertex: number | null;
  within: number;
  within_width: number;
  without_instances: number[];
}
/**
 * What a new handle of the session's preset has, by which the page shows what one would hold.
 */
export interface NewHandle {
  falloff: string;
  reach: number;
}
/**
 * It was done.
 */
export interface DoneMessage {
  handle: number | null;
  id: number;
  type: "done";
}
/**
 * It was not done, and nothing changed; `message` is a sentence for people.
 */
export interface FailureMessage {
  fatal: boolean;
  id: number;
  message: string;
  type: "failure";
}
/**
 * How far the long work in the background is.
 */
export interface ProgressMessage {
  done: number;
  id: number;
  seconds_left: number | null;
  stage: string;
  task: "open" | "distill" | "prepare" | "export";
  total: number | null;
  type: "progress";
}
/**
 * What the edit does to the shape, in numbers and as a sentence.
 */
export interface ReportMessage {
  id: number;
  largest: number;
  missed: number;
  moved: number;
  text: string;
  type: "report";
}
/**
 * Answer to `suggest`.
 */
export interface SuggestionsMessage {
  id: number;
  suggestions: Suggestion[];
  type: "suggestions";
}
/**
 * A place worth taking hold of.
 */
export interface Suggestion {
  group: number;
  name: string;
  /**
   * @minItems 3
   * @maxItems 3
   */
  position: [number, number, number];
  share: number;
  vertex: number;
}
/**
 * Answer to `instances`: the handle's own place first, which always moves, then the most alike.
 */
export interface AlikeMessage {
  handle: number;
  id: number;
  places: Alike[];
  type: "alike";
}
/**
 * A place that looks like the one a handle holds.
 */
export interface Alike {
  on: boolean;
  /**
   * @minItems 3
   * @maxItems 3
   */
  position: [number, number, number];
  vertex: number;
  weight: number;
}
/**
 * A file that is served once.
 */
export interface DownloadMessage {
  id: number;
  name: string;
  type: "download";
  url: string;
}
/**
 * Answer to `script`.
 */
export interface ScriptMessage {
  command: string;
  id: number;
  python: string;
  type: "script";
}
/**
 * The resting shape. A row is a vertex as the file has it, split at seams; weights belong to vertices.
 *
 * Buffers: `positions` float32 (R, 3), relative to `center`; `triangles` uint32 (F, 3), corners as rows; `vertex`
 * uint32 (R,), the vertex of each row; `normals` int16 (R, 4), of length 32767, the fourth 0; where the file has them,
 * `uv` float32 (R, 2), v upwards, and `colors` uint8 (R, 4), display-referred; and the textures' files.
 *
 * With `coarse` these are few rows and triangles, which look like the shape from afar; all of them follow in `detail`.
 */
export interface MeshMessage {
  /**
   * @minItems 2
   * @maxItems 2
   */
  bounds: [[number, number, number], [number, number, number]];
  buffers: Buffer[];
  /**
   * @minItems 3
   * @maxItems 3
   */
  center: [number, number, number];
  coarse: boolean;
  diagonal: number;
  faces: number;
  groups: Group[];
  id: number;
  materials: MaterialEntry[];
  mesh: number;
  name: string;
  parts: string[];
  rows: number;
  type: "mesh";
  vertices: number;
  warnings: string[];
}
/**
 * An array of a binary message; `offset` counts bytes from the end of the header.
 */
export interface Buffer {
  dtype: "uint8" | "int8" | "uint16" | "int16" | "uint32" | "int32" | "float32";
  name: string;
  offset: number;
  shape: number[];
}
/**
 * A run of triangles of one part and one material.
 */
export interface Group {
  count: number;
  material: number;
  part: number;
  start: number;
}
/**
 * What one kind of surface looks like; colors are display-referred (sRGB).
 */
export interface MaterialEntry {
  alpha_cutoff: number;
  alpha_mode: "OPAQUE" | "MASK" | "BLEND";
  /**
   * @minItems 4
   * @maxItems 4
   */
  color: [number, number, number, number];
  media_type: string | null;
  texture: string | null;
  /**
   * @minItems 2
   * @maxItems 2
   */
  wrap: ["repeat" | "mirror" | "clamp", "repeat" | "mirror" | "clamp"];
}
/**
 * The whole of a shape that came as its coarse level: the buffers of `mesh`, its rows first, in their order.
 */
export interface DetailMessage {
  buffers: Buffer[];
  groups: Group[];
  id: number;
  mesh: number;
  rows: number;
  type: "detail";
}
/**
 * Columns that `state` names and the page has not got; it may forget those that `state` no longer names.
 *
 * That of the fixed places has the kind "weight": F of Eq. 6.
 */
export interface ColumnsMessage {
  buffers: Buffer[];
  columns: ColumnEntry[];
  id: number;
  type: "columns";
}
/**
 * One column: `values` names a buffer uint16 (V,); its number times `scale` / 65535 is the distance or weight.
 */
export interface ColumnEntry {
  column: number;
  geodesic: string | null;
  kind: "distance" | "weight";
  scale: number;
  values: string;
}
/**
 * Instances of columns that came before; until then such a column acts as one.
 */
export interface InstancesMessage {
  buffers: Buffer[];
  columns: InstancesEntry[];
  id: number;
  type: "instances";
}
/**
 * The instances of one column, that of its handle first; where there are none, the handle acts as it is.
 */
export interface InstancesEntry {
  column: number;
  instances: InstanceEntry[];
}
/**
 * One of the places where a handle acts: `share` names the buffer uint16 (V,), how much of a vertex is its own.
 */
export interface InstanceEntry {
  /**
   * @minItems 3
   * @maxItems 3
   */
  frame: [[number, number, number], [number, number, number], [number, number, number]];
  gain: number;
  instance: number;
  on: boolean;
  /**
   * @minItems 3
   * @maxItems 3
   */
  pivot: [number, number, number];
  /**
   * @minItems 3
   * @maxItems 3
   */
  position: [number, number, number];
  share: string;
}
/**
 * Answer to `probe`: buffer `values` uint16 (V,), distances as in a column.
 */
export interface HeatMessage {
  buffers: Buffer[];
  id: number;
  scale: number;
  type: "heat";
  vertex: number | null;
}
/**
 * Answer to `compute`: `positions` float32 (V, 3), relative to the mesh's center, and `normals` int16 (V, 4).
 */
export interface PositionsMessage {
  buffers: Buffer[];
  id: number;
  type: "positions";
}
/**
 * Answer to `features`: `colors` uint8 (V, 4).
 */
export interface ColorsMessage {
  buffers: Buffer[];
  id: number;
  type: "colors";
}
