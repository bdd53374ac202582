"""Navigation during a dive: NMEA sentences saved as they arrive, and growing files read for the key scans."""

import re
import socket
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
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

_TEXTS = (".csv", ".txt", ".tum", ".nmea", ".log")  # files whose last line may be incomplete


_GRACE = 10.0  # a file may be unreadable for this time, for example while it is created [s]


@dataclass(slots=True)
class Navigation:
    """Reads the navigation files, as the options say.

    Attributes:
        faults: what was wrong with them when they were last read, one sentence each.
        place: the map's on the Earth, if they gave it then.
    """

    priors: PriorsFile
    odometry: OdometryFile
    reading: NavigationReading
    fastest: float = float("inf")  # largest speed of the vehicle [m/s]
    origin: Georeference | None = None  # of the map; None for the first fix
    faults: list[str] = field(default_factory=list[str])
    place: Georeference | None = None
    _failed: dict[str, float] = field(default_factory=dict[str, float])  # since when a file cannot be read [s]

    def __post_init__(self) -> None:
        self._settings()
        _ = self.odometry.drift

    def __call__(self, scans: Sequence[Scan]) -> tuple[Sequence[Scan], Odometry | None]:
        """The scans with priors, and dead reckoning at their times, from the files. A file that has no data yet
        or cannot be read now changes nothing."""
        odometry, settings, self.faults = None, self._settings(), []
        now = max(scan.stamp for scan in scans)
        if self.priors.priors:
            with self._reading("--priors", now), ExitStack() as stack:
                paths = {path: stack.enter_context(_whole_lines(path)) for path in self.priors.priors}
                with _naming(paths):
                    navigated = navigate(scans, list(paths.values()), settings, allow_unknown=True)
                scans, self.place = navigated.scans, navigated.georeference
                self.faults += [_named(fault, paths) for fault in navigated.faults]
        if (file := self.odometry.odometry) is not None:
            with self._reading("--odometry", now), _whole_lines(file) as path, _naming({file: path}):
                odometry = read_odometry(path, scans, *self.odometry.drift, settings=settings)
        return scans, odometry

    @contextmanager
    def _reading(self, option: str, now: float) -> Generator[None]:
        """Within the block a file is read; what prevents it is a fault if it lasts. `now`: stamp of the last scan."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - no error of navigation may end the dive
            if now - self._failed.setdefault(option, now) >= _GRACE:
                self.faults.append(f"{option} is not used: {error}")
        else:
            self._failed.pop(option, None)

    def _settings(self) -> NavigationSettings:
        settings = self.reading.settings(*self.priors.priors, self.odometry.odometry, origin=self.origin)
        return replace(self.priors.applied(settings), fastest=self.fastest)


@contextmanager
def _naming(paths: Mapping[Path, Path]) -> Generator[None]:
    """Within the block errors name the files themselves, not their copies."""
    try:
        yield
    except InputError as error:
        raise InputError(_named(str(error), paths)) from error


def _named(words: str, paths: Mapping[Path, Path]) -> str:
    for path, copy in paths.items():
        words = words.replace(str(copy), str(path))
    return words


@contextmanager
def _whole_lines(path: Path) -> Generator[Path]:
    """The file itself, or, for a text file, a copy without its incomplete last line."""
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
_LARGEST = 1 << 16  # bytes received at once, and length of an incomplete sentence at most
_MOST_WAITING = 1 << 24  # bytes of sentences that wait for the disk: more than an hour
_MOST_SAID = 64  # alerts that wait to be shown
_WAIT = 0.3  # longest delay until a requested end is noticed [s]
_SILENT = 10.0  # silence that is reported [s]
_BAUD = 4800  # of NMEA 0183
_LISTENS = "navigation by --nmea"
_LOCAL = "127.0.0.1"
_ADDRESS = re.compile(r"(?:\[?([^/\\]*?)\]?:)?(\d+)")  # HOST:PORT, or PORT


class NavigationLog:
    """Appends received sentences to a file of the map's folder while it is open as a context. A device that was
    unplugged is opened again; sentences wait in memory while the disk is full. The source is a UDP port, such as
    10110 or 0.0.0.0:10110, or a serial device, such as /dev/ttyUSB0 or COM3@38400 (4800 baud by default)."""

    def __init__(self, source: str, out: Path) -> None:
        self.said = deque[str](maxlen=_MOST_SAID)  # alerts to show
        self._source, self._path = source, out / NAME
        self._waiting = b""
        self._faults = dict[str, str]()  # present faults by kind; "" for none
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
        """Receive until the end, and open the source again if it fails. `receive` reads it as it was opened first."""
        again = Again()
        while not self._ends.is_set():
            again.begins()
            try:
                with self._source_open:
                    self._keep(receive or self._source_open.enter_context(_opened(self._source)))
            except Exception as error:  # noqa: BLE001 - pyserial raises many types
                self._set("device", f"{self._source} has gone ({error}), and is opened again when it is back")
                self._ends.wait(max(_WAIT, again.pause()))
            receive = None
        self._store()

    def _keep(self, receive: Callable[[], bytes]) -> None:
        """Save sentences until the end. A serial line delivers them in pieces."""
        rest = b""
        while not self._ends.is_set():
            with suppress(TimeoutError):
                rest = (rest + receive())[-_LARGEST:]
            end = max(rest.rfind(b"\n"), rest.rfind(b"\r")) + 1
            sentences, rest = b"".join(sentences_in(rest[:end])), rest[end:]
            self._waiting = (self._waiting + sentences)[-_MOST_WAITING:]
            now = time.monotonic()
            self._came = now if sentences else self._came
            self._set("device", "")
            silent = f"no sentence has come at {self._source} for {_SILENT:.0f} s{_hint(self._source)}"
            self._set("silence", silent if now - self._came > _SILENT else "")
            self._store()

    def _store(self) -> None:
        """Write the waiting sentences; they stay in memory while the disk is full."""
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

    def _set(self, kind: str, fault: str) -> None:
        """Set the fault of a kind, "" for none, and report it if it begins or ends."""
        before = self._faults.get(kind, "")
        self._faults[kind] = fault
        if fault and not before:
            self.said.append(f"{_LISTENS}: {fault}")
        elif before and not fault:
            self.said.append(f"{_LISTENS}: resolved: {before}")


def sentences_in(received: bytes) -> list[bytes]:
    """The sentences with a correct checksum, each as a line."""
    found = [
        match for match in _SENTENCE.finditer(received) if reduce(lambda a, b: a ^ b, match[1]) == int(match[2], 16)
    ]
    return [match[0] + b"\r\n" for match in found]


def _hint(source: str) -> str:
    """Advice for a silent source."""
    return f"; senders on other computers need --nmea 0.0.0.0:{source}" if source.isdecimal() else ""


@contextmanager
def _opened(source: str) -> Generator[Callable[[], bytes]]:
    """Open a source; a function that returns received bytes, or raises TimeoutError."""
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
            f"{_LISTENS}: {source} cannot be opened ({error}); give a UDP port, such as 10110, or a serial device"
        ) from error
    with line:
        yield lambda: line.read(max(1, line.in_waiting))
