import { describe, expect, it } from "vitest";

import { decode } from "../../src/protocol/binary_messages";

/** Return a message with an array, as the server's `dfd.app.protocol` writes it. */
function framed(message: object, body: Uint8Array): ArrayBuffer {
  let text = JSON.stringify({
    __metadata__: { message: JSON.stringify(message) },
    positions: { dtype: "F32", shape: [1, 3], data_offsets: [0, 12] },
  });
  while (new TextEncoder().encode(text).length % 8) text += " ";
  const bytes = new TextEncoder().encode(text);
  const data = new Uint8Array(8 + bytes.length + body.length);
  new DataView(data.buffer).setBigUint64(0, BigInt(bytes.length), true);
  data.set(bytes, 8);
  data.set(body, 8 + bytes.length);
  return data.buffer;
}

const floats = new Uint8Array(Float32Array.of(1.5, -2, 3e8).buffer);
const positions = { type: "positions", id: 7 };

describe("decode", () => {
  it("reads a text message", () => {
    const { message, payload } = decode('{"type":"start","id":0}');
    expect(message.type).toBe("start");
    expect(payload.has("positions")).toBe(false);
  });

  it("reads arrays", () => {
    const { message, payload } = decode(framed({ ...positions, name: "Körper" }, floats));
    expect(message.id).toBe(7);
    expect([...payload.get("positions", "F32")]).toEqual([1.5, -2, Math.fround(3e8)]);
    expect(payload.has("normals")).toBe(false);
  });

  it("explains what is wrong with arrays that are cut short, missing or of another type", () => {
    const whole = framed(positions, floats);
    expect(() => decode(new ArrayBuffer(3))).toThrow("cut short");
    expect(() => decode(whole.slice(0, 20))).toThrow("cut short");
    const { payload } = decode(whole.slice(0, whole.byteLength - 8));
    expect(() => payload.get("positions", "F32")).toThrow("'positions' was cut short");
    expect(() => decode(whole).payload.get("normals", "I16")).toThrow("no array 'normals'");
    expect(() => decode(whole).payload.get("positions", "U32")).toThrow("is F32, not U32");
  });
});
