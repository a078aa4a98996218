/** The brush takes vertices within its radius on the resting shape, so parts that touch when posed stay separate. */

import { store } from "../../store/state";
import type { Pick } from "../picker";
import type { Shape } from "../shape";

export function paint(shape: Shape, picked: Pick, erase: boolean): void {
  const { positions, message } = shape;
  const reach = (store.get().brush * message.diagonal) ** 2;
  const [x, y, z] = picked.point;
  const within = (row: number) => {
    const dx = positions[3 * row] - x;
    const dy = positions[3 * row + 1] - y;
    const dz = positions[3 * row + 2] - z;
    return dx * dx + dy * dy + dz * dz <= reach;
  };
  touch(shape, within, erase);
}

/** Paint or erase the vertices of some rows. */
export function touch({ vertexOf, message: mesh }: Shape, within: (row: number) => boolean, erase: boolean): void {
  const { painted } = store.get();
  const mask = painted?.mask ?? new Uint8Array(Math.ceil(mesh.vertices / 8));
  const weights = painted?.weights.slice() ?? new Uint16Array(mesh.vertices);
  let count = painted?.count ?? 0;
  for (let row = 0; row < vertexOf.length; row++) {
    const vertex = vertexOf[row];
    if (weights[vertex] > 0 !== erase || !within(row)) continue;
    weights[vertex] = erase ? 0 : 65535;
    mask[vertex >> 3] ^= 1 << (vertex & 7);
    count += erase ? -1 : 1;
  }
  store.set({ painted: count > 0 ? { mask, weights, count } : null, probe: null });
}
