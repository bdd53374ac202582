"""Candidate shifts under each rotation, and the evidence for poses: views, surfaces and correlations.

Candidates come from a coarse grid of about half the edge, 64 voxels at most: several peaks of each rotation's
translation correlation, with all shifts that a cyclic one may stand for. Points in front of the other scan's surface
contradict a candidate. The best few distinct ones are refined and compared on the whole grid. At the best pose the
correlation along the least constrained directions measures the observability.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Pending, upload_poses
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.pomf.correlator import FoundPeaks
from sonarmap.kernels.pomf.peak import Peak
from sonarmap.kernels.surface.shared import Nearness, WeightedElements, shared_sums
from sonarmap.spectral.grid import coarse_edge
from sonarmap.spectral.prepare.range_image import COARSE, FINE, Visibility, visibility
from sonarmap.spectral.prepare.spectral_scan import WHITENINGS, CoarseVolume, SpectralScan
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.so3 import RotationPeaks, distinct
from sonarmap.spectral.translation import SAME_SHIFT, Box, Translation
from sonarmap.spectral.verify.fit import Fit, firmness
from sonarmap.spectral.verify.hypothesis import Candidates, Evidence, Hypothesis

# Distances along a direction [coarse voxels].
BANDS = ((1.5, 3.0), (3.0, 6.0), (6.0, 12.0))  # bands in which the highest correlation is taken
_STEP = 0.5
_PEAK = 1.0  # largest distance of the peak
_TURN = float(np.deg2rad(10.0))  # turn in both directions [rad]
TURNED = 2  # number of axes to turn about
# Range that correlations beside the peak are clipped to, as shares of it.
_LEAST_LEFT = 0.02
_MOST_LEFT = 2.0


@dataclass(frozen=True, slots=True)
class Observability:
    """Correlation of the translation beside a pose, as shares of its peak; 1 along an unconstrained direction."""

    axes: np.ndarray  # (3, 3) in columns, directions in the target's axes, the least constrained first
    # (3, bands, whitenings) highest along each direction, of both signs, in each of BANDS and for each of WHITENINGS
    slides: np.ndarray
    turns: np.ndarray  # (TURNED,) about each of the least constrained axes, the higher of both signs; phase only


def observe_directions(
    correlation: Translation, target: CoarseVolume, source: CoarseVolume, fit: Fit, scale: float
) -> Pending[Observability]:
    """Queue the correlations of two scans about a pose, on the coarse grid and for each of WHITENINGS, along the
    directions of least information; `scale` is the ratio of a voxel to a coarse voxel."""
    turning, shifting = weakest(fit.information)
    steps = np.arange(-BANDS[-1][1], BANDS[-1][1] + _STEP / 2, _STEP)
    places = fit.shift * scale + (shifting.T[:, None] * steps[:, None]).reshape(-1, 3)
    profile = correlation.profile(target, source, fit.R, places)
    turns = np.array([sign * _TURN * axis for axis in turning.T[:TURNED] for sign in (1, -1)])
    R = Rotation.from_rotvec(turns) * fit.R
    turned = correlation.find_at(target, source, R, np.tile(fit.shift * scale, (len(turns), 1)))

    def read() -> Observability:
        around = turned.read().value.reshape(-1, 2).max(axis=1)
        values = profile.read().reshape(len(WHITENINGS), 3, len(steps))
        away = np.abs(steps)
        peak = values[:, :, away <= _PEAK].max(axis=(1, 2))
        bands = [values[:, :, (away > low) & (away <= high)].max(axis=2) for low, high in BANDS]
        slides = np.stack(bands, axis=-1).transpose(1, 2, 0) / np.maximum(peak, 1e-12)
        return Observability(shifting, _share(slides), _share(around / max(float(peak[0]), 1e-12)))

    return Pending(read)


def weakest(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions (3, 3) of turns and of shifts, in columns, the least constrained first, by (6, 6) information; the
    other block is marginalized out of each."""
    axes = []
    for block, other in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        across = information[block, other]
        marginal = information[block, block] - across @ np.linalg.pinv(information[other, other], 1e-6, True) @ across.T
        axes.append(np.linalg.eigh((marginal + marginal.T) / 2)[1])
    return axes[0], axes[1]


def _share(values: np.ndarray) -> np.ndarray:
    return np.clip(values, _LEAST_LEFT, _MOST_LEFT)


# A counterpart is a point within `reach` [voxels] whose normal is within 37 degrees (`alike`, cosine). A point is
# covered if the other scan has a point within `covered` [voxels], so that it should show the point too.
_NEARNESS = Nearness(reach=2.0, covered=6.0, alike=0.8)
# Added to denominators, so that shares of very few points are small.
_LEAST = 0.05


@dataclass(frozen=True, slots=True)
class SharedSurface:
    """Shares of two scans' surfaces under k poses, (k,) each, 0..1, mean of both ways, weighted to balance the
    directions of normals."""

    agree: np.ndarray  # share with a counterpart in the other scan that faces the same direction
    covered: np.ndarray  # share near any point of the other scan
    # share with a point of the other scan within 2 voxels, whatever it faces, not weighted; the smaller of both
    # directions
    overlap: np.ndarray

    @property
    def consistency(self) -> np.ndarray:
        """Share of agreeing among covered points, 0..1; small if few are covered."""
        return self.agree / (self.covered + _LEAST)


def shared_surfaces(
    device: Device, target: Surface, source: Surface, poses: Array, most: int
) -> Pending[SharedSurface]:
    """Queue the shared surfaces under each of k poses, p_target = R p_source + t about the grid centers [voxels], with
    at most `most` points of each scan."""
    ours, theirs = (WeightedElements(surface.elements, surface.direction_weights) for surface in (target, source))
    queued = shared_sums(device, ours, theirs, poses, most, _NEARNESS)

    def read() -> SharedSurface:
        sums = queued.read()
        agree, covered = (sums[:, :, :2] / sums[:, :, 2:3]).mean(axis=1).T
        return SharedSurface(agree, covered, sums[:, :, 3].min(axis=1))

    return Pending(read)


_PEAKS = 8  # peaks of the translation for each rotation
_SEPARATION = 2.0  # minimum distance between these peaks [coarse voxels]
_FARTHEST = 0.92  # largest shift along an axis at which scans overlap [share of the grid's edge]
_SAME_ROTATION = float(np.deg2rad(9.0))  # candidates closer than this are the same [rad]
# Without viewpoints only the highest candidates are scored, by their shared surfaces.
_BY_POINTS = 60  # number of candidates
_POINTS = 400  # points of each scan
SURFACE_POINTS = 1200  # points of each scan for the shared surface of a refined hypothesis
_WRAPS = np.array(list(product((False, True), repeat=3)))  # axes along which a cyclic shift is wrapped
_WEIGHT = 4.0  # weight of a contradiction, in agreements


def consistency(agree: np.ndarray, contradict: np.ndarray) -> np.ndarray:
    """Share of agreeing points among those that agree or contradict, 0..1; a contradiction counts several times. It is
    not a share of all points, as few can agree if scans overlap little."""
    return agree / (agree + _WEIGHT * contradict + _LEAST)


@dataclass(frozen=True, slots=True)
class Observation:
    """Observations of k poses: the shared surfaces, and the views with a tight and with a wide tolerance."""

    surfaces: SharedSurface
    views: list[Visibility]

    def evidence(self, fits: Sequence[Fit], moved: np.ndarray) -> list[Evidence]:
        """Evidence of the poses, whose refinements are `fits`; `moved` (k,) as in `Evidence`."""
        firm = firmness(np.stack([fit.shares for fit in fits]))
        views = [consistency(view.agree, view.contradict) for view in self.views]
        measured = np.column_stack([*views, self.surfaces.consistency, self.surfaces.overlap, firm, moved])
        return [
            Evidence(
                *seen,
                residual=fit.residual,
                width=fit.width,
                firmness=firm,
                moved=away,
                measured=0.0 if fit.prior is None else float(fit.prior.squared()),
            )
            for fit, (*seen, firm, away) in zip(fits, measured.tolist(), strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Selection:
    count: int  # largest number of candidates
    # largest distance of a point from the surface [voxels; share of the range]; None: for the coarse grid
    tolerance: tuple[float, float] | None = None
    apart: float = SAME_SHIFT  # candidates of similar rotations no farther apart are the same [voxels]
    share: float = 0.0  # minimum score, as a share of the best one's


class Verifier:
    """Finds candidates for rotations and measures hypotheses, on one device and grid."""

    def __init__(self, device: Device, edge: int) -> None:
        self.device, self.edge = device, edge
        self.coarse_edge = coarse_edge(edge)
        # ratio of the error of coarse candidates to that on a grid of half the edge
        self.coarser = max(1.0, edge / self.coarse_edge / 2)
        self.translation = Translation(device, edge)
        self.coarse = Translation(device, self.coarse_edge, WHITENINGS)

    def candidates(
        self, target: SpectralScan, source: SpectralScan, rotations: RotationPeaks, boxes: Sequence[Box | None]
    ) -> Candidates:
        """Several shifts for each rotation, from the coarse grid, with all shifts that a cyclic one may stand for.

        Both whitenings give candidates, whose psr is scaled by the ratio of the whitenings' median heights over all
        rotations. `boxes` holds the allowed shifts under each rotation [voxels of the whole grid]; None for all.
        """
        scale = self.edge / self.coarse_edge
        coarse_boxes = [None if box is None else Box(np.rint(box.center / scale), box.half / scale) for box in boxes]
        found = self.coarse.find_within(target.coarse, source.coarse, rotations.R, coarse_boxes, _PEAKS, _SEPARATION)
        usual = np.array([_usual_height(found, exponent) for exponent in range(len(WHITENINGS))])
        psr = found.peaks.psr * (usual[0] / usual)[found.exponent]
        bounded = [self.coarse.is_bounded(box) for box in coarse_boxes]
        return self._candidates(rotations, bounded, found, found.peaks.shift * scale, psr)

    def fine_candidates(
        self, target: SpectralScan, source: SpectralScan, rotations: RotationPeaks, boxes: Sequence[Box | None]
    ) -> Candidates:
        """Like `candidates`, from the whole grid: refined rotations have higher peaks, and other ones."""
        found = self.translation.find_within(target.volume, source.volume, rotations.R, boxes, _PEAKS, _SEPARATION)
        bounded = [self.translation.is_bounded(box) for box in boxes]
        return self._candidates(rotations, bounded, found, found.peaks.shift, found.peaks.psr)

    def _candidates(
        self, rotations: RotationPeaks, bounded: Sequence[bool], found: FoundPeaks, shifts: np.ndarray, psr: np.ndarray
    ) -> Candidates:
        """Candidates at the shifts (m, 3) of peaks, and at all others that cyclic ones may stand for if the rotation's
        shifts are not bounded."""
        peak, places = self._unwrapped(shifts, np.array(bounded, bool)[found.pose])
        rotation = found.pose[peak]
        return Candidates(rotations.R[rotation], places, psr[peak], rotations.scores[rotation])

    def _unwrapped(self, shifts: np.ndarray, bounded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) int64 indices of cyclic shifts (m, 3), and (n, 3) the shifts that these may stand for and at which
        the scans overlap; a `bounded` (m,) one stands for itself alone."""
        wrapped = shifts - np.copysign(self.edge, shifts)
        unwrapped = np.where(_WRAPS, wrapped[:, None], shifts[:, None])
        allowed = (np.abs(unwrapped) <= _FARTHEST * self.edge).all(axis=2) & ~bounded[:, None]
        allowed[bounded, 0] = True
        return np.nonzero(allowed)[0], unwrapped[allowed]

    def best(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, selection: Selection
    ) -> np.ndarray:
        """Indices of the best distinct candidates, best first."""
        tolerance = selection.tolerance or (self.coarser * COARSE[0], COARSE[1])
        scores = self._scores(target, source, candidates, tolerance)
        order = np.argsort(-scores, kind="stable")
        order = order[scores[order] >= selection.share * scores[order[0]]]
        return distinct(candidates.R, order, selection.count, _SAME_ROTATION, candidates.shifts, selection.apart)

    def observe(
        self, target: SpectralScan, source: SpectralScan, poses: Array, points: int = SURFACE_POINTS
    ) -> Pending[Observation]:
        """Queue the observation of poses (k, 16) between the grids' centers, by the views and at most `points` points
        of each surface."""
        views = visibility(self.device, target.view, source.view, poses, (FINE, COARSE))
        surfaces = shared_surfaces(self.device, target.surface, source.surface, poses, points)
        return Pending(lambda: _observation(views, surfaces))

    def measure(
        self, target: SpectralScan, source: SpectralScan, hypotheses: Sequence[Hypothesis]
    ) -> Pending[list[Hypothesis]]:
        """Queue the translation's correlation at the poses of hypotheses, whose psr it becomes."""
        R = Rotation.concatenate([hypothesis.fit.R for hypothesis in hypotheses])
        shifts = np.array([hypothesis.fit.shift for hypothesis in hypotheses])
        peaks = self.translation.find_at(target.volume, source.volume, R, shifts)
        return Pending(lambda: _measured(hypotheses, peaks.read()))

    def observe_directions(self, target: SpectralScan, source: SpectralScan, fit: Fit) -> Pending[Observability]:
        """Queue the observability at a refined pose, on the coarse grid."""
        return observe_directions(self.coarse, target.coarse, source.coarse, fit, self.coarse_edge / self.edge)

    def _scores(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, tolerance: tuple[float, float]
    ) -> np.ndarray:
        """(n,) scores: consistency times psr."""
        if target.view.ranges is not None or source.view.ranges is not None:
            poses = upload_poses(self.device, candidates.R.as_matrix(), candidates.shifts)
            (seen,) = visibility(self.device, target.view, source.view, poses, [tolerance]).read()
            agreement = consistency(seen.agree, seen.contradict)
        else:
            agreement = np.zeros(len(candidates.psr))
            highest = np.argsort(-candidates.psr, kind="stable")[:_BY_POINTS]
            R = candidates.R[highest]
            poses = upload_poses(self.device, R.as_matrix(), candidates.shifts[highest])
            shared = shared_surfaces(self.device, target.surface, source.surface, poses, _POINTS)
            agreement[highest] = shared.read().consistency
        return agreement * np.maximum(candidates.psr, 0.0)


def _observation(views: Pending[list[Visibility]], surfaces: Pending[SharedSurface]) -> Observation:
    return Observation(surfaces.read(), views.read())  # the surfaces are queued last: reading them waits for all


def _measured(hypotheses: Sequence[Hypothesis], peaks: Peak) -> list[Hypothesis]:
    return [
        replace(each, evidence=replace(each.evidence, psr=psr))
        for each, psr in zip(hypotheses, peaks.psr.tolist(), strict=True)
    ]


def _usual_height(found: FoundPeaks, exponent: int) -> float:
    """Median over the rotations of their highest psr; 1 if it is not above 0."""
    rows = found.exponent == exponent
    pose, psr = found.pose[rows], found.peaks.psr[rows]
    highest = [psr[pose == each].max() for each in np.unique(pose)]
    usual = float(np.median(highest)) if highest else 0.0
    return usual if usual > 0 else 1.0
