"""What has come of a sonar's packets: how many of each kind, what is missing by their numbers, and its clock."""

import zlib
from dataclasses import dataclass, field
from typing import Any

from google.protobuf.message import Message
from wlsonar import range_image_protocol as rip

from sonarmap.tools.files.readers.sonar.messages import (
    STRENGTH,
    Remembered,
    ShotNumbers,
    message_of,
    range_image_type,
    stamp_of,
)

RANGES, STRENGTHS, SHADED, IMU = "range_images", "strength_images", "shaded_images", "imu_batches"
_REMEMBERED = 1024  # packets of a kind, among which doubled ones are recognized
_WINDOW = 10.0  # seconds in which the packet that took the shortest time tells the clock


@dataclass(slots=True)
class Numbered:
    """Packets of one kind."""

    came: int = 0  # each once
    doubled: int = 0  # those that came again
    # count what is missing between the first and the last, and what came late
    numbers: ShotNumbers = field(default_factory=ShotNumbers)
    _seen: Remembered = field(default_factory=lambda: Remembered(_REMEMBERED))

    def add(self, number: int, stamp: float | None, content: bytes) -> None:
        """A packet has come, with its number and its time [s, UTC]."""
        key = (number, zlib.crc32(content) if stamp is None else stamp)
        if not self._seen.is_new(key):
            self.doubled += 1
            return
        self.came += 1
        self.numbers.place(number, stamp)


@dataclass(slots=True)
class ClockOffset:
    """By how much the sonar's clock is ahead of this computer's [s].

    A stamp is of the shot, and the packet arrives later: of the packets of ten seconds the one that took the least time
    counts, and what it took still makes the sonar's clock seem behind.
    """

    first: float | None = None  # in the first ten seconds; None until a stamp has come
    latest: float | None = None  # in the latest ten whole seconds
    _best: float | None = None
    _since: float = 0.0
    _windows: int = 0

    def add(self, stamp: float, arrival: float) -> None:
        """A shot was taken at `stamp` by the sonar's clock, and came at `arrival` by this computer's."""
        if self._best is None or abs(arrival - self._since) >= _WINDOW:  # this computer's clock may be set, too
            self._windows += 1
            self._best, self._since, previous = stamp - arrival, arrival, self._best
            self.latest = self._best if previous is None else previous
        self._best = max(self._best, stamp - arrival)
        if self._windows == 1:
            self.first = self.latest = self._best


@dataclass(slots=True)
class Tally:
    """The sonar's packets."""

    packets: int = 0  # all that were recorded
    # those with numbers, by kind
    kinds: dict[str, Numbered] = field(
        default_factory=lambda: {kind: Numbered() for kind in (RANGES, STRENGTHS, SHADED, IMU)}
    )
    undocumented: int = 0  # of kinds that the protocol does not document
    unreadable: int = 0  # with a right checksum, and content that is no message
    clock: ClockOffset = field(default_factory=ClockOffset)  # of the sonar

    def add(self, packet: bytes, arrival: float) -> None:
        """A whole packet has come, at a time by this computer's clock [s, UTC]."""
        self.packets += 1
        try:
            self._count(packet, arrival)
        except Exception:  # noqa: BLE001 - the packet is recorded, whatever its content is
            self.unreadable += 1

    def _count(self, packet: bytes, arrival: float) -> None:
        message = message_of(packet, range_image_type(), rip.BitmapImageGreyscale8, rip.ImuBatch)
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
        """Range images, each once."""
        return self.kinds[RANGES].came

    @property
    def missing(self) -> int:
        """Packets of all kinds that did not come, by the numbers of those that did."""
        return sum(kind.numbers.missing for kind in self.kinds.values())

    @property
    def missing_share(self) -> float:
        """Of all packets that have a number."""
        came = sum(kind.came for kind in self.kinds.values())
        return self.missing / max(came + self.missing, 1)


def _kind_of(image: Message) -> str:
    if not isinstance(image, rip.BitmapImageGreyscale8):
        return RANGES
    return STRENGTHS if image.type == STRENGTH else SHADED
