"""The paper's registration of two scans: the seven steps of Sect. 2.11, in order, and the verdict on their pose."""

from dataclasses import dataclass
from itertools import product
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.arrays import upload_places
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.pomf.peak import Peak
from sonarmap.kernels.surface.cells import find_nearest
from sonarmap.spectral.geometry import covariance_at_sensor, tilt_allowed, tilt_reach, tilt_refusal
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere_layers import Hemisphere, LayerSpectra
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.prepare.prepared import GridRegistrar, Prepared, Preparer
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.translation import SAME_SHIFT, Translation

# Rotations closer than this are the same answer [rad]
_SAME_ROTATION = float(np.deg2rad(10.0))
# Minimum peak-to-sidelobe ratio of an accepted translation, on a grid of up to 128 voxels per edge. It grows with
# (edge / 128)^0.75, as false peaks are higher on larger grids.
_LEAST_PSR = 30.0
_DISTINCTION = 1.7  # minimum ratio of its psr to that of any other answer
_LEAST_OVERLAP = 0.05  # minimum share of points in common
_REACH = 2.0  # largest distance of a counterpart: a voxel of either scan plus noise [voxels]
_SAMPLE = 2000  # points used to choose among the alternatives of a cyclic shift
# psr per voxel of the grid's edge from which a peak's error is the quantization alone; that of lower peaks grows with
# the inverse of their height.
_CLEAR_PSR = 0.7
_QUANTIZATION = 1.0 / 12.0  # variance of a number rounded to whole voxels or bins


@dataclass(frozen=True, slots=True)
class Match:
    """A rotation, its translation peak, and the peak-to-sidelobe ratios of the earlier steps."""

    R: Rotation  # R_target_source
    peak: Peak  # of the translation's correlation under it [voxels]
    # yaw_psr, tilt_psr: of the peaks that gave yaw, and roll and pitch; 0 if there was none
    yaw_psr: float
    tilt_psr: float
    other_psr: float = 0.0  # of the next highest peak of the translation, 0 if there is none


def differ(a: Match, b: Match, edge: int) -> bool:
    """Whether two matches on a grid of `edge` voxels are different answers."""
    turned = (a.R.inv() * b.R).magnitude() > _SAME_ROTATION
    apart = (a.peak.shift - b.peak.shift + edge / 2) % edge - edge / 2  # shifts are cyclic
    return bool(turned or np.linalg.norm(apart) > SAME_SHIFT)


def assess(best: Match, rival: float, shared: float, max_tilt: float, grid: Grid) -> tuple[bool, str]:
    """Whether to accept the best match, and why: `rival` is the peak-to-sidelobe ratio of the next best answer,
    `shared` the share of points in common, 0..1, and `max_tilt` the bound on roll and pitch [rad], with a tolerance of
    3 degrees."""
    psr, least_psr = best.peak.psr, _LEAST_PSR * max(1.0, grid.edge / 128) ** 0.75
    if refusal := tilt_refusal(best.R, max_tilt):
        return False, refusal
    if psr < least_psr:
        words = f"no shift stands out: the translation's peak is {psr:.1f} standard deviations high"
        return False, f"{words}; wanted at least {least_psr:.0f}"
    if psr < _DISTINCTION * rival:
        return False, (
            f"two answers fit: the translation's peak is {psr:.1f} standard deviations high and another answer's "
            f"{rival:.1f}; wanted at least {_DISTINCTION:g} times as high"
        )
    if shared < _LEAST_OVERLAP:
        return False, f"the scans share too little, {shared:.1%} of their points; wanted at least {_LEAST_OVERLAP:.0%}"
    return True, (
        f"the scans match: the translation's peak is {psr:.1f} standard deviations high, the next answer's "
        f"{rival:.1f}; {shared:.0%} of the points are shared"
    )


def overlap(device: Device, target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray) -> float:
    """Share of points, 0..1, one per voxel, with a counterpart in the other scan; the smaller of both directions.

    p_target = R p_source + shift, both about the scans' grid centers [voxels].
    """
    back = R_target_source.inv()
    there = _shares_near(device, target, source.surface, R_target_source, shift[None])[0]
    return float(min(there, _shares_near(device, source, target.surface, back, -back.apply(shift)[None])[0]))


def unwrap(
    device: Device, target: Prepared, source: Prepared, R_target_source: Rotation, shift: np.ndarray, edge: int
) -> np.ndarray:
    """The true shift (3,) [voxels] of a cyclic one, which is ambiguous by one edge along each axis.

    It is the one of the eight alternatives under which most points of the source have a counterpart, or the given shift
    if none is better.
    """
    points = source.surface[:: max(1, len(source.surface) // _SAMPLE)]
    wrapped = shift - np.copysign(edge, shift)
    alternatives = np.array(list(product(*zip(shift, wrapped, strict=True))))
    return alternatives[_shares_near(device, target, points, R_target_source, alternatives).argmax()]


def _shares_near(device: Device, scan: Prepared, points: np.ndarray, R: Rotation, shifts: np.ndarray) -> np.ndarray:
    """(k,) shares of points (n, 3), 0..1, with a point of the scan within 2 voxels under R and each of k shifts."""
    turns = np.repeat(R.as_matrix()[None], len(shifts), axis=0)
    distance, _ = find_nearest(device, scan.cells, upload_places(device, points), turns, shifts, _REACH)
    return np.isfinite(distance).mean(axis=1)


def peak_covariance(
    peak: Peak, R_target_source: Rotation, center: np.ndarray, grid: Grid, bin_angle: float
) -> np.ndarray:
    """Covariance (6, 6) of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m].

    Rotation and translation are taken as independent about the source's grid center (3,) [m, its sensor frame]. The
    peak is in the target's axes [voxels], `bin_angle` is the angle of one bin of the rotation's correlations [rad].
    """
    slack = max(1.0, _CLEAR_PSR * grid.edge / max(peak.psr, 1e-3)) ** 2
    width = peak_width(peak) * _QUANTIZATION * slack * grid.voxel**2
    R = R_target_source.as_matrix()
    about_center = np.zeros((6, 6))
    about_center[:3, :3] = np.eye(3) * bin_angle**2 * _QUANTIZATION * slack
    about_center[3:, 3:] = R.T @ width @ R
    return covariance_at_sensor(about_center, center)


def peak_width(peak: Peak) -> np.ndarray:
    """Covariance (3, 3) [voxels^2] of a Gaussian fitted to the peak by the curvature of its logarithm; at most 3 voxels
    wide in any direction."""
    height = np.log(np.maximum(peak.neighborhood.astype(np.float64) / peak.value, 0.05))
    along = np.eye(3, dtype=int)

    def at(step: np.ndarray) -> float:
        return float(height[tuple(1 + step)])

    curvature = np.empty((3, 3))
    for (a, x), (b, y) in product(enumerate(along), repeat=2):
        if a == b:
            curvature[a, a] = 2 * height[1, 1, 1] - at(x) - at(-x)
        else:
            curvature[a, b] = -0.25 * sum(p * q * at(p * x + q * y) for p in (-1, 1) for q in (-1, 1))
    values, vectors = np.linalg.eigh(curvature)
    widths = 1.0 / np.maximum(values, 1.0 / 9.0)
    return (vectors * widths) @ vectors.T


@dataclass(frozen=True, slots=True)
class HemisphereConfig:
    """Configuration of `HemisphereRegistrar`.

    Attributes:
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7).
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
        centered: whether each scan's grid is centered on its points; else it is centered on the origin of its frame and
            points outside are lost, as in the paper's Sect. 3.
    """

    max_tilt: float = float(np.deg2rad(35.0))
    use_strength: bool = False
    centered: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"`max_tilt` is {np.rad2deg(self.max_tilt):g} degrees; give more than 0 and up to 180")


@dataclass(frozen=True, slots=True)
class LayeredScan:
    """What a scan contributes to all its pairs."""

    volume: Prepared  # voxels and spectrum
    magnitude: Array  # device (N, N, N/2 + 1) float32, centered magnitude spectrum
    layers: LayerSpectra  # whitened spectra of its layers, for steps 1 and 4


class HemisphereRegistrar(GridRegistrar):
    """The paper's registration on one device and grid; any two scans it prepared can be registered."""

    # The unwraps show one hemisphere: a tilt of 90 degrees moves its pole to the rim [rad]
    _LARGEST_TILT = float(np.deg2rad(85.0))

    def __init__(self, device: Device, grid: Grid, config: HemisphereConfig | None = None) -> None:
        """Plan everything that does not depend on the scans; DeviceError if the device has too little memory."""
        self.config = config or HemisphereConfig()
        super().__init__(device, grid, memory_plan(grid.edge, "hemisphere"))
        self.hemisphere = Hemisphere(device, grid.edge)
        self._translation = Translation(device, grid.edge)
        self._preparer = Preparer(device, grid, self.config.use_strength, self.config.centered)

    def prepare(self, scan: Scan) -> LayeredScan:
        """A scan's spectra and, for steps 1 and 4, its layers; InputError if it shows too little structure."""
        volume, magnitude = self._preparer.prepare(scan)
        return LayeredScan(volume, magnitude, self.hemisphere.prepare(magnitude))

    def register(self, target: LayeredScan, source: LayeredScan) -> Registration:
        """T_target_source of two scans from `prepare`, with covariance and verdict but no probability."""
        start = perf_counter()
        best, *others = sorted(self._matches(target, source), key=lambda match: -match.peak.psr)
        # the next best answer is of the other yaw, or another shift under the best one
        rivals = [other.peak.psr for other in others if differ(best, other, self.grid.edge)]
        return self._conclude(target, source, best, max(best.other_psr, *rivals, 0.0), start)

    def _matches(self, target: LayeredScan, source: LayeredScan) -> list[Match]:
        """Run steps 1 to 7 for the yaw of the highest peak and for this yaw + 180 degrees."""
        matches: list[Match] = []
        # Steps 1, 2: yaw from the rotational unwraps
        for yaw in self.hemisphere.yaws(target.layers, source.layers):
            # Steps 3 to 5: roll and pitch from the rectangular unwraps, the spectrum turned back by yaw
            reach = min(tilt_reach(self.config.max_tilt), self._LARGEST_TILT)
            tilt = self.hemisphere.tilt(target.layers, source.magnitude, yaw.R, reach, self._may_tilt)
            R = yaw.R if tilt is None else tilt.R * yaw.R
            # Steps 6, 7: the translation, the scan turned back by all three angles
            peaks = self._translation.find(target.volume, source.volume, R)
            psr = 0.0 if tilt is None else tilt.psr
            matches.append(Match(R, peaks[0], yaw.psr, psr, max(peaks.psr[1:], default=0.0)))
        # drop matches beyond the bound on tilt; if all are, `assess` refuses the best of them
        return [match for match in matches if self._may_tilt(match.R)] or matches

    def _may_tilt(self, R_target_source: Rotation) -> bool:
        return bool(tilt_allowed(R_target_source, self.config.max_tilt))

    def _conclude(
        self, target: LayeredScan, source: LayeredScan, best: Match, rival: float, start: float
    ) -> Registration:
        """The registration between the sensor frames, with covariance and verdict."""
        voxel, R = self.grid.voxel, best.R
        voxels = unwrap(self.device, target.volume, source.volume, R, best.peak.shift, self.grid.edge)
        shift = target.volume.center + voxels * voxel - R.apply(source.volume.center)
        share = overlap(self.device, target.volume, source.volume, R, voxels)
        accepted, reason = assess(best, rival, share, self.config.max_tilt, self.grid)
        return Registration(
            T_target_source=RigidTransform.from_components(shift, R),
            covariance=peak_covariance(best.peak, R, source.volume.center, self.grid, self.hemisphere.tilt_bin),
            psr=best.peak.psr,
            overlap=share,
            accepted=accepted,
            seconds=perf_counter() - start,
            reason=reason,
            step_psr=(("yaw", best.yaw_psr), ("tilt", best.tilt_psr), ("translation", best.peak.psr), ("rival", rival)),
        )
