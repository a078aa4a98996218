/** Convert the state to the scene of the pose shader, relative to the mesh's center. */

import type { Matrix4 } from "three";

import {
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
import { EMPTY_SCENE, height, type Column, type Mirror, type Scene } from "../posing/columns";
import { heldPart } from "../posing/held";
import type { ColumnState, HandleState, SymmetryPlane } from "../protocol/messages";
import { colorsHandle, isolates, present, type State } from "../store/state";

/** Return the handle's motion at a counterpart: in the counterpart's frame and about the counterpart's pivot. */
export function columnMatrix(handle: Placed, { frame, position }: ColumnState): Matrix4 {
  const { transform, position: held } = handle;
  const back = basisOf(frame);
  const turn = back.clone().transpose();
  const pivot = transform.pivot ?? held;
  const matrix = relative(matrixOf(transform, held), pivot).premultiply(turn).multiply(back);
  // In the counterpart's frame, the vector from pivot to position has the same coordinates as at the handle.
  return relative(matrix, subtract(apply(turn, subtract(held, pivot)), position));
}

type Placed = Pick<HandleState, "position"> & { readonly transform: Transform };

export function mirrorOf(plane: SymmetryPlane, center: Vec3): Mirror {
  return { normal: plane.normal, offset: -height(plane, center), band: plane.band ?? 0 };
}

export function sceneOf(state: State): Scene {
  const { edit, mesh, columns: known, painted } = state;
  const probe = state.isolated && state.selected !== null ? null : state.probe;
  if (!edit || !mesh) return EMPTY_SCENE;
  const { center } = mesh;
  const { symmetry } = edit;
  const columns: Column[] = [];
  const colored = colorsHandle(state) || isolates(state);
  for (const own of edit.handles) {
    const handle = present(state, own);
    for (const each of own.columns) {
      const weights = known.get(each.column);
      if (!weights) continue;
      columns.push({
        handle: own.handle,
        weights,
        positive: !symmetry || height(symmetry, each.position) >= 0,
        heat: colored && !probe && !painted && state.tool !== "fix" && state.selected === own.handle ? 1 : 0,
        transform: state.comparing ? IDENTITY : relative(columnMatrix(handle, each), center),
      });
    }
  }
  if (painted) columns.push(shownColumn(painted.weights, PAINTED));
  else if (probe) columns.push(shownColumn(probe.weights, 1));
  else if (state.tool === "fix" && state.stays) columns.push(shownColumn(state.stays, 1));
  const d0 = state.comparing ? null : edit.default;
  const rest = d0 && matrixOf({ ...REST, ...d0 }, center);
  return {
    columns,
    defaultTransform: rest && relative(rest, center),
    mirror: symmetry && mirrorOf(symmetry, center),
  };
}

/** Return the weight columns of a handle. */
export function columnsOf(state: State, handle: number): readonly Column[] {
  return sceneOf(state).columns.filter((column) => column.handle === handle);
}

/** Return the share of the surface that follows a handle. */
export function held(state: State, handle: number): number {
  return state.surface ? heldPart(columnsOf(state, handle), state.surface) : 0;
}

/** The heat of the painted region. The heat map shows this heat in a color that is visible on pale shapes. */
const PAINTED = 0.66;

/** Return a column that is only shown in the heat map. */
function shownColumn(weights: Uint16Array, heat: number): Column {
  return { handle: 0, weights, positive: true, heat, transform: IDENTITY };
}
