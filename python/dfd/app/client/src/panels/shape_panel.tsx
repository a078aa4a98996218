import { setBlend, setOverlap } from "../actions/edit";
import type { StateMessage } from "../protocol/messages";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { Panel, Select } from "./controls";

const count = new Intl.NumberFormat("en");

export function ShapePanel({ known }: { readonly known: StateMessage }) {
  const mesh = useStore(store, (state) => state.mesh);
  const report = useStore(store, (state) => state.report);
  const { status, origin } = known.field;
  return (
    <Panel title="Shape">
      {status === "ready" && known.overlaps.length > 1 && (
        <Select
          label="Overlap"
          hint="What happens where handles hold the same"
          value={known.overlap}
          options={known.overlaps}
          onChange={setOverlap}
        />
      )}
      {status === "ready" && known.blends.length > 1 && (
        <Select label="Blending" value={known.blend} options={known.blends} onChange={setBlend} />
      )}
      <dl class="facts">
        {mesh && (
          <>
            <dt>Faces</dt>
            <dd>{count.format(mesh.faces)}</dd>
            <dt>Vertices</dt>
            <dd>{count.format(mesh.vertices)}</dd>
            <dt>Parts</dt>
            <dd>{count.format(Math.max(mesh.parts.length, 1))}</dd>
          </>
        )}
        <dt>Features</dt>
        <dd>{status === "ready" ? (origin ?? "ready") : status === "none" ? "not learned yet" : `${status}…`}</dd>
      </dl>
      {report && <p class="report">{report.text}</p>}
    </Panel>
  );
}
