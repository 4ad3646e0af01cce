// Starts the page.
import { render } from "preact";
import type { Socket } from "./core/channel";
import type { Json } from "./core/protocol";
import { App } from "./panels/app";
import { Page } from "./panels/context";
import { Session } from "./state/session";
import "./style.css";

declare global {
  interface Window {
    /** The page, for its tests and for a look from the browser's console. */
    usdlivePage: Page;
  }
}

/** A number that stays when the tab is loaded again, so that the gateway knows the viewer. */
function viewer(): string {
  const known = sessionStorage.getItem("usdlive.viewer");
  if (known) return known;
  const made = Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) =>
    byte.toString(16).padStart(2, "0"),
  ).join("");
  sessionStorage.setItem("usdlive.viewer", made);
  return made;
}

function hello(): { [key: string]: Json } {
  const token = sessionStorage.getItem("usdlive.token");
  return { viewer: viewer(), ...(token ? { token } : {}) };
}

function open(): Socket {
  const web = new WebSocket(address);
  const socket: Socket = {
    onopen: null,
    onmessage: null,
    onclose: null,
    send: (data) => web.send(data),
    close: () => web.close(),
  };
  web.binaryType = "arraybuffer";
  web.onopen = () => socket.onopen?.();
  web.onmessage = (event) => socket.onmessage?.(event);
  web.onclose = (event) => socket.onclose?.(event);
  return socket;
}

const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`;
const page = new Page(new Session(open, hello));
window.usdlivePage = page;
render(<App page={page} />, document.getElementById("page") as HTMLElement);
page.session.connect();
