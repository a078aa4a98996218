import { ready } from "../store/state";
import { useParts } from "../store/use";
import { KeyButton } from "../widgets/controls";

const TOOLS = { hold: "H", fix: "X", paint: "B", box: "M" } as const;
const MODES = { translate: "W", rotate: "E", scale: "R", bend: "D" } as const;

export function Toolbar() {
  const { edit, tool, gizmo, comparing, suggestions } = useParts();
  const disabled = !ready({ edit });
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {(Object.keys(TOOLS) as (keyof typeof TOOLS)[]).map((name) => (
          <KeyButton key={name} icon={name} keys={TOOLS[name]} pressed={tool === name} disabled={disabled} />
        ))}
      </div>
      <div role="group" aria-label="Gizmo">
        {(Object.keys(MODES) as (keyof typeof MODES)[]).map((name) => (
          <KeyButton key={name} icon={name} keys={MODES[name]} pressed={gizmo === name} disabled={disabled} />
        ))}
      </div>
      <div role="group" aria-label="Shape">
        <KeyButton icon="suggest" keys="G" pressed={suggestions.length > 0} disabled={disabled} />
        <KeyButton icon="compare" keys="C" pressed={comparing} disabled={disabled} />
      </div>
    </nav>
  );
}
