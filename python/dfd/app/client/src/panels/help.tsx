import { useEffect, useRef } from "preact/hooks";

import { LIST, toggle, type Action } from "../actions/actions";
import { useParts } from "../store/use";
import { IconButton } from "../widgets/controls";

type Entry = readonly [keys: string, label: string];
const POINTER: readonly Entry[] = [
  ["Click", "Add a handle"],
  ["Drag", "Orbit; the right button pans"],
  ["Wheel", "Zoom; on a part, or during a drag, a smaller or larger part"],
  ["Ctrl Wheel", "Zoom everywhere"],
  ["Shift Click", "Add the clicked part to the handle"],
  ["Ctrl Click", "Remove the clicked part from the handle"],
];
const TOUCH: readonly Entry[] = [
  ["Tap", "Add a handle, or select one"],
  ["Finger", "Orbit; on the gizmo, move the handle"],
  ["2 Fingers", "Zoom and pan"],
];
const GROUPS: readonly Action["group"][] = ["Handle", "Tools", "View", "Edit", "Timeline"];
function entriesOf(group: Action["group"]): readonly Entry[] {
  return LIST.filter((action) => action.group === group).map(({ keys, label }) => [keys, label]);
}

export function Help() {
  const { help } = useParts();
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    if (help) box.current?.focus();
  }, [help]);
  if (!help) return null;
  const close = () => toggle("help");
  return (
    <div class="veil" onClick={(event) => event.target === event.currentTarget && close()}>
      <div class="dialog keys" role="dialog" aria-modal="true" aria-label="Keys" tabIndex={-1} ref={box}>
        <header>
          <h2>Keys and pointer</h2>
          <IconButton icon="remove" label="Close" keys="Esc" onPress={close} />
        </header>
        <div class="key-groups">
          <KeyGroup title="Pointer" entries={POINTER} />
          <KeyGroup title="Touch" entries={TOUCH} />
          {GROUPS.map((group) => (
            <KeyGroup key={group} title={group} entries={entriesOf(group)} />
          ))}
        </div>
      </div>
    </div>
  );
}

interface KeyGroupProps {
  readonly title: string;
  readonly entries: readonly Entry[];
}

function KeyGroup({ title, entries }: KeyGroupProps) {
  return (
    <section aria-label={title}>
      <h3>{title}</h3>
      <dl>
        {entries.map(([keys, label]) => (
          <div key={label}>
            <dt>
              {keys.split(" ").map((key) => (
                <kbd key={key}>{key}</kbd>
              ))}
            </dt>
            <dd>{label}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
