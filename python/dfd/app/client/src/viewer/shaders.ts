import { GLSL3, ShaderMaterial, type IUniform, type ShaderMaterialParameters } from "three";

import pickFragment from "../shaders/pick.frag.glsl?raw";
import pickVertex from "../shaders/pick.vert.glsl?raw";
import pose from "../shaders/pose.glsl?raw";
import readbackFragment from "../shaders/readback.frag.glsl?raw";
import readbackVertex from "../shaders/readback.vert.glsl?raw";
import surfaceFragment from "../shaders/surface.frag.glsl?raw";
import surfaceVertex from "../shaders/surface.vert.glsl?raw";

const PROGRAMS = {
  surface: [surfaceVertex, surfaceFragment],
  pick: [pickVertex, pickFragment],
  readback: [readbackVertex, readbackFragment],
} as const;

/** A material that poses the shape; `uniforms` are shared, not copied, so that all of them follow one scene. */
export function poseMaterial(
  program: keyof typeof PROGRAMS,
  uniforms: Record<string, IUniform>,
  settings: ShaderMaterialParameters = {},
): ShaderMaterial {
  const [vertex, fragment] = PROGRAMS[program];
  const material = new ShaderMaterial({
    ...settings,
    glslVersion: GLSL3,
    vertexShader: `precision highp int;\n${pose}\n${vertex}`,
    fragmentShader: fragment,
  });
  material.uniforms = uniforms;
  return material;
}
