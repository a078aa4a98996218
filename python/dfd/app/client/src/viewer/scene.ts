/** From what the store says to what the shader poses by, in coordinates relative to the mesh's center. */

import type { Matrix4 } from "three";

import {
  add,
  apply,
  basisOf,
  IDENTITY,
  matrixOf,
  relative,
  REST,
  subtract,
  type Transform,
  type Vec3,
} from "../posing/affine";
import { EMPTY_SCENE, type Column, type Layer, type Mirror, type Scene } from "../posing/columns";
import { heldPart } from "../posing/held";
import type { Plane } from "../protocol/messages";
import { present, type Counterpart, type State } from "../store/state";

/** The handle's motion about the counterpart's own pivot, turned or mirrored into its frame. */
export function counterpartMatrix(matrix: Matrix4, pivot: Vec3, { frame }: Counterpart, own: Vec3): Matrix4 {
  const back = basisOf(frame);
  const turned = relative(matrix, pivot).premultiply(back.clone().transpose()).multiply(back);
  return relative(turned, subtract([0, 0, 0], own));
}

/** The pivot of a counterpart: it lies to the counterpart as the pivot of the handle lies to the handle. */
export function counterpartPivot(transform: Transform, position: Vec3, { frame, position: own }: Counterpart): Vec3 {
  return add(own, apply(basisOf(frame).transpose(), subtract(transform.pivot ?? position, position)));
}

export function mirrorOf(plane: Plane, center: Vec3): Mirror {
  const [x, y, z] = plane.normal;
  const offset = plane.offset - (x * center[0] + y * center[1] + z * center[2]);
  return { normal: plane.normal, offset, band: plane.band ?? 0 };
}

export function sceneOf(state: State): Scene {
  const { edit, mesh, columns: known, painted } = state;
  const probe = state.isolated && state.selected !== null ? null : state.probe;
  if (!edit || !mesh) return EMPTY_SCENE;
  const { center } = mesh;
  const { symmetry } = edit;
  const fixed = known.get(edit.fixed_column)?.layer ?? null;
  const columns: Column[] = [];
  for (const own of edit.handles) {
    const data = known.get(own.column);
    if (!data) continue;
    const handle = present(state, own);
    const { transform, position, reach, falloff, exponent, gain, strength } = handle;
    const matrix = state.comparing ? IDENTITY : matrixOf(transform, position);
    const column: Column = {
      handle: own.handle,
      layer: data.layer,
      fixed: data.layer.kind === "weight" ? null : fixed,
      share: null,
      shareGain: 1,
      reach,
      falloff,
      exponent,
      gain,
      strength,
      positive: isPositive(symmetry, position),
      heat: !probe && !painted && state.selected === own.handle ? 1 : 0,
      transform: relative(matrix, center),
      acts: true,
    };
    const ofCounterpart = (counterpart: Counterpart): Column => ({
      ...column,
      share: counterpart.share,
      shareGain: counterpart.gain,
      positive: isPositive(symmetry, counterpart.position),
      transform: relative(
        counterpartMatrix(
          matrix,
          transform.pivot ?? position,
          counterpart,
          counterpartPivot(transform, position, counterpart),
        ),
        center,
      ),
    });
    columns.push(...(data.counterparts.length > 0 ? data.counterparts.map(ofCounterpart) : [column]));
  }
  // What was painted, in a color of the ramp that stands out from pale shapes too.
  if (painted) columns.push(shownColumn(painted.layer, PAINTED));
  else if (probe) columns.push(shownColumn(probe.layer, 1));
  const d0 = state.comparing ? null : edit.default;
  const rest = d0 && matrixOf({ ...REST, ...d0 }, center);
  return {
    columns,
    defaultTransform: rest && relative(rest, center),
    mirror: symmetry && mirrorOf(symmetry, center),
  };
}

/** The columns by which a handle moves the shape. */
export function columnsOf(state: State, handle: number): readonly Column[] {
  return sceneOf(state).columns.filter((column) => column.handle === handle && column.acts);
}

/** The part of the surface that a handle holds, by the weights that move it. */
export function held(state: State, handle: number): number {
  return state.surface ? heldPart(columnsOf(state, handle), state.surface) : 0;
}

const PAINTED = 0.66;

/** A column of weights that only the heat map shows. */
function shownColumn(layer: Layer, heat: number): Column {
  return {
    handle: 0,
    layer,
    fixed: null,
    share: null,
    shareGain: 1,
    reach: 1,
    falloff: "linear",
    exponent: 0,
    gain: 1,
    strength: 1,
    positive: true,
    heat,
    transform: IDENTITY,
    acts: false,
  };
}

function isPositive(plane: Plane | null, position: Vec3): boolean {
  if (!plane) return true;
  const [x, y, z] = plane.normal;
  return x * position[0] + y * position[1] + z * position[2] - plane.offset >= 0;
}

/** Where a handle's gizmo stands: its pivot, carried along by its own translation, relative to the center. */
export function gripOf(transform: Transform, position: Vec3, center: Vec3): Vec3 {
  const pivot = transform.pivot ?? position;
  return [0, 1, 2].map((i) => pivot[i] + transform.translation[i] - center[i]) as unknown as Vec3;
}
