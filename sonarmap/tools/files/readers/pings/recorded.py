"""A line recorded by a multibeam echo sounder, in latitude, longitude and true North.

The readers of all formats assemble their pings to a line here.
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
SINGLE_BEAM = (
    "a single beam: no swath to register; give lines of a multibeam echo sounder. To check their map with its depths, "
    "export these as LAZ, and run `sonarmap compare MAP FILE.laz`"
)
_AHEAD = np.array([1e-4, 0.0, 0.0])  # degrees of latitude, about 11 m: a step to the North
_SMOOTHED = 30.0  # [s], before and after a ping: its height above the ellipsoid is a mean
_MAX_RANGE = 15_000.0  # [m], of a sounding; the ocean is 11 km deep
_MAX_STAMP = 4102444800.0  # the year 2100 [s, UTC]: a later stamp is damaged
_MAX_TIME = 2 * 86400.0  # [s], between a ping of a file and the median one
_MAX_ANGLE = 1.0  # [deg], difference of their latitudes; of their longitudes, at the equator


@dataclass(frozen=True, slots=True)
class RecordedLine:
    """Pings and soundings of one file, not yet placed in a map. The pings' frames are those of `PingLine`."""

    name: str  # in messages and tables
    echo_sounder: str  # as named in the file; "" if it is not
    stamps: np.ndarray  # (P,) float64 [s, UTC], ascending, P >= 1
    # (P, 3) float64 latitude, longitude [deg, WGS84] and height [m] of the pings' frames; the height is that of the
    # level from which depths count, above the vertical reference, 0 if unknown
    fixes: np.ndarray
    attitudes: np.ndarray  # (P, 3) float64 [rad]: roll, starboard down; pitch, bow up; heading, clockwise from North
    sensors: np.ndarray  # (P, 3) float64 [m], positions of the transducer in the pings' frames
    pings: np.ndarray  # (N,) int64, ascending: the ping of each sounding
    points: np.ndarray  # (N, 3) float64 [m], soundings in the frames of their pings
    flagged: np.ndarray  # (N,) bool, which of them the recording flags as rejected
    beams: int  # number of soundings, including those that are left out
    sound_speed: float | None  # at the transducer [m/s], the median; None if it is not in the file
    notes: tuple[str, ...]  # for the user
    # (P,) float64 [m], heights above the ellipsoid of the level from which depths count, NaN if unknown
    levels: np.ndarray
    below_water: bool = True  # whether depths count from the water surface; else from the transducer

    @property
    def rejected(self) -> int:
        """Number of soundings left out: flagged, without a detection, not finite, too far or without a height."""
        return self.beams - len(self.points)

    def selected(self, all_soundings: bool) -> "RecordedLine":
        """The line without its flagged soundings, or with all, and a note on them."""
        count = int(self.flagged.sum())
        if all_soundings:
            note = f"{counted(count, 'sounding')} that the file flags as rejected kept (--all-soundings)"
            return replace(self, notes=(*self.notes, *[note] * bool(count)))
        good = ~self.flagged
        if not good.any():
            pings = counted(len(self.stamps), "ping")
            raise InputError(f"all {self.beams:,} soundings of its {pings} are rejected; --all-soundings keeps them")
        return replace(self, pings=self.pings[good], points=self.points[good], flagged=self.flagged[good])

    def above_ellipsoid(self) -> "RecordedLine":
        """The line with heights above the ellipsoid, and a note on them. The level from which depths count is at its
        mean height of a minute: in waves single heights are up to 0.2 m off, as they are older than the heave of their
        ping. Pings without any in that time are left out."""
        known = np.isfinite(self.levels)
        sums = np.concatenate([[0.0], np.cumsum(self.levels[known])])
        bounds = self.stamps[:, None] + [-_SMOOTHED, _SMOOTHED]
        first, last = np.searchsorted(self.stamps[known], bounds).T
        has_height = last > first
        kept = has_height[self.pings]
        if not kept.any():
            raise InputError("it has no heights above the ellipsoid; leave --heights ellipsoid out")
        left_out = counted(int((~has_height).sum()), "ping")
        notes = [f"{left_out} left out, without a height above the ellipsoid"] * (not has_height.all())
        levels = (sums[last] - sums[first])[has_height] / (last - first)[has_height]
        return replace(
            self,
            stamps=self.stamps[has_height],
            fixes=np.column_stack([self.fixes[has_height, :2], levels]),
            attitudes=self.attitudes[has_height],
            sensors=self.sensors[has_height],
            pings=(np.cumsum(has_height) - 1)[self.pings[kept]],
            points=self.points[kept],
            flagged=self.flagged[kept],
            notes=(*self.notes, "heights are above the ellipsoid", *notes),
            levels=levels,
        )

    def immersed(self, draught: float) -> "RecordedLine":
        """The line with its transducer at `draught` [m] below the water surface."""
        if draught and self.below_water:
            raise InputError(f"{self.name} has the depth of its transducer; leave --draught out")
        return replace(self, fixes=self.fixes - [0.0, 0.0, draught])

    def origin(self) -> Georeference:
        """The origin for a map of this line: its first fix, rounded."""
        return rounded_origin(self.fixes, "fix", [])

    def placed(self, georeference: Georeference) -> PingLine:
        """The line in the frame of a map, with headings from the North at the map's origin."""
        places = georeference.local(self.fixes)
        # meridians converge: the North of another place is not that of the origin
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
    flagged: Sequence[np.ndarray],
    sound_speeds: Sequence[float],
    notes: Sequence[str],
    levels: np.ndarray | None = None,
    below_water: bool = True,
) -> RecordedLine:
    """The line of P pings, which are sorted by their stamps; invalid ones (NaN, or out of range) are left out. For each
    ping, `points` are its (n, 3) float64 soundings [m], NaN without a detection, and `flagged` (n,) bool whether the
    recording flags them as rejected; `sound_speeds` are those of any pings [m/s]; `levels` is None if unknown."""
    order, faults = _usable(np.column_stack([stamps, fixes, attitudes, sensors]))
    notes = (*notes, *faults)
    if not len(order):
        why = f"; {'; '.join(notes)}" if notes else ""
        raise InputError(f"no ping with a time, a position and soundings in it{why}; give a recorded line")
    if max(len(points[k]) for k in order) == 1:
        raise InputError(SINGLE_BEAM)
    pings = np.repeat(np.arange(len(order)), [len(points[k]) for k in order])
    soundings = np.concatenate([points[k] for k in order])
    near = (np.abs(soundings) <= _MAX_RANGE).all(axis=1)  # NaN is left out too
    if not near.any():
        raise InputError(f"none of its {counted(len(soundings), 'sounding')} has a detection; give a recorded line")
    speeds = [speed for speed in sound_speeds if 1300 < speed < 1700]  # the range in water
    return RecordedLine(
        name,
        echo_sounder,
        *(each[order] for each in (stamps, fixes, attitudes, sensors)),
        pings=pings[near],
        points=soundings[near],
        flagged=np.concatenate([flagged[k] for k in order])[near],
        beams=len(soundings),
        sound_speed=float(np.median(speeds)) if speeds else None,
        notes=notes,
        levels=np.full(len(order), np.nan) if levels is None else levels[order],
        below_water=below_water,
    )


def _usable(table: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Indices of the valid rows of (P, 10) stamps, fixes, attitudes and sensors, ordered by time, and notes."""
    stamps, latitudes, longitudes = table[:, :3].T
    known = np.isfinite(table).all(axis=1) & (np.abs(table[:, 3:]) < _MAX_RANGE).all(axis=1)
    placed = (np.abs(latitudes) <= 89.8) & (np.abs(longitudes) <= 180) & ((latitudes != 0) | (longitudes != 0))
    good = known & placed & (stamps > 0) & (stamps < _MAX_STAMP)
    if good.any():
        # longitudes relative to a valid one, as a line may cross the date line
        whole = np.column_stack([stamps, latitudes, (longitudes - longitudes[good][0] + 180) % 360])
        middle = np.median(whole[good], axis=0)
        widest = [_MAX_TIME, _MAX_ANGLE, _MAX_ANGLE / max(np.cos(np.radians(middle[1])), 0.01)]
        good &= (np.abs(whole - middle) <= widest).all(axis=1)
    order = np.flatnonzero(good)
    order = order[np.argsort(stamps[order], kind="stable")]
    left_out, late = len(table) - len(order), int((np.diff(stamps[good]) < 0).sum())
    faults = [f"{counted(left_out, 'ping')} left out, without a valid time, position or attitude"] * bool(left_out)
    return order, faults + [f"{counted(late, 'ping')} came late, now in order"] * bool(late)


def between(
    wanted: np.ndarray, times: np.ndarray, values: np.ndarray, gap: float, beyond: float
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate `values` (n, k) at `times` (n,) [s], in any order, to times `wanted` (P,) [s]: (P, k) values and
    (P,) bool, which are known: between two at most `gap` [s] apart, at most `beyond` [s] before or after these."""
    order, first = np.unique(times, return_index=True)
    if len(order) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan), np.zeros(len(wanted), bool)
    after = np.clip(np.searchsorted(order, wanted), 1, len(order) - 1)
    a, b = order[after - 1], order[after]
    low, high = values[first[after - 1]], values[first[after]]
    known = (b - a <= gap) & (wanted >= a - beyond) & (wanted <= b + beyond)
    return low + ((wanted - a) / (b - a))[:, None] * (high - low), known


def damage(skipped: int, damaged: int, noun: str, first: str) -> list[str]:
    """A note on `skipped` bytes and `damaged` pings or datagrams (`noun`), with the first fault; empty without any."""
    left_out = f"{counted(damaged, noun)} and {counted(skipped, 'byte')} left out{'; ' * bool(first)}{first}"
    return [f"damaged or cut: {left_out}"] if skipped or damaged else []
