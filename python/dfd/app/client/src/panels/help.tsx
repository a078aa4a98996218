import { useEffect, useRef } from "preact/hooks";

import { COMPARE, shortcuts, type Shortcut } from "../actions/keyboard";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { IconButton } from "../widgets/controls";

const POINTER = [
  { keys: "Click", label: "Take hold of a point" },
  { keys: "Drag", label: "Orbit; right button pans" },
  { keys: "Wheel", label: "Zoom; while dragging a handle: reach" },
  { keys: "Alt Wheel", label: "Reach of the selected handle" },
];
const GROUPS: readonly Shortcut["group"][] = ["Handle", "Tools", "View", "Edit", "Timeline"];

export function Help() {
  const open = useStore(store, (state) => state.help);
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    if (open) box.current?.focus();
  }, [open]);
  if (!open) return null;
  const close = () => store.set({ help: false });
  const table = [...shortcuts(close).filter((shortcut) => shortcut.keys), COMPARE];
  return (
    <div class="veil" onClick={(event) => event.target === event.currentTarget && close()}>
      <div class="dialog keys" role="dialog" aria-modal="true" aria-label="Keys" tabIndex={-1} ref={box}>
        <header>
          <h2>Keys and pointer</h2>
          <IconButton icon="remove" label="Close" keys="Esc" onPress={close} />
        </header>
        <div class="key-groups">
          <KeyGroup title="Pointer" entries={POINTER} />
          {GROUPS.map((group) => (
            <KeyGroup key={group} title={group} entries={table.filter((entry) => entry.group === group)} />
          ))}
        </div>
      </div>
    </div>
  );
}

interface KeyGroupProps {
  readonly title: string;
  readonly entries: readonly { readonly keys: string; readonly label: string }[];
}

function KeyGroup({ title, entries }: KeyGroupProps) {
  return (
    <section aria-label={title}>
      <h3>{title}</h3>
      <dl>
        {entries.map(({ keys, label }) => (
          <div key={label}>
            <dt>{keys.split(" ").map((key) => (key === "…" ? " … " : <kbd key={key}>{key}</kbd>))}</dt>
            <dd>{label}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
