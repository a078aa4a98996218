/** The pose shader, compiled once for each set of defines. */

import pose from "../../shaders/pose.glsl?raw";
import pass from "../../shaders/pose_pass.glsl?raw";

export const ATTRIBUTES = { rest: 0, restNormal: 1, vertex: 2, givenPosition: 3, givenNormal: 4 } as const;
const VARYINGS = ["posedPosition", "posedNormal"];
const UNIFORMS = ["weights", "columns", "columnCount", "defaultTransform", "mirror", "mirrorBand"] as const;

export interface PoseProgram {
  readonly program: WebGLProgram;
  readonly at: Readonly<Record<(typeof UNIFORMS)[number], WebGLUniformLocation | null>>;
}

export class PosePrograms {
  private readonly known = new Map<string, PoseProgram>();

  constructor(private readonly gl: WebGL2RenderingContext) {}

  with(defines: readonly string[]): PoseProgram {
    const key = [...defines].sort().join(" ");
    const program = this.known.get(key) ?? compile(this.gl, defines);
    this.known.set(key, program);
    return program;
  }

  dispose(): void {
    for (const { program } of this.known.values()) this.gl.deleteProgram(program);
  }
}

function compile(gl: WebGL2RenderingContext, defines: readonly string[]): PoseProgram {
  const defined = defines.map((name) => `#define ${name}\n`).join("");
  const header = "#version 300 es\nprecision highp float;\nprecision highp int;\n";
  const program = gl.createProgram();
  const shaders = [
    shader(gl, gl.VERTEX_SHADER, `${header}${defined}${pose}\n${pass}`),
    shader(gl, gl.FRAGMENT_SHADER, `${header}void main() {}`),
  ];
  shaders.forEach((each) => gl.attachShader(program, each));
  for (const [name, place] of Object.entries(ATTRIBUTES)) gl.bindAttribLocation(program, place, name);
  gl.transformFeedbackVaryings(program, VARYINGS, gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  shaders.forEach((each) => gl.deleteShader(each));
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
    throw new Error(`The pose shader does not link: ${gl.getProgramInfoLog(program)}`);
  const at = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]));
  return { program, at: at as PoseProgram["at"] };
}

function shader(gl: WebGL2RenderingContext, type: GLenum, source: string): WebGLShader {
  const made = gl.createShader(type);
  if (!made) throw new Error("The graphics are gone.");
  gl.shaderSource(made, source);
  gl.compileShader(made);
  if (!gl.getShaderParameter(made, gl.COMPILE_STATUS) && !gl.isContextLost())
    throw new Error(`The pose shader does not compile: ${gl.getShaderInfoLog(made)}`);
  return made;
}
