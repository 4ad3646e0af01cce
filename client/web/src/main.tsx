// Starts the page.
import { render } from "preact";
import { hexOf } from "./core/batch";
import type { Socket } from "./core/channel";
import { App } from "./panels/app";
import { Page } from "./panels/context";
import { type Memory, Session } from "./state/session";
import "./style.css";

declare global {
  interface Window {
    /** The page, for its tests and for a look from the browser's console. */
    usdlivePage: Page;
  }
}

const memory: Memory = {
  hello: () => {
    const token = sessionStorage.getItem("usdlive.token");
    const name = localStorage.getItem("usdlive.name");
    return { viewer: viewer(), ...(token ? { token } : {}), ...(name ? { name } : {}) };
  },
  setName: (name) => localStorage.setItem("usdlive.name", name),
  setToken: (token) => sessionStorage.setItem("usdlive.token", token),
};

/** A number that stays when the tab is loaded again, so that the gateway knows the viewer. */
function viewer(): string {
  const known = sessionStorage.getItem("usdlive.viewer");
  if (known) return known;
  const made = hexOf(crypto.getRandomValues(new Uint8Array(16)));
  sessionStorage.setItem("usdlive.viewer", made);
  return made;
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
const page = new Page(new Session(open, memory));
window.usdlivePage = page;
render(<App page={page} />, document.getElementById("page") as HTMLElement);
page.session.connect();
