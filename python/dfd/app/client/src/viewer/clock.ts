/** How long the graphics take, told by a fence behind what was asked of them: nobody waits for it. */

const INTERVAL = 4;

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
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    // However long it takes: whoever waits for it has nothing else under way.
    const poll = () => {
      if (!fence || gl.isContextLost()) {
        ended();
        return;
      }
      if (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) {
        setTimeout(poll, INTERVAL);
        return;
      }
      gl.deleteSync(fence);
      ended();
      tell(performance.now() - begun);
    };
    setTimeout(poll, INTERVAL);
  }
}
