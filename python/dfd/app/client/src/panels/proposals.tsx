import { take } from "../actions/propose";
import { useParts } from "../store/use";

/** Small pictures of what the last gesture would do with other controls. */
export function Proposed() {
  const { proposals, dragging, moment } = useParts();
  if (!proposals || dragging || moment) return null;
  return (
    <section class="proposals" aria-label="Proposals">
      {proposals.choices.map(({ label, picture }, i) => (
        <button key={label} type="button" title={`${label} (Alt ${i + 1})`} onClick={() => take(i)}>
          <img src={picture} alt="" width={120} height={90} />
          <span>{label}</span>
        </button>
      ))}
    </section>
  );
}
