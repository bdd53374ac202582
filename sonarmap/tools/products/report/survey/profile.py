# pyright: strict, reportUnknownMemberType=false
"""What there is to say of a map along the track: depths, overlaps, and how sure the poses are."""

from dataclasses import dataclass

import numpy as np

from sonarmap.tools.files.time_scales import are_times
from sonarmap.tools.products.report.survey.view import PartView

_MOVED = 2.0  # a track shorter than this has no distances worth showing [voxels]
_UNDER = 3.0  # points within a square of this half edge are under the vehicle [voxels]
_SHARES = (0.1, 0.5, 0.9)  # of the points under the vehicle: what lies beyond the outer ones may be strays
_HOUR, _MINUTE = 3600.0, 60.0


@dataclass(frozen=True, slots=True)
class Profile:
    """Numbers of the n scans of a part, in their order."""

    along: np.ndarray  # (n,) where each is on the horizontal axis
    axis: str  # what that axis is
    starts: tuple[int, ...]  # first places of the surveys after the first: the track is broken before them
    vehicle: np.ndarray  # (n,) depth or height of the sensor [m]
    # (3, n) quantiles of the map's points under it, the deepest first: 90 % or 10 %, median, 10 % or 90 % of depth or
    # height [m]; NaN where there are none
    bed: np.ndarray
    # (m, 2) of consecutive registrations: middle on the horizontal axis, and share of common points, 0..1
    overlaps: np.ndarray
    kept: np.ndarray  # (m,) whether they were kept
    # (3, n) standard deviations: horizontally along the worst direction [m], vertically [m], heading [deg]
    sigmas: np.ndarray
    loop_ends: tuple[int, ...]  # places of the scans that kept loops join


def profile_of(view: PartView) -> Profile:
    """The profile of a part."""
    places = view.trajectory.T_world_sensor.translation
    starts = tuple(k for k in range(1, len(places)) if view.surveys[k] != view.surveys[k - 1])
    along, axis = _axis(view, places, starts)
    overlaps, kept = _overlaps(view, along)
    return Profile(
        along=along,
        axis=axis,
        starts=starts,
        vehicle=view.frame.level(places[:, 2]),
        bed=view.frame.level(heights_under(view.point_map.points, places, _UNDER * view.point_map.voxel)),
        overlaps=overlaps,
        kept=kept,
        sigmas=world_sigmas(view.trajectory.T_world_sensor.rotation.as_matrix(), view.covariances),
        loop_ends=tuple(sorted({k for pair in view.loops("kept") for k in pair})),
    )


def world_sigmas(R_world_sensor: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(3, n) standard deviations of poses: horizontal along the worst direction [m], vertical [m], heading [deg]; of
    R_world_sensor (n, 3, 3) and covariances (n, 6, 6), rotation first [rad, m], body tangent."""
    turns, shifts = (
        R_world_sensor @ covariances[:, part, part] @ R_world_sensor.swapaxes(1, 2)
        for part in (slice(0, 3), slice(3, 6))
    )
    worst = np.linalg.eigvalsh(shifts[:, :2, :2])[:, -1]
    variances = np.stack([worst, shifts[:, 2, 2], turns[:, 2, 2]])
    return np.sqrt(np.maximum(variances, 0.0)) * np.array([[1.0], [1.0], [np.degrees(1.0)]])


def heights_under(points: np.ndarray, places: np.ndarray, reach: float) -> np.ndarray:
    """(3, n) quantiles of z [m], the lowest first, of the map's points (M, 3) [m] below each place (n, 3) [m] in the
    square of half edge `reach` [m] around it; NaN where there are none."""
    order = np.argsort(points[:, 0], kind="stable")
    ends = np.searchsorted(points[:, 0], [places[:, 0] - reach, places[:, 0] + reach], sorter=order)
    heights = np.full((len(_SHARES), len(places)), np.nan)
    for k, (begin, end) in enumerate(ends.T.tolist()):
        near = points[order[begin:end]]
        z = near[(np.abs(near[:, 1] - places[k, 1]) <= reach) & (near[:, 2] < places[k, 2]), 2]
        if len(z):
            heights[:, k] = np.quantile(z, _SHARES)
    return heights


def _axis(view: PartView, places: np.ndarray, starts: tuple[int, ...]) -> tuple[np.ndarray, str]:
    """Distance along the track; of a vehicle that hardly moved the time, or the number of the scan."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[[k - 1 for k in starts]] = 0.0  # between two surveys there is no track
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if np.ptp(places, axis=0).max() > _MOVED * view.point_map.voxel:
        return along, "distance along the track [m]"
    stamps = view.trajectory.stamps
    passed = stamps - stamps[0]
    if are_times(stamps) and (np.diff(stamps) > 0).all():
        for unit, name in ((_HOUR, "h"), (_MINUTE, "min"), (1.0, "s")):
            if passed[-1] >= 2 * unit or name == "s":
                return passed / unit, f"time since the first scan [{name}]"
    return np.array(view.scans, np.float64), "number of the scan"


def _overlaps(view: PartView, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    place = {scan: k for k, scan in enumerate(view.scans)}
    rows = [
        ((along[place[pair.i]] + along[place[pair.j]]) / 2, pair.registration.overlap, pair.kept)
        for pair in view.pairs
        if pair.role == "sequential" and pair.registration is not None
    ]
    table = np.array(sorted(rows), np.float64).reshape(-1, 3)
    return table[:, :2], table[:, 2] > 0
