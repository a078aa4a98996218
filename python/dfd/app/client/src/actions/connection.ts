/** Send requests to the server over a WebSocket, and receive the answers. A lost connection is opened again. */

import { decode, type Received, type Request } from "../protocol/binary_messages";
import { store, type State } from "../store/state";
import { problem } from "./toasts";

const SESSION_KEY = "dfd-session";
/** The key of the kept edit, with which a new server opens the same shape. */
const KEPT_KEY = "dfd-kept";

const SERVER_STOPS = [1001, 1012, 4002];
const STOPPED: State["ended"] = {
  title: "The server has stopped",
  text: "Your edit is kept. Start `dfd app` again, and this page goes on.",
  button: "Try again",
};
/** Close codes after which the page does not connect again by itself, and what it says. */
const DISMISSALS: Record<number, State["ended"]> = {
  4001: { title: "Opened in another tab", text: "This session was opened in another tab.", button: "Use it here" },
  4403: {
    title: "The server refused this page",
    text: "Open the address that `dfd app` printed. Your edit is kept.",
    button: null,
  },
};
/** Milliseconds without an answer after which the page says that the server works. It is drawn before 300 ms. */
const NOTICED = 250;

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
    if (document.hidden || store.get().link === "closed" || socket?.readyState !== WebSocket.CLOSED) return;
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
  setTimeout(() => answered < id && store.set({ busy: true }), NOTICED);
  return id;
}

/** Send a request and return its answer; null if the request fails or the connection is lost. */
export function ask(request: Request, quiet = false): Promise<Received | null> {
  const id = send(request);
  return id === 0 ? Promise.resolve(null) : new Promise((resolve) => waiting.set(id, { resolve, quiet }));
}

/** The newest request with an answer. The server answers in order, or leaves out requests that are outdated. */
let answered = 0;

function settle(id: number): void {
  answered = Math.max(answered, id);
  if (answered === next - 1 && store.get().busy) store.set({ busy: false });
}

/** Remember the kept edit of the shape, also when the page is loaded again. */
export function keep(key: string): void {
  sessionStorage.setItem(KEPT_KEY, key);
}

export function congested(): boolean {
  return (socket?.bufferedAmount ?? 0) > CONGESTED;
}

/** Close the connection. Tests use this function to see whether the page reconnects. */
export function drop(): void {
  socket?.close();
}

export function connect(): void {
  store.set({ link: socket ? "lost" : "connecting" });
  const address = new URL("ws", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.hash = "";
  const [session, kept] = [SESSION_KEY, KEPT_KEY].map((key) => sessionStorage.getItem(key) ?? "");
  address.search = new URLSearchParams({ session, kept }).toString();
  clearTimeout(timer);
  const own = new WebSocket(address);
  own.binaryType = "arraybuffer";
  let opened = false;
  own.onopen = () => {
    opened = true;
    wait = FIRST_WAIT;
    store.set({ link: "open", ended: null });
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
    settle(next - 1);
    if (code in DISMISSALS) {
      store.set({ link: "closed", ended: DISMISSALS[code] });
      return;
    }
    const stopped = SERVER_STOPS.includes(code) || !opened;
    store.set({ link: "lost", ended: stopped && store.get().page !== "waiting" ? STOPPED : store.get().ended });
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
  settle(message.id);
}
