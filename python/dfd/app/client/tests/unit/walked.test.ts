import { expect, test } from "vitest";
import { walked } from "../../src/actions/files";

function file(path: string): FileSystemEntry {
  const name = path.split("/").at(-1) ?? "";
  const content = new File(["x"], name);
  const made = { isFile: true, name, fullPath: `/${path}`, file: (take: (found: File) => void) => take(content) };
  return made as unknown as FileSystemEntry;
}

/** A folder that a browser reads 100 entries at a time. */
function folder(path: string, entries: FileSystemEntry[]): FileSystemEntry {
  const createReader = () => {
    const left = [...entries];
    return { readEntries: (take: (found: FileSystemEntry[]) => void) => take(left.splice(0, 100)) };
  };
  const name = path.split("/").at(-1) ?? "";
  return { isFile: false, name, fullPath: `/${path}`, createReader } as unknown as FileSystemEntry;
}

test("a dropped folder is walked, and its files keep their paths", async () => {
  const inner = folder("f/textures", [file("f/textures/a.png"), file("f/textures/._a.png")]);
  const found = await walked([
    folder("f", [file("f/m.obj"), inner, folder("f/.git", [file("f/.git/x")])]),
    file("b.png"),
  ]);
  expect(found.map(({ path }) => path).sort()).toEqual(["b.png", "f/m.obj", "f/textures/a.png"]);
  expect(found.map(({ file }) => file.name).sort()).toEqual(["a.png", "b.png", "m.obj"]);
});

test("a folder of more than a hundred files is read to its end, and a huge one only so far that it is refused", async () => {
  const many = (count: number) =>
    folder(
      "f",
      Array.from({ length: count }, (_, index) => file(`f/${index}.png`)),
    );
  expect(await walked([many(250)])).toHaveLength(250);
  expect(await walked([many(900)])).toHaveLength(501);
});
