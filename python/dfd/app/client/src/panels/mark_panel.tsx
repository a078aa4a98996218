import { aimMark, removeMark } from "../actions/marks";
import { niceStep } from "../posing/affine";
import type { StateMessage } from "../protocol/messages";
import { useParts } from "../store/use";
import { IconButton, Panel, PlaceRow, readable, Triple } from "../widgets/controls";

/** The marks, with their targets and the distances from them. */
export function MarkPanel({ known: { marks, fitted, handles } }: { readonly known: StateMessage }) {
  const size = useParts().mesh?.diagonal ?? 1;
  const all = <IconButton icon="remove" label="Remove all marks" onClick={() => removeMark()} />;
  return (
    <Panel title="Marks" action={marks.length > 1 && all}>
      {handles.length === 0 && <p class="empty">Add a handle first: marks move handles.</p>}
      {marks.length === 0 && <p class="empty">Click a point to place a mark. Drag it to where it must arrive.</p>}
      <ul class="rows">
        {marks.map(({ vertex, target, missing }, i) => {
          const note = missing < 1e-4 * size ? "arrived" : `${readable(missing)} away`;
          const remove = () => removeMark(i);
          const [of, step] = [` of mark ${i + 1}`, niceStep(size / 100)];
          return (
            <PlaceRow key={vertex} dot="moved goal" name={`Mark ${i + 1}`} note={note} verb="Remove" onRemove={remove}>
              {target && <Triple label="Target" of={of} value={target} step={step} onChange={(at) => aimMark(i, at)} />}
            </PlaceRow>
          );
        })}
      </ul>
      {fitted && <p class="empty" role="status" children={fitted} />}
    </Panel>
  );
}
