/** Convert the store's state to the scene of the pose shader, in coordinates relative to the mesh's center. */

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

/** The handle's motion about the pivot of a column, in the column's frame. */
export function columnMatrix(handle: Placed, { frame, position }: ColumnState): Matrix4 {
  const { transform, position: held } = handle;
  const matrix = matrixOf(transform, held);
  const back = basisOf(frame);
  const turn = back.clone().transpose();
  const pivot = transform.pivot ?? held;
  // The column's pivot relative to its position corresponds to the handle's pivot.
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
  // The painted region, in a color of the ramp that is also visible on pale shapes.
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

/** Return the columns of a handle. */
export function columnsOf(state: State, handle: number): readonly Column[] {
  return sceneOf(state).columns.filter((column) => column.handle === handle);
}

/** Return the share of the surface that follows a handle. */
export function held(state: State, handle: number): number {
  return state.surface ? heldPart(columnsOf(state, handle), state.surface) : 0;
}

const PAINTED = 0.66;

/** A column that is only shown in the heat map. */
function shownColumn(weights: Uint16Array, heat: number): Column {
  return { handle: 0, weights, positive: true, heat, transform: IDENTITY };
}

function isPositive(plane: SymmetryPlane | null, position: Vec3): boolean {
  if (!plane) return true;
  const [x, y, z] = plane.normal;
  return x * position[0] + y * position[1] + z * position[2] - plane.offset >= 0;
}

/** The position of a handle's gizmo: its pivot after its translation, relative to the center. */
export function gripOf(transform: Transform, position: Vec3, center: Vec3): Vec3 {
  const pivot = transform.pivot ?? position;
  return [0, 1, 2].map((i) => pivot[i] + transform.translation[i] - center[i]) as unknown as Vec3;
}
