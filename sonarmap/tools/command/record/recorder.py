"""Recording of a sonar's packets: receive them, write them to a file, count them by kind and number, and report the
status."""

import os
import shutil
import time
import zlib
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any

from google.protobuf.message import Message
from wlsonar import range_image_protocol as rip

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.record.receiver import Datagram, Receiver, Senders, Source, join, open_socket, system_buffer
from sonarmap.tools.files.readers.sonar.messages import (
    STRENGTH,
    Remembered,
    ShotNumbers,
    message_of,
    stamp_of,
)

_TICK = 1.0  # interval of reports [s]
_WAIT = 0.2  # longest delay until a requested end is noticed [s]
_OVER = 5  # ticks over which rates are averaged, and after which the file is flushed to the disk
_LEAST_DISK = 16 << 20  # free bytes needed to begin, about 15 s of packets
ENDING = ".sonar"


RANGES, STRENGTHS, SHADED, IMU = "range_images", "strength_images", "shaded_images", "imu_batches"
_REMEMBERED = 1024  # latest packets of a kind, among which duplicates are recognized
_WINDOW = 10.0  # period of which the packet with the shortest delay gives the clock's offset [s]


@dataclass(slots=True)
class Numbered:
    """Counts of the packets of one kind."""

    came: int = 0  # without duplicates
    doubled: int = 0  # duplicates
    numbers: ShotNumbers = field(default_factory=ShotNumbers)  # counts missing and late packets
    _seen: Remembered = field(default_factory=lambda: Remembered(_REMEMBERED))

    def add(self, number: int, stamp: float | None, content: bytes) -> None:
        """Count a packet by its number and its time [s, UTC]."""
        key = (number, zlib.crc32(content) if stamp is None else stamp)
        if not self._seen.is_new(key):
            self.doubled += 1
            return
        self.came += 1
        self.numbers.place(number, stamp)


@dataclass(slots=True)
class ClockOffset:
    """Offset of the sonar's clock, positive if it is ahead of this computer's [s]. Packets arrive later than their
    shots: in each ten seconds, the packet with the shortest delay gives the offset."""

    latest: float | None = None  # in the latest ten whole seconds; None before the first stamp
    _best: float | None = None
    _since: float = 0.0
    _windows: int = 0

    def add(self, stamp: float, arrival: float) -> None:
        """Add a shot's `stamp` by the sonar's clock, and its `arrival` by this computer's."""
        if self._best is None or abs(arrival - self._since) >= _WINDOW:  # abs, as this computer's clock may be set back
            self._windows += 1
            self._best, self._since, previous = stamp - arrival, arrival, self._best
            self.latest = self._best if previous is None else previous
        self._best = max(self._best, stamp - arrival)
        if self._windows == 1:
            self.latest = self._best


@dataclass(slots=True)
class Tally:
    """Counts of the sonar's packets."""

    packets: int = 0  # all that were recorded
    # of packets with numbers, by kind
    kinds: dict[str, Numbered] = field(
        default_factory=lambda: {kind: Numbered() for kind in (RANGES, STRENGTHS, SHADED, IMU)}
    )
    undocumented: int = 0  # of kinds that the protocol does not document
    unreadable: int = 0  # with a right checksum, but not a valid message
    clock: ClockOffset = field(default_factory=ClockOffset)  # of the sonar

    def add(self, packet: bytes, arrival: float) -> None:
        """Count a whole packet that arrived at a time by this computer's clock [s, UTC]."""
        self.packets += 1
        try:
            self._count(packet, arrival)
        except Exception:  # noqa: BLE001 - the packet is recorded, whatever its content is
            self.unreadable += 1

    def _count(self, packet: bytes, arrival: float) -> None:
        message = message_of(packet, rip.RangeImage, rip.BitmapImageGreyscale8, rip.ImuBatch)
        if message is None:
            self.undocumented += 1
        elif isinstance(message, rip.ImuBatch):
            first = message.timestamp[0] if message.timestamp else None
            stamp = None if first is None else first.seconds + first.nanos * 1e-9
            self.kinds[IMU].add(message.batch_sequence_id, stamp, packet)
        else:
            image: Any = message
            stamp = stamp_of(image)
            self.kinds[_kind_of(image)].add(image.header.sequence_id, stamp, packet)
            if stamp is not None:
                self.clock.add(stamp, arrival)

    @property
    def shots(self) -> int:
        """Number of range images, without duplicates."""
        return self.kinds[RANGES].came

    @property
    def missing(self) -> int:
        """Number of missing packets of all kinds, by the numbers of the others."""
        return sum(kind.numbers.missing for kind in self.kinds.values())

    @property
    def missing_share(self) -> float:
        """Share of missing packets among those with a number, 0..1."""
        came = sum(kind.came for kind in self.kinds.values())
        return self.missing / max(came + self.missing, 1)


def _kind_of(image: Message) -> str:
    if not isinstance(image, rip.BitmapImageGreyscale8):
        return RANGES
    return STRENGTHS if image.type == STRENGTH else SHADED


def require_free(out: Path, overwrite: bool) -> None:
    """Refuse a name that is none of a recording, or is taken (unless `overwrite`)."""
    if out.suffix != ENDING:
        raise InputError(f"{out} does not end in {ENDING}, by which recordings are recognized; try {out}{ENDING}")
    if out.is_dir():
        raise InputError(f"cannot write {out}: a folder of that name is there; choose another name")
    if out.exists() and not overwrite:
        raise InputError(f"{out} is there already; choose another name, or give --overwrite to replace it")


class PartFile:
    """NAME.part.sonar, which `finish` renames to NAME.sonar; NAME.part2.sonar if an earlier recording left that."""

    def __init__(self, out: Path, overwrite: bool) -> None:
        """Create an empty part file. Raises InputError: `out` cannot be written, or exists (unless `overwrite`)."""
        self.out, self.size, self._overwrite = out, 0, overwrite
        require_free(out, overwrite)
        number = 1
        while True:
            self.path = out.with_name(f"{out.stem}.part{number if number > 1 else ''}{ENDING}")
            try:
                out.parent.mkdir(parents=True, exist_ok=True)
                self._file = self.path.open("xb", buffering=0)  # a written packet survives the program
                return
            except FileExistsError:
                number += 1
            except OSError as error:
                raise InputError(
                    f"cannot write {self.path}: {error.strerror}. Check the folder's permissions, or choose another."
                ) from error

    def write(self, packet: bytes) -> None:
        """Append a whole packet, or nothing."""
        rest = memoryview(packet)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self.size)
            raise InputError(f"the recording ended, as {self.path} cannot grow: {error.strerror}; make room") from error
        self.size += len(packet)

    def sync(self) -> None:
        """Flush the file to the disk, in case the computer crashes."""
        with suppress(OSError):  # if the disk is full, `write` raises
            os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Rename the part file to `out`."""
        try:
            os.fsync(self._file.fileno())
            self._file.close()
            require_free(self.out, self._overwrite)
            self.path.replace(self.out)
        except OSError as error:
            raise InputError(f"cannot write {self.out}: {error.strerror}; the recording is in {self.path}") from error
        except InputError as error:
            raise InputError(f"{error}. The recording is in {self.path}.") from error

    def close(self) -> None:
        """Close the file without renaming it, and delete it if it is empty."""
        with suppress(OSError):
            self._file.close()
            if self.size == 0:
                self.path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class RecordSettings:
    """Settings of a recording."""

    source: Source  # where packets are received
    out: Path  # the file, NAME.sonar
    duration: float | None = None  # after which the recording ends [s]; None to record until it is stopped
    sonar: str | None = None  # address of the sonar to record; None for the first that sends
    overwrite: bool = False  # whether `out` may replace a file


@dataclass(slots=True)
class Status:
    """Status of a recording."""

    settings: RecordSettings
    path: Path  # of the file: the part file until the end
    buffer: int  # size of the system's receive buffer [bytes]
    tally: Tally = field(default_factory=Tally)  # counts of the sonar's packets
    senders: Senders = field(default_factory=Senders)  # the sonar, and counts of all other datagrams
    seconds: float = 0.0  # since the start
    silence: float = 0.0  # seconds since the last packet of the sonar, or since the start
    size: int = 0  # bytes written
    # rates over the latest five ticks [1/s]
    shot_rate: float = 0.0
    packet_rate: float = 0.0
    byte_rate: float = 0.0
    disk: int = 0  # free bytes of the disk
    unsaved: int = 0  # received datagrams that were lost, as the disk was too slow
    overflow: int = 0  # datagrams that the system lost, as this computer was too slow
    ticks: int = 0  # number of earlier reports

    @property
    def disk_lasts(self) -> float | None:
        """Time until the disk is full at the present rate [s]; None while nothing comes."""
        return self.disk / self.byte_rate if self.byte_rate > 0 else None


def record(settings: RecordSettings, follow: Callable[[Status], None], stop: Event) -> Status:
    """Record until the duration is over or `stop` is set, then rename the file; without packets no file remains.

    `follow` is called each second, also before the first packet, and at the end. Memory does not grow with the
    recording: at most `receiver.MOST_WAITING` datagrams wait for the disk."""
    with open_socket(settings.source) as listening:
        part = PartFile(settings.out, settings.overwrite)
        status = Status(settings, part.path, system_buffer(listening), senders=Senders(settings.sonar))
        try:
            status.disk = shutil.disk_usage(part.path.parent).free
            if status.disk < _LEAST_DISK:
                raise InputError(f"the disk of {part.path.parent} is nearly full; make room, or record to another disk")
            recording = _Recording(status, part, follow)
            with Receiver(listening) as receiver:
                recording.run(receiver, stop, lambda: join(listening, settings.source))
            if part.size:
                part.finish()
                status.path = part.out
        finally:
            part.close()
        with suppress(Exception):
            follow(status)
        return status


class _Recording:
    def __init__(self, status: Status, part: PartFile, follow: Callable[[Status], None]) -> None:
        self._status, self._part, self._follow = status, part, follow
        self._start = self._latest = time.monotonic()
        self._ticks = deque[tuple[float, int, int, int]](maxlen=_OVER + 1)  # time, shots, packets, bytes

    def run(self, receiver: Receiver, stop: Event, rejoin: Callable[[], object]) -> None:
        """Record until the end; `rejoin` is called while nothing comes, as an interface may have gone and come back."""
        end = self._start + (self._status.settings.duration or float("inf"))
        due = self._start
        while not stop.is_set() and (now := time.monotonic()) < end:
            if now >= due:
                self._tick(receiver, now)
                due += _TICK * (1 + (now - due) // _TICK)  # missed ticks are skipped
                if self._status.silence > _OVER:
                    with suppress(OSError):
                        rejoin()
            self._take(receiver.next(max(0.0, min(_WAIT, due - now, end - now))))
        receiver.end()
        for datagram in receiver.rest():
            self._take(datagram)
        self._tick(receiver, time.monotonic())

    def _take(self, datagram: Datagram | None) -> None:
        now = time.monotonic()
        if datagram is None or not self._status.senders.is_wanted(datagram, now):
            return
        self._part.write(datagram.content)
        self._latest = now
        self._status.tally.add(datagram.content, datagram.arrival)

    def _tick(self, receiver: Receiver, now: float) -> None:
        status = self._status
        status.seconds, status.silence, status.size = now - self._start, now - self._latest, self._part.size
        status.unsaved, status.overflow = receiver.unsaved, receiver.overflow
        with suppress(OSError):
            status.disk = shutil.disk_usage(self._part.path.parent).free
        if not status.tally.packets:
            self._ticks.clear()  # rates begin with the first packet
        totals = status.tally.shots, status.tally.packets, status.size
        self._ticks.append((now, *totals))
        then, *before = self._ticks[0]
        if now > then:
            rates = ((total - past) / (now - then) for total, past in zip(totals, before, strict=True))
            status.shot_rate, status.packet_rate, status.byte_rate = rates
        with suppress(Exception):  # an error in the display does not end the recording
            self._follow(status)
        status.ticks += 1
        if status.ticks % _OVER == 0:
            self._part.sync()
