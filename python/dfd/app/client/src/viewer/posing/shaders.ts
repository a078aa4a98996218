import { GLSL3, ShaderMaterial, type IUniform, type ShaderMaterialParameters } from "three";

import backgroundFragment from "../../shaders/background.frag.glsl?raw";
import backgroundVertex from "../../shaders/background.vert.glsl?raw";
import pickFragment from "../../shaders/pick.frag.glsl?raw";
import pickVertex from "../../shaders/pick.vert.glsl?raw";
import stillFragment from "../../shaders/still.frag.glsl?raw";
import stillVertex from "../../shaders/still.vert.glsl?raw";
import surfaceFragment from "../../shaders/surface.frag.glsl?raw";
import surfaceVertex from "../../shaders/surface.vert.glsl?raw";

const PROGRAMS = {
  background: [backgroundVertex, backgroundFragment],
  pick: [pickVertex, pickFragment],
  still: [stillVertex, stillFragment],
  surface: [surfaceVertex, surfaceFragment],
} as const;

/** A material that draws what is posed; `uniforms` are shared, not copied, so that all of them follow one scene. */
export function material(
  program: keyof typeof PROGRAMS,
  uniforms: Record<string, IUniform>,
  settings: ShaderMaterialParameters = {},
): ShaderMaterial {
  const [vertex, fragment] = PROGRAMS[program];
  const made = new ShaderMaterial({
    ...settings,
    glslVersion: GLSL3,
    vertexShader: `precision highp int;\n${vertex}`,
    fragmentShader: fragment,
  });
  made.uniforms = uniforms;
  return made;
}

/** Compile a material for what its look needs, unless it is made for that already. */
export function define(made: ShaderMaterial, names: readonly string[]): void {
  if (Object.keys(made.defines).join() === names.join()) return;
  made.defines = Object.fromEntries(names.map((name) => [name, ""]));
  made.needsUpdate = true;
}
