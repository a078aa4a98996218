import { useState } from "preact/hooks";

import { send } from "../actions/connection";
import { select } from "../actions/edit";
import type { HandleState } from "../protocol/messages";
import { handleColor, handleName, ready } from "../store/state";
import { useParts } from "../store/use";
import { IconButton, Menu, Panel, Rename } from "../widgets/controls";
import { whenReady } from "./next_step";

const ALL = [
  ["Return all to rest", "", () => send({ type: "reset" })],
  ["Remove all handles and fixed points", "", () => send({ type: "clear" })],
] as const;

export function HandleList() {
  const { edit } = useParts();
  const handles = edit?.handles ?? [];
  const edited = handles.length + (edit?.fixed.length ?? 0) > 0;
  return (
    <Panel title="Handles" action={edited && <Menu icon="more" label="All handles" groups={[["", ALL]]} />}>
      {handles.length === 0 ? (
        <p class="empty">
          {ready({ edit })
            ? "Click a point of the shape to add a handle. All similar parts follow the handle."
            : `You can add handles ${whenReady({ edit })}.`}
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
  const id = handle.handle;
  const selected = useParts().selected === id;
  const [naming, setNaming] = useState(false);
  const name = handleName(handle);
  return (
    <li class={selected ? "row selected" : "row"}>
      {naming ? (
        <Rename
          name={name}
          onDone={(typed) => {
            setNaming(false);
            if (typed) send({ type: "change", handle: id, controls: { name: typed } });
          }}
        />
      ) : (
        <button
          class="row-name"
          aria-pressed={selected}
          title={`${name}: double-click or F2 to rename`}
          onClick={() => select(selected ? null : id)}
          onDblClick={() => setNaming(true)}
          onKeyDown={(event) => {
            if (event.key === "F2") setNaming(true);
          }}
        >
          <span class={handle.moved ? "dot moved" : "dot"} style={{ "--own": handleColor(id) }} aria-hidden="true" />
          <span>{name}</span>
          <small>
            {handle.region > 0 ? `${handle.region} vertices` : handle.vertex !== null && `vertex ${handle.vertex}`}
          </small>
        </button>
      )}
      <IconButton icon="remove" label={`Remove ${name}`} onClick={() => send({ type: "remove", handle: id })} />
    </li>
  );
}
