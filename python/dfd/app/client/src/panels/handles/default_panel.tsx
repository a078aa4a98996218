import { setDefault } from "../../actions/edit";
import type { StateMessage } from "../../protocol/messages";
import { store } from "../../store/state";
import { useStore } from "../../store/use";
import { REST, type Transform } from "../../viewer/posing/affine";
import { niceStep } from "../../viewer/viewer";
import { IconButton, Panel } from "../../widgets/controls";
import { Scale, Triple } from "../../widgets/triple";

/** D₀ of Eq. 1: what happens to what no handle holds. */
export function DefaultPanel({ known }: { readonly known: StateMessage }) {
  const size = useStore(store, (state) => state.mesh?.diagonal ?? 1);
  const now = known.default ?? REST;
  const set = (part: Partial<Transform>) => setDefault({ ...now, ...part });
  return (
    <Panel
      title="What no handle holds"
      action={
        <IconButton
          icon="reset"
          label="Leave it where it is"
          disabled={known.default === null}
          onPress={() => setDefault(REST)}
        />
      }
    >
      <Triple
        label="Move"
        of=" the rest"
        value={now.translation}
        step={niceStep(size / 100)}
        onChange={(translation) => set({ translation })}
      />
      <Triple
        label="Rotate °"
        of=" the rest"
        value={now.rotation}
        step={1}
        onChange={(rotation) => set({ rotation })}
      />
      <Scale of=" the rest" value={now.scale} onChange={(scale) => set({ scale })} />
    </Panel>
  );
}
