import { send } from "../actions/connection";
import { chooseFiles, megabytes } from "../actions/files";
import { useParts } from "../store/use";
import { titled } from "../widgets/controls";
import { Icon } from "../widgets/icons";

const BESIDE = [".zip", ".json", ".safetensors"];

function meshFormats(endings: readonly string[]): string {
  const shapes = endings.filter((ending) => !BESIDE.includes(ending));
  return shapes.map((ending) => ending.replace(".", "").toUpperCase()).join(", ");
}

/** The start page, shown without a shape. */
export function Start() {
  const { session, uploading } = useParts();
  return (
    <main class="start">
      <div class="start-card">
        <h1>Take hold of a shape</h1>
        <p class="lead">Point at a mesh, drag, and everything that looks alike follows.</p>

        <button type="button" class="drop" onClick={chooseFiles} disabled={!session || uploading !== null}>
          <Icon name="open" />
          <strong>{uploading ? `Sending ${uploading}…` : "Drop a mesh here, or choose a file"}</strong>
          <small>
            {session
              ? `${meshFormats(session.formats)}, with its textures or as one ZIP, up to ${megabytes(session.upload_bytes)}. A saved session goes with its mesh.`
              : "Waiting for the server…"}
          </small>
        </button>
        {session && session.samples.length > 0 && (
          <section aria-label="Samples">
            <h2>Or begin with a sample</h2>
            <ul class="samples">
              {session.samples.map((sample) => (
                <li key={sample}>
                  <button type="button" onClick={() => send({ type: "open_sample", name: sample })}>
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
