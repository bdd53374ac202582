"""A page in Chromium without a window, with its console messages and requests."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # WebGL on the processor
WITHOUT_WEBGL = ("--disable-3d-apis",)
_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_PATIENCE = 200.0  # limit of wait_until [s]


@dataclass
class Opened:
    page: "Page"  # of the browser
    console: list[str] = field(default_factory=list)  # console messages and uncaught errors
    requests: list[str] = field(default_factory=list)  # addresses that the page requested


def wait_until(page: "Page", expression: str) -> None:
    """Wait for a condition in the page, whose policy forbids Playwright's own wait."""
    end = time.monotonic() + _PATIENCE
    while not page.evaluate(f"Boolean({expression})"):
        assert time.monotonic() < end, f"{expression} did not come true within {_PATIENCE:g} s"
        page.wait_for_timeout(20)


def seen_at(page: "Page", place: np.ndarray) -> list[float]:
    """Canvas position [pixels] of a place [m]."""
    return page.evaluate("place => sonarmap.view.camera.project(place).slice(0, 2)", np.asarray(place).tolist())


def click(page: "Page", place: np.ndarray) -> None:
    """Click on a place [m]."""
    x, y = seen_at(page, place)
    page.locator("#canvas").click(position={"x": x, "y": y})


@contextmanager
def opened(
    path: Path, flags: tuple[str, ...] = SOFTWARE, script: str = "", silent: bool = True, **context: str
) -> Iterator[Opened]:
    """The page of a file, once it is drawn; at exit it must have logged nothing if `silent`.

    `script` runs before the page's own.
    """
    ready = "window.sonarmap && (!sonarmap.view || sonarmap.view.frames > 0)"
    with browsed(path.resolve().as_uri(), ready, (1200, 800), flags, script, **context) as shown:
        yield shown
        assert shown.console == [] or not silent


@contextmanager
def browsed(
    address: str, ready: str, size: tuple[int, int], flags: tuple[str, ...], script: str = "", **context: str
) -> Iterator[Opened]:
    """The page at an address, once the condition `ready` holds in it, in a window of this width and height.

    Skips the test without Chromium or Playwright.
    """
    session = started(flags).new_context(viewport={"width": size[0], "height": size[1]}, **context)
    page = session.new_page()
    shown = Opened(page)
    page.on("console", lambda message: shown.console.append(message.text))
    page.on("pageerror", lambda error: shown.console.append(str(error)))
    page.on("request", lambda request: shown.requests.append(request.url))
    page.add_init_script(script)
    try:
        page.goto(address)
        wait_until(page, ready)
        yield shown
    finally:
        session.close()


_STARTED: "dict[tuple[str, ...], Browser]" = {}
_PLAYWRIGHT: "list[Playwright]" = []


def started(flags: tuple[str, ...]) -> "Browser":
    """Chromium with these flags, shared by all tests; each test has its own context."""
    path = next((found for name in _NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium is installed: apt-get install chromium")
    sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: pip install playwright")
    if not _PLAYWRIGHT:
        _PLAYWRIGHT.append(sync_api.sync_playwright().start())
    if flags not in _STARTED:
        _STARTED[flags] = _PLAYWRIGHT[0].chromium.launch(executable_path=path, args=["--no-sandbox", *flags])
    return _STARTED[flags]


def end_browsers() -> None:
    """Close all browsers and Playwright, whose event loop would block any other in this thread."""
    while _STARTED:
        _STARTED.popitem()[1].close()
    while _PLAYWRIGHT:
        _PLAYWRIGHT.pop().stop()
