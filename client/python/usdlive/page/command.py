"""The command `usdlive page`: starts the gateway and prints the address of the page."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ipaddress
import logging
import os
import pathlib
import signal
import socket
import sys
import typing
import webbrowser

_MOST_UNSENT_BYTES = 128 << 10  # in the kernel, of one connection

_EPILOG = """URL is ws://HOST:PORT, wss://HOST:PORT (encrypted) or HOST:PORT; the default is USDLIVE_URL, or
ws://127.0.0.1:7447. For a server with several projects use ws://HOST:PORT/PROJECT."""


class _Parser(argparse.ArgumentParser):
    """Prints help and errors as the other verbs do."""

    def format_help(self) -> str:
        return super().format_help().replace("usage: ", "Usage: ", 1)

    def error(self, message: str) -> typing.NoReturn:
        print(f"usdlive: {message}. `usdlive help page` explains the usage", file=sys.stderr)
        sys.exit(2)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser("usdlive page", usage="usdlive page [OPTIONS] [URL]", add_help=False, description="Show a project in browsers: the live stage, its people and its history",
                                     epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("-h", "--help", action="store_true", help="print this help")
    parser.add_argument("url", metavar="URL", nargs="?", help="the server")
    parser.add_argument("--stage", metavar="LAYER", default="", help="the root layer; by default one near the top of the project")
    parser.add_argument("--host", default="127.0.0.1", help="the address to listen on (%(default)s)")
    parser.add_argument("--port", type=int, default=0, help="the port to listen on; 0: any (%(default)s)")
    parser.add_argument("--port-file", metavar="FILE", help="write the port to this file when the page can be opened")
    parser.add_argument("--allow-host", metavar="NAME", action="append", default=[], help="also answer under this name; may be given again")
    parser.add_argument("--tls", nargs=2, metavar=("CERTIFICATE", "KEY"), help="encrypt; two files in PEM")
    parser.add_argument("--insecure", action="store_true", help="listen on a network without encryption or sign-in")
    parser.add_argument("-u", "--user", default=os.environ.get("USDLIVE_USER", ""), metavar="NAME", help="the name of the gateway's own connection")
    parser.add_argument("--ca", metavar="FILE", help="also trust servers that an authority in this file has certified")
    parser.add_argument("--with-parent", action="store_true", help=argparse.SUPPRESS)  # ends when the standard input does
    parser.add_argument("--open", action="store_true", help="open the page in a browser")
    return parser


class Failed(Exception):
    """Ends the command with a message."""


def main(arguments: list[str]) -> int:
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.help:
        try:
            print(parser.format_help(), end="", flush=True)
        except OSError as failed:
            return _unwritten(failed)
        return 0
    if options.ca:
        os.environ["USDLIVE_CA"] = options.ca
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ModuleNotFoundError as missing:
        return _failed(f"the page needs {missing.name}: {sys.executable} -m pip install 'usdlive[page]'")
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(message)s")
    import usdlive

    try:
        asyncio.run(_serve(options))
    except (Failed, usdlive.Error) as failed:
        return _failed(getattr(failed, "message", str(failed)))
    except KeyboardInterrupt:
        pass
    return 0


def _unwritten(failed: OSError) -> int:
    # The interpreter would try again when it ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return _failed(f"standard output cannot be written: {failed.strerror}")


def _failed(why: str) -> int:
    print(f"usdlive: {why}", file=sys.stderr)
    return 1


async def _serve(options: argparse.Namespace) -> None:
    import uvicorn

    from .access import Places
    from .app import MOST_MESSAGE_BYTES, create
    from .gateway import Gateway

    url = options.url or os.environ.get("USDLIVE_URL") or "ws://127.0.0.1:7447"
    if url.startswith("dds://"):
        raise Failed(f"{url}: the page needs the server's WebSocket address, ws://HOST:PORT")
    listener = _listen(options.host, options.port)
    gateway = Gateway(url, options.stage, options.user)
    try:
        await gateway.start()
        _check_exposure(options, gateway.server.asks_to_sign_in)
        config = uvicorn.Config(create(gateway, Places(options.host, options.allow_host)), log_level="warning", access_log=False,
                                ws="websockets-sansio", ws_max_size=MOST_MESSAGE_BYTES, ws_per_message_deflate=False, lifespan="off",
                                server_header=False, timeout_graceful_shutdown=1, limit_concurrency=1000,
                                **({"ssl_certfile": options.tls[0], "ssl_keyfile": options.tls[1]} if options.tls else {}))
        server = uvicorn.Server(config)
        server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
        for name in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(name, lambda: setattr(server, "should_exit", True))
        if options.with_parent:
            asyncio.get_running_loop().add_reader(sys.stdin.fileno(), _parent, server)
        announcing = asyncio.ensure_future(_announce(options, server, listener))
        with contextlib.suppress(asyncio.CancelledError):
            await server.serve([listener])
        await announcing
    finally:
        await gateway.stop()
        listener.close()


def _parent(server: "object") -> None:
    """`usdlive serve --page` holds the other end of the standard input, which is closed when it ends."""
    if not os.read(sys.stdin.fileno(), 4096):
        asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
        server.should_exit = True  # type: ignore[attr-defined]


async def _announce(options: argparse.Namespace, server: "object", listener: socket.socket) -> None:
    """Prints the address when it can be opened."""
    while not server.started and not server.should_exit:  # type: ignore[attr-defined]
        await asyncio.sleep(0.01)
    port = listener.getsockname()[1]
    host = f"[{options.host}]" if ":" in options.host else options.host
    address = f"{'https' if options.tls else 'http'}://{host}:{port}/"
    try:
        print(f"The page is at {address}", flush=True)
    except OSError as failed:
        server.should_exit = True  # type: ignore[attr-defined]
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise Failed(f"standard output cannot be written: {failed.strerror}") from None
    if options.port_file:
        part = pathlib.Path(options.port_file + ".part")
        part.write_text(str(port))
        part.rename(options.port_file)
    if options.open:
        await asyncio.to_thread(webbrowser.open, address)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_NOTSENT_LOWAT"):  # not on Windows
            # Connections inherit it. What a slow page has not received waits in its Viewer, which can replace it.
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _MOST_UNSENT_BYTES)
        listener.bind((host, port))
        return listener
    except (OSError, OverflowError) as failed:
        raise Failed(f"cannot listen on {host}:{port}: {failed}") from None


def _check_exposure(options: argparse.Namespace, asks_to_sign_in: bool) -> None:
    """A page on a network needs what the server needs there (docs/security.md)."""
    try:
        local = ipaddress.ip_address(options.host).is_loopback
    except ValueError:
        local = options.host == "localhost"
    if local or options.insecure:
        return
    if not asks_to_sign_in:
        raise Failed(f"{options.host} can be reached from other machines, and the server asks nobody to sign in. Add users "
                     "(usdlive user add), or allow everybody with --insecure")
    if not options.tls:
        raise Failed(f"{options.host} can be reached from other machines, and tokens would be sent in plain text. "
                     "Give --tls CERTIFICATE KEY, or allow it with --insecure")
