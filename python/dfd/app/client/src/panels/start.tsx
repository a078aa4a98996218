import { send } from "../actions/connection";
import { chooseFiles, megabytes } from "../actions/files";
import { useParts } from "../store/use";
import { count } from "../widgets/controls";
import { Icon } from "../widgets/icons";

const BESIDE = [".zip", ".json", ".safetensors"];

function meshFormats(endings: readonly string[]): string {
  const shapes = endings.filter((ending) => !BESIDE.includes(ending));
  return shapes.map((ending) => ending.replace(".", "").toUpperCase()).join(", ");
}

/** What to begin with, while there is no shape. */
export function Start() {
  const { session, uploading, alone } = useParts();
  return (
    <main class="start">
      <div class="start-card">
        <h1>Take hold of a shape</h1>
        <p class="lead">Point at a mesh, drag, and everything that looks alike follows.</p>
        {alone === null && (
          <button type="button" class="drop" onClick={chooseFiles} disabled={!session || uploading !== null}>
            <Icon name="open" />
            <strong>{uploading ? `Sending ${uploading}…` : "Drop a mesh here, or choose a file"}</strong>
            <small>
              {session
                ? `${meshFormats(session.formats)}, with its textures or as one ZIP, up to ${megabytes(session.upload_bytes)}. A saved session goes with its mesh.`
                : "Waiting for the server…"}
            </small>
          </button>
        )}
        {session && session.samples.length > 0 && (
          <section aria-label="Samples">
            <h2>{alone === null ? "Or begin with a sample" : "Begin with one of these"}</h2>
            <ul class="samples">
              {session.samples.map((sample) => (
                <li key={sample.name}>
                  <button type="button" onClick={() => send({ type: "open_sample", name: sample.name })}>
                    <strong>{sample.title}</strong>
                    <small>{count.format(sample.faces)} faces</small>
                  </button>
                </li>
              ))}
            </ul>
          </section>
        )}
        {alone !== null && <p class="lead">Your own meshes take the app: {alone}</p>}
      </div>
    </main>
  );
}
