/** The look-alikes of the selected handle: asked for once it is cheap, and switched one by one. */

import type { AlikeMessage } from "../protocol/messages";
import { selectedHandle, store, type State } from "../store/state";
import { ask, tell } from "./server";

/** What they depend on; null while there is nothing to ask, or finding them would hold up what is more urgent. */
function wanted(state: State): string | null {
  const handle = selectedHandle(state);
  if (!handle || state.dragging || !state.edit?.controls.includes("without_instances")) return null;
  const column = state.columns.get(handle.column);
  if (!column || handle.instances === "only" || (handle.instances === "own" && column.instances.length === 0))
    return null;
  const symmetry = JSON.stringify(state.edit.symmetry?.normal ?? null);
  return [handle.handle, handle.position, handle.without_instances, handle.instances, symmetry].join(" ");
}

export function followLookAlikes(): void {
  store.watch(wanted, (key) => {
    const { selected, alike } = store.get();
    if (key !== null && selected !== null) tell({ type: "instances", handle: selected });
    else if (alike && alike.handle !== selected) store.set({ alike: null });
  });
}

/** Those of the selected handle besides its own place. */
export function othersOf(state: State): AlikeMessage["places"] {
  const { alike, selected } = state;
  const handle = selectedHandle(state);
  if (alike?.handle !== selected || handle?.instances === "only") return [];
  return alike.places.slice(1);
}

export function switchLookAlike(handle: number, vertex: number): void {
  const places = store.get().alike?.places ?? [];
  const off = places.slice(1).filter((place) => place.on === (place.vertex === vertex));
  void ask({ type: "change", handle, controls: { without_instances: off.map((place) => place.vertex) } });
}
