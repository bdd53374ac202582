"""Navigation while the vehicle dives: NMEA sentences kept as they come, and files that grow, read for key scans."""

import re
import socket
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from threading import Event, Thread

from sonarmap.kernels.errors import InputError
from sonarmap.slam.motion.odometry import Odometry
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live.recording import Again
from sonarmap.tools.command.navigation import NavigationReading, OdometryFile, PriorsFile
from sonarmap.tools.extras import load_package
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

_TEXTS = (".csv", ".txt", ".tum", ".nmea", ".log")  # whose last line may be half written


@dataclass(frozen=True, slots=True)
class Navigation:
    """The options that say what there is."""

    priors: PriorsFile
    odometry: OdometryFile
    reading: NavigationReading
    fastest: float | None = None  # that the vehicle goes [m/s]
    origin: Georeference | None = None  # of the map; None for the first fix

    def __post_init__(self) -> None:
        self._settings()
        _ = self.odometry.drift

    def __call__(self, scans: Sequence[Scan]) -> tuple[Sequence[Scan], Odometry | None]:
        """The scans with their priors, and the dead reckoning at their times, as far as the files go. Where one says
        nothing yet, or cannot be read now, the scans stay as they are: the map at the end says what is wrong."""
        odometry, settings = None, self._settings()
        if self.priors.priors:
            with suppress(Exception), ExitStack() as stack:
                paths = [stack.enter_context(_whole_lines(path)) for path in self.priors.priors]
                scans = navigate(scans, paths, settings, allow_unknown=True).scans
        if self.odometry.odometry is not None:
            with suppress(Exception), _whole_lines(self.odometry.odometry) as path:
                odometry = read_odometry(path, scans, *self.odometry.drift, settings=settings)
        return scans, odometry

    def _settings(self) -> NavigationSettings:
        settings = self.reading.settings(*self.priors.priors, self.odometry.odometry, origin=self.origin)
        # pyrefly: ignore[bad-argument-type]
        return replace(settings, sigmas=self.priors.sigmas or settings.sigmas, fastest=self.fastest)


@contextmanager
def _whole_lines(path: Path) -> Generator[Path]:
    """A file, or of a text what is written of it so far but for the line that is being written."""
    if path.suffix.lower() not in _TEXTS:
        yield path
        return
    with tempfile.NamedTemporaryFile(suffix=path.suffix) as copy:
        content = path.read_bytes()
        copy.write(content[: content.rfind(b"\n") + 1])
        copy.flush()
        yield Path(copy.name)


NAME = "navigation.nmea"  # within the map's folder
_SENTENCE = re.compile(rb"[$!]([A-Z][^*\r\n]{5,110})\*([0-9A-Fa-f]{2})")
_LARGEST = 1 << 16  # bytes that are looked at together
_MOST_WAITING = 1 << 24  # bytes of sentences that wait for the disk: an hour and more
_MOST_SAID = 64  # lines that wait to be shown
_WAIT = 0.3  # seconds after which the end is noticed, at the latest
_SILENT = 10.0  # seconds without a sentence that are worth a word
_BAUD = 4800  # of NMEA 0183
_LISTENS = "navigation by --nmea"
_LOCAL = "127.0.0.1"
_ADDRESS = re.compile(r"(?:\[?([^/\\]*?)\]?:)?(\d+)")  # HOST:PORT, or PORT


class NavigationLog:
    """Sentences that come are added to a file of the map's folder, as long as it is open as a context. A device that
    was unplugged is opened again, and what a full disk does not take waits in memory. The source is a UDP port, as
    10110 or 0.0.0.0:10110, or a serial device, as /dev/ttyUSB0 or COM3@38400 (4800 baud without a number)."""

    def __init__(self, source: str, out: Path) -> None:
        self.said = deque[str](maxlen=_MOST_SAID)  # what there is to say, a line each
        self._source, self._path = source, out / NAME
        self._waiting = b""
        self._faults = dict[str, str]()  # what is wrong now, by what it is of
        self._came = time.monotonic()
        self._ends = Event()
        self._source_open = ExitStack()

    def __enter__(self) -> "NavigationLog":
        try:
            self._path.open("ab").close()
        except OSError as error:
            raise InputError(f"cannot write {self._path}: {error.strerror}; choose another output folder") from error
        receive = self._source_open.enter_context(_opened(self._source))
        self._thread = Thread(target=self._run, args=(receive,), name="navigation", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _run(self, receive: Callable[[], bytes] | None) -> None:
        """`receive`: of the source that is open: closing and opening a device drops what has come meanwhile."""
        again = Again()
        while not self._ends.is_set():
            again.begins()
            try:
                with self._source_open:
                    self._keep(receive or self._source_open.enter_context(_opened(self._source)))
            except Exception as error:  # noqa: BLE001 - pyserial raises many kinds; all are tried again
                self._set("device", f"{self._source} has gone ({error}), and is opened again when it is back")
                self._ends.wait(max(_WAIT, again.pause()))
            receive = None
        self._store()

    def _keep(self, receive: Callable[[], bytes]) -> None:
        """Until the end; a serial line gives parts of sentences."""
        left = b""
        while not self._ends.is_set():
            with suppress(TimeoutError):
                left = (left + receive())[-_LARGEST:]
            end = max(left.rfind(b"\n"), left.rfind(b"\r")) + 1
            sentences, left = b"".join(sentences_in(left[:end])), left[end:]
            self._waiting = (self._waiting + sentences)[-_MOST_WAITING:]
            now = time.monotonic()
            self._came = now if sentences else self._came
            self._set("device", "")
            silent = f"no sentence has come at {self._source} for {_SILENT:.0f} s{_hint(self._source)}"
            self._set("silence", silent if now - self._came > _SILENT else "")
            self._store()

    def _store(self) -> None:
        """Write what waits, as far as the disk takes it."""
        try:
            if self._waiting:
                with self._path.open("ab", buffering=0) as file:
                    while self._waiting:
                        self._waiting = self._waiting[file.write(self._waiting) :]
        except OSError as error:
            words = f"{self._path} cannot be written ({error.strerror}); sentences wait in memory until there is room"
            self._set("disk", words)
        else:
            self._set("disk", "")

    def _set(self, what: str, fault: str) -> None:
        """Say that something is wrong, or no longer."""
        before = self._faults.get(what, "")
        self._faults[what] = fault
        if fault and not before:
            self.said.append(f"{_LISTENS}: {fault}")
        elif before and not fault:
            self.said.append(f"{_LISTENS}: comes again after: {before}")


def sentences_in(received: bytes) -> list[bytes]:
    """The sentences with a right checksum, each as a line."""
    found = [
        match for match in _SENTENCE.finditer(received) if reduce(lambda a, b: a ^ b, match[1]) == int(match[2], 16)
    ]
    return [match[0] + b"\r\n" for match in found]


def _hint(source: str) -> str:
    """What to look at where nothing comes."""
    return f"; senders on other computers need --nmea 0.0.0.0:{source}" if source.isdecimal() else ""


@contextmanager
def _opened(source: str) -> Generator[Callable[[], bytes]]:
    """A function that gives what has come, or raises TimeoutError."""
    if address := _ADDRESS.fullmatch(source):
        host, port = address[1] or _LOCAL, int(address[2])
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as listening:
            try:
                listening.bind((host, port))
            except (OSError, OverflowError) as error:
                raise InputError(f"{_LISTENS}: UDP port {source} cannot be used ({error}); choose another") from error
            listening.settimeout(_WAIT)
            yield lambda: listening.recv(_LARGEST) + b"\n"
        return
    name, _, baud = source.partition("@")
    serial = load_package("serial", "pyserial", _LISTENS, "live")
    try:
        line = serial.Serial(name, int(baud or _BAUD), timeout=_WAIT)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{_LISTENS}: {source} cannot be opened ({error}); give a UDP port, as 10110 or 0.0.0.0:10110, or a serial "
            "device"
        ) from error
    with line:
        yield lambda: line.read(max(1, line.in_waiting))
