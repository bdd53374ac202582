"""Scans that do not go with the others: in another unit, by their size, or given twice, which a map would believe."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sonarmap.spectral.point_store import in_turn
from sonarmap.spectral.scan import Scan

_SAMPLE = 1000  # points of a scan that are looked at
_LEAST_SCANS = 3  # of two nobody knows which is wrong
_LEAST_POINTS = 100  # of fewer the spread says nothing
# Views of one place differ in range by tens; a scan in centimeters beside others in meters by a hundred. One that is so
# much smaller than the others fills three voxels of a grid of 128, and nothing is lost with it.
_STRANGE = 40.0
_UNITS = {"centimeters": (40, 300), "millimeters": (300, 3000)}  # times
_LISTED = 5  # scans in a sentence
_FIRST = 64  # points by which scans are compared first


def strange_sizes(scans: Sequence[Scan]) -> dict[int, str]:
    """What is wrong with scans that are 40 times larger or smaller, or more, than the others, by their index. `scans`:
    of one survey."""
    many = ((k, scan) for k, scan in enumerate(in_turn(scans)) if len(scan.points) >= _LEAST_POINTS)
    sizes = {k: size for k, scan in many if (size := _size(scan)) > 0}
    if len(sizes) < _LEAST_SCANS:
        return {}
    usual = float(np.median(list(sizes.values())))
    strange = {k: size for k, size in sizes.items() if not 1 / _STRANGE < size / usual < _STRANGE}
    return {k: _in_words(size, usual, size / usual) for k, size in strange.items()}


def _size(scan: Scan) -> float:
    """The median distance of the points from their middle [m], which a scan of a map has, too."""
    points = scan.points[:: -(-len(scan.points) // _SAMPLE)].astype(np.float64)
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _in_words(size: float, usual: float, times: float) -> str:
    factor = f"{times:.3g} times larger" if times > 1 else f"{1 / times:.3g} times smaller"
    ratio = max(times, 1 / times)
    unit = next((unit for unit, (least, most) in _UNITS.items() if least <= ratio < most), "another unit")
    hint = f"as if {'it was' if times > 1 else 'the others were'} in {unit}"
    return (
        f"its points are spread over {size:.3g} m, those of the other scans over {usual:.3g} m: {factor}, {hint}; "
        "write all scans in one unit (--units says which)"
    )


def same_points(scans: Sequence[Scan]) -> list[tuple[int, int]]:
    """Each scan whose points are exactly those of an earlier one, and the first that has them: (earlier, later)."""
    firsts: dict[tuple[int, bytes], list[int]] = {}
    pairs: list[tuple[int, int]] = []
    for k, scan in enumerate(in_turn(scans)):
        alike = firsts.setdefault((len(scan.points), scan.points[:_FIRST].tobytes()), [])
        earlier = next((j for j in alike if np.array_equal(scans[j].points, scan.points)), k)
        if earlier == k:
            alike.append(k)
        else:
            pairs.append((earlier, k))
    return pairs


def repeated_in_words(given_twice: Sequence[Path], scans: Sequence[Scan]) -> list[str]:
    """What to tell the user of files that several of the given paths name, and are read once, and of scans that are
    another's copy; none if all is well."""
    words: list[str] = []
    if given_twice:
        words.append(f"given more than once, and used once: {_listed([str(path) for path in given_twice])}")
    if copies := same_points(scans):
        named = _listed([f"{scans[later].name} of {scans[earlier].name}" for earlier, later in copies])
        words.append(f"the same points twice: {named}; leave the copies out, or the map believes them twice")
    return words


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED:,} more" if len(names) > _LISTED else "")
