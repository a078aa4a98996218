/** Panels over the view: what the colors mean, proposals, and the actions for a selection. */

import { send } from "../actions/connection";
import { regionOf } from "../actions/edit";
import { take } from "../actions/propose";
import { colorsHandle, draws, handleName, selectedHandle, store, type State } from "../store/state";
import { useParts } from "../store/use";
import { Button, Slider } from "../widgets/controls";

/** Say what the colors of the view mean, while there are any. */
export function Legend() {
  const meaning = meaningOf(useParts());
  if (!meaning) return null;
  const [low, high] = meaning;
  return (
    <div class="legend" role="img" aria-label={`Colors: from ${low} to ${high}`}>
      <span>{low}</span>
      <i aria-hidden="true" />
      <span>{high}</span>
    </div>
  );
}

function meaningOf(state: State): readonly [string, string] | null {
  const { tool, probe, stays, painted, look } = state;
  if (painted || look === "features") return null;
  if (tool === "fix") return probe || stays ? ["free", "fixed"] : null;
  return probe || colorsHandle(state) ? ["stays", "follows"] : null;
}

/** Small pictures of what the last gesture would do with other controls. */
export function Proposed() {
  const { proposals, dragging, moment } = useParts();
  if (!proposals || dragging || moment) return null;
  return (
    <section class="proposals" aria-label="Proposals">
      {proposals.choices.map(({ label, picture }, i) => (
        <button key={label} title={`${label} (Alt ${i + 1})`} onClick={() => take(i)}>
          <img src={picture} alt="" width={120} height={90} />
          <span>{label}</span>
        </button>
      ))}
    </section>
  );
}

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
          <Button text="Fix" kind="primary" onClick={use((at) => send({ type: "fix", at }))} />
          <Button text="Add handle" onClick={use((at) => send({ type: "add", at }))} />
          {selected && (
            <Button
              text="Limit"
              title={`Limit ${handleName(selected)} to this region`}
              onClick={use((mask) => send({ type: "change", handle: selected.handle, controls: { mask } }))}
            />
          )}
          <Button text="Clear" onClick={() => store.set({ painted: null })} />
        </div>
      )}
    </section>
  );
}
