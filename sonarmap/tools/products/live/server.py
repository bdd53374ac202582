"""The page's server: `/` is the page, `/feed` the WebSocket, `/report` the report once there is one, other paths are
refused. It reads no file."""

import asyncio
import json
import logging
import secrets
import socket
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from http import HTTPStatus
from ipaddress import ip_address
from string import Template
from threading import Thread
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from sonarmap.kernels.errors import InputError
from sonarmap.tools.products.live.messages import Kept, Message
from sonarmap.tools.products.report.page import REPORT_WEB, joined, part

MOST_BROWSERS = 8
LARGEST = 1024  # largest message from a browser, which sends only choices [bytes]
_PATIENCE = 20.0  # for a browser that receives nothing, or a whole report [s]
_AGAIN = 1.0  # pause before a server that failed is restarted [s]
_ADDRESS_OF = 0x8915  # SIOCGIFADDR of Linux: the address of an interface
_FAREWELL = 2.0  # for browsers to receive the end of the dive [s]
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_OF_REPORT_PAGE = "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"  # beside the policy that it contains
_LOOPBACK_HEADERS = {"Cross-Origin-Opener-Policy": "same-origin"}  # browsers ignore it elsewhere, with a warning
_quiet = logging.Logger("sonarmap.live", logging.CRITICAL + 1)  # requests of strangers are not logged
OWN = "sonarmap.tools.products.live"
_OF_REPORT = ("camera", "scene", "elements", "colorings", "layers", "labels", "gestures", "map_view")
_OWN = ("view", "live")
_REPORT = "/report"


class LivePage:
    """Serves the page while it is open as a context.

    bind: address to listen at; if it is not a loopback address, the page requires the token in `address`.
    port: TCP port; 0 for any that is free.
    """

    def __init__(self, bind: str = "127.0.0.1", port: int = 0) -> None:
        self._bind, self._port = "127.0.0.1" if bind == "localhost" else bind, port
        self._token = None if _is_loopback(bind) else secrets.token_urlsafe(24)
        self._kept = Kept()
        self._ending = False
        self.choices = frozenset[str]()  # labels of the buttons that browsers may press
        self.chosen = deque[str]()  # labels of pressed buttons; the reader removes them
        self._pages = {"/": live_page()}  # path -> HTML and Content-Security-Policy

    @property
    def address(self) -> str:
        return self.addresses[0]

    @property
    def addresses(self) -> list[str]:
        """All URLs of the page for other computers, by IP address, as few networks resolve host names."""
        hosts = (_own_addresses() if self._bind in ("0.0.0.0", "::") else []) or [self._bind]
        token = f"?token={self._token}" if self._token else ""
        return [f"http://{f'[{host}]' if ':' in host else host}:{self._port}/{token}" for host in hosts]

    def __enter__(self) -> Self:
        started: Future[int] = Future()
        self._thread = Thread(target=self._run, args=(started,), name="live page", daemon=True)
        self._thread.start()
        try:
            self._port = started.result()
        except (OSError, OverflowError) as error:
            raise InputError(
                f"port {self._port} of {self._bind} cannot be used for the page ({error}); another program may use it: "
                "name another with --port, or leave --port out, and look at --bind"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._ending = True
        self._call(self._stop.set)
        self._thread.join(2 * _PATIENCE)

    def publish(self, message: Message) -> None:
        """Show a message in all present and future browsers, without waiting for them."""
        self._kept.add(message)
        self._call(self._wake)

    def making(self, words: str) -> None:
        """Say on the page how far the final map is."""
        said = f"The dive has ended, and its map is being made ({words}). The report then opens here."
        self.publish(("making", json.dumps({"kind": "making", "words": said})))

    def show_report(self, page: str) -> None:
        """Have all browsers open a report, for which the end of the server waits; the report itself needs no server."""
        self._pages[_REPORT] = page, _OF_REPORT_PAGE
        self.publish(("made", json.dumps({"kind": "made"})))

    def _call(self, function: Callable[[], object]) -> None:
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function)

    def _wake(self) -> None:
        """Wake the feeds that wait for new messages."""
        self._news.set()
        self._news = asyncio.Event()

    def _run(self, started: Future[int]) -> None:
        """Serve until the end; restart the server after an error."""
        while not self._ending:
            try:
                asyncio.run(self._serve(started))
            except BaseException as error:  # noqa: BLE001 - `__enter__` raises it, if it is of the start
                if not started.done():
                    return started.set_exception(error)
                time.sleep(_AGAIN)

    async def _serve(self, started: Future[int]) -> None:
        self._loop, self._stop, self._news = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event()
        options: dict[str, Any] = {"compression": None, "max_size": LARGEST, "max_queue": 1, "server_header": None}
        options |= {"open_timeout": _PATIENCE, "close_timeout": 2, "process_request": self._answer, "logger": _quiet}
        async with serve(self._feed, self._bind, self._port, **options) as server:
            if not started.done():
                started.set_result(next(iter(server.sockets)).getsockname()[1])
            await self._stop.wait()
            self._wake()
            if closing := [asyncio.ensure_future(browser.wait_closed()) for browser in server.connections]:
                await asyncio.wait(closing, timeout=_PATIENCE if _REPORT in self._pages else _FAREWELL)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page or a refusal; None for a request that may open the feed."""
        url = urlsplit(request.path)
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_own(_name_of(hosts[0]), connection):
            return connection.respond(HTTPStatus.FORBIDDEN, "This page is at another address.\n")
        if self._token is not None:
            given = parse_qs(url.query).get("token", [""])[0]
            if not secrets.compare_digest(given.encode("utf-8", "replace"), self._token.encode()):
                why = "Open the address that sonarmap printed, with its token.\n"
                return connection.respond(HTTPStatus.FORBIDDEN, why)
        if url.path in self._pages:
            page, policy = self._pages[url.path]
            response = connection.respond(HTTPStatus.OK, page)
            del response.headers["Content-Type"]
            own = {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy}
            response.headers.update(_HEADERS | own | ({} if self._token else _LOOPBACK_HEADERS))
            return response
        if url.path != "/feed":
            return connection.respond(HTTPStatus.NOT_FOUND, "There is only the page itself, at /.\n")
        if origins != [f"http://{hosts[0]}"]:
            return connection.respond(HTTPStatus.FORBIDDEN, "Only the page itself may ask for its feed.\n")
        return None

    def _is_own(self, name: str, connection: ServerConnection) -> bool:
        """Whether a browser may use this name for the host: a foreign page that reaches it by DNS rebinding uses
        another. With a token, the host's own name is accepted in any domain, such as host.local."""
        reached = str(connection.local_address[0]).removeprefix("::ffff:")
        own = socket.gethostname().lower().partition(".")[0]
        return name in {self._bind.lower(), reached, "localhost"} or bool(self._token and name.partition(".")[0] == own)

    async def _feed(self, connection: ServerConnection) -> None:
        """Send a browser the messages that it does not have, as fast as it receives them."""
        if len(connection.server.connections) > MOST_BROWSERS:
            return await connection.close(1013, f"{MOST_BROWSERS} browsers show the page already; close one")
        listening, reached = asyncio.create_task(self._listen(connection)), dict[type, int]()
        try:
            while not listening.done():
                news, messages = self._news, self._kept.after(reached)
                for message in messages:
                    async with asyncio.timeout(_PATIENCE):
                        await connection.send(message)
                if not messages and self._ending and _REPORT not in self._pages:
                    break
                if not messages:
                    await news.wait()
        except (ConnectionClosed, TimeoutError):
            connection.transport.abort()
        finally:
            listening.cancel()

    async def _listen(self, connection: ServerConnection) -> None:
        """Take the choices of a browser, and close a connection that sends anything else."""
        with suppress(ConnectionClosed):
            while (choice := await connection.recv()) in self.choices:
                self.chosen.append(str(choice))
            await connection.close(1008, "only a choice of the page is expected")
        self._wake()


def _is_loopback(bind: str) -> bool:
    with suppress(ValueError):
        return bind == "localhost" or ip_address(bind).is_loopback
    return False


def _own_addresses() -> list[str]:
    """IPv4 addresses of this computer's interfaces, without loopback."""
    addresses = list[str]()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking, suppress(ImportError, OSError):
        from fcntl import ioctl

        for _, name in socket.if_nameindex():
            with suppress(OSError):  # without an address
                answer = ioctl(asking.fileno(), _ADDRESS_OF, name.encode().ljust(40, b"\0"))
                addresses.append(socket.inet_ntoa(answer[20:24]))
    return [address for address in addresses if not _is_loopback(address)]


def _name_of(host: str) -> str:
    with suppress(ValueError):
        return (urlsplit(f"//{host}").hostname or "").lower()
    return ""


def live_page() -> tuple[str, str]:
    """The page, and its Content-Security-Policy."""
    scripts = [*((REPORT_WEB, name) for name in _OF_REPORT), *((OWN, name) for name in _OWN)]
    parts = joined(
        [(REPORT_WEB, "page.css"), (OWN, "live.css")], [(package, f"{name}.js") for package, name in scripts]
    )
    policy = (
        f"default-src 'none'; connect-src 'self'; img-src data:; style-src {parts['style_hash']}; "
        f"script-src {parts['script_hash']}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return Template(part(OWN, "live.html")).substitute(parts), policy
