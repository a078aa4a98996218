import { describe, expect, it } from "vitest";

import { decode } from "../../src/protocol/binary_messages";

/** A binary message as `dfd.app.protocol.binary_messages` writes it. */
function framed(header: object, body: Uint8Array): ArrayBuffer {
  let text = JSON.stringify(header);
  while ((4 + new TextEncoder().encode(text).length) % 8) text += " ";
  const bytes = new TextEncoder().encode(text);
  const data = new Uint8Array(4 + bytes.length + body.length);
  new DataView(data.buffer).setUint32(0, bytes.length, true);
  data.set(bytes, 4);
  data.set(body, 4 + bytes.length);
  return data.buffer;
}

const floats = new Uint8Array(Float32Array.of(1.5, -2, 3e8, 0).buffer);
const header = {
  type: "positions",
  id: 7,
  buffers: [{ name: "positions", dtype: "float32", shape: [1, 3], offset: 0 }],
};

describe("decode", () => {
  it("reads a text", () => {
    const { message, payload } = decode('{"type":"start","id":0}');
    expect(message.type).toBe("start");
    expect(payload.has("positions")).toBe(false);
  });

  it("reads arrays in place", () => {
    const { message, payload } = decode(framed({ ...header, name: "Körper" }, floats));
    expect(message.id).toBe(7);
    expect([...payload.get("positions", "float32")]).toEqual([1.5, -2, Math.fround(3e8)]);
    expect(payload.has("normals")).toBe(false);
  });

  it("refuses what is cut short, missing or of another type, in a sentence", () => {
    const whole = framed(header, floats);
    expect(() => decode(new ArrayBuffer(3))).toThrow("cut short");
    expect(() => decode(whole.slice(0, 20))).toThrow("cut short");
    const { payload } = decode(whole.slice(0, whole.byteLength - 8));
    expect(() => payload.get("positions", "float32")).toThrow("'positions' was cut short");
    expect(() => decode(whole).payload.get("normals", "int16")).toThrow("no array 'normals'");
    expect(() => decode(whole).payload.get("positions", "uint32")).toThrow("is float32, not uint32");
  });
});
