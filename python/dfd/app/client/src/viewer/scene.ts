/** From what the store says to what the shader poses by, in coordinates relative to the mesh's center. */

import type { Plane } from "../protocol/messages";
import { present, type ColumnData, type Instance, type State } from "../store/state";
import { apply, IDENTITY, matrixOf, multiply, subtract, type Affine, type Transform, type Vec3 } from "./affine";
import { EMPTY_SCENE, isFalloff, type Column, type Mirror, type Scene } from "./columns";

/** The map that does to p − center what `transform` does to p. */
export function relative(transform: Affine, center: Vec3): Affine {
  const moved = subtract(apply(transform, center), center);
  return transform.map((entry, i) => (i % 4 === 3 ? moved[(i - 3) / 4] : entry));
}

/** The handle's motion about the instance's own pivot, turned or mirrored into its frame. */
export function instanceMatrix(transform: Affine, pivot: Vec3, instance: Instance): Affine {
  const [x, y, z] = instance.frame;
  const frame: Affine = [...x, 0, ...y, 0, ...z, 0];
  const back: Affine = [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0];
  const about: Affine = relative(transform, pivot);
  const turned = multiply(frame, multiply(about, back));
  const away = subtract([0, 0, 0], instance.pivot);
  return relative(turned, away);
}

export function mirrorOf(plane: Plane, center: Vec3): Mirror {
  const [x, y, z] = plane.normal;
  const offset = plane.offset - (x * center[0] + y * center[1] + z * center[2]);
  return { normal: plane.normal, offset, band: plane.band ?? 0 };
}

export function sceneOf(state: State): Scene {
  const { edit, mesh } = state;
  if (!edit || !mesh) return EMPTY_SCENE;
  const { center } = mesh;
  const fixed = state.columns.get(edit.fixed_column)?.layer ?? null;
  const columns: Column[] = [];
  for (const known of edit.handles) {
    const data = state.columns.get(known.column);
    if (!data) continue;
    const handle = present(state, known);
    const matrix = state.comparing ? IDENTITY : matrixOf(handle.transform, handle.position);
    const column = {
      handle: handle.handle,
      layer: data.layer,
      fixed: data.layer.kind === "weight" ? null : fixed,
      reach: handle.reach,
      falloff: isFalloff(handle.falloff) ? handle.falloff : ("linear" as const),
      locality: handle.locality,
      gain: handle.gain,
      positive: edit.symmetry ? side(edit.symmetry, handle.position) >= 0 : true,
      heat: !state.probe && !state.painted && state.selected === handle.handle ? 1 : 0,
      acts: true,
    };
    const pivot = handle.transform.pivot ?? handle.position;
    columns.push(...ofInstances(column, data, matrix, pivot, center));
  }
  const shown = state.painted?.layer ?? state.probe?.layer;
  if (shown) columns.push(shownColumn(shown, state.painted ? null : fixed));
  const d0 = edit.default && !state.comparing ? edit.default : null;
  const rest = d0 ? matrixOf({ ...d0, pivot: d0.pivot ?? null }, center) : null;
  return {
    columns,
    defaultTransform: rest && relative(rest, center),
    mirror: edit.symmetry && mirrorOf(edit.symmetry, center),
  };
}

type Shared = Omit<Column, "share" | "transform">;

function ofInstances(column: Shared, data: ColumnData, matrix: Affine, pivot: Vec3, center: Vec3): Column[] {
  if (data.instances.length === 0) return [{ ...column, share: null, transform: relative(matrix, center) }];
  return data.instances
    .filter((instance) => instance.on)
    .map((instance) => ({
      ...column,
      share: instance.share,
      transform: relative(instanceMatrix(matrix, pivot, instance), center),
    }));
}

/** A column that only the heat map shows. */
function shownColumn(layer: Column["layer"], fixed: Column["fixed"]): Column {
  return {
    handle: 0,
    layer,
    fixed,
    share: null,
    reach: 1,
    falloff: "linear",
    locality: 0,
    gain: 1,
    positive: true,
    heat: 1,
    transform: IDENTITY,
    acts: false,
  };
}

function side(plane: Plane, position: Vec3): number {
  return plane.normal[0] * position[0] + plane.normal[1] * position[1] + plane.normal[2] * position[2] - plane.offset;
}

/** Where a handle's gizmo stands: its pivot, carried along by its own translation, relative to the center. */
export function gripOf(transform: Transform, position: Vec3, center: Vec3): Vec3 {
  const pivot = transform.pivot ?? position;
  return [0, 1, 2].map((i) => pivot[i] + transform.translation[i] - center[i]) as unknown as Vec3;
}
