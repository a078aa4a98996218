import { release } from "../actions/edit";
import type { FixedState } from "../protocol/messages";
import { IconButton, Panel } from "./controls";

export function FixedPanel({ fixed }: { readonly fixed: readonly FixedState[] }) {
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
            <li key={`${name} ${index}`} class="row">
              <span class="row-name">
                <span class="dot fixed" aria-hidden="true" />
                <span>{name}</span>
                {place.strength < 1 && <small>{Math.round(100 * place.strength)} %</small>}
              </span>
              <IconButton icon="remove" label={`Release ${name}`} onPress={() => release(index)} />
            </li>
          );
        })}
      </ul>
    </Panel>
  );
}
