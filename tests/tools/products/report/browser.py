"""A page in a real Chromium without a window, and all that it says and asks for meanwhile."""

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
_PATIENCE = 200.0  # for what is waited for [s]


@dataclass
class Opened:
    page: "Page"  # of the browser
    said: list[str] = field(default_factory=list)  # what came to the console, and errors that nothing caught
    asked: list[str] = field(default_factory=list)  # addresses that the page asked for


def wait_until(page: "Page", expression: str) -> None:
    """Wait for a condition in the page, whose policy forbids the way in which Playwright itself would."""
    end = time.monotonic() + _PATIENCE
    while not page.evaluate(f"Boolean({expression})"):
        assert time.monotonic() < end, f"{expression} did not come true within {_PATIENCE:g} s"
        page.wait_for_timeout(20)


def seen_at(page: "Page", place: np.ndarray) -> list[float]:
    """Where a place [m] is seen [pixels of the canvas]."""
    return page.evaluate("place => sonarmap.view.camera.project(place).slice(0, 2)", np.asarray(place).tolist())


def click(page: "Page", place: np.ndarray) -> None:
    """Click where a place [m] is seen."""
    x, y = seen_at(page, place)
    page.locator("#canvas").click(position={"x": x, "y": y})


@contextmanager
def opened(
    path: Path, flags: tuple[str, ...] = SOFTWARE, script: str = "", silent: bool = True, **context: str
) -> Iterator[Opened]:
    """The page of a file, once it has shown what it has to show, and unless it is not `silent`, has said nothing.

    `script` runs before the page's own.
    """
    ready = "window.sonarmap && (!sonarmap.view || sonarmap.view.frames > 0)"
    with browsed(path.resolve().as_uri(), ready, (1200, 800), flags, script, **context) as shown:
        yield shown
        assert shown.said == [] or not silent


@contextmanager
def browsed(
    address: str, ready: str, size: tuple[int, int], flags: tuple[str, ...], script: str = "", **context: str
) -> Iterator[Opened]:
    """The page at an address, once the condition `ready` holds in it, in a window of this width and height.

    Skips the test where there is no Chromium, or no Playwright to drive it.
    """
    own = started(flags).new_context(viewport={"width": size[0], "height": size[1]}, **context)
    page = own.new_page()
    shown = Opened(page)
    page.on("console", lambda message: shown.said.append(message.text))
    page.on("pageerror", lambda error: shown.said.append(str(error)))
    page.on("request", lambda request: shown.asked.append(request.url))
    page.add_init_script(script)
    try:
        page.goto(address)
        wait_until(page, ready)
        yield shown
    finally:
        own.close()


_STARTED: "dict[tuple[str, ...], Browser]" = {}
_PLAYWRIGHT: "list[Playwright]" = []


def started(flags: tuple[str, ...]) -> "Browser":
    """A Chromium with these flags, which all tests share, each in a context of its own."""
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
    """All of them, and Playwright, beside whose event loop no other can run in this thread."""
    while _STARTED:
        _STARTED.popitem()[1].close()
    while _PLAYWRIGHT:
        _PLAYWRIGHT.pop().stop()
