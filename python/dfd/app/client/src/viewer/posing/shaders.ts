import * as THREE from "three";

import pose from "../../shaders/pose.glsl?raw";
import posePass from "../../shaders/pose.frag.glsl?raw";
import pickFragment from "../../shaders/pick.frag.glsl?raw";
import pickVertex from "../../shaders/pick.vert.glsl?raw";
import surfaceFragment from "../../shaders/surface.frag.glsl?raw";
import surfaceVertex from "../../shaders/surface.vert.glsl?raw";

const PROGRAMS = {
  pose: ["void main() { gl_Position = vec4(position, 1.0); }", `precision highp int;\n${pose}\n${posePass}`],
  pick: [pickVertex, pickFragment],
  surface: [surfaceVertex, surfaceFragment],
} as const;

/** Create a material that draws the posed shape. `uniforms` is not copied, so materials can share uniforms. */
export function material(
  program: keyof typeof PROGRAMS,
  uniforms: Record<string, THREE.IUniform>,
  settings: THREE.ShaderMaterialParameters = {},
): THREE.ShaderMaterial {
  const [vertex, fragment] = PROGRAMS[program];
  const made = new THREE.ShaderMaterial({
    ...settings,
    glslVersion: THREE.GLSL3,
    vertexShader: `precision highp int;\n${vertex}`,
    fragmentShader: fragment,
  });
  made.uniforms = uniforms;
  return made;
}

/** Compile a material with the defines that are true in `wanted`, unless it already has them. */
export function define(made: THREE.ShaderMaterial, wanted: Readonly<Record<string, boolean>>): void {
  const names = Object.keys(wanted).filter((name) => wanted[name]);
  if (Object.keys(made.defines).join() === names.join()) return;
  made.defines = Object.fromEntries(names.map((name) => [name, ""]));
  made.needsUpdate = true;
}

/** Create a render target of bits of numbers, in a format that every implementation of WebGL 2 supports. */
export function pixels(width: number, height: number, count = 1): THREE.WebGLRenderTarget {
  return new THREE.WebGLRenderTarget(width, height, {
    count,
    format: THREE.RGBAIntegerFormat,
    type: THREE.UnsignedIntType,
    internalFormat: "RGBA32UI",
    minFilter: THREE.NearestFilter,
    magFilter: THREE.NearestFilter,
    generateMipmaps: false,
  });
}
