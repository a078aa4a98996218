/** Send requests to the server over a WebSocket, and receive the answers. A lost connection is opened again. */

import { decode, type Received, type Request } from "../protocol/binary_messages";
import { store } from "../store/state";
import { problem } from "./toasts";

const SESSION_KEY = "dfd-session";

/** Close codes after which the page does not connect again, and the reasons that it shows. */
const DISMISSALS: Record<number, string> = {
  4001: "This session was opened in another tab.",
  4002: "This session has ended. Reload the page to start a new one.",
  4403: "The server refused this page. Open the address that `dfd app` printed.",
};

const FIRST_WAIT = 400; // milliseconds before the first attempt to reconnect; later waits double
const LONGEST_WAIT = 8000;
/** If more than this number of bytes wait to be sent, sliders and drags send no new requests. */
const CONGESTED = 16_384;

let socket: WebSocket | null = null;
let receive: (received: Received) => void = () => undefined;
let next = 1;
let wait = FIRST_WAIT;
let timer = 0;
/** Unanswered requests by `id`. A failed request resolves to null. The failure of a `quiet` request is not shown. */
const waiting = new Map<number, { readonly resolve: (received: Received | null) => void; readonly quiet: boolean }>();

export function start(receiver: (received: Received) => void): void {
  receive = receiver;
  connect();
  // Reconnect at once after the computer wakes or the network returns.
  const reconnect = () => {
    if (document.hidden || store.get().ended !== null || socket?.readyState !== WebSocket.CLOSED) return;
    clearTimeout(timer);
    connect();
  };
  addEventListener("online", reconnect);
  document.addEventListener("visibilitychange", reconnect);
}

/** Send a request; return its `id`, or 0 without a connection. */
export function send(request: Request): number {
  if (socket?.readyState !== WebSocket.OPEN) return 0;
  const id = next++;
  socket.send(JSON.stringify({ ...request, id }));
  return id;
}

/** Send a request and return its answer; null if the request fails or the connection is lost. */
export function ask(request: Request, quiet = false): Promise<Received | null> {
  const id = send(request);
  return id === 0 ? Promise.resolve(null) : new Promise((resolve) => waiting.set(id, { resolve, quiet }));
}

export function congested(): boolean {
  return (socket?.bufferedAmount ?? 0) > CONGESTED;
}

/** Close the connection. Tests use this function to see whether the page reconnects. */
export function drop(): void {
  socket?.close();
}

function connect(): void {
  store.set({ link: socket ? "lost" : "connecting" });
  const address = new URL("ws", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.hash = "";
  address.search = new URLSearchParams({ session: sessionStorage.getItem(SESSION_KEY) ?? "" }).toString();
  const own = new WebSocket(address);
  own.binaryType = "arraybuffer";
  own.onopen = () => {
    wait = FIRST_WAIT;
    store.set({ link: "open" });
  };
  own.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
    try {
      received(decode(data));
    } catch (error) {
      problem(`The page could not read a message of the server: ${(error as Error).message}`);
    }
  };
  own.onclose = ({ code }) => {
    if (socket !== own) return;
    for (const { resolve } of waiting.values()) resolve(null);
    waiting.clear();
    if (code in DISMISSALS) {
      store.set({ link: "closed", ended: DISMISSALS[code] });
      return;
    }
    store.set({ link: "lost" });
    timer = window.setTimeout(connect, wait);
    wait = Math.min(2 * wait, LONGEST_WAIT);
  };
  socket = own;
}

function received(answer: Received): void {
  const { message } = answer;
  if (message.type === "session") sessionStorage.setItem(SESSION_KEY, message.session);
  const failed = message.type === "failure";
  const request = waiting.get(message.id);
  if (!failed || !request?.quiet) receive(answer);
  request?.resolve(failed ? null : answer);
  waiting.delete(message.id);
}
