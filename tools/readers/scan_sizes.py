"""Scans in another unit than the others, by their size."""

from collections.abc import Sequence

import numpy as np

from spectral.scan import Scan

_SAMPLE = 1000  # points of a scan that are looked at
_LEAST_SCANS = 3  # of two nobody knows which is wrong
# Views of one place differ in range by tens; a scan in millimeters beside others in meters by a thousand.
_STRANGE = 200.0
_MILLIMETERS = (500, 2000)  # times


def strange_sizes(scans: Sequence[Scan]) -> dict[int, str]:
    """What is wrong with scans that are hundreds of times larger or smaller than the others, by their index.

    Args:
        scans: of one survey.
    """
    if len(scans) < _LEAST_SCANS:
        return {}
    sizes = np.array([_size(scan) for scan in scans])
    usual = float(np.median(sizes))
    with np.errstate(divide="ignore"):
        times = sizes / usual if usual > 0 else np.ones(len(sizes))
    return {
        k: _in_words(float(sizes[k]), usual, float(times[k]))
        for k in np.flatnonzero((times >= _STRANGE) | (times <= 1 / _STRANGE)).tolist()
    }


def _size(scan: Scan) -> float:
    """The median distance of the points from their middle [m], which a scan of a map has, too."""
    points = scan.points[:: -(-len(scan.points) // _SAMPLE)].astype(np.float64)
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _in_words(size: float, usual: float, times: float) -> str:
    factor = f"{times:.3g} times larger" if times > 1 else f"{1 / max(times, 1e-30):.3g} times smaller"
    likely = any(_MILLIMETERS[0] < ratio < _MILLIMETERS[1] for ratio in (times, 1 / max(times, 1e-30)))
    hint = f"as if {'it was' if times > 1 else 'the others were'} in millimeters" if likely else "in another unit"
    return (
        f"its points are spread over {size:.3g} m, those of the other scans over {usual:.3g} m: {factor}, {hint}; "
        "write all scans in one unit (--units says which)"
    )
