import { resetOne } from "../actions/edit";
import { alive, selectedHandle, store } from "../store/state";
import { useStore } from "../store/use";
import { BrushPanel } from "./handles/brush_panel";
import { IconButton, Panel } from "../widgets/controls";
import { DefaultPanel } from "./handles/default_panel";
import { FixedPanel } from "./handles/fixed_panel";
import { HandleList } from "./handles/handle_list";
import { HandlePanel } from "./handles/handle_panel";
import { ShapePanel } from "./shape_panel";
import { SymmetryPanel } from "./symmetry_panel";

export function Inspector() {
  const open = useStore(store, (state) => state.inspector);
  const known = useStore(store, (state) => state.edit);
  const handle = useStore(store, selectedHandle);
  const ready = useStore(store, alive);
  const painting = useStore(store, (state) => state.tool === "paint" || state.painted !== null);
  if (!open) return null;
  return (
    <aside class="inspector" aria-label="Inspector">
      {painting && <BrushPanel />}
      <HandleList />
      {handle && (
        <Panel
          title="Transform and reach"
          action={
            <IconButton
              icon="reset"
              label="Return this handle to rest"
              keys="0"
              disabled={!handle.moved}
              onPress={() => resetOne(handle.handle)}
            />
          }
        >
          <HandlePanel known={handle} />
        </Panel>
      )}
      {known && known.fixed.length > 0 && <FixedPanel fixed={known.fixed} />}
      {known && ready && <SymmetryPanel known={known} />}
      {known && ready && <DefaultPanel known={known} />}
      {known && <ShapePanel known={known} />}
    </aside>
  );
}
