import { aimMark, removeMark } from "../actions/marks";
import { niceStep } from "../posing/affine";
import type { StateMessage } from "../protocol/messages";
import { useParts } from "../store/use";
import { IconButton, Panel, readable, Triple } from "../widgets/controls";

/** The marks, with their targets and the distances from them. */
export function MarkPanel({ known: { marks, fitted, handles } }: { readonly known: StateMessage }) {
  const size = useParts().mesh?.diagonal ?? 1;
  const all = <IconButton icon="remove" label="Remove all marks" onPress={() => removeMark()} />;
  return (
    <Panel title="Marks" action={marks.length > 1 && all}>
      {handles.length === 0 && <p class="empty">Add a handle first: marks move handles.</p>}
      {marks.length === 0 && <p class="empty">Click a point to place a mark. Drag it to where it must arrive.</p>}
      <ul class="rows">
        {marks.map(({ vertex, target, missing }, i) => (
          <li key={vertex} class="row tall">
            <span class="row-name">
              <span class="dot moved goal" aria-hidden="true" />
              <span>{`Mark ${i + 1}`}</span>
              <small>{missing < 1e-4 * size ? "arrived" : `${readable(missing)} away`}</small>
            </span>
            <IconButton icon="remove" label={`Remove mark ${i + 1}`} onPress={() => removeMark(i)} />
            {target && (
              <Triple
                label="Target"
                of={` of mark ${i + 1}`}
                value={target}
                step={niceStep(size / 100)}
                onChange={(place) => void aimMark(i, place)}
              />
            )}
          </li>
        ))}
      </ul>
      {fitted && (
        <p class="empty" role="status">
          {fitted}
        </p>
      )}
    </Panel>
  );
}
