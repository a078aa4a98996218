/** Paint regions. Distances are measured at rest, so parts that touch only in the pose are not painted together. */

import { Sphere, Vector3 } from "three";

import { store, type Picked } from "../../store/state";
import type { Shape } from "../shape";

export function paint(shape: Shape, picked: Picked, erase: boolean): void {
  const ball = new Sphere(new Vector3(...picked.point), store.get().brush * shape.message.diagonal);
  const at = new Vector3();
  touch(shape, (row) => ball.containsPoint(at.fromArray(shape.positions, 3 * row)), erase);
}

/** Paint or erase the vertices of all rows for which `within` is true. */
export function touch({ vertexOf, message: mesh }: Shape, within: (row: number) => boolean, erase: boolean): void {
  const { painted } = store.get();
  const weights = painted?.weights.slice() ?? new Uint16Array(mesh.vertices);
  let count = painted?.count ?? 0;
  for (let row = 0; row < vertexOf.length; row++) {
    const vertex = vertexOf[row];
    if (weights[vertex] > 0 !== erase || !within(row)) continue;
    weights[vertex] = erase ? 0 : 65535;
    count += erase ? -1 : 1;
  }
  store.set({ painted: count > 0 ? { weights, count } : null, probe: null });
}
