/** The WebSocket to the server: it comes back by itself, and every request knows what became of it. */

import { decode, type Received, type Request, type ServerMessage } from "./frames";

export type Link = "connecting" | "open" | "lost" | "closed";

export interface Listener {
  /** `awaited` where somebody waits for the answer and will tell of a failure. */
  received(received: Received, awaited: boolean): void;
  linked(link: Link): void;
  opened(): void;
  /** Whatever went wrong while a message was read; the connection stays. */
  failed(problem: Error): void;
  /** The server will not have this tab again, and why. */
  dismissed(reason: string): void;
}

/** A request that did not succeed, in the server's own sentence. */
export class Refused extends Error {}
/** A request whose answer a lost connection took along, or that a newer one overtook. */
export class Dropped extends Error {}

/** Close codes after which another try would only be refused again. */
const DISMISSALS: Record<number, string> = {
  4001: "This session was opened in another tab, where it goes on.",
  4002: "This session has ended. Reload the page to begin another one.",
  4403: "The server does not know this page. Open the address that `dfd app` printed.",
};

const FIRST_WAIT = 400;
const LONGEST_WAIT = 8000;

interface Waiting {
  resolve(received: Received): void;
  reject(problem: Error): void;
}

export class Connection {
  private socket: WebSocket | null = null;
  private next = 1;
  private wait = FIRST_WAIT;
  private timer = 0;
  private ended = false;
  private readonly waiting = new Map<number, Waiting>();

  constructor(
    private readonly address: string,
    private readonly listener: Listener,
  ) {
    this.connect();
    // A laptop that wakes, or a network that is back, need not wait for the next try.
    addEventListener("online", () => this.hurry());
    document.addEventListener("visibilitychange", () => this.hurry());
  }

  get open(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Send and wait for the answer. */
  ask(request: Request): Promise<Received> {
    const id = this.send(request);
    if (id === 0) return Promise.reject(new Dropped("There is no connection to the server."));
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  /** Send without waiting; returns the request's number, or 0 where there is no connection. */
  send(request: Request): number {
    if (!this.socket || !this.open) return 0;
    const id = this.next++;
    this.socket.send(JSON.stringify({ ...request, id }));
    return id;
  }

  /** How many bytes wait to be sent: a drag skips frames that would only queue up. */
  get queued(): number {
    return this.socket?.bufferedAmount ?? 0;
  }

  /** Lose the connection, as a network does. */
  drop(): void {
    this.socket?.close();
  }

  /** Let go for good. */
  end(): void {
    this.ended = true;
    clearTimeout(this.timer);
    this.socket?.close();
    this.listener.linked("closed");
  }

  private connect(): void {
    this.listener.linked(this.socket ? "lost" : "connecting");
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.wait = FIRST_WAIT;
      this.listener.linked("open");
      this.listener.opened();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => this.receive(event.data);
    socket.onclose = (event) => {
      if (socket !== this.socket) return;
      for (const waiting of this.waiting.values())
        waiting.reject(new Dropped("The connection to the server was lost."));
      this.waiting.clear();
      if (this.ended) return;
      if (event.code in DISMISSALS) {
        this.end();
        this.listener.dismissed(DISMISSALS[event.code]);
        return;
      }
      this.listener.linked("lost");
      this.timer = window.setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
  }

  private hurry(): void {
    if (this.ended || document.hidden || !this.socket || this.socket.readyState < WebSocket.CLOSING) return;
    clearTimeout(this.timer);
    this.connect();
  }

  private receive(data: string | ArrayBuffer): void {
    try {
      const received = decode(data);
      const { message } = received;
      this.listener.received(received, this.waiting.has(message.id));
      this.settle(message, received);
    } catch (problem) {
      this.listener.failed(problem instanceof Error ? problem : new Error(String(problem)));
    }
  }

  private settle(message: ServerMessage, received: Received): void {
    const waiting = this.waiting.get(message.id);
    if (!waiting) return;
    this.waiting.delete(message.id);
    if (message.type === "failure") waiting.reject(new Refused(message.message));
    else waiting.resolve(received);
  }
}
