import { send } from "../actions/connection";
import { suggest } from "../actions/edit";
import { toggle, toggleSpace } from "../actions/keyboard";
import { ready, store, type GizmoMode, type Tool } from "../store/state";
import { useStore } from "../store/use";
import { IconButton } from "../widgets/controls";

const TOOLS: readonly (readonly [Tool, string, string])[] = [
  ["hold", "Hold points", "H"],
  ["fix", "Fix points", "X"],
  ["paint", "Brush a region", "B"],
  ["pivot", "Move the pivot", "P"],
];
const MODES: readonly (readonly [GizmoMode, string, string])[] = [
  ["translate", "Move", "W"],
  ["rotate", "Rotate", "E"],
  ["scale", "Scale", "R"],
];

export function Toolbar() {
  const [tool, gizmo, space, snap, comparing, suggested, off, still] = useStore(
    (s) =>
      [
        s.tool,
        s.gizmo,
        s.space,
        s.snap,
        s.comparing,
        s.suggestions.length > 0,
        !ready(s),
        !s.edit?.handles.some((handle) => handle.moved),
      ] as const,
  );
  const compare = (on: boolean) => () => store.set({ comparing: on });
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {TOOLS.map(([name, label, keys]) => (
          <IconButton
            key={name}
            icon={name}
            label={label}
            keys={keys}
            pressed={tool === name}
            disabled={off}
            onPress={() => store.set({ tool: name })}
          />
        ))}
      </div>
      <div role="group" aria-label="Gizmo">
        {MODES.map(([name, label, keys]) => (
          <IconButton
            key={name}
            icon={name}
            label={label}
            keys={keys}
            pressed={gizmo === name}
            disabled={off}
            onPress={() => store.set({ gizmo: name, tool: "hold" })}
          />
        ))}
        <IconButton
          icon={space}
          label={space === "world" ? "World axes" : "Local axes"}
          keys="L"
          disabled={off}
          onPress={toggleSpace}
        />
        <IconButton icon="snap" label="Snap" keys="S" pressed={snap} disabled={off} onPress={() => toggle("snap")} />
      </div>
      <div role="group" aria-label="Shape">
        <IconButton
          icon="suggest"
          label="Suggest handles"
          keys="G"
          pressed={suggested}
          disabled={off}
          onPress={suggest}
        />
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
          disabled={still}
          onPress={() => send({ type: "reset" })}
        />
        <IconButton
          icon="frame"
          label="Frame the shape"
          keys="F"
          onPress={() => store.set({ framed: store.get().framed + 1 })}
        />
      </div>
    </nav>
  );
}
