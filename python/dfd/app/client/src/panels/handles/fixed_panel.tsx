import { release, setFixedStrength } from "../../actions/edit";
import type { FixedState } from "../../protocol/messages";
import { store } from "../../store/state";
import { useStore } from "../../store/use";
import { IconButton, Panel, Slider } from "../../widgets/controls";

export function FixedPanel({ fixed }: { readonly fixed: readonly FixedState[] }) {
  const strengths = useStore(store, (state) => state.edit?.controls.includes("strength") ?? false);
  return (
    <Panel title="Fixed">
      <ul class="rows">
        {fixed.map((place, index) => {
          const name =
            place.region > 0
              ? `Region of ${place.region} vertices`
              : place.vertex === null
                ? "Point"
                : `Vertex ${place.vertex}`;
          return (
            <li key={`${name} ${index}`} class="row tall">
              <span class="row-name">
                <span class="dot fixed" aria-hidden="true" />
                <span>{name}</span>
              </span>
              <IconButton icon="remove" label={`Release ${name}`} onPress={() => release(index)} />
              {strengths && (
                <Slider
                  label="Strength"
                  of={` of ${name}`}
                  hint="How much of what looks like it is held in place"
                  value={place.strength}
                  min={0}
                  max={1}
                  step={0.05}
                  text={`${Math.round(100 * place.strength)} %`}
                  onInput={(strength) => setFixedStrength(index, strength)}
                />
              )}
            </li>
          );
        })}
      </ul>
    </Panel>
  );
}
