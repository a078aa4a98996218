import { colorsHandle, type State } from "../store/state";
import { useParts } from "../store/use";

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
