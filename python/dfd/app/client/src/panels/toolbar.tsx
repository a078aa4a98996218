import { send } from "../actions/connection";
import { ready, store } from "../store/state";
import { useParts } from "../store/use";
import { IconButton, KeyButton } from "../widgets/controls";

const TOOLS = { hold: "H", fix: "X", paint: "B", box: "M", pivot: "P" } as const;
const MODES = { translate: "W", rotate: "E", scale: "R", bend: "D" } as const;

export function Toolbar() {
  const { edit, tool, gizmo, space, snap, comparing, suggestions, xray, isolated, selected } = useParts();
  const off = !ready({ edit });
  const compare = (on: boolean) => () => store.set({ comparing: on });
  const keyed = (icon: keyof typeof TOOLS | keyof typeof MODES, keys: string, pressed: boolean) => (
    <KeyButton key={keys} icon={icon} keys={keys} pressed={pressed} disabled={off} />
  );
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {(Object.keys(TOOLS) as (keyof typeof TOOLS)[]).map((name) => keyed(name, TOOLS[name], tool === name))}
      </div>
      <div role="group" aria-label="Gizmo">
        {(Object.keys(MODES) as (keyof typeof MODES)[]).map((name) => keyed(name, MODES[name], gizmo === name))}
        <KeyButton icon={space} keys="L" disabled={off} />
        <KeyButton icon="snap" keys="S" pressed={snap} disabled={off} />
      </div>
      <div role="group" aria-label="Shape">
        <KeyButton icon="suggest" keys="G" pressed={suggestions.length > 0} disabled={off} />
        <IconButton
          icon="compare"
          label="Hold to see the original"
          keys="C"
          pressed={comparing}
          disabled={off}
          onPointerDown={compare(true)}
          onPointerUp={compare(false)}
          onPointerLeave={compare(false)}
          onPointerCancel={compare(false)}
        />
        <IconButton
          icon="reset"
          label="Return everything to rest"
          disabled={!edit?.handles.some((handle) => handle.moved)}
          onPress={() => send({ type: "reset" })}
        />
        <KeyButton icon="xray" keys="V" pressed={xray} />
        <KeyButton icon="isolate" keys="/" pressed={isolated} disabled={selected === null} />
        <KeyButton icon="frame" keys="F" />
      </div>
    </nav>
  );
}
