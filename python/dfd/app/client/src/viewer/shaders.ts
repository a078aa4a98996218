import { GLSL3, ShaderMaterial, type IUniform, type ShaderMaterialParameters } from "three";

import pickFragment from "../shaders/pick.frag.glsl?raw";
import pickVertex from "../shaders/pick.vert.glsl?raw";
import pose from "../shaders/pose.glsl?raw";
import passFragment from "../shaders/pose_pass.frag.glsl?raw";
import passVertex from "../shaders/pose_pass.vert.glsl?raw";
import posed from "../shaders/posed.glsl?raw";
import surfaceFragment from "../shaders/surface.frag.glsl?raw";
import surfaceVertex from "../shaders/surface.vert.glsl?raw";

const PROGRAMS = {
  surface: [`${posed}\n${surfaceVertex}`, surfaceFragment],
  pick: [`${posed}\n${pickVertex}`, pickFragment],
  pose: [`${pose}\n${passVertex}`, passFragment],
} as const;

/** A material that poses the shape, or draws what is posed; `uniforms` are shared, not copied, so that all of them follow one scene. */
export function poseMaterial(
  program: keyof typeof PROGRAMS,
  uniforms: Record<string, IUniform>,
  settings: ShaderMaterialParameters = {},
): ShaderMaterial {
  const [vertex, fragment] = PROGRAMS[program];
  const material = new ShaderMaterial({
    ...settings,
    glslVersion: GLSL3,
    vertexShader: `precision highp int;\n${vertex}`,
    fragmentShader: fragment,
  });
  material.uniforms = uniforms;
  return material;
}
