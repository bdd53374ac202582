"""Scans in another unit than the others, by their size."""

from collections.abc import Sequence

import numpy as np

from sonarmap.spectral.scan import Scan

_SAMPLE = 1000  # points of a scan that are looked at
_LEAST_SCANS = 3  # of two nobody knows which is wrong
_LEAST_POINTS = 100  # of fewer the spread says nothing
# Views of one place differ in range by tens; a scan in millimeters beside others in meters by a thousand.
_STRANGE = 200.0
_MILLIMETERS = (500, 2000)  # times


def strange_sizes(scans: Sequence[Scan]) -> dict[int, str]:
    """What is wrong with scans that are hundreds of times larger or smaller than the others, by their index.

    Args:
        scans: of one survey.
    """
    sizes = {k: size for k, scan in enumerate(scans) if len(scan.points) >= _LEAST_POINTS and (size := _size(scan)) > 0}
    if len(sizes) < _LEAST_SCANS:
        return {}
    usual = float(np.median(list(sizes.values())))
    return {
        k: _in_words(size, usual, size / usual)
        for k, size in sizes.items()
        if not 1 / _STRANGE < size / usual < _STRANGE
    }


def _size(scan: Scan) -> float:
    """The median distance of the points from their middle [m], which a scan of a map has, too."""
    points = scan.points[:: -(-len(scan.points) // _SAMPLE)].astype(np.float64)
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _in_words(size: float, usual: float, times: float) -> str:
    factor = f"{times:.3g} times larger" if times > 1 else f"{1 / times:.3g} times smaller"
    likely = any(_MILLIMETERS[0] < ratio < _MILLIMETERS[1] for ratio in (times, 1 / times))
    hint = f"as if {'it was' if times > 1 else 'the others were'} in millimeters" if likely else "in another unit"
    return (
        f"its points are spread over {size:.3g} m, those of the other scans over {usual:.3g} m: {factor}, {hint}; "
        "write all scans in one unit (--units says which)"
    )
