/** The counterparts of the selected handle: requested when that is cheap, and switched one by one. */

import type { SimilarPoint } from "../protocol/messages";
import { selectedHandle, store, type State } from "../store/state";
import { ask, send } from "./connection";

/** Request the counterparts of the selected handle when they may have changed. */
export function followSimilar(): void {
  const wanted = (state: State) => {
    const handle = selectedHandle(state);
    if (!handle || state.dragging || handle.counterparts === "only") return null;
    const { position, excluded_counterparts, counterparts } = handle;
    const normal = state.edit?.symmetry?.normal;
    return [handle.handle, JSON.stringify([position, excluded_counterparts, counterparts, normal])] as const;
  };
  store.watch(wanted, (found) => {
    if (found) send({ type: "counterparts", handle: found[0] });
  });
}

/** Request the pivots and the axis of the selected handle when a mode of the gizmo needs them. */
export function followAxis(): void {
  const wanted = ({ gizmo, selected, dragging, edit }: State) =>
    gizmo === "translate" || dragging || selected === null || !edit ? null : ([selected, edit.after] as const);
  store.watch(wanted, (found) => {
    if (found) send({ type: "axis", handle: found[0] });
  });
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
