/** The WebSocket to the server that served the page. */

import { decode } from "../protocol/binary_messages";
import type { Link, LinkEvents } from "./connection";
import { problem } from "./toasts";

const STATES = ["connecting", "open", "closed", "closed"] as const;

export function socket({ opened, received, closed }: LinkEvents): Link {
  const address = new URL("ws", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.search = address.hash = "";
  const own = new WebSocket(address);
  own.binaryType = "arraybuffer";
  own.onopen = opened;
  own.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
    try {
      received(decode(data));
    } catch (error) {
      problem(`A message of the server could not be read: ${error instanceof Error ? error.message : String(error)}`);
    }
  };
  own.onclose = ({ code }) => closed(code);
  return {
    get status() {
      return STATES[own.readyState];
    },
    get unsent() {
      return own.bufferedAmount;
    },
    send: (request) => own.send(JSON.stringify(request)),
    close: () => own.close(),
  };
}
