"""A writer of Kongsberg's .kmall, by struct after the tables of its description."""

import struct
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tests.tools.files.readers.pings.samples import SPEED, Sample

WATER, DEPTH, HEIGHT = 0.75, 2.5, 45.5  # water line below the reference point; transducer below that; ellipsoid [m]
LAYOUT = (
    "OSCV:Empty,EMXV:EM2042,\nSYSTEM:EM 2042 - Single Tx single Rx,TRAI_TX1:N=5001;X=6.500;Y=1.750;Z=4.250;R=0.045;"
    "IPX=0.1;ICY=0.2,TRAI_TX2:N=5002;X=-1.500;Y=0.250;Z=2.000,POSI_1:X=-0.100;Y=-0.100;Z=0.000;U=ACTIVE,\n"
)
UNKNOWN = 200.0  # a latitude
ACTIVE = 0x01


def datagram(kind: str, stamp: float, content: bytes, model: int = 2042) -> bytes:
    size = 20 + len(content) + 4
    whole, rest = int(stamp), round(stamp % 1 * 1e9)
    return struct.pack("<I4sBBHII", size, kind.encode(), 3, 40, model, whole, rest) + content + struct.pack("<I", size)


def installation(stamp: float, text: str = LAYOUT) -> bytes:
    return datagram("#IIP", stamp, struct.pack("<3H", 6 + len(text), 0, 0) + text.encode())


def ping(
    line: Sample, k: int, *, parts: int = 1, fix: tuple[float, float] | None = None, transmitter: int = 0,
    longer: int = 0, kinds: np.ndarray | None = None, height: float = HEIGHT,
) -> list[bytes]:  # fmt: skip
    """The datagram of a ping, split in `parts`. `longer`: bytes that a later version adds to each structure; `kinds`:
    (n, 3) type, method and class of detections; else those that `rejected` says, in turns."""
    beams, more = line.points.shape[1], bytes([7] * longer)
    latitude, longitude = line.fixes[k] if fix is None else fix
    content = struct.pack("<2H8B", 12 + longer, k, 1, 0, 1, 0, transmitter, 0, 1, 0) + more
    modes = [5.0, *[0] * 7, *[1.0] * 11, *[0] * 6, *[2.0] * 3, 0, 0, 3.0]
    content += struct.pack("<2Hf6BH11f2h2BHI3f2Hf", 152 + longer, 0, *modes)
    content += struct.pack("<2H6f", 2, 48 + longer, line.attitudes[k, 2], SPEED, DEPTH, WATER, -0.1, -0.2)
    content += struct.pack("<4B2d2f4B", 1, 0, 0, 0, latitude, longitude, height, 0.0, 1, 2, 3, 4) + more
    content += 2 * (struct.pack("<4B7f2BH3f", *[1] * 4, *[1.5] * 7, *[1] * 3, *[0.0] * 3) + more)
    counts = [32 + longer, beams - 1, beams, 120 + longer, *[1e4] * 4, 0, 1, 2, 4 + longer]
    content += struct.pack("<4H4f4H", *counts) + more
    content += 2 * (struct.pack("<HbB", 1, 0, 0) + more)
    for n, (x, y, z) in enumerate(line.points[k].tolist()):
        kind, method, group = _rejected(n) if line.rejected[k, n] else (0, 1 + n % 2, 0)
        if kinds is not None:
            kind, method, group = kinds[n].tolist()
        content += struct.pack("<H8BH6f2H14f", n, 0, kind, method, 0, 99, 0, group, 0, 0, *[3.5] * 6, n, 9, *[4.5] * 14)
        content += struct.pack("<4f4H", z + WATER, y, x, 0.0, 0, 5, 6, 7) + more
    content += bytes(90)  # samples of the seabed's image
    ends = np.linspace(0, len(content), parts + 1).astype(int).tolist()
    return [
        datagram("#MRZ", line.stamps[k], struct.pack("<2H", parts, n) + content[a:b])
        for n, (a, b) in enumerate(pairwise(ends), 1)
    ]


def _rejected(n: int) -> tuple[int, int, int]:
    """Type, method and class of a rejected detection: rejected, none, or an extra one of a disabled class."""
    return ((2, 1, 0), (0, 0, 0), (1, 1, 103))[n % 3]


def position(
    stamp: float, fix: Sequence[float], *, status: int = ACTIVE, system: int = 0, speed: float = -1.0,
    course: float = -4.0, short: bool = False,
) -> bytes:  # fmt: skip
    """`short`: nothing after latitude and longitude."""
    content = struct.pack("<4H2If2d", 8, system, status, 0, int(stamp), 5, 0.07, *fix)
    rest = b"" if short else struct.pack("<3f", speed, course, 45.0) + b"$GGA,1*2A\r\n"
    return datagram("#SPO", stamp, content + rest)


def motion(
    rows: Sequence[tuple[float, float, float]], *, status: int = ACTIVE, system: int = 0, wrong: Sequence[int] = ()
) -> bytes:
    """Rows of stamp, roll and pitch [deg]; those of the indices `wrong` are flagged."""
    samples = b"".join(
        struct.pack("<4s2H3I2d", b"#KMB", 120, 1, int(t), round(t % 1 * 1e9), 2 * (n in wrong), 11.0, 22.0)
        + struct.pack("<21f2If", 45.0, roll, pitch, *[33.0] * 18, 1, 2, 0.5)
        for n, (t, roll, pitch) in enumerate(rows)
    )
    head = struct.pack("<H2B4H", 12, system, status, 1, len(rows), 132, 0x7F)
    return datagram("#SKM", rows[0][0], head + samples)


def kmall(line: Sample, parts: int = 1, longer: int = 0) -> bytes:
    """A file with attitudes between its pings, on a straight line, and datagrams that are not read."""
    content, rate = [installation(line.stamps[0])], np.diff(line.stamps)[0]
    for k in range(len(line.stamps)):
        stamp = line.stamps[k] - 0.4 * rate
        roll, pitch, _ = line.attitudes[k] - 0.4 * np.diff(line.attitudes, axis=0)[0]
        content += [datagram("#SVT", stamp, bytes(44)), position(stamp, (1.0, 2.0))]
        content += [motion([(stamp, roll, pitch)]), motion([(stamp, 77.0, 66.0)], status=0, system=1)]
        content += ping(line, k, parts=parts, longer=longer)
    return b"".join(content)
