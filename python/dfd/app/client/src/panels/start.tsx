import { useState } from "preact/hooks";

import { send } from "../actions/connection";
import { chooseFiles, megabytes } from "../actions/files";
import { note } from "../actions/toasts";
import type { RecentShape } from "../protocol/messages";
import { useParts } from "../store/use";
import { handleCount, IconButton, Rename, titled } from "../widgets/controls";
import { Icon } from "../widgets/icons";

/** Endings of files that are not meshes, which the list of mesh formats leaves out. */
const BESIDE = [".zip", ".json", ".safetensors"];

/** The start page, shown without a shape. */
export function Start() {
  const { session, uploading, recent } = useParts();
  const endings = session?.formats.filter((ending) => !BESIDE.includes(ending)) ?? [];
  const formats = endings.map((ending) => ending.slice(1).toUpperCase()).join(", ");
  const hint = session
    ? `${formats}, up to ${megabytes(session.upload_bytes)}. Add textures or a saved session, or choose one ZIP file.`
    : "Waiting for the server…";
  return (
    <main class="start">
      <div class="start-card">
        <h1>Deform a shape</h1>
        <p class="lead">Drag a point of a mesh, and all similar parts follow.</p>

        <button class="drop" onClick={chooseFiles} disabled={!session || uploading !== null}>
          <Icon name="open" />
          <strong>{uploading ? `Sending ${uploading}…` : "Drop a mesh here, or choose a file"}</strong>
          <small>{hint}</small>
        </button>
        {recent.length > 0 && (
          <section aria-label="Recent">
            <h2>Continue an edit</h2>
            <ul class="samples">
              {recent.map((each) => (
                <Recent key={each.key} shape={each} />
              ))}
            </ul>
          </section>
        )}
        {session && session.samples.length > 0 && (
          <section aria-label="Samples">
            <h2>Or begin with a sample</h2>
            <ul class="samples">
              {session.samples.map((sample) => (
                <li key={sample}>
                  <button class="opens" onClick={() => send({ type: "open_sample", name: sample })}>
                    <strong>{titled(sample)}</strong>
                  </button>
                </li>
              ))}
            </ul>
          </section>
        )}
      </div>
    </main>
  );
}

function Recent({ shape: { key, name, handles, seconds, present, picture } }: { readonly shape: RecentShape }) {
  const [naming, setNaming] = useState(false);
  const remove = () => {
    send({ type: "change_kept", key, how: "delete" });
    note(`${titled(name)} is deleted.`, {
      text: "Undo",
      run: () => send({ type: "change_kept", key, how: "restore" }),
    });
  };
  return (
    <li class="recent">
      {naming ? (
        <Rename
          name={titled(name)}
          onDone={(typed) => {
            setNaming(false);
            if (typed) send({ type: "change_kept", key, how: "rename", name: typed });
          }}
        />
      ) : (
        <button class="opens" disabled={!present} onClick={() => send({ type: "open_recent", key })}>
          {picture && <img src={picture} alt="" width={240} height={180} />}
          <strong>{titled(name)}</strong>
          <small>
            {handleCount(handles)} · {new Date(1000 * seconds).toLocaleString()}
            {!present && " · open the mesh again to continue"}
          </small>
        </button>
      )}
      <div class="card-tools">
        <IconButton icon="rename" label={`Rename ${titled(name)}`} onClick={() => setNaming(true)} />
        <IconButton
          icon="copy"
          label={`Duplicate ${titled(name)}`}
          onClick={() => send({ type: "change_kept", key, how: "duplicate" })}
        />
        <IconButton icon="remove" label={`Delete ${titled(name)}`} onClick={remove} />
      </div>
    </li>
  );
}
