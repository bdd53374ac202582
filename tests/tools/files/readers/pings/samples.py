"""A line made by hand, no two numbers of it alike, and writers of it: GSF by its library, XTF by struct."""
# as pyxtf has ctypes where Python has numbers

import ctypes
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyxtf
from gsfpy3_09 import bindings
from gsfpy3_09.enums import FileMode, RecordType
from gsfpy3_09.gsfDataID import c_gsfDataID
from gsfpy3_09.gsfRecords import c_gsfRecords

START = 1700000000.25  # [s, UTC]: 2023-11-14 22:13:20.25
SPEED = 1487.5  # of sound [m/s]
OFFSET, DRAFT = (6.5, 1.75, 4.25), 3.5  # of the transducer: forward, starboard, down of the reference point; draft [m]


@dataclass(frozen=True, slots=True)
class Sample:
    """P pings of n soundings each.

    Attributes:
        stamps: (P,) float64 [s, UTC].
        fixes: (P, 2) float64 latitude, longitude [deg].
        attitudes: (P, 3) float64 [deg] roll, pitch, heading.
        heave: (P,) float64 [m], up.
        points: (P, n, 3) float64 [m] forward, starboard, down, in level frames.
        rejected: (P, n) bool.
    """

    stamps: np.ndarray
    fixes: np.ndarray
    attitudes: np.ndarray
    heave: np.ndarray
    points: np.ndarray
    rejected: np.ndarray = field(repr=False)

    def first(self, count: int) -> "Sample":
        return replace(self, **{name: getattr(self, name)[:count] for name in self.__slots__})

    @property
    def kept(self) -> np.ndarray:
        """(N, 3) forward, port, up of what is not rejected."""
        return self.points[~self.rejected] * [1, -1, -1]


def sample(count: int = 12, beams: int = 9) -> Sample:
    """A vehicle on a curve, far from the equator and the prime meridian."""
    k = np.arange(count)
    across = np.linspace(-18.0, 23.0, beams)
    points = np.zeros((count, beams, 3))
    points[..., 0] = 0.5 + 0.25 * k[:, None] - 0.125 * np.arange(beams)
    points[..., 1] = across + 0.5 * k[:, None]
    points[..., 2] = 31.0 + 0.2 * across + 0.75 * k[:, None]
    rejected = np.zeros((count, beams), bool)
    rejected[1::3, 2], rejected[2:3, beams - 1] = True, True
    return Sample(
        stamps=START + 0.5 * k,
        fixes=np.column_stack([58.123456 + 2e-5 * k, -11.654321 + 3e-5 * k]),
        attitudes=np.column_stack([3.25 + 0.5 * k, -1.5 + 0.25 * k, 37.25 + 1.25 * k]),
        heave=0.125 * k - 0.5,
        points=points,
        rejected=rejected,
    )


LINE = sample()


def write_gsf(
    path: Path, line: Sample, tide: float = 0.0, ignored: tuple[int, ...] = (), flags: bool = True,
    words: Sequence[bytes] = (), **header: float,
) -> Path:  # fmt: skip
    """By the GSF library. `tide`: the corrector that was added to depths [m]; `ignored`: pings that are marked so;
    `words`: further parameters; `header`: fields of all pings."""
    opened, identity = ctypes.c_int(), c_gsfDataID()
    assert bindings.gsfOpen(str(path).encode(), FileMode.GSF_CREATE, ctypes.byref(opened)) == 0
    record = c_gsfRecords()
    words = [*words, b"APPLIED_DRAFT=%+06.2f" % DRAFT, b"APPLIED_TRANSDUCER_OFFSET=%+06.2f,%+06.2f,%+06.2f" % OFFSET]
    parameters = record.process_parameters
    parameters.param_time.tv_sec, parameters.number_parameters = int(START), len(words)
    held = [ctypes.create_string_buffer(word) for word in words]
    for k, text in enumerate(held):
        parameters.param_size[k] = len(text)
        parameters.param[k] = ctypes.cast(text, ctypes.POINTER(ctypes.c_char))
    identity.recordID = RecordType.GSF_RECORD_PROCESSING_PARAMETERS
    assert bindings.gsfWrite(opened, ctypes.byref(identity), ctypes.byref(record)) > 0
    for k in range(len(line.stamps)):
        _write_ping(opened, line, k, tide, k in ignored, flags, header)
    assert bindings.gsfClose(opened) == 0
    return path


def _write_ping(
    opened: ctypes.c_int, line: Sample, k: int, tide: float, ignored: bool, flags: bool, header: dict[str, float]
) -> None:
    record, identity = c_gsfRecords(), c_gsfDataID()
    ping, beams = record.mb_ping, line.points.shape[1]
    ping.ping_time.tv_sec, ping.ping_time.tv_nsec = int(line.stamps[k]), round(line.stamps[k] % 1 * 1e9)
    ping.longitude, ping.latitude = line.fixes[k]  # as gsfpy has them the wrong way round
    ping.number_beams, ping.ping_flags, ping.tide_corrector = beams, int(ignored), tide
    ping.roll, ping.pitch, ping.heading = line.attitudes[k]
    ping.heave, ping.height, ping.sep = -line.heave[k], 9999.99, 9999.99
    for name, value in header.items():
        setattr(ping, name, value)
    held = [np.ascontiguousarray(line.points[k, :, axis]) for axis in (2, 1, 0)]
    held[0] += tide
    for which, (name, values) in enumerate(zip(("depth", "across_track", "along_track"), held, strict=True), 1):
        setattr(ping, name, values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))
        factors = ctypes.byref(ping.scaleFactors)
        assert bindings._libgsf.gsfLoadScaleFactor(factors, which, b"\x40", ctypes.c_double(0.001), 100) == 0
    marks = np.ascontiguousarray(line.rejected[k], np.uint8)
    if flags:
        ping.beam_flags = marks.ctypes.data_as(ctypes.POINTER(ctypes.c_ubyte))
    identity.recordID = RecordType.GSF_RECORD_SWATH_BATHYMETRY_PING
    assert bindings.gsfWrite(opened, ctypes.byref(identity), ctypes.byref(record)) > 0


@dataclass(frozen=True, slots=True)
class Beams:
    """What an R2Sonic measures: two-way times [s] and angles [rad] (n,), and four flags (n,)."""

    times: np.ndarray
    angles: np.ndarray
    flags: np.ndarray


def xtf(
    line: Sample, beams: list[Beams], *, kind: int = 65, units: int = 3, equal_angles: bool = False,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0), lag: float | None = None, tide: float = 0.0, raw: bool = False,
    deep: float = 1.5,
) -> bytes:  # fmt: skip
    """Of pings with these beams. `mount`: roll, pitch, yaw of the array [deg]. `lag`: the motion is in packets of
    its own, pings come so much later [s] and have none. `raw`: positions are in such packets, too.
    `deep`: the transducer, 0 where that is not said."""
    header = pyxtf.XTFFileHeader()
    header.NavUnits, header.NumberOfBathymetryChannels = units, 1
    # pyrefly: ignore[unsupported-operation]
    channel = header.ChanInfo[0]
    channel.TypeOfChannel, channel.OffsetX, channel.OffsetY = 3, OFFSET[1], OFFSET[0]
    channel.OffsetRoll, channel.OffsetPitch, channel.OffsetYaw = mount
    parts = [bytes(header)]
    for k, each in enumerate(beams):
        parts += [_attitude_packet(line, k)] if lag is not None else []
        parts += [_position_packet(line, k)] if raw else []
        body = bth0(line.stamps[k] + (lag or 0.0), each, equal_angles)
        head = pyxtf.XTFPingHeader()
        head.MagicNumber, head.HeaderType, head.NumBytesThisRecord = 0xFACE, kind, 256 + len(body)
        head.SensorYcoordinate, head.SensorXcoordinate = (0, 0) if raw else line.fixes[k]
        shown = line.attitudes[k] if lag is None else (0.0, 0.0, 0.0)
        head.SensorRoll, head.SensorPitch, head.SensorHeading = shown
        head.Heave, head.SensorDepth, head.OceanTide = line.heave[k], deep, tide
        parts += [bytes(head), body]
    return b"".join(parts)


def _attitude_packet(line: Sample, k: int) -> bytes:
    packet = pyxtf.XTFAttitudeData()
    packet.Roll, packet.Pitch, packet.Heading = line.attitudes[k]
    packet.Heave, packet.Millisecond = line.heave[k], int(line.stamps[k] % 1 * 1e3)
    return _dated(packet, 3, line.stamps[k])


def _position_packet(line: Sample, k: int) -> bytes:
    packet = pyxtf.XTFPosRawNavigation()
    packet.RawYcoordinate, packet.RawXcoordinate = line.fixes[k]
    packet.Microsecond = int(line.stamps[k] % 1 * 1e4)
    return _dated(packet, 107, line.stamps[k])


def _dated(packet: pyxtf.XTFPacketStart, kind: int, stamp: float) -> bytes:
    packet.MagicNumber, packet.HeaderType, packet.NumBytesThisRecord = 0xFACE, kind, 64
    moment = datetime.fromtimestamp(stamp, UTC)
    packet.Year, packet.Month, packet.Day = moment.year, moment.month, moment.day
    packet.Hour, packet.Minute, packet.Second = moment.hour, moment.minute, moment.second
    return bytes(packet)


def bth0(stamp: float, beams: Beams, equal_angles: bool = False) -> bytes:
    """A packet of an R2Sonic."""
    count, scale = len(beams.times), 1e-6
    header = struct.pack(
        ">12s12sIIIff", b"2024", b"100017", int(stamp), round(stamp % 1 * 1e9), 7, 0.05, SPEED
    )  # fmt: skip
    header = header.ljust(110, b"\0") + struct.pack(">H", count)
    if equal_angles:
        angles = b"A0", struct.pack(">ff", beams.angles[0], beams.angles[-1]) + bytes(24)
    else:
        steps = np.diff(beams.angles, prepend=beams.angles[0]) / scale / 10
        angles = b"A2", struct.pack(">ff", beams.angles[0], scale * 10) + bytes(24) + _shorts(steps)
    flags = np.append(beams.flags, np.zeros(-count % 8, np.uint8)).astype(np.uint8)
    sections = [
        (b"H0", header),
        (b"R0", struct.pack(">f", scale) + _shorts(beams.times / scale)),
        angles,
        (b"Q0", (flags[0::2] << 4 | flags[1::2]).tobytes()),
    ]
    body = b"".join(name + struct.pack(">H", len(part) + 4) + part for name, part in sections)
    return struct.pack(">4sII", b"BTH0", len(body) + 12, 0) + body


def _shorts(values: np.ndarray) -> bytes:
    packed = np.round(values).astype(">u2").tobytes()
    return packed + bytes(-len(packed) % 4)


def fan(pings: int, count: int = 10) -> list[Beams]:
    """Beams of a fan, the third rejected by a check, the last without a detection."""
    flags = np.full(count, 0b1011)
    flags[3:], flags[2], flags[-1] = 0b0111, 0b1001, 0b0011
    angles = np.linspace(-0.7, 0.9, count)
    return [Beams(0.04 + 0.001 * np.arange(count) + 0.0005 * k, angles, flags) for k in range(pings)]
