"""The spectral registration of two scans: rotations from all of SO(3), each verified and refined."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import recycled
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.points.voxelize import scaled
from sonarmap.kernels.pomf.point_spectra import PointSpectra
from sonarmap.spectral.covariance import covers
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.grid import Grid, second_edge
from sonarmap.spectral.judgement import conclude, no_candidates
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.prepare.prepared import GridRegistrar, Prepared, Preparer
from sonarmap.spectral.prepare.range_image import scan_view
from sonarmap.spectral.prepare.spectral_scan import WHITENINGS, CoarseVolume, SpectralScan, signature
from sonarmap.spectral.prepare.surface import smooth_surface, smoothed_further
from sonarmap.spectral.prior import relative_prior
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.so3 import RotationPeaks, So3, distinct_rotations
from sonarmap.spectral.verify.bounds import Bounds
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.hypothesis_testing import HypothesisTest
from sonarmap.spectral.verify.rehearsal import rehearse_apart
from sonarmap.spectral.verify.verifier import Observability, Verifier


@dataclass(frozen=True, slots=True)
class SpectralConfig:
    """Configuration of `SpectralRegistrar`.

    Attributes:
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7); pi for no bound.
        hypotheses: number of distinct rotations to follow from each of three bands of layers; if the attitude is
            known, three times this number of turns.
        shortlist: largest number of candidate poses to refine.
        finalists: number of refined poses to compare on the whole grid, with at most as many that only it shows.
        least_probability: probability of the place from which a registration is accepted.
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
    """

    max_tilt: float = float(np.deg2rad(35.0))
    hypotheses: int = 4
    shortlist: int = 32
    finalists: int = 3
    least_probability: float = FITTED["acceptance"]["place"]
    use_strength: bool = False

    def __post_init__(self) -> None:
        for name in ("hypotheses", "shortlist", "finalists"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}={getattr(self, name)}` is too few; give at least 1")
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"`max_tilt` is {np.rad2deg(self.max_tilt):g} degrees; give more than 0 and up to 180")
        if not 0 < self.least_probability < 1:
            raise InputError(f"`least_probability={self.least_probability}` is not between 0 and 1")


class SpectralRegistrar(GridRegistrar):
    """Spectral registration on one device and grid; any two scans it prepared can be registered."""

    def __init__(self, device: Device, grid: Grid, config: SpectralConfig | None = None) -> None:
        """Plan everything that does not depend on the scans; DeviceError if the device has too little memory."""
        self.config = config or SpectralConfig()
        super().__init__(device, grid, memory_plan(grid.edge))
        rehearse_apart(device, grid.edge)
        self.so3 = So3(device, grid.edge, self.config.max_tilt)
        self._preparer = Preparer(device, grid, self.config.use_strength)
        self._verifier = Verifier(device, grid.edge)
        self._coarse_spectra = PointSpectra(device, self._verifier.coarse_edge, WHITENINGS)
        second = second_edge(grid.edge)
        plan = None if second is None else partial(SpectralRegistrar, device, Grid(second, 1.0), self.config)
        self._plan_coarse = None if plan is None else cache(plan)  # run at the first coarse-grid retry
        self._voxel_of_survey: float | None = None  # [m], set in a retry's registrar only

    def prepare(self, scan: Scan) -> SpectralScan:
        """A scan's spectra, its layers' harmonics, its surface and its view; InputError if structure is lacking."""
        # queue all work of the device before the first read
        volume, magnitude = self._preparer.prepare(scan)
        analyzed = self.so3.analyze(magnitude)
        coarse = self._coarsen(volume)
        points = self.grid.to_voxels(scan.points, volume.center)
        places = np.zeros(3) if scan.viewpoints is None else scan.viewpoints
        viewpoints = self.grid.to_voxels(places, volume.center)
        view = scan_view(self.device, points, volume.surface, viewpoints)
        surface = smooth_surface(self.device, volume.cells, list(view.places))
        layers, shown = analyzed.read(), surface.read()
        return SpectralScan(
            volume=volume,
            coarse=coarse,
            coefficients=layers.coefficients,
            signature=signature(layers.products),
            surface=shown,
            smoother=cache(partial(smoothed_further, self.device, shown)),
            view=view,
            prior=scan.prior,
            second=cache(partial(self._prepare_coarse, scan)),
        )

    def register(self, target: SpectralScan, source: SpectralScan) -> Registration:
        """T_target_source of two scans from `prepare`, with its covariance, probability and verdict.

        If the bound on tilt and the priors leave no candidate, the result is a refused identity of huge covariance.
        """
        return self._register(target, source, self._bounds(target, source))

    def _register(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> Registration:
        start = perf_counter()
        return replace(self._with_retry(target, source, bounds), seconds=perf_counter() - start)

    def _with_retry(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> Registration:
        """The registration, or that of the coarse-grid retry if the first is refused and the retry is more probable.

        If both find the same place, the pose is that of the fine grid: larger voxels do not make it more accurate."""
        first = self._register_once(HypothesisTest(self.grid, target, source, bounds, self._verifier))
        if first.probability >= self.config.least_probability:
            return first
        second = self._looked_at_again(target, source, bounds)
        if second is None or second.probability <= first.probability:
            return first
        if not (first.probability and covers(first.covariance, first.T_target_source, second.T_target_source)):
            return second
        believed = second.probability >= self.config.least_probability
        merged = first.with_probability(second.probability)
        return replace(merged, accepted=believed and first.is_fixed, reason=second.reason)

    def _looked_at_again(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> Registration | None:
        """The registration on the coarser grid; None without one, or if a scan shows too little structure on it."""
        registrar = self._coarse_registrar
        if registrar is None or (ours := target.second()) is None or (theirs := source.second()) is None:
            return None
        scans = replace(ours, prior=target.prior), replace(theirs, prior=source.prior)
        found = registrar._with_retry(*scans, replace(bounds, voxel=registrar.grid.voxel * registrar._verifier.coarser))
        reason = f"on the coarser grid, with voxels of {registrar.grid.voxel:.3g} m: {found.reason}"
        return replace(found, reason=reason)

    @property
    def _coarse_registrar(self) -> "SpectralRegistrar | None":
        """The registrar of the coarse-grid retry; None if the grid is not fine enough to retry."""
        if self._plan_coarse is None:
            return None
        planned = self._plan_coarse()
        second = planned.with_voxel(self.grid.extent / planned.grid.edge)
        second._voxel_of_survey = self._voxel_of_survey or self.grid.voxel
        return second

    def _prepare_coarse(self, scan: Scan) -> SpectralScan | None:
        """The scan on the grid of the retry; None if it shows too little structure there, as a low relief does."""
        if (registrar := self._coarse_registrar) is None:
            return None
        with suppress(InputError):
            return registrar.prepare(scan)

    def _register_once(self, test: HypothesisTest) -> Registration:
        # 1. rotations under which the magnitude spectra agree
        rotations = self._rotations(test.target, test.source, test.bounds)
        if not len(rotations.scores):
            return no_candidates(self.grid.extent)
        # 2. shifts of the source under each rotation
        candidates = test.find_candidates(rotations)
        if not len(candidates.psr):
            return no_candidates(self.grid.extent)
        # 3. the candidates that agree best with the views, refined, and others from the whole grid
        finalists = test.refine_candidates(candidates, self.config.shortlist)[: self.config.finalists]
        hypotheses = finalists + test.find_missed(finalists)
        hypotheses += test.find_alike(hypotheses)
        # 4. all compared on the whole grid, the best fully refined, and its correlation peak sampled along directions
        hypotheses = test.conclude(hypotheses)
        seen = self._verifier.observe_directions(test.target, test.source, hypotheses[0].fit).read()
        # 5. probabilities and covariances
        return self._conclude(test, hypotheses, seen)

    def register_expected(self, target: SpectralScan, source: SpectralScan, expected: ExpectedPose) -> Registration:
        """Register two scans near the pose that the vehicle's motion predicts, used as a measurement beside the priors.

        The prediction bounds the tilt, so `max_tilt` does not apply: two scans that look ahead and down in opposite
        directions are tilted to each other by twice the tilt of each.
        """
        ours, theirs = expected.priors(target.prior, source.prior)
        target, source = replace(target, prior=ours), replace(source, prior=theirs)
        bounds = self._bounds(target, source)
        return self._register(target, source, replace(bounds, max_tilt=np.pi, by_instruments=expected.by_instruments))

    @staticmethod
    def signature(prepared: SpectralScan) -> np.ndarray:
        """(K,) float32, nearly invariant to rotations and shifts of the scan's points; for a `PlaceIndex`."""
        return prepared.signature

    def _rotations(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> RotationPeaks:
        """Rotations under which the spectra agree best, among turns about the vertical if both attitudes are measured,
        else among all; then the measured rotation, if there is one, is appended."""
        count, coefficients = self.config.hypotheses, (target.coefficients, source.coefficients)
        if (sweep := bounds.sweep) is not None:
            return self.so3.best_of(*coefficients, sweep, 3 * count)
        peaks = distinct_rotations(self.so3.candidates(*coefficients, count, bounds.allow_rotations))
        if (measured := bounds.measured) is None:
            return peaks
        return RotationPeaks(Rotation.concatenate([peaks.R, measured]), np.append(peaks.scores, 0.0))

    def _bounds(self, target: SpectralScan, source: SpectralScan) -> Bounds:
        voxel = self.grid.voxel * self._verifier.coarser
        return Bounds(self.config.max_tilt, relative_prior(target.prior, source.prior), voxel)

    def _conclude(self, test: HypothesisTest, hypotheses: Sequence[Hypothesis], seen: Observability) -> Registration:
        """The registration with its probability, from the hypotheses and the observability of the best one."""
        voxel = self._voxel_of_survey or self.grid.voxel
        return conclude(test, hypotheses, seen, self.config.least_probability, voxel)

    def _coarsen(self, volume: Prepared) -> CoarseVolume:
        edge = self._verifier.coarse_edge
        points = scaled(self.device, volume.points, edge / self.grid.edge)
        spectra = tuple(recycled(self.device, (edge, edge, row_pitch(edge)), np.complex64) for _ in WHITENINGS)
        self._coarse_spectra.transform(points, spectra)
        return CoarseVolume(points, spectra)
