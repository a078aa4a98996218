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
import { EMPTY_SCENE, type Column, type Mirror, type Scene } from "../posing/columns";
import { heldPart } from "../posing/held";
import type { ColumnState, HandleState, SymmetryPlane } from "../protocol/messages";
import { present, type State } from "../store/state";

/** The handle's motion about the pivot of a column, turned or mirrored into its frame. */
export function columnMatrix(handle: Placed, { frame, position }: ColumnState): Matrix4 {
  const { transform, position: held } = handle;
  const matrix = matrixOf(transform, held);
  if (frame === null) return matrix;
  const back = basisOf(frame);
  const turn = back.clone().transpose();
  const pivot = transform.pivot ?? held;
  // Its pivot lies to it as the pivot of the handle lies to the handle.
  const own = add(position, apply(turn, subtract(pivot, held)));
  return relative(relative(matrix, pivot).premultiply(turn).multiply(back), subtract([0, 0, 0], own));
}

type Placed = Pick<HandleState, "position"> & { readonly transform: Transform };

export function mirrorOf(plane: SymmetryPlane, center: Vec3): Mirror {
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
  const columns: Column[] = [];
  for (const own of edit.handles) {
    const handle = present(state, own);
    for (const each of own.columns) {
      const weights = known.get(each.column);
      if (!weights) continue;
      columns.push({
        handle: own.handle,
        weights,
        positive: isPositive(symmetry, each.position),
        heat: !probe && !painted && state.selected === own.handle ? 1 : 0,
        transform: state.comparing ? IDENTITY : relative(columnMatrix(handle, each), center),
      });
    }
  }
  // What was painted, in a color of the ramp that stands out from pale shapes too.
  if (painted) columns.push(shownColumn(painted.weights, PAINTED));
  else if (probe) columns.push(shownColumn(probe.weights, 1));
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
  return sceneOf(state).columns.filter((column) => column.handle === handle);
}

/** The part of the surface that a handle holds, by the weights that move it. */
export function held(state: State, handle: number): number {
  return state.surface ? heldPart(columnsOf(state, handle), state.surface) : 0;
}

const PAINTED = 0.66;

/** A column that only the heat map shows. */
function shownColumn(weights: Uint16Array, heat: number): Column {
  return { handle: 0, weights, positive: true, heat, transform: IDENTITY };
}

function isPositive(plane: SymmetryPlane | null, position: Vec3): boolean {
  if (!plane) return true;
  const [x, y, z] = plane.normal;
  return x * position[0] + y * position[1] + z * position[2] - plane.offset >= 0;
}

/** Where a handle's gizmo stands: its pivot, carried along by its own translation, relative to the center. */
export function gripOf(transform: Transform, position: Vec3, center: Vec3): Vec3 {
  const pivot = transform.pivot ?? position;
  return [0, 1, 2].map((i) => pivot[i] + transform.translation[i] - center[i]) as unknown as Vec3;
}
