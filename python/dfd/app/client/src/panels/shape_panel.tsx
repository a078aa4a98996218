import { setBlend, setOverlap, setPreset } from "../actions/edit";
import type { StateMessage } from "../protocol/messages";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { Panel, Select } from "../widgets/controls";

const count = new Intl.NumberFormat("en");

export function ShapePanel({ known }: { readonly known: StateMessage }) {
  const mesh = useStore(store, (state) => state.mesh);
  const report = useStore(store, (state) => state.report);
  const { status, origin } = known.field;
  return (
    <Panel title="Shape">
      {status === "ready" && (
        <Select
          label="Preset"
          hint="How handles act and are put together: dfd's own way, or the paper's equations to the letter"
          value={known.preset}
          options={known.presets}
          onChange={setPreset}
        />
      )}
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
