"""Pings that a reader took from a file, one by one, as one line; and values between two times."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.pings.recorded import RecordedLine

_FARTHEST = 15_000.0  # meters between a vehicle and what its echo sounder can reach; the ocean is 11 km deep
_LATEST = 4102444800.0  # the year 2100 [s, UTC]: a stamp beyond is damage
_LONGEST = 2 * 86400.0  # seconds between a ping of a file and the median one
_WIDEST = 1.0  # degrees of latitude or longitude between them


@dataclass(frozen=True, slots=True)
class RecordedPing:
    """One ping, in the frame of `PingLine`; numbers that the file has wrong are sorted out by `assembled`."""

    stamp: float  # [s, UTC]
    fix: tuple[float, float, float]  # latitude, longitude [deg], and height of the level that depths count from [m]
    attitude: tuple[float, float, float]  # roll, pitch, heading [rad]
    sensor: np.ndarray  # (3,) [m]
    points: np.ndarray  # (n, 3) float64 [m], those that are not rejected
    beams: int  # soundings in all


def assembled(
    name: str, pings: Sequence[RecordedPing], echo_sounder: str, sound_speeds: Sequence[float], notes: Sequence[str]
) -> RecordedLine:
    """The line of these pings, in the order of their stamps. Raises InputError: no ping has a stamp, a fix and
    soundings that can be."""
    kept, faults = _usable(pings) if pings else ([], [])
    if not kept:
        why = f"; {'; '.join([*notes, *faults])}" if notes or faults else ""
        raise InputError(f"no ping with a time, a position and soundings in it{why}; give a recorded line")
    points = [ping.points for ping in kept]
    near = [(np.abs(each) <= _FARTHEST).all(axis=1) for each in points]  # NaN is left out too
    points = [each[good] for each, good in zip(points, near, strict=True)]
    counts, beams = [len(each) for each in points], sum(ping.beams for ping in kept)
    if not sum(counts):
        raise InputError(f"all {beams:,} soundings of its {len(kept):,} pings are rejected; give a line with soundings")
    speeds = [speed for speed in sound_speeds if 1300 < speed < 1700]  # any water's; the rest is damage
    fixes = np.array([ping.fix for ping in kept])
    return RecordedLine(
        name=name,
        stamps=np.array([ping.stamp for ping in kept]),
        latitudes=fixes[:, 0],
        longitudes=fixes[:, 1],
        heights=fixes[:, 2],
        attitudes=np.array([ping.attitude for ping in kept]),
        sensors=np.array([ping.sensor for ping in kept]),
        pings=np.repeat(np.arange(len(kept)), counts),
        points=np.concatenate(points),
        beams=beams,
        rejected=beams - sum(counts),
        echo_sounder=echo_sounder,
        sound_speed=float(np.median(speeds)) if speeds else None,
        notes=(*notes, *faults),
    )


def _usable(pings: Sequence[RecordedPing]) -> tuple[list[RecordedPing], list[str]]:
    """Those whose numbers can be, by time, and what is wrong with the others."""
    table = np.array([[ping.stamp, *ping.fix, *ping.attitude, *ping.sensor] for ping in pings])
    stamps, latitudes, longitudes = table[:, :3].T
    with np.errstate(invalid="ignore"):
        known = np.isfinite(table).all(axis=1) & (np.abs(table[:, 3:]) < _FARTHEST).all(axis=1)
        placed = (np.abs(latitudes) <= 89.8) & (np.abs(longitudes) <= 180) & ((latitudes != 0) | (longitudes != 0))
        good = known & placed & (stamps > 0) & (stamps < _LATEST)
    if good.any():
        # longitudes from one of them, as a line may cross the date line
        whole = np.column_stack([stamps, latitudes, (longitudes - longitudes[good][0] + 180) % 360])
        middle = np.median(whole[good], axis=0)
        away = np.abs(whole - middle)
        with np.errstate(invalid="ignore"):
            good &= (away <= [_LONGEST, _WIDEST, _WIDEST / max(np.cos(np.radians(middle[1])), 0.01)]).all(axis=1)
    order = np.flatnonzero(good)
    order = order[np.argsort(stamps[order], kind="stable")]
    faults = list(_faults(len(pings) - len(order), int((np.diff(stamps[good]) < 0).sum())))
    return [pings[k] for k in order], faults


def _faults(left_out: int, late: int) -> Iterator[str]:
    if left_out:
        yield f"{counted(left_out, 'ping')} left out, without a time, position or attitude that can be"
    if late:
        yield f"{counted(late, 'ping')} came late, now in order"


def between(
    wanted: np.ndarray, times: np.ndarray, values: np.ndarray, gap: float, beyond: float
) -> tuple[np.ndarray, np.ndarray]:
    """Values at the times that are wanted, linearly between those known, and which of them are known so.

    Args:
        wanted: (P,) [s].
        times: (n,) [s], in any order.
        values: (n, k), whatever varies linearly between them.
        gap: the longest time between two that are known [s].
        beyond: how far before the first and after the last one the line is continued [s].
    """
    order, first = np.unique(times, return_index=True)
    if len(order) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan), np.zeros(len(wanted), bool)
    after = np.clip(np.searchsorted(order, wanted), 1, len(order) - 1)
    a, b = order[after - 1], order[after]
    low, high = values[first[after - 1]], values[first[after]]
    known = (b - a <= gap) & (wanted >= a - beyond) & (wanted <= b + beyond)
    return low + ((wanted - a) / (b - a))[:, None] * (high - low), known


def matrices_of(attitudes: np.ndarray) -> np.ndarray:
    """(P, 3, 3) how the vehicle (x forward, y port, z up) is turned in the pings' frames, of attitudes (P, 3) [rad]."""
    roll, pitch = attitudes[:, 0], attitudes[:, 1]
    return Rotation.from_euler("YX", np.column_stack([-pitch, roll])).as_matrix()


def counted(number: int, noun: str) -> str:
    """A number and a noun."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"
