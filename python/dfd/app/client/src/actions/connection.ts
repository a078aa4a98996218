/** The connection to the server: it comes back by itself, and every request knows what became of it. */

import type { Numbered, Received, Request } from "../protocol/binary_messages";
import { store } from "../store/state";

export const PROTOCOL = 1;
const SESSION_KEY = "dfd-session";

/** What carries the messages: a socket, or the page itself where there is no server. */
export interface Link {
  readonly status: "connecting" | "open" | "closed";
  /** Bytes that wait to be sent. */
  readonly unsent: number;
  send(request: Numbered): void;
  close(): void;
}

/** What a link tells, never before it was returned. */
export interface LinkEvents {
  readonly opened: () => void;
  readonly received: (received: Received) => void;
  readonly closed: (code: number) => void;
}

export type Connect = (events: LinkEvents) => Link;

/** Close codes after which another try would only be refused again. */
const DISMISSALS: Record<number, string> = {
  4001: "This session was opened in another tab, where it goes on.",
  4002: "This session has ended. Reload the page to begin another one.",
  4403: "The server does not know this page. Open the address that `dfd app` printed.",
};

const FIRST_WAIT = 400;
const LONGEST_WAIT = 8000;
/** Bytes that wait to be sent, beyond which frames of a drag are skipped. */
const CONGESTED = 16_384;

let link: Link | null = null;
let open: Connect = () => {
  throw new Error("Nothing connects the page yet.");
};
let receive: (received: Received) => void = () => undefined;
let next = 1;
let wait = FIRST_WAIT;
let timer = 0;
/** Those who wait for an answer; it is null where the request failed. */
const waiting = new Map<number, (received: Received | null) => void>();

export function start(receiver: (received: Received) => void, by: Connect): void {
  receive = receiver;
  open = by;
  connect();
  // A laptop that wakes, or a network that is back, need not wait for the next try.
  const hurry = () => {
    if (document.hidden || store.get().ended !== null || link?.status !== "closed") return;
    clearTimeout(timer);
    connect();
  };
  addEventListener("online", hurry);
  document.addEventListener("visibilitychange", hurry);
}

/** Send without waiting for the answer; returns the request's number, or 0 where there is no connection. */
export function send(request: Request): number {
  if (link?.status !== "open") return 0;
  const id = next++;
  link.send({ ...request, id });
  return id;
}

/** Send and wait for the answer; null where it is refused, which the person is told, or the connection was lost. */
export function ask(request: Request): Promise<Received | null> {
  const id = send(request);
  return id === 0 ? Promise.resolve(null) : new Promise((resolve) => waiting.set(id, resolve));
}

export function congested(): boolean {
  return (link?.unsent ?? 0) > CONGESTED;
}

/** Lose the connection, as a network does. */
export function drop(): void {
  link?.close();
}

function connect(): void {
  store.set({ link: link ? "lost" : "connecting" });
  const own = open({
    opened() {
      wait = FIRST_WAIT;
      store.set({ link: "open" });
      send({ type: "hello", version: PROTOCOL, session: sessionStorage.getItem(SESSION_KEY) });
    },
    received(received) {
      const { message } = received;
      if (message.type === "session") sessionStorage.setItem(SESSION_KEY, message.session);
      receive(received);
      waiting.get(message.id)?.(message.type === "failure" ? null : received);
      waiting.delete(message.id);
    },
    closed(code) {
      if (link !== own) return;
      for (const resolve of waiting.values()) resolve(null);
      waiting.clear();
      if (code in DISMISSALS) {
        store.set({ link: "closed", ended: DISMISSALS[code] });
        return;
      }
      store.set({ link: "lost" });
      timer = window.setTimeout(connect, wait);
      wait = Math.min(2 * wait, LONGEST_WAIT);
    },
  });
  link = own;
}
