import { LIST, type Action } from "../actions/actions";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { Dialog } from "../widgets/controls";

type Entry = readonly [keys: string, label: string];
const POINTER: readonly Entry[] = [
  ["Click", "Add a handle"],
  ["Drag", "Orbit; the right button pans"],
  ["Axis", "Click an axis in the corner to look along it"],
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
/** How to set a wrong guess right, as the page docs/how_to/too_much.md explains. */
const WRONG: readonly Entry[] = [
  ["Wheel", "Over the part: a smaller or a larger part, as in the ladder of the panel"],
  ["Picture", "Click a picture that appears after a drag: this result instead"],
  ["Panel", "Who follows: all alike, only mirrored parts, or only this one"],
  ["X", "Fix a point: it stays, and so does what looks like it"],
  ["B", "Paint a region, to hold it or to limit the handle to it"],
  ["Shift Click", "Hold one more part"],
];
const GROUPS: readonly Action["group"][] = ["Handle", "Tools", "View", "Edit", "Timeline"];

export function Help() {
  const { help } = useParts();
  if (!help) return null;
  return (
    <Dialog title="Keys and pointer" label="Keys" wide onClose={() => store.set({ help: false })}>
      <div class="key-groups">
        <KeyGroup title="It moved too much, or too little" entries={WRONG} />
        <KeyGroup title="Pointer" entries={POINTER} />
        <KeyGroup title="Touch" entries={TOUCH} />
        {GROUPS.map((group) => {
          const own = LIST.filter((action) => action.group === group);
          return <KeyGroup key={group} title={group} entries={own.map(({ keys, label }) => [keys, label])} />;
        })}
      </div>
    </Dialog>
  );
}

function KeyGroup({ title, entries }: { readonly title: string; readonly entries: readonly Entry[] }) {
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
