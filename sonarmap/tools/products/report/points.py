"""Compressed points of a map: quantized, sorted along a space-filling curve, as differences, gzipped.

Coordinates are whole numbers of a quantum, 1 / `FRACTION` of a voxel, from the corner of a tile 65,536 quanta wide.
Within a tile points follow a Morton curve, so that successive points are near each other and their differences small.
The bytes are laid out in planes (all low bytes of x, then all high bytes of x, and so on), which gzip compresses best.
`web/packed.js` unpacks them.
"""

import gzip
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

FRACTION = 64  # quanta in a voxel: coordinates are rounded by at most a 128th of a voxel
TILE = 1 << 16  # edge of a tile [quanta]
MOST_CODE = 255
_LEVEL = 6  # of gzip: a higher one takes three times as long for two percent
_AXES = 3
_SPACED = (  # shifts and masks that insert two zeros between the bits of a number of 16 bits
    (16, 0x0000FF0000FF),
    (8, 0x00F00F00F00F),
    (4, 0x0C30C30C30C3),
    (2, 0x249249249249),
)


def pack(points: np.ndarray, columns: Mapping[str, np.ndarray], voxel: float) -> tuple[bytes, dict[str, Any]]:
    """Pack points (M, 3) [m] and columns of M whole numbers from 0 to 2**32 - 1.

    Returns gzipped planes of M bytes each, and their layout: the `quantum` of coordinates [m]; the `tiles` in the order
    of the points, each with the `count` of its points and its corner `origin` [m]; and `planes`, {column: number of
    planes}. These follow the six planes of x, y and z, lowest byte first."""
    quantum = voxel / FRACTION
    lowest = points.min(axis=0) if len(points) else np.zeros(_AXES)
    places = np.rint((points - lowest) / quantum).astype(np.int64)
    corner, within = places // TILE, (places % TILE).astype(np.uint64)
    order = np.lexsort((_along_curve(within), *corner.T))
    corner, within = corner[order], within[order].astype(np.uint16)
    starts = _starts(corner)
    counts = np.diff([*starts, len(points)]).tolist()
    origins = (lowest + corner[starts] * (quantum * TILE)).tolist()
    tiles = [{"origin": origin, "count": count} for origin, count in zip(origins, counts, strict=True)]
    planes = [plane for axis in within.T for plane in _bytes_of(_steps(axis, starts), 2)]
    sizes = {name: _size(values) for name, values in columns.items()}
    for name, values in columns.items():
        planes += _bytes_of(values[order].astype(np.uint32), sizes[name])
    data = gzip.compress(b"".join(plane.tobytes() for plane in planes), _LEVEL, mtime=0)
    return data, {"quantum": quantum, "tiles": tiles, "planes": sizes}


def codes(values: np.ndarray) -> tuple[np.ndarray, tuple[float, float]]:
    """Positive numbers (M,) as bytes, and their extremes: 1 to 255 on a logarithmic scale from the smallest to the
    largest, 0 for a missing number."""
    values = np.asarray(values, np.float64)
    known = np.isfinite(values) & (values > 0)
    if not known.any():
        return np.zeros(len(values), np.uint8), (1.0, 1.0)
    low, high = float(values[known].min()), float(values[known].max())
    ratio = np.log(np.where(known, values, low) / low) / (np.log(high / low) or 1.0)
    return np.where(known, 1 + np.rint(ratio * (MOST_CODE - 1)), 0).astype(np.uint8), (low, high)


def _along_curve(places: np.ndarray) -> np.ndarray:
    """(M,) uint64 Morton codes: the bits of x, y and z (M, 3), 16 each, interleaved."""
    places = places.copy()
    for shift, mask in _SPACED:
        places = (places | places << np.uint64(shift)) & np.uint64(mask)
    return places[:, 0] | places[:, 1] << np.uint64(1) | places[:, 2] << np.uint64(2)


def _starts(corner: np.ndarray) -> np.ndarray:
    if not len(corner):
        return np.zeros(0, np.int64)
    return np.flatnonzero(np.concatenate([[True], (np.diff(corner, axis=0) != 0).any(axis=1)]))


def _steps(axis: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """(M,) uint16 zigzag-coded differences between successive points; those of a tile's first point are from 0."""
    steps = np.diff(axis, prepend=np.uint16(0))
    steps[starts] = axis[starts]
    steps = steps.astype(np.int16)
    return ((steps << 1) ^ (steps >> 15)).view(np.uint16)


def _size(values: np.ndarray) -> int:
    return max(1, (int(values.max(initial=0)).bit_length() + 7) // 8)


def _bytes_of(values: np.ndarray, size: int) -> Sequence[np.ndarray]:
    return [(values >> 8 * k & 0xFF).astype(np.uint8) for k in range(size)]
