/** The places that look like the one that the selected handle holds: asked for once that is cheap, switched singly. */

import type { SimilarPoint } from "../protocol/messages";
import { selectedHandle, store, type State } from "../store/state";
import { ask, send } from "./connection";

/** What they depend on; null while there is nothing to ask. */
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

/** Ask what the selected handle turns about and bends along, once a verb needs to know. */
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

/** Those of the selected handle besides its own place. */
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
