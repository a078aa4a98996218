/** Messages with arrays, in the format of safetensors; see `dfd.app.protocol`. */

import type { Client, Server } from "./messages";

export type ServerMessage = Server["message"];
type WithoutId<Message> = Message extends unknown ? Omit<Message, "id"> : never;
/** A request without its `id`. */
export type Request = WithoutId<Client["message"]>;

/** Array types by their names in safetensors. */
const ARRAYS = { U8: Uint8Array, I16: Int16Array, U16: Uint16Array, U32: Uint32Array, F32: Float32Array } as const;

type Arrays = typeof ARRAYS;

/** The type of an array, and the range of its bytes, counted from the end of the header. */
interface Entry {
  readonly dtype: string;
  readonly data_offsets: readonly [begin: number, end: number];
}

export class Payload {
  constructor(
    private readonly data: ArrayBuffer,
    private readonly start: number,
    private readonly entries: Readonly<Partial<Record<string, Entry>>>,
  ) {}

  has(name: string): boolean {
    return name in this.entries;
  }

  /** Return an array without a copy. Throws if the array is missing or incomplete, or has another type. */
  get<Type extends keyof Arrays>(name: string, dtype: Type): InstanceType<Arrays[Type]> {
    const entry = this.entries[name];
    if (!entry) throw new Error(`The server's message has no array '${name}'.`);
    if (entry.dtype !== dtype) throw new Error(`The server's array '${name}' is ${entry.dtype}, not ${dtype}.`);
    const [begin, end] = entry.data_offsets;
    if (this.start + end > this.data.byteLength) throw new Error(`The server's array '${name}' was cut short.`);
    const Kind = ARRAYS[dtype];
    return new Kind(this.data, this.start + begin, (end - begin) / Kind.BYTES_PER_ELEMENT) as InstanceType<
      Arrays[Type]
    >;
  }
}

/** A message and its arrays; a text message has no arrays. */
export interface Received {
  readonly message: ServerMessage;
  readonly payload: Payload;
}

export function decode(data: string | ArrayBuffer): Received {
  if (typeof data === "string") {
    return { message: JSON.parse(data) as ServerMessage, payload: new Payload(new ArrayBuffer(0), 0, {}) };
  }
  const length = data.byteLength < 8 ? Infinity : Number(new DataView(data).getBigUint64(0, true));
  if (8 + length > data.byteLength) throw new Error("The server's message was cut short.");
  const text = new TextDecoder().decode(new Uint8Array(data, 8, length));
  const { __metadata__: metadata, ...entries } = JSON.parse(text) as Header;
  return { message: JSON.parse(metadata.message) as ServerMessage, payload: new Payload(data, 8 + length, entries) };
}

type Header = Record<string, Entry> & { readonly __metadata__: { readonly message: string } };
