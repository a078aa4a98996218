/** Binary messages: a header of JSON, then arrays; see `dfd.app.protocol`. */

import type { Buffer, Client, Server } from "./messages";

export type ServerMessage = Server["message"];
type WithoutNumber<Message> = Message extends unknown ? Omit<Message, "id"> : never;
/** A request before it has its number. */
export type Request = WithoutNumber<Client["message"]>;

const ARRAYS = {
  uint8: Uint8Array,
  int8: Int8Array,
  uint16: Uint16Array,
  int16: Int16Array,
  uint32: Uint32Array,
  int32: Int32Array,
  float32: Float32Array,
} as const;

type Arrays = typeof ARRAYS;

export class Payload {
  private readonly entries: Map<string, Buffer>;

  constructor(
    private readonly data: ArrayBuffer,
    private readonly start: number,
    buffers: readonly Buffer[],
  ) {
    this.entries = new Map(buffers.map((buffer) => [buffer.name, buffer]));
  }

  has(name: string): boolean {
    return this.entries.has(name);
  }

  /** A view of an array, not a copy; fails where it is of another type or lies outside the message. */
  get<Type extends keyof Arrays>(name: string, dtype: Type): InstanceType<Arrays[Type]> {
    const entry = this.entries.get(name);
    if (!entry) throw new Error(`The server's message has no array '${name}'.`);
    if (entry.dtype !== dtype) throw new Error(`The server's array '${name}' is ${entry.dtype}, not ${dtype}.`);
    const length = entry.shape.reduce((product, size) => product * size, 1);
    const Kind = ARRAYS[dtype];
    if (this.start + entry.offset + length * Kind.BYTES_PER_ELEMENT > this.data.byteLength) {
      throw new Error(`The server's array '${name}' was cut short.`);
    }
    return new Kind(this.data, this.start + entry.offset, length) as InstanceType<Arrays[Type]>;
  }
}

/** A message and its arrays; one that is text has none. */
export interface Received {
  readonly message: ServerMessage;
  readonly payload: Payload;
}

export function decode(data: string | ArrayBuffer): Received {
  if (typeof data === "string") {
    return { message: JSON.parse(data) as ServerMessage, payload: new Payload(new ArrayBuffer(0), 0, []) };
  }
  const length = data.byteLength < 4 ? Infinity : new DataView(data).getUint32(0, true);
  if (4 + length > data.byteLength) throw new Error("The server's message was cut short.");
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))) as ServerMessage;
  const buffers = "buffers" in message ? message.buffers : [];
  return { message, payload: new Payload(data, 4 + length, buffers) };
}
