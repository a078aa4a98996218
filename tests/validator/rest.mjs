/**
 * Prints the positions at which three.js shows the vertices of each GLB file on the command line, before any animation.
 * The output is JSON: for each file, a list with the coordinates of all meshes.
 */

import { readFileSync } from "node:fs";
import { Vector3 } from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

/** Returns a GLB file without materials, because three.js can load images only in a browser. */
function withoutMaterials(file) {
  const length = file.readUInt32LE(12);
  const header = JSON.parse(file.subarray(20, 20 + length).toString());
  for (const name of ["materials", "textures", "images", "samplers", "extensionsRequired"]) delete header[name];
  for (const mesh of header.meshes) for (const primitive of mesh.primitives) delete primitive.material;
  let text = Buffer.from(JSON.stringify(header));
  text = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, " ")]);
  const head = Buffer.from(file.subarray(0, 20));
  head.writeUInt32LE(file.length - length + text.length, 8);
  head.writeUInt32LE(text.length, 12);
  const whole = Buffer.concat([head, text, file.subarray(20 + length)]);
  return whole.buffer.slice(whole.byteOffset, whole.byteOffset + whole.length);
}

globalThis.self = globalThis;
const found = {};
for (const path of process.argv.slice(2)) {
  const { scene } = await new GLTFLoader().parseAsync(withoutMaterials(readFileSync(path)), "");
  scene.updateMatrixWorld(true);
  const places = [];
  scene.traverse((mesh) => {
    if (!mesh.isMesh) return;
    for (let vertex = 0; vertex < mesh.geometry.attributes.position.count; vertex++) {
      const place = mesh.getVertexPosition(vertex, new Vector3()).applyMatrix4(mesh.matrixWorld);
      places.push(place.x, place.y, place.z);
    }
  });
  found[path] = places;
}
console.log(JSON.stringify(found));
