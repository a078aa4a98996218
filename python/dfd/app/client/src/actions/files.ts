/** Uploads and exports. */

import type { Export, HandleState } from "../protocol/messages";
import { store } from "../store/state";
import { ask } from "./connection";
import { seenTransforms } from "./edit";
import { note, problem } from "./toasts";

/** A file, and its path in the folder that the user dropped; without a folder, its name. */
export interface Sent {
  file: File;
  path: string;
}

const MOST_SENT = 500; // the server accepts no more files

export async function upload(files: readonly Sent[]): Promise<void> {
  const { session } = store.get();
  if (files.length === 0) return;
  if (!session) {
    problem("The server is not connected yet. Try again in a moment.");
    return;
  }
  const known = files.some(({ path: name }) => session.formats.some((ending) => name.toLowerCase().endsWith(ending)));
  if (!known) {
    problem(`${files[0].path} cannot be opened. Open OBJ, PLY, STL, OFF, glTF or GLB; convert FBX with Blender.`);
    return;
  }
  const bytes = files.reduce((sum, { file }) => sum + file.size, 0);
  if (bytes > session.upload_bytes) {
    problem(`The files have ${megabytes(bytes)}, but the server accepts at most ${megabytes(session.upload_bytes)}.`);
    return;
  }
  const form = new FormData();
  for (const { file, path } of files) form.append("files", file, path);
  store.set({ uploading: files[0].file.name });
  try {
    const address = new URL("upload", location.href);
    address.search = new URLSearchParams({ session: session.session }).toString();
    const response = await fetch(address, { method: "POST", body: form });
    const answer = (await response.json().catch(() => ({}))) as { message?: string };
    if (!response.ok) problem(answer.message ?? `The server refused the file (${response.status}).`);
  } catch {
    problem("The upload failed because the connection was lost.");
  } finally {
    store.set({ uploading: null });
  }
}

/** Accept files that are dropped anywhere on the page, and highlight the page meanwhile. */
export function takeDrops(): void {
  addEventListener("dragover", (event) => {
    event.preventDefault();
    if (event.dataTransfer?.types.includes("Files")) store.set({ dropping: true });
  });
  addEventListener("dragleave", (event) => event.relatedTarget === null && store.set({ dropping: false }));
  addEventListener("drop", (event) => {
    event.preventDefault();
    store.set({ dropping: false });
    const { items, files } = event.dataTransfer ?? { items: [], files: [] };
    // The entries must be taken before the handler returns: then the browser empties the list.
    const entries = [...items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
    void (entries.length > 0 ? walked(entries) : Promise.resolve(named(files))).then(upload);
  });
}

function named(files: Iterable<File>): Sent[] {
  return [...files].map((file) => ({ file, path: file.name }));
}

/** Returns the files of dropped folders and files, with their paths. Hidden files are left out. */
export async function walked(entries: readonly FileSystemEntry[]): Promise<Sent[]> {
  const found: Sent[] = [];
  const left = [...entries];
  for (let entry = left.shift(); entry && found.length <= MOST_SENT; entry = left.shift()) {
    if (entry.name.startsWith(".")) continue;
    if (entry.isFile) {
      const file = await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject));
      found.push({ file, path: entry.fullPath.replace(/^\//, "") });
    } else {
      const reader = (entry as FileSystemDirectoryEntry).createReader();
      const read = () => new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
      for (let some = await read(); some.length > 0; some = await read()) left.push(...some); // 100 at a time
    }
  }
  return found;
}

/** Let the user choose files to upload. */
export function chooseFiles(): void {
  const input = document.createElement("input");
  input.type = "file";
  input.multiple = true;
  const { session } = store.get();
  input.accept = session ? [...session.formats, ...session.beside].join(",") : "";
  input.onchange = () => void upload(named(input.files ?? []));
  input.click();
}

export async function exportAs(format: Export["format"]): Promise<void> {
  const received = await ask({ type: "export", format, transforms: seenTransforms() });
  if (received?.message.type !== "download") return;
  const { url, name, said } = received.message;
  save(new URL(url, location.href).href, name);
  note(said ? `${name} is saved: ${said}` : `${name} is saved in your downloads.`);
}

function save(address: string, name: string): void {
  const anchor = document.createElement("a");
  anchor.href = address;
  anchor.download = name;
  anchor.click();
}

/** Copy the coordinates of a handle, by which Python and the command line name its place. */
export async function copyPlace({ position }: HandleState): Promise<void> {
  const place = position.map((part) => Number(part.toPrecision(4))).join();
  await navigator.clipboard.writeText(place).then(
    () => note(`${place} is copied, for --handle on the command line or session.add in Python.`),
    () => problem(`The browser does not let the page copy. The place is ${place}.`),
  );
}

/** Save a picture under the name of the shape. */
export function savePicture(picture: Blob): void {
  const address = URL.createObjectURL(picture);
  save(address, `${(store.get().mesh?.name ?? "shape").replace(/\.[^.]+$/, "")}.png`);
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export function megabytes(bytes: number): string {
  const format = { style: "unit", unit: "megabyte", maximumSignificantDigits: 3 } as const;
  return new Intl.NumberFormat("en", format).format(bytes / 1e6);
}
