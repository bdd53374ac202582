"""The live page's server: access, refusals, garbage, and slow browsers."""

import json
import os
import re
import socket
import time
from base64 import b64encode
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from http.client import HTTPConnection
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from sonarmap.kernels.errors import InputError
from sonarmap.tools.products.live import messages, server
from sonarmap.tools.products.live.messages import Message, State
from sonarmap.tools.products.live.server import LivePage

STATE: Message = ("state", State("placed", alerts=("here",)).message)


@pytest.fixture
def live() -> Iterator[LivePage]:
    with LivePage() as page:
        page.publish(STATE)
        yield page


def answer(live: LivePage, path: str = "/", **headers: str) -> tuple[int, dict[str, str], str]:
    address = urlsplit(live.address)
    connection = HTTPConnection("127.0.0.1", address.port or 0, timeout=10)
    connection.request("GET", path, headers={"Host": address.netloc} | headers)
    response = connection.getresponse()
    return response.status, dict(response.getheaders()), response.read().decode()


@contextmanager
def feed(
    live: LivePage, origin: str | None = None, query: str | None = None, max_queue: int = 16
) -> Iterator[ClientConnection]:
    address = urlsplit(live.address)
    where = f"ws://127.0.0.1:{address.port}/feed?{address.query if query is None else query}"
    origin_header = Origin(origin or f"http://127.0.0.1:{address.port}")
    with connect(where, origin=origin_header, compression=None, max_queue=max_queue) as connection:
        yield connection


def drained(connection: ClientConnection) -> None:
    """Read until the server closes the connection."""
    while True:
        connection.recv(5)


def still_serves(live: LivePage) -> bool:
    with feed(live) as connection:
        return json.loads(connection.recv(5))["alerts"] == ["here"]


def test_the_page_has_a_strict_content_security_policy(live: LivePage) -> None:
    status, headers, text = answer(live)
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'; connect-src 'self'; ")
    assert "unsafe" not in policy
    for tag, name in (("style", "style-src"), ('script type="module"', "script-src")):
        (inside,) = re.findall(rf"<{tag}>(.*?)</{tag.split()[0]}>", text, re.DOTALL)
        assert f"{name} 'sha256-{b64encode(sha256(inside.encode()).digest()).decode()}'" in policy
    assert set(re.findall(r"(?:https?|wss?)://[^\s\"'`)]+", text)) == {"http://www.w3.org/2000/svg"}


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "["])
@pytest.mark.parametrize("path", ["/", "/feed"])
def test_another_host_is_refused(live: LivePage, host: str, path: str) -> None:
    assert answer(live, path, Host=host)[0] == 403


@pytest.mark.parametrize("path", ["/summary.json", "/../../etc/passwd", "/%2e%2e/etc/passwd"])
def test_files_on_disk_are_not_served(live: LivePage, path: str) -> None:
    assert answer(live, path)[0] == 404


@pytest.mark.parametrize("origin", ["http://evil.example", "null"])
def test_another_origin_is_refused(live: LivePage, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"), feed(live, origin):
        pass
    assert answer(live, "/feed")[0] == 403  # no origin at all
    assert still_serves(live)


def test_other_machines_need_a_token() -> None:
    with LivePage("0.0.0.0") as live:
        token = urlsplit(live.address).query
        live.publish(STATE)
        assert re.fullmatch(r"token=[\w-]{32}", token)
        assert answer(live, f"/?{token}", Host="127.0.0.1")[0] == 200
        for wrong in ("/", "/?token=", f"/?{token}x", f"/?{token[:-1]}", "/?token=%ff%00"):
            assert answer(live, wrong, Host="127.0.0.1")[0] == 403
        assert answer(live, f"/?{token}", Host="evil.example")[0] == 403
        assert still_serves(live)
        with pytest.raises(InvalidStatus, match="403"), feed(live, query="token=wrong"):
            pass


@pytest.mark.parametrize("name", ["SHIP", "ship.local"])
def test_with_the_token_every_name_of_this_computer_works(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "Ship.example")
    with LivePage("0.0.0.0") as live, LivePage() as alone:
        parts = urlsplit(live.address)
        assert answer(live, f"/?{parts.query}", Host=f"{name}:{parts.port}")[0] == 200
        assert answer(live, "/", Host=name)[0] == 403
        assert answer(live, f"/?{parts.query}", Host=f"ship7.{name}")[0] == 403
        assert answer(alone, Host=name)[0] == 403


def test_a_stopped_server_restarts_at_the_same_address(live: LivePage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_AGAIN", 0.1)
    for _ in range(2):
        live._loop.call_soon_threadsafe(live._loop.stop)  # asyncio.run raises RuntimeError then
        live._thread.join(0.3)
        end = time.monotonic() + 10
        while time.monotonic() < end:
            with suppress(OSError):
                assert still_serves(live)
                break
            time.sleep(0.05)
        assert still_serves(live)


def test_only_choices_of_the_page_are_taken(live: LivePage) -> None:
    live.choices = frozenset({"Use --frame frd", "Use --range-scale 0.97"})
    with feed(live) as connection:
        for choice in ("Use --range-scale 0.97", "Use --frame frd"):
            connection.send(choice)
        connection.send("Use --device none")
        with pytest.raises(ConnectionClosed, match="1008"):
            drained(connection)
    assert list(live.chosen) == ["Use --range-scale 0.97", "Use --frame frd"]


def test_garbage_is_refused_and_the_server_survives(live: LivePage, capfd: pytest.CaptureFixture[str]) -> None:
    garbage = os.urandom(1_000_000)
    for sent, why in ((garbage, "."), ("hello", "1008")):
        with feed(live) as connection:
            with suppress(ConnectionClosed):
                connection.send(sent)
            with pytest.raises(ConnectionClosed, match=why):
                drained(connection)
    with feed(live) as connection, suppress(OSError):  # not a WebSocket frame
        connection.socket.sendall(garbage)
    for begin in (b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: "):
        with socket.create_connection(("127.0.0.1", urlsplit(live.address).port or 0)) as raw, suppress(OSError):
            raw.sendall(begin + garbage)
            while raw.recv(65536):
                pass
    assert still_serves(live)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_browser_that_does_not_read_delays_nobody(live: LivePage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_PATIENCE", 0.5)
    with feed(live, max_queue=1) as slow, feed(live) as quick:
        quick.recv(5)
        begin = time.monotonic()
        for key in range(100):
            live.publish(messages.loops([(0, key)]))
            live.publish(messages.cloud(key, np.random.default_rng(key).random((10_000, 3))))
        assert time.monotonic() - begin < 5
        clouds = 0
        while clouds < 100:
            message = quick.recv(10)
            clouds += isinstance(message, bytes) and message[0] == messages.CLOUD
        time.sleep(1.5)
        with pytest.raises(ConnectionClosed):
            drained(slow)
    assert still_serves(live)


def test_the_number_of_browsers_is_limited(live: LivePage) -> None:
    with ExitStack() as browsers:
        for _ in range(server.MOST_BROWSERS):
            browsers.enter_context(feed(live)).recv(5)
        with feed(live) as more, pytest.raises(ConnectionClosed, match="close one"):
            more.recv(5)
    time.sleep(0.2)
    assert still_serves(live)


def test_browsers_are_sent_the_end_of_the_dive() -> None:
    with ExitStack() as browsers:
        with LivePage() as live:
            connection = browsers.enter_context(feed(live))
            live.publish(messages.cloud(0, np.zeros((10_000, 3))))
            live.publish(("state", State("ended").message))
        last = [message for message in connection if isinstance(message, str)][-1]
    assert json.loads(last)["status"] == "ended"


def test_a_report_is_served_whole_before_the_server_ends() -> None:
    report = "<!doctype html>" + "echo " * 4_000_000
    answers = list[tuple[int, str]]()

    def browse(live: LivePage, connection: ClientConnection) -> None:
        while json.loads(connection.recv(10))["kind"] != "made":
            pass
        status, headers, text = answer(live, "/report?" + urlsplit(live.address).query, Host="127.0.0.1")
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        answers.append((status, text))
        connection.close()

    with ExitStack() as browsers:
        with LivePage("0.0.0.0") as live:
            token = urlsplit(live.address).query
            assert answer(live, f"/report?{token}", Host="127.0.0.1")[0] == 404
            connection = browsers.enter_context(feed(live))
            live.making("mapping: 3 of 7")
            assert "mapping: 3 of 7" in json.loads(connection.recv(5))["words"]
            live.show_report(report)
            assert answer(live, "/report", Host="127.0.0.1")[0] == 403
            browser = Thread(target=browse, args=(live, connection))
            browser.start()
        browser.join()
    assert answers == [(200, report)]


def test_an_unusable_port_or_address_names_its_option(live: LivePage) -> None:
    port = urlsplit(live.address).port or 0
    with pytest.raises(InputError, match="--port"), LivePage(port=port):
        pass
    with pytest.raises(InputError, match="--bind"), LivePage("192.0.2.1"):
        pass


def test_a_shared_page_is_reached_at_its_numeric_addresses() -> None:
    with LivePage("0.0.0.0") as live:
        for address in live.addresses:
            parts = urlsplit(address)
            assert re.fullmatch(r"[\d.]+", parts.hostname or "")
            connection = HTTPConnection(parts.hostname or "", parts.port, timeout=10)
            connection.request("GET", f"/?{parts.query}")
            assert connection.getresponse().status == 200
