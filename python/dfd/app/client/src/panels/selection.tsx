import { send } from "../actions/connection";
import { regionOf } from "../actions/edit";
import { draws, handleName, selectedHandle, store } from "../store/state";
import { useParts } from "../store/use";
import { Button, Slider } from "../widgets/controls";

/** The size of the brush, and the actions for the painted region beside this region. */
export function Selection() {
  const state = useParts();
  const { brush, painted, tool, stroked } = state;
  const selected = selectedHandle(state);
  if (!draws(tool) && !painted) return null;
  const use = (what: (region: { mask: string }) => void) => () => {
    if (!painted) return;
    what(regionOf(painted.weights));
    store.set({ painted: null, tool: "hold" });
  };
  const beside = painted && stroked ? { "--x": `${stroked[0]}px`, "--y": `${stroked[1]}px` } : {};
  return (
    <section class={`selection ${painted ? "beside" : ""}`} aria-label="Selection" style={beside}>
      {tool === "paint" && (
        <Slider
          label="Size"
          value={brush}
          range={[0.005, 0.2, 0.005]}
          text={`${(100 * brush).toFixed(1)} % of the size`}
          onChange={(radius) => store.set({ brush: radius })}
        />
      )}
      <p class="empty" role="status">
        {painted ? `${painted.count} vertices are selected.` : "Paint the shape, or draw a box. Shift erases."}
      </p>
      {painted && (
        <div class="buttons">
          <Button text="Fix" style="primary" onPress={use((at) => send({ type: "fix", at }))} />
          <Button text="Add handle" onPress={use((at) => send({ type: "add", at }))} />
          {selected && (
            <Button
              text="Limit"
              title={`Limit ${handleName(selected)} to this region`}
              onPress={use((mask) => send({ type: "change", handle: selected.handle, controls: { mask } }))}
            />
          )}
          <Button text="Clear" onPress={() => store.set({ painted: null })} />
        </div>
      )}
    </section>
  );
}
