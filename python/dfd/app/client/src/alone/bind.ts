/** `dfd.bind` in the page: the core itself, as WebAssembly (cpp/wasm). */

import { FALLOFFS, type Falloff } from "../posing/columns";

/** What the module exports: places are bytes from the start of its memory. */
export interface Core {
  readonly memory: WebAssembly.Memory;
  _initialize(): void;
  dfd_take(bytes: number): number;
  dfd_give(place: number): void;
  dfd_bind(
    features: number,
    vertices: number,
    dimensions: number,
    step: number,
    handles: number,
    handleCount: number,
    fixed: number,
    strengths: number,
    fixedCount: number,
    reach: number,
    falloff: number,
    weights: number,
  ): void;
}

export interface Fixed {
  readonly vertex: number;
  readonly strength: number;
}

/** Vertices that lie side by side, and bytes beside the entries of each: its squared length. */
const BLOCK = 16;
const LENGTH = 4;

/** The module, from the bytes of `dfd.wasm`. */
export async function loadCore(bytes: BufferSource): Promise<Core> {
  let memory = new WebAssembly.Memory({ initial: 0 });
  const none = () => 8; // WASI's EBADF: there are no files
  const imports = {
    page: {
      refuse(text: number) {
        const all = new Uint8Array(memory.buffer, text);
        throw new Error(new TextDecoder().decode(all.subarray(0, all.indexOf(0))));
      },
    },
    wasi_snapshot_preview1: { fd_close: none, fd_seek: none, fd_write: none },
  };
  const { instance } = await WebAssembly.instantiate(bytes, imports);
  const core = instance.exports as unknown as Core;
  memory = core.memory;
  core._initialize();
  return core;
}

/** The compact features of one shape, in the module's memory. */
export class Features {
  private readonly step: number;
  private readonly dimensions: number;
  private readonly place: number;

  /** `file` is what a byte's step is worth, as float32, and the blocks of the features. */
  constructor(
    private readonly core: Core,
    private readonly vertices: number,
    file: ArrayBuffer,
  ) {
    this.step = new DataView(file).getFloat32(0, true);
    const blocks = new Uint8Array(file, 4);
    this.dimensions = blocks.length / (BLOCK * Math.ceil(vertices / BLOCK)) - LENGTH;
    this.place = this.put(blocks);
  }

  /** (H · V) weights of handles at vertices, those of one handle after those of the other: Eq. 4 to 6. */
  bind(handles: readonly number[], reach = 1, falloff: Falloff = "linear", fixed: readonly Fixed[] = []): Float32Array {
    const { core, vertices } = this;
    const size = handles.length * vertices;
    const weights = core.dfd_take(4 * size);
    const places = [
      this.put(Int32Array.from(handles)),
      this.put(Int32Array.from(fixed, ({ vertex }) => vertex)),
      this.put(Float32Array.from(fixed, ({ strength }) => strength)),
    ] as const;
    try {
      const [held, still, strengths] = places;
      const shape = [this.place, vertices, this.dimensions, this.step] as const;
      const control = [reach, FALLOFFS[falloff], weights] as const;
      core.dfd_bind(...shape, held, handles.length, still, strengths, fixed.length, ...control);
      return new Float32Array(core.memory.buffer, weights, size).slice();
    } finally {
      for (const place of [...places, weights]) core.dfd_give(place);
    }
  }

  dispose(): void {
    this.core.dfd_give(this.place);
  }

  /** An array's copy in the module's memory. */
  private put({ buffer, byteOffset, byteLength }: Uint8Array | Int32Array | Float32Array): number {
    const place = this.core.dfd_take(byteLength);
    new Uint8Array(this.core.memory.buffer, place, byteLength).set(new Uint8Array(buffer, byteOffset, byteLength));
    return place;
  }
}
