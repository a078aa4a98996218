/** How long the graphics take, told by a fence behind what was asked of them: nobody waits for it. */

const INTERVAL = 4;
/** Milliseconds after which nothing is expected any more. */
const PATIENCE = 20_000;

export class Clock {
  private pending = false;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Tell, once all that was asked until now is drawn, how long after `begun` that is; one question at a time. */
  ask(begun: number, tell: (milliseconds: number) => void): void {
    if (this.pending) return;
    this.pending = true;
    this.follow(begun, tell, () => (this.pending = false));
  }

  /** The same whoever else asks; `ended` is called in any case, `tell` not where the graphics are lost. */
  follow(begun: number, tell: (milliseconds: number) => void, ended: () => void = () => undefined): void {
    const answer = (milliseconds: number | null) => {
      ended();
      if (milliseconds !== null) tell(milliseconds);
    };
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) {
      answer(null);
      return;
    }
    gl.flush();
    const poll = () => {
      if (gl.isContextLost()) {
        answer(null);
        return;
      }
      const gone = performance.now() - begun;
      const done = gl.clientWaitSync(fence, 0, 0) !== gl.TIMEOUT_EXPIRED;
      if (!done && gone < PATIENCE) {
        setTimeout(poll, INTERVAL);
        return;
      }
      gl.deleteSync(fence);
      answer(done ? gone : null);
    };
    setTimeout(poll, INTERVAL);
  }
}
