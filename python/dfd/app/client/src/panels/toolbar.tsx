import { MODES, ready, TOOLS } from "../store/state";
import { useParts } from "../store/use";
import { ActionButton } from "../widgets/controls";

export function Toolbar() {
  const { edit, tool, gizmo, snap, local, xray, isolated, weights, comparing, suggestions } = useParts();
  const disabled = !ready({ edit });
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {TOOLS.map((name) => (
          <ActionButton key={name} action={name} pressed={tool === name} disabled={disabled} />
        ))}
      </div>
      <div role="group" aria-label="Gizmo">
        {MODES.map((name) => (
          <ActionButton key={name} action={name} pressed={gizmo === name} disabled={disabled} />
        ))}
        <ActionButton action="snap" pressed={snap} disabled={disabled} />
        <ActionButton action="local" pressed={local} disabled={disabled} />
      </div>
      <div role="group" aria-label="Shape">
        <ActionButton action="xray" pressed={xray} />
        <ActionButton action="isolate" pressed={isolated} disabled={disabled} />
        <ActionButton action="weights" pressed={weights} disabled={disabled} />
        <ActionButton action="suggest" pressed={suggestions.length > 0} disabled={disabled} />
        <ActionButton action="compare" pressed={comparing} disabled={disabled} />
      </div>
    </nav>
  );
}
