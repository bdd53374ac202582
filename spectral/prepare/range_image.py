"""What a scan saw from its viewpoint, as ranges over directions: points before its surface contradict it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.device.device import Array, Device
from kernels.points.visibility import agreement, octahedral_cells, upload_points

# Cells along an edge of the map: 1.6 degrees, a voxel at 36 voxels' distance. Finer cells stay empty between beams.
_EDGE = 128
# The nearest and the farthest range of a cell are these quantiles: a stray echo among them is left out.
_NEAR, _FAR = 0.15, 0.85
# A scan has a single viewpoint if this share of its points lies this near to the median of their cell [share; voxels;
# of the range].
_SINGLE, _SPREAD, _SLOPE = 0.8, 2.0, 0.03
# Points of a scan that are compared with another's view.
_SAMPLE = 1500
# How far from the surface a point may lie, while the rotation is 2 degrees off and once refined [voxels; of the range].
COARSE, FINE = (1.5, 0.03), (1.0, 0.01)


@dataclass(frozen=True, slots=True)
class RangeImage:
    """One scan's view, and a sample of its points to compare with others' views.

    Attributes:
        viewpoint: (3,) float64, the sensor, from the grid's center [voxels].
        view: device (_EDGE, _EDGE, 2) float32, nearest and farthest range of each cell of an octahedral map [voxels].
        sample: points about the grid's center, on the device [voxels].
        count: number of points in the sample.
        single: whether the scan was seen from that one viewpoint, unlike a map or a sweep put together from several.
    """

    viewpoint: np.ndarray
    view: Array
    sample: tuple[Array, int]
    count: int
    single: bool


def range_image(device: Device, points: np.ndarray, surface: np.ndarray, viewpoint: np.ndarray) -> RangeImage:
    """The view of one scan.

    Args:
        points: (n, 3) all points, about the grid's center [voxels].
        surface: (m, 3) one point a voxel [voxels].
        viewpoint: (3,) the sensor's place [voxels].
    """
    beams = points - viewpoint
    ranges = np.linalg.norm(beams, axis=1)
    cells = octahedral_cells(beams, _EDGE)
    order = np.lexsort((ranges, cells))
    cells, ranges = cells[order], ranges[order]
    seen, first, count = np.unique(cells, return_index=True, return_counts=True)
    view = np.empty((_EDGE * _EDGE, 2), np.float32)
    view[:] = np.inf, -np.inf
    view[seen, 0] = ranges[first + np.floor(_NEAR * (count - 1)).astype(np.int64)]
    view[seen, 1] = ranges[first + np.ceil(_FAR * (count - 1)).astype(np.int64)]
    median = np.repeat(ranges[first + count // 2], count)
    agreeing = np.abs(ranges - median) <= _SPREAD + _SLOPE * ranges
    # a point alone in its cell agrees with itself, which is no evidence
    shared = np.repeat(count > 1, count)
    sample = surface[:: max(1, len(surface) // _SAMPLE)]
    return RangeImage(
        viewpoint=viewpoint,
        view=device.to_device(view.reshape(_EDGE, _EDGE, 2)),
        sample=upload_points(device, sample),
        count=len(sample),
        single=not shared.any() or bool(agreeing[shared].mean() >= _SINGLE),
    )


@dataclass(frozen=True, slots=True)
class Visibility:
    """What two scans' views say about poses between them: shares of the sampled points, (n,) each; NaN without a view.

    Attributes:
        agree: fit the other scan's surface, the mean of both ways.
        contradict: stand where the other scan saw through.
        seen: fall where the other scan saw something.
    """

    agree: np.ndarray
    contradict: np.ndarray
    seen: np.ndarray


def visibility(
    device: Device,
    target: RangeImage,
    source: RangeImage,
    R_target_source: Rotation,
    shifts: np.ndarray,
    reach: float,
    slope: float,
) -> Visibility:
    """How far poses agree with both views; a scan that has none is left out.

    Args:
        R_target_source: (n,) rotations.
        shifts: (n, 3) p_target = R p_source + shift, both about the scans' grid centers [voxels].
        reach, slope: a range within reach [voxels] + slope * range of the surface agrees.
    """
    R = R_target_source.as_matrix()
    shares = []
    if target.single:
        counts = agreement(device, target.view, source.sample, R, shifts - target.viewpoint, reach, slope)
        shares.append(counts / source.count)
    if source.single:
        back = R.transpose(0, 2, 1)
        origin = -np.einsum("nij,nj->ni", back, shifts) - source.viewpoint
        counts = agreement(device, source.view, target.sample, back, origin, reach, slope)
        shares.append(counts / target.count)
    mean = np.mean(shares, axis=0) if shares else np.full((len(R), 3), np.nan)
    return Visibility(mean[:, 0], mean[:, 1], mean[:, 2])
