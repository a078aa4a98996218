import { useState } from "preact/hooks";

import { clear, remove, rename, select, toggleHidden } from "../../actions/edit";
import type { HandleState } from "../../protocol/messages";
import { alive, store } from "../../store/state";
import { useStore } from "../../store/use";
import { handleName } from "../../viewer/overlays/marks";
import { IconButton, Menu, Panel } from "../../widgets/controls";

const NONE: readonly HandleState[] = [];

export function HandleList() {
  const handles = useStore(store, (state) => state.edit?.handles) ?? NONE;
  const ready = useStore(store, alive);
  const edited = useStore(store, (state) => (state.edit?.handles.length ?? 0) + (state.edit?.fixed.length ?? 0) > 0);
  return (
    <Panel
      title="Handles"
      action={
        edited && (
          <Menu
            icon="more"
            label="All handles"
            groups={[[{ text: "Remove all handles and fixed points", run: clear }]]}
          />
        )
      }
    >
      {handles.length === 0 ? (
        <p class="empty">
          {ready
            ? "Click a point of the shape to take hold of it. All that looks alike will follow."
            : "The shape can be held once its features are learned."}
        </p>
      ) : (
        <ul class="rows">
          {handles.map((handle) => (
            <HandleRow key={handle.handle} handle={handle} />
          ))}
        </ul>
      )}
    </Panel>
  );
}

function HandleRow({ handle }: { readonly handle: HandleState }) {
  const selected = useStore(store, (state) => state.selected === handle.handle);
  const hidden = useStore(store, (state) => state.hidden.has(handle.handle));
  const [naming, setNaming] = useState(false);
  const name = handleName(handle);
  return (
    <li class={selected ? "row selected" : "row"}>
      {naming ? (
        <input
          class="rename"
          aria-label={`New name of ${name}`}
          defaultValue={name}
          ref={(input) => input?.focus()}
          onBlur={(event) => {
            setNaming(false);
            if (event.currentTarget.value !== name) rename(handle.handle, event.currentTarget.value);
          }}
          onKeyDown={(event) => {
            if (event.key === "Enter") event.currentTarget.blur();
            if (event.key === "Escape") {
              event.currentTarget.value = name;
              event.currentTarget.blur();
            }
            event.stopPropagation();
          }}
        />
      ) : (
        <button
          type="button"
          class="row-name"
          aria-pressed={selected}
          title={`${name}: double-click or F2 to rename`}
          onClick={() => select(selected ? null : handle.handle)}
          onDblClick={() => setNaming(true)}
          onKeyDown={(event) => {
            if (event.key === "F2") setNaming(true);
          }}
        >
          <span class={handle.moved ? "dot moved" : "dot"} aria-hidden="true" />
          <span>{name}</span>
          <small>
            {handle.region > 0 ? `${handle.region} vertices` : handle.vertex !== null && `vertex ${handle.vertex}`}
          </small>
        </button>
      )}
      <IconButton
        icon={hidden ? "hidden" : "eye"}
        label={hidden ? `Show ${name}` : `Hide ${name}`}
        onPress={() => toggleHidden(handle.handle)}
      />
      <IconButton icon="remove" label={`Remove ${name}`} onPress={() => remove(handle.handle)} />
    </li>
  );
}
