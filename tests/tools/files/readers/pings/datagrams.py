"""Writers of Kongsberg's datagrams, by struct after the tables of the manual, in either byte order."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tests.tools.files.readers.pings.kmall_file import kmall
from tests.tools.files.readers.pings.samples import LINE, SPEED, START, Sample, fan, write_gsf, xtf

LAYOUT = "WLZ=1.50,SMH=101,STC=1,S1X=6.50,S1Y=1.75,S1Z=4.25,P1X=-2.25,P1Y=0.75,P1Z=-9.00,APS=0,"
DEPTHS = 2.5  # of the transducer [m]
SUFFIXES = (".gsf", ".xtf", ".all", ".mb56", ".kmall")  # .mb56 is a .all file of depth datagrams


@dataclass(frozen=True, slots=True)
class Recorder:
    """An echo sounder of a model that writes numbers in this order, and perhaps its sizes in another."""

    model: int = 2040
    order: str = "<"
    sizes: str | None = None

    def pack(self, layout: str, *values: float) -> bytes:
        return struct.pack(self.order + layout, *values)

    def datagram(self, kind: str, stamp: float, content: bytes, serial: int = 101, wrong_sum: bool = False) -> bytes:
        moment = datetime.fromtimestamp(round(stamp, 3), UTC)
        date = moment.year * 10000 + moment.month * 100 + moment.day
        day = ((moment.hour * 60 + moment.minute) * 60 + moment.second) * 1000 + moment.microsecond // 1000
        inner = self.pack("BHIIHH", ord(kind), self.model, date, day, 5, serial) + content
        whole = b"\x02" + inner + b"\x03" + self.pack("H", (sum(inner) + wrong_sum) & 0xFFFF)
        return struct.pack((self.sizes or self.order) + "I", len(whole)) + whole

    def installation(self, text: str, second: int = 0) -> bytes:
        return self.datagram("I", START, self.pack("H", second) + text.encode() + b"\0")

    def position(
        self, stamp: float, latitude: float, longitude: float, system: int = 0x81, speed: int = 0, course: int = 0
    ) -> bytes:
        """Speed [cm/s] and course [0.01 deg] over ground are 0xFFFF where unknown."""
        place = round(latitude * 2e7), round(longitude * 1e7)
        content = self.pack("iiHHHHBB", *place, 0, speed, course, 0, system, 3)
        return self.datagram("P", stamp, content + b"GGA")

    def motion(self, stamp: float, rows: list[tuple[float, float, float]], system: int = 0, status: int = 0) -> bytes:
        """Rows of seconds after the stamp, roll and pitch [deg]."""
        packed = [
            self.pack("HHhhhH", round(1000 * t), status, round(100 * r), round(100 * p), 0, 0) for t, r, p in rows
        ]
        return self.datagram("A", stamp, self.pack("H", len(rows)) + b"".join(packed) + bytes([system]))

    def network_motion(self, stamp: float, rows: list[tuple[float, float, float]], system: int = 0x20) -> bytes:
        """The same by network: each with a copy of what the sensor sent, of some length."""
        packed = [
            self.pack("HhhhHB", round(1000 * t), round(100 * r), round(100 * p), 0, 0, 7 + k) + bytes(7 + k)
            for k, (t, r, p) in enumerate(rows)
        ]
        return self.datagram("n", stamp, self.pack("HBB", len(rows), system, 0) + b"".join(packed) + b"\0")

    def swath(self, line: Sample, k: int, depth: float, serial: int = 101) -> bytes:
        """XYZ 88 of a ping, whose points are down from the transducer at this depth [m]."""
        beams = line.points.shape[1]
        rows = list[bytes]()
        for n, ((x, y, z), rejected) in enumerate(zip(line.points[k], line.rejected[k], strict=True)):
            detection, cleaning = (0x80 if rejected and n % 2 else 1), (-3 if rejected and n % 2 == 0 else 0)
            rows.append(self.pack("fffHBbBbh", z - depth, y, x, 10, 20, 0, detection, cleaning, -200))
        head = self.pack(
            "HHfHHfBBBB", round(100 * line.attitudes[k, 2]), round(10 * SPEED), depth, beams, beams, 1e4, *[0] * 4
        )
        return self.datagram("X", line.stamps[k], head + b"".join(rows) + b"\0", serial)

    def depths(
        self, line: Sample, k: int, depth: float, serial: int = 101, *, units: tuple[int, int] = (1, 2), rate: int = 0,
        first: int = 1,
    ) -> bytes:  # fmt: skip
        """The older form (D), of what is not rejected, with units of depth and of distance [cm]; `first` is the number
        of the first beam."""
        kept = np.flatnonzero(~line.rejected[k])
        head = self._depths_head(line, k, depth, len(kept), units, rate)
        rows = [
            self.pack("HhhhHHBBbB", *self._beam(line.points[k, n], depth, units), 9000, 0, 100, 200, 10, -40, first + n)
            for n in kept.tolist()
        ]
        multiplier = self.pack("b", int(np.floor(depth / 655.36)))
        return self.datagram("D", line.stamps[k], head + b"".join(rows) + multiplier, serial)

    def processed_depths(self, line: Sample, k: int, depth: float, serial: int = 101) -> bytes:
        """As MB-System has them: with a place and a speed of the ping, and a flag of each beam."""
        place = self.pack("iiH", round(line.fixes[k, 0] * 2e7), round(line.fixes[k, 1] * 1e7), 150)
        head = place + self._depths_head(line, k, depth, line.points.shape[1], (1, 2), 0)
        rows = [
            self.pack(
                "HhhhHHBBhBB", *self._beam(point, depth, (1, 2)), 9000, 0, 100, 200, 10, -40, n + 1, 2 * int(flagged)
            )
            for n, (point, flagged) in enumerate(zip(line.points[k], line.rejected[k], strict=True))
        ]
        return self.datagram("\xe1", line.stamps[k], head + b"".join(rows) + b"\0", serial)

    def processed_swath(self, line: Sample, k: int, depth: float, serial: int = 101, heave: bool = False) -> bytes:
        """The same of XYZ 88; `heave`: the later form with one of each beam."""
        place = [round(line.fixes[k, 0] * 2e7), round(line.fixes[k, 1] * 1e7)]
        ping = [round(100 * line.attitudes[k, 2]), 0, 0, 0, 150, round(10 * SPEED), depth, line.points.shape[1], 3, 1e4]
        rows = [
            self.pack("fffHBbBbhfff" + "f" * heave, z - depth, y, x, 10, 20, 0, 0x80, -1, 0, *[0.0] * (3 + heave))
            + bytes([int(flagged), 0])
            for (x, y, z), flagged in zip(line.points[k], line.rejected[k], strict=True)
        ]
        content = self.pack("iiHhhhHHfHHfI", *place, *ping, 0) + b"".join(rows) + b"\0"
        return self.datagram("\xe5" if heave else "\xe3", line.stamps[k], content, serial)

    def _depths_head(self, line: Sample, k: int, depth: float, count: int, units: tuple[int, int], rate: int) -> bytes:
        turned, below = round(100 * line.attitudes[k, 2]), round(100 * depth) % 65536
        return self.pack("HHHBBBBh", turned, round(10 * SPEED), below, 254, count, *units, rate)

    def _beam(self, point: np.ndarray, depth: float, units: tuple[int, int]) -> list[int]:
        z, across, along = np.round(
            100 * (point[[2, 1, 0]] - [depth, 0, 0]) / np.array(units)[[0, 1, 1]].clip(1)
        ).astype(int)
        return [int(z) % 65536, int(across), int(along)]

    def file(
        self, line: Sample, layout: str = LAYOUT, heads: tuple[int, ...] = (101,), second: int = 0,
        swath: Callable[..., bytes] | None = None,
    ) -> bytes:  # fmt: skip
        """A .all file whose positions and attitudes are between its pings, and lie on a straight line."""
        parts, rate = [self.installation(layout, second)], np.diff(line.stamps)[0]
        for k in range(len(line.stamps)):
            early = -0.4  # of the time between pings
            fix = line.fixes[k] + early * np.diff(line.fixes, axis=0)[0]
            roll, pitch, _ = line.attitudes[k] + early * np.diff(line.attitudes, axis=0)[0]
            stamp = line.stamps[k] + early * rate
            parts += [self.position(stamp, *fix), self.position(stamp, 1.0, 2.0, system=0x02)]
            parts += [self.motion(stamp - 0.1, [(0.1, roll, pitch)]), self.motion(stamp, [(0.0, 77.0, 66.0)], system=2)]
            parts.append((swath or self.swath)(line, k, DEPTHS, heads[k % len(heads)]))
        return b"".join(parts)


EM = Recorder()
OLD = Recorder(model=3000, order=">")


def written(folder: Path, suffix: str, line: Sample = LINE) -> Path:
    """A good file of a format."""
    path = folder / f"line{suffix}"
    if suffix == ".gsf":
        return write_gsf(path, line)
    if suffix == ".xtf":
        path.write_bytes(xtf(line, fan(len(line.stamps))))
    elif suffix == ".kmall":
        path.write_bytes(kmall(line))
    else:
        path.write_bytes(EM.file(line) if suffix == ".all" else OLD.file(line, swath=OLD.depths))
    return path
