/** Marks: points of the surface, and where they must arrive. The server moves the handles so that the marks do. */

import type { Vec3 } from "../posing/affine";
import type { Mark } from "../protocol/messages";
import { store } from "../store/state";
import { ask, send } from "./connection";

/** Return the marks on the server, as a request has them. */
const marks = (): Mark[] => store.get().edit?.marks.map(({ vertex, target }) => ({ vertex, target })) ?? [];

/** Place a mark where the vertex is now. */
export function placeMark(vertex: number): void {
  if (!marks().some((mark) => mark.vertex === vertex))
    send({ type: "set_marks", marks: [...marks(), { vertex, target: null }], fit: false });
}

/** Remove a mark; without an index, remove all. The shape stays as it is. */
export function removeMark(index?: number): void {
  send({ type: "set_marks", marks: index === undefined ? [] : marks().toSpliced(index, 1), fit: false });
}

/** Set the target of a mark, and fit the handles. With `merge`, the change belongs to the newest step of undo. */
export function aimMark(index: number, target: Vec3, merge = false): Promise<unknown> {
  return ask({ type: "set_marks", marks: marks().with(index, { ...marks()[index], target }), merge });
}

/** Whether a fit of the drag has succeeded, a fit is not answered yet, and the user has cancelled the drag. */
const drag = { begun: false, waits: false, cancelled: false };

export function startMark(index: number): void {
  const target = marks()[index].target;
  if (drag.waits || !target) return;
  Object.assign(drag, { begun: false, cancelled: false });
  store.set({ marked: { index, target }, dragging: true });
}

/** Show the target of the dragged mark, and fit the handles as fast as the server answers. */
export async function dragMark(target: Vec3): Promise<void> {
  const { marked, dragging } = store.get();
  if (!marked || !dragging) return;
  store.set({ marked: { ...marked, target } });
  if (drag.waits) return;
  drag.waits = true;
  for (let now = store.get().marked, last = null; now && now !== last && !drag.cancelled; now = store.get().marked) {
    last = now;
    drag.begun = (await aimMark(now.index, now.target, drag.begun)) !== null || drag.begun;
  }
  drag.waits = false;
  settle();
}

/** End the drag, and return whether there was one. If `cancels`, the mark and the handles return. */
export function dropMark(cancels = false): boolean {
  const { marked, dragging } = store.get();
  if (!marked || !dragging) return false;
  drag.cancelled = cancels;
  store.set({ dragging: false });
  if (!drag.waits) settle();
  return true;
}

function settle(): void {
  if (store.get().dragging) return;
  store.set({ marked: null });
  if (drag.cancelled && drag.begun) send({ type: "go", by: -1 });
}
