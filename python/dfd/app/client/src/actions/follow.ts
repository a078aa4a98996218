/** Send requests when the state changes. */

import { ready, selectedHandle, serverPoses, store } from "../store/state";
import { ask, send } from "./connection";
import { seenTransforms, showWeights, throttle } from "./edit";

export function follow(): void {
  // Request the counterparts of the selected handle when they may have changed.
  store.watch(
    (state) => {
      const handle = selectedHandle(state);
      if (!handle || state.dragging || handle.follow === "none") return null;
      const { position, excluded_counterparts, counterparts } = handle;
      const normal = state.edit?.symmetry?.normal;
      return [handle.handle, JSON.stringify([position, excluded_counterparts, counterparts, normal])] as const;
    },
    (wanted) => wanted && send({ type: "counterparts", handle: wanted[0] }),
  );
  // Request the pivots and the axis of the selected handle when the gizmo needs them.
  store.watch(
    ({ gizmo, selected, dragging, edit }) =>
      gizmo === "translate" || dragging || selected === null || !edit ? null : ([selected, edit.after] as const),
    (wanted) => wanted && send({ type: "axis", handle: wanted[0] }),
  );
  // Request what stays in place while the user fixes points.
  store.watch(
    ({ tool, edit }) => (tool === "fix" && edit ? ([edit.field.origin, JSON.stringify(edit.fixed)] as const) : null),
    (wanted) => {
      store.set({ stays: null, probe: null });
      if (!wanted) return;
      void ask({ type: "stays" }, true).then((answer) => {
        if (answer) store.set({ stays: answer.payload.get("values", "U16") });
      });
    },
  );
  // Request the parts at the selected handle and at the pointer.
  store.watch(
    (state) => {
      const vertices = [selectedHandle(state)?.origin, state.probe?.vertex].filter(
        (vertex) => typeof vertex === "number",
      );
      return state.edit?.field.parts.length ? vertices.find((vertex) => !state.ladders.has(vertex)) : undefined;
    },
    (vertex) => vertex !== undefined && ask({ type: "ladder", vertex }, true),
  );
  // Parts of the geometry are not those of the features, which replace them when they are learned.
  store.watch(
    ({ edit }) => edit?.field.origin,
    () => {
      const { hover } = store.get();
      store.set({ ladders: new Map(), suggestions: [], probe: null, level: 0 });
      if (hover) showWeights(hover.vertex);
    },
  );
  store.watch(
    (state) => (state.look === "features" && ready(state) ? ([state.mesh, state.edit?.field.origin] as const) : null),
    (wanted) => wanted && send({ type: "features" }),
  );
  // The server computes poses that the shader does not support. During a drag, `sendDrag` requests these poses.
  store.watch(serverPoses, (on) => {
    if (!on) store.set({ posed: null });
  });
  const compute = () => serverPoses(store.get()) && send({ type: "compute", transforms: seenTransforms() });
  store.on("edit", compute);
  store.on("comparing", compute);
  store.on("moment", () => throttle("compute", compute));
}
