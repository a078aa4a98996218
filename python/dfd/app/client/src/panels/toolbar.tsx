import { resetAll, suggest } from "../actions/edit";
import { alive, store, type GizmoMode, type Tool } from "../store/state";
import { useStore } from "../store/use";
import { IconButton } from "../widgets/controls";
import type { IconName } from "../widgets/icons";

const TOOLS: readonly (readonly [Tool, IconName, string, string])[] = [
  ["hold", "hold", "Hold points", "H"],
  ["fix", "fix", "Fix points", "X"],
  ["paint", "paint", "Brush a region", "B"],
  ["pivot", "pivot", "Move the pivot", "P"],
];
const MODES: readonly (readonly [GizmoMode, IconName, string, string])[] = [
  ["translate", "translate", "Move", "W"],
  ["rotate", "rotate", "Rotate", "E"],
  ["scale", "scale", "Scale", "R"],
];

export function Toolbar({ frame }: { readonly frame: () => void }) {
  const tool = useStore(store, (state) => state.tool);
  const gizmo = useStore(store, (state) => state.gizmo);
  const space = useStore(store, (state) => state.space);
  const snap = useStore(store, (state) => state.snap);
  const comparing = useStore(store, (state) => state.comparing);
  const suggested = useStore(store, (state) => state.suggestions.length > 0);
  const ready = useStore(store, alive);
  const still = useStore(store, (state) => !state.edit?.handles.some((handle) => handle.moved));
  const compare = (on: boolean) => () => store.set({ comparing: on });
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {TOOLS.map(([name, icon, label, keys]) => (
          <IconButton
            key={name}
            icon={icon}
            label={label}
            keys={keys}
            pressed={tool === name}
            disabled={!ready}
            onPress={() => store.set({ tool: name })}
          />
        ))}
      </div>
      <div role="group" aria-label="Gizmo">
        {MODES.map(([name, icon, label, keys]) => (
          <IconButton
            key={name}
            icon={icon}
            label={label}
            keys={keys}
            pressed={gizmo === name}
            disabled={!ready}
            onPress={() => store.set({ gizmo: name, tool: tool === "hold" ? tool : "hold" })}
          />
        ))}
        <IconButton
          icon={space}
          label={space === "world" ? "World axes" : "Local axes"}
          keys="L"
          disabled={!ready}
          onPress={() => store.set({ space: space === "world" ? "local" : "world" })}
        />
        <IconButton
          icon="snap"
          label="Snap"
          keys="S"
          pressed={snap}
          disabled={!ready}
          onPress={() => store.set({ snap: !snap })}
        />
      </div>
      <div role="group" aria-label="Shape">
        <IconButton
          icon="suggest"
          label="Suggest handles"
          keys="G"
          pressed={suggested}
          disabled={!ready}
          onPress={suggest}
        />
        <button
          type="button"
          class="icon-button"
          aria-label="Hold to see the original"
          title="Hold to see the original (C)"
          aria-pressed={comparing}
          disabled={!ready}
          onPointerDown={compare(true)}
          onPointerUp={compare(false)}
          onPointerLeave={compare(false)}
          onPointerCancel={compare(false)}
        >
          <CompareIcon />
        </button>
        <IconButton icon="reset" label="Return everything to rest" disabled={still} onPress={resetAll} />
        <IconButton icon="frame" label="Frame the shape" keys="F" onPress={frame} />
      </div>
    </nav>
  );
}

function CompareIcon() {
  return (
    <svg class="icon" viewBox="0 0 20 20" aria-hidden="true">
      <path d="M10 2.5v15M8 5H3.5v10H8" />
      <path d="M12 5h4.5v10H12" stroke-dasharray="2 2" />
    </svg>
  );
}
