# pyright: strict
"""Navigation that comes while the vehicle dives: whole NMEA 0183 sentences in a file, which `map` reads at the end."""

import re
import socket
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from threading import Event, Thread
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.extras import load_package

NAME = "navigation.nmea"  # within the map's folder
_SENTENCE = re.compile(rb"[$!]([A-Z][^*\r\n]{5,110})\*([0-9A-Fa-f]{2})")
_LARGEST = 1 << 16  # bytes that are looked at together
_WAIT = 0.3  # seconds after which the end is noticed, at the latest
_BAUD = 4800  # of NMEA 0183
_LISTENS = "navigation by --nmea"


@contextmanager
def kept_navigation(source: str | None, out: Path) -> Generator[None]:
    """Within the block sentences that come are added to a file of the map's folder; None for no source.

    Args:
        source: a UDP port, as 10110, or a serial device, as /dev/ttyUSB0 or COM3@38400 (4800 baud without a number).
        out: the map's folder.

    Raises:
        InputError: nothing can be received there, or the file cannot be written.
    """
    if source is None:
        yield
        return
    ends = Event()
    with _opened(source) as receive:
        try:
            file = (out / NAME).open("ab", buffering=0)
        except OSError as error:
            raise InputError(f"cannot write {out / NAME}: {error.strerror}; choose another output folder") from error
        with file:
            thread = Thread(target=_keep, args=(receive, file.write, ends), name="navigation", daemon=True)
            thread.start()
            try:
                yield
            finally:
                ends.set()
                thread.join()


def sentences_in(received: bytes) -> list[bytes]:
    """The sentences with a right checksum, each as a line."""
    found = [
        match for match in _SENTENCE.finditer(received) if reduce(lambda a, b: a ^ b, match[1]) == int(match[2], 16)
    ]
    return [match[0] + b"\r\n" for match in found]


def _keep(receive: Callable[[], bytes], write: Callable[[bytes], Any], ends: Event) -> None:
    """Until the end; a serial line gives parts of sentences."""
    left = b""
    while not ends.is_set():
        try:
            left = (left + receive())[-_LARGEST:]
            end = max(left.rfind(b"\n"), left.rfind(b"\r")) + 1
            write(b"".join(sentences_in(left[:end])))
            left = left[end:]
        except TimeoutError:
            continue
        except OSError:  # the disk is full, or the device has gone
            ends.wait(_WAIT)


@contextmanager
def _opened(source: str) -> Generator[Callable[[], bytes]]:
    """A function that gives what has come, or raises TimeoutError."""
    if source.isdecimal():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
            try:
                listening.bind(("", int(source)))
            except (OSError, OverflowError) as error:
                raise InputError(f"{_LISTENS}: UDP port {source} cannot be used ({error}); choose another") from error
            listening.settimeout(_WAIT)
            yield lambda: listening.recv(_LARGEST) + b"\n"
        return
    name, _, baud = source.partition("@")
    serial = load_package("serial", "pyserial", _LISTENS, "serial")
    try:
        line = serial.Serial(name, int(baud or _BAUD), timeout=_WAIT)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{_LISTENS}: {source} cannot be opened ({error}); give a UDP port or a serial device"
        ) from error
    with line:
        yield lambda: line.read(max(1, line.in_waiting))
