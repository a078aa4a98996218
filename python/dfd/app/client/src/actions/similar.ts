/** The counterparts of the selected handle: requested when that is cheap, and switched one by one. */

import type { SimilarPoint } from "../protocol/messages";
import { selectedHandle, store, type State } from "../store/state";
import { ask, send } from "./connection";

/** Return a key of everything that counterparts depend on; null if there is nothing to request. */
function key(state: State): string | null {
  const handle = selectedHandle(state);
  if (!handle || state.dragging || handle.counterparts === "only") return null;
  const symmetry = JSON.stringify(state.edit?.symmetry?.normal ?? null);
  return [handle.handle, handle.position, handle.excluded_counterparts, handle.counterparts, symmetry].join(" ");
}

export function followSimilar(): void {
  store.watch(key, (wanted) => {
    const { selected, similar } = store.get();
    if (wanted !== null && selected !== null) send({ type: "counterparts", handle: selected });
    else if (similar && similar.handle !== selected) store.set({ similar: null });
  });
}

/** Request the pivots and the axis of the selected handle when a mode of the gizmo needs them. */
export function followAxis(): void {
  const wanted = ({ gizmo, selected, dragging, edit }: State) =>
    gizmo === "translate" || dragging || selected === null || !edit ? null : [selected, edit.after];
  store.watch(
    (state) => wanted(state)?.join() ?? null,
    () => {
      const { selected } = store.get();
      if (wanted(store.get()) && selected !== null) send({ type: "axis", handle: selected });
    },
  );
}

/** Return the counterparts of the selected handle without its own place. */
export function otherPlaces(state: State): readonly SimilarPoint[] {
  const handle = selectedHandle(state);
  return handle && state.similar?.handle === handle.handle && handle.counterparts !== "only"
    ? state.similar.places.slice(1)
    : [];
}

export function toggleCounterpart(handle: number, vertex: number): void {
  const off = otherPlaces(store.get()).filter((place) => place.on === (place.vertex === vertex));
  void ask({ type: "change", handle, controls: { excluded_counterparts: off.map((place) => place.vertex) } });
}
