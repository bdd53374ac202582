"""A line of a multibeam echo sounder as its file has it: by latitude, longitude and true North.

What a reader took from a file, ping by ping, is assembled to a line here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.navigation.settings import rounded_origin

NO_DRAUGHT = "Depths are below the transducer; the file does not give its draught (--draught M)."
_AHEAD = np.array([1e-4, 0.0, 0.0])  # degrees of latitude, about 11 m: a step to the North
_FARTHEST = 15_000.0  # meters between a vehicle and what its echo sounder can reach; the ocean is 11 km deep
_LATEST = 4102444800.0  # the year 2100 [s, UTC]: a stamp beyond is damage
_LONGEST = 2 * 86400.0  # seconds between a ping of a file and the median one
_WIDEST = 1.0  # degrees of latitude or longitude between them


@dataclass(frozen=True, slots=True)
class RecordedLine:
    """Pings and soundings of one file, not yet placed in a map; frames of the pings are those of `PingLine`."""

    name: str  # in messages and tables
    echo_sounder: str  # as the file says; "" if it does not
    stamps: np.ndarray  # (P,) float64 [s, UTC], ascending, P >= 1
    # (P, 3) float64 latitude, longitude [deg, WGS84] and height [m] of the pings' frames: of the level from which the
    # recording counts depths, above the vertical reference; 0 where it does not say
    fixes: np.ndarray
    attitudes: np.ndarray  # (P, 3) float64 [rad]: roll, starboard down; pitch, bow up; heading, clockwise from North
    sensors: np.ndarray  # (P, 3) float64 [m], where the transducer was, in the pings' frames
    pings: np.ndarray  # (N,) int64, ascending: the ping of each sounding
    points: np.ndarray  # (N, 3) float64 [m], soundings that were not rejected, in the frames of their pings
    beams: int  # soundings in all, rejected ones counted
    sound_speed: float | None  # at the transducer [m/s], the median; None if the file does not say
    notes: tuple[str, ...]  # what the user should know of the file
    below_water: bool = True  # whether depths count from the water, and not from the transducer

    @property
    def rejected(self) -> int:
        """Number of soundings that the recording rejects, or that are not finite."""
        return self.beams - len(self.points)

    def immersed(self, draught: float) -> "RecordedLine":
        """The line with its transducer so deep below the water [m]."""
        if draught and self.below_water:
            raise InputError(f"{self.name} says how deep the transducer was; leave --draught out")
        return replace(self, fixes=self.fixes - [0.0, 0.0, draught])

    def origin(self) -> Georeference:
        """An origin for a map of this line: its first fix, rounded."""
        return rounded_origin(self.fixes, "fix", [])

    def placed(self, georeference: Georeference) -> PingLine:
        """The line in the frame of a map, headings by the North of the map's origin."""
        places = georeference.local(self.fixes)
        # meridians meet at the pole: the North of a place beside the origin is not the origin's
        ahead = georeference.local(self.fixes + _AHEAD) - places
        attitudes = self.attitudes.copy()
        attitudes[:, 2] += np.arctan2(ahead[:, 0], ahead[:, 1])
        return PingLine(self.name, self.stamps, places, attitudes, self.sensors, self.pings, self.points)


def assembled(
    name: str,
    echo_sounder: str,
    *,
    stamps: np.ndarray,
    fixes: np.ndarray,
    attitudes: np.ndarray,
    sensors: np.ndarray,
    points: Sequence[np.ndarray],
    beams: Sequence[int],
    sound_speeds: Sequence[float],
    notes: Sequence[str],
    below_water: bool = True,
) -> RecordedLine:
    """The line of P pings in the order of their stamps, without what cannot be: numbers may be NaN or wrong, in any
    order. Of each ping `points` (n, 3) float64 [m] that are not rejected, and `beams`, soundings in all; `sound_speeds`
    are of any pings [m/s]."""
    order, faults = _usable(np.column_stack([stamps, fixes, attitudes, sensors]))
    notes = (*notes, *faults)
    if not len(order):
        why = f"; {'; '.join(notes)}" if notes else ""
        raise InputError(f"no ping with a time, a position and soundings in it{why}; give a recorded line")
    pings = np.repeat(np.arange(len(order)), [len(points[k]) for k in order])
    soundings, total = np.concatenate([points[k] for k in order]), sum(beams[k] for k in order)
    near = (np.abs(soundings) <= _FARTHEST).all(axis=1)  # NaN is left out too
    if not near.any():
        raise InputError(
            f"all {total:,} soundings of its {len(order):,} pings are rejected; give a line with soundings"
        )
    speeds = [speed for speed in sound_speeds if 1300 < speed < 1700]  # any water's; the rest is damage
    return RecordedLine(
        name,
        echo_sounder,
        *(each[order] for each in (stamps, fixes, attitudes, sensors)),
        pings=pings[near],
        points=soundings[near],
        beams=total,
        sound_speed=float(np.median(speeds)) if speeds else None,
        notes=notes,
        below_water=below_water,
    )


def _usable(table: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """The rows of (P, 10) stamps, fixes, attitudes and sensors that can be, by time, and what is wrong with others."""
    stamps, latitudes, longitudes = table[:, :3].T
    known = np.isfinite(table).all(axis=1) & (np.abs(table[:, 3:]) < _FARTHEST).all(axis=1)
    placed = (np.abs(latitudes) <= 89.8) & (np.abs(longitudes) <= 180) & ((latitudes != 0) | (longitudes != 0))
    good = known & placed & (stamps > 0) & (stamps < _LATEST)
    if good.any():
        # longitudes from one of them, as a line may cross the date line
        whole = np.column_stack([stamps, latitudes, (longitudes - longitudes[good][0] + 180) % 360])
        middle = np.median(whole[good], axis=0)
        widest = [_LONGEST, _WIDEST, _WIDEST / max(np.cos(np.radians(middle[1])), 0.01)]
        good &= (np.abs(whole - middle) <= widest).all(axis=1)
    order = np.flatnonzero(good)
    order = order[np.argsort(stamps[order], kind="stable")]
    left_out, late = len(table) - len(order), int((np.diff(stamps[good]) < 0).sum())
    faults = [f"{counted(left_out, 'ping')} left out, without a time, position or attitude that can be"] * bool(
        left_out
    )
    return order, faults + [f"{counted(late, 'ping')} came late, now in order"] * bool(late)


def between(
    wanted: np.ndarray, times: np.ndarray, values: np.ndarray, gap: float, beyond: float
) -> tuple[np.ndarray, np.ndarray]:
    """Values (n, k) at times (n,) [s], in any order, interpolated to the times that are `wanted` (P,) [s], and which of
    these are known: between two at most `gap` apart, or less than `beyond` before the first or after the last [s]."""
    order, first = np.unique(times, return_index=True)
    if len(order) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan), np.zeros(len(wanted), bool)
    after = np.clip(np.searchsorted(order, wanted), 1, len(order) - 1)
    a, b = order[after - 1], order[after]
    low, high = values[first[after - 1]], values[first[after]]
    known = (b - a <= gap) & (wanted >= a - beyond) & (wanted <= b + beyond)
    return low + ((wanted - a) / (b - a))[:, None] * (high - low), known


def damage(skipped: int, damaged: int, noun: str, first: str) -> list[str]:
    """What to tell of bytes and pings or datagrams that are left out, and the first fault of these, in words."""
    left_out = f"{counted(damaged, noun)} and {counted(skipped, 'byte')} left out{'; ' * bool(first)}{first}"
    return [f"damaged or cut: {left_out}"] if skipped or damaged else []
