/** How long the graphics take, told by a fence behind what was asked of them: nobody waits for it. */

const INTERVAL = 4;
/** Milliseconds after which nothing is expected any more. */
const PATIENCE = 20_000;

export class Clock {
  private pending = false;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Tell, once all that was asked until now is drawn, how long after `begun` that is; one question at a time. */
  ask(begun: number, tell: (milliseconds: number) => void): void {
    const { gl } = this;
    const fence = this.pending ? null : gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) return;
    this.pending = true;
    gl.flush();
    const look = () => {
      if (gl.isContextLost()) {
        this.pending = false;
        return;
      }
      const gone = performance.now() - begun;
      const done = gl.clientWaitSync(fence, 0, 0) !== gl.TIMEOUT_EXPIRED;
      if (!done && gone < PATIENCE) {
        setTimeout(look, INTERVAL);
        return;
      }
      this.pending = false;
      gl.deleteSync(fence);
      if (done) tell(gone);
    };
    setTimeout(look, INTERVAL);
  }
}
