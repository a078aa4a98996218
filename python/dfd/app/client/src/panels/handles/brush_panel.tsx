import { fixPainted, holdPainted, limitTo } from "../../actions/edit";
import { selectedHandle, store } from "../../store/state";
import { useStore } from "../../store/use";
import { handleName } from "../../viewer/overlays/marks";
import { Panel, Slider } from "../../widgets/controls";

export function BrushPanel() {
  const brush = useStore(store, (state) => state.brush);
  const painted = useStore(store, (state) => state.painted);
  const strengths = useStore(store, (state) => state.edit?.controls.includes("strength") ?? false);
  const selected = useStore(store, selectedHandle);
  const limits = useStore(store, (state) => state.edit?.controls.includes("within") ?? false);
  const use = (what: (mask: Uint8Array) => void) => () => {
    if (!painted) return;
    what(painted.mask);
    store.set({ painted: null, tool: "hold" });
  };
  return (
    <Panel title="Brush">
      <Slider
        label="Size"
        value={brush.radius}
        min={0.005}
        max={0.2}
        step={0.005}
        text={`${(100 * brush.radius).toFixed(1)} %`}
        onInput={(radius) => store.set({ brush: { ...brush, radius } })}
      />
      {strengths && (
        <Slider
          label="Strength of fixing"
          value={brush.strength}
          min={0.05}
          max={1}
          step={0.05}
          text={`${Math.round(100 * brush.strength)} %`}
          onInput={(strength) => store.set({ brush: { ...brush, strength } })}
        />
      )}
      <p class="empty" role="status">
        {painted ? `${painted.count} vertices painted.` : "Paint over the shape; Shift erases."}
      </p>
      <div class="buttons">
        <button
          type="button"
          class="button primary"
          disabled={!painted}
          onClick={use((mask) => fixPainted(mask, brush.strength))}
        >
          Fix
        </button>
        <button type="button" class="button" disabled={!painted} onClick={use(holdPainted)}>
          Hold
        </button>
        {limits && selected && (
          <button
            type="button"
            class="button"
            disabled={!painted}
            title={`${handleName(selected)} is to act nowhere else`}
            onClick={use((mask) => limitTo(selected.handle, mask))}
          >
            Limit
          </button>
        )}
        <button type="button" class="button" disabled={!painted} onClick={() => store.set({ painted: null })}>
          Clear
        </button>
      </div>
    </Panel>
  );
}
