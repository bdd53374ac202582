"""The spectral registration of two scans: rotations from all of SO(3), verified, refined, judged; on one screen."""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.device import Device
from kernels.errors import InputError
from kernels.spectrum import Pomf
from kernels.voxelize import voxelize
from spectral.acceptance import tilt_allowed
from spectral.belief import Belief, believe
from spectral.grid import Grid
from spectral.hypothesis import largest_tilt
from spectral.icp import refine
from spectral.memory import require_memory
from spectral.prepared import Prepared, Preparer
from spectral.prior import RelativePrior, relative_prior
from spectral.range_image import range_image
from spectral.refine import search_rotation
from spectral.result import Registration
from spectral.scan import Scan
from spectral.so3 import RotationPeaks, So3
from spectral.surface import smooth_surface
from spectral.uncertainty import fit_covariance
from spectral.verification import Candidates, CoarseVolume, Refined, SpectralScan, Verified, Verifier

Refinement = Literal["icp", "spectral"]

# What a rotation of the correlation, and a shift of the coarse grid, may be off by until refined [rad; voxels].
_ROTATION_SLACK, _SHIFT_SLACK = float(np.deg2rad(6.0)), 6.0
# Reaches of the refinement's steps [voxels] and its points: out of a candidate's error, and on to the end.
_ROUGH, _ROUGH_POINTS = (4.0, 3.0, 3.0, 2.0, 2.0, 2.0), 500
_FINAL, _FINAL_POINTS = (3.0, 2.0, 2.0) + (1.5,) * 12, 3000


@dataclass(frozen=True, slots=True)
class SpectralConfig:
    """How to register.

    Attributes:
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7); pi for any.
        rotations: how many distinct rotations are verified.
        hypotheses: how many of the poses that these lead to are refined.
        finalists: how many of them are compared on the whole grid.
        refinement: what makes the result finer than voxels and bins: "icp", point to plane on the surfaces, or
            "spectral", the translation's peak, which is climbed over the rotation.
        least_probability: what makes a registration believed.
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
    """

    max_tilt: float = float(np.deg2rad(35.0))
    rotations: int = 12
    hypotheses: int = 6
    finalists: int = 3
    refinement: Refinement = "icp"
    least_probability: float = 0.95
    use_strength: bool = False

    def __post_init__(self) -> None:
        if min(self.rotations, self.hypotheses, self.finalists) < 1:
            raise InputError(
                f"rotations is {self.rotations}, hypotheses {self.hypotheses}, finalists {self.finalists}; wanted at "
                "least 1 of each"
            )
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"--max-tilt {np.rad2deg(self.max_tilt):g}: wanted above 0 and up to 180 degrees")
        if self.refinement not in ("icp", "spectral"):
            raise InputError(f"refinement is {self.refinement!r}; wanted 'icp' or 'spectral'")
        if not 0 < self.least_probability < 1:
            raise InputError(f"least_probability is {self.least_probability}; wanted between 0 and 1")


class SpectralRegistrar:
    """Spectral registration on one device and grid; any two scans it prepared can be registered."""

    def __init__(self, device: Device, grid: Grid, config: SpectralConfig | None = None) -> None:
        """Plan everything that does not depend on the scans.

        Raises:
            DeviceError: the device cannot hold what the grid needs.
        """
        self.device, self.grid, self.config = device, grid, config or SpectralConfig()
        require_memory(device, grid.edge)
        self.so3 = So3(device, grid.edge, self.config.max_tilt)
        self._preparer = Preparer(device, grid, self.config.use_strength)
        self._verifier = Verifier(device, grid.edge)
        edge = self._verifier.coarse_edge
        self._coarse_pomf = Pomf(device, (edge, edge, edge))
        self._coarse_volume = device.empty((edge, edge, edge))
        self._warm = False

    def prepare(self, scan: Scan) -> SpectralScan:
        """What the scan contributes to every pair: its spectra, its layers' harmonics, its surface and its view.

        Raises:
            InputError: the scan shows too little structure.
        """
        volume = self._preparer.prepare(scan)
        points = self.grid.to_voxels(scan.points, volume.center)
        prepared = SpectralScan(
            volume=volume,
            coarse=self._coarsen(volume),
            coefficients=self.so3.prepare(volume.magnitude),
            surface=smooth_surface(volume.surface, volume.tree),
            image=range_image(self.device, points, volume.surface, -volume.center / self.grid.voxel),
            prior=scan.prior,
        )
        if not self._warm:
            # some drivers compile at the first launch, which takes seconds
            self._warm = True
            self.register(prepared, prepared)
        return prepared

    def register(self, target: SpectralScan, source: SpectralScan) -> Registration:
        """Find T_target_source; `probability` says how sure it is the right one, `accepted` whether to believe it."""
        start = perf_counter()
        prior = relative_prior(target.prior, source.prior)
        # where the spectra are alike over all rotations
        rotations = self._rotations(target, source, prior)
        if not len(rotations.scores):
            return self._nothing(start)
        # where the scan would lie under each, and what the views say to that
        candidates = self._verifier.candidates(target, source, rotations)
        candidates = self._within_prior(target, source, candidates, prior)
        if not len(candidates.psr):
            return self._nothing(start)
        # the best few, refined, and judged again on the whole grid
        refined = self._refined(target, source, rotations, candidates)
        found = [self._verifier.verify(target, source, one) for one in refined[: self.config.finalists]]
        found.sort(key=lambda one: -one.score)
        found[0] = self._settle(target, source, found[0])
        return self._conclude(target, source, found, refined, prior, start)

    def _rotations(self, target: SpectralScan, source: SpectralScan, prior: RelativePrior | None) -> RotationPeaks:
        """The best rotations that the vehicle and its instruments allow, and the one that these measured."""

        def allowed(R: Rotation) -> np.ndarray:
            may = tilt_allowed(R, self.config.max_tilt)
            return may if prior is None else may & prior.allows(R, _ROTATION_SLACK)

        found = self.so3.candidates(target.coefficients, source.coefficients, self.config.rotations, allowed)
        measured = None if prior is None else prior.R_target_source
        if measured is None:
            return found
        return RotationPeaks(Rotation.concatenate([found.R, measured]), np.append(found.scores, 0.0))

    def _within_prior(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, prior: RelativePrior | None
    ) -> Candidates:
        """Those candidates whose shift the depths and positions allow."""
        if prior is None or not len(candidates.psr):
            return candidates
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for turn in np.unique(candidates.turn):
            these = np.flatnonzero(candidates.turn == turn)
            R = candidates.R[int(these[0])]
            shifts = self._shift(target, source, R, candidates.shifts[these])
            allowed[these] = prior.allows_shift(shifts, R, self._slack)
        return candidates.only(allowed)

    def _refined(
        self, target: SpectralScan, source: SpectralScan, rotations: RotationPeaks, candidates: Candidates
    ) -> list[Refined]:
        """The best candidates, polished roughly, best first."""
        best = self._verifier.best(target, source, candidates, self.config.hypotheses)
        fits = [
            refine(target.surface, source.surface, candidates.R[int(n)], candidates.shifts[n], _ROUGH, _ROUGH_POINTS)
            for n in best
        ]
        scores, psr = rotations.scores[candidates.turn[best]], candidates.psr[best]
        return self._verifier.judge(target, source, fits, scores.tolist(), psr.tolist())

    def _settle(self, target: SpectralScan, source: SpectralScan, best: Verified) -> Verified:
        """The winner, refined to the end, and judged once more."""
        fit = refine(target.surface, source.surface, best.fit.R, best.fit.shift, _FINAL, _FINAL_POINTS)
        if self.config.refinement == "spectral":
            translation = self._verifier.translation
            peak = translation.find_at(target.volume, source.volume, best.fit.R, best.fit.shift)
            R, peak = search_rotation(translation, target.volume, source.volume, best.fit.R, peak, stay=True)
            near = peak.shift + self.grid.edge * np.rint((best.fit.shift - peak.shift) / self.grid.edge)
            fit = replace(fit, R=R, shift=near)
        one = best.refined
        judged = self._verifier.judge(target, source, [fit], [one.rotation_score], [one.coarse_psr])
        return self._verifier.verify(target, source, judged[0])

    def _conclude(
        self,
        target: SpectralScan,
        source: SpectralScan,
        found: list[Verified],
        refined: list[Refined],
        prior: RelativePrior | None,
        start: float,
    ) -> Registration:
        """The result: the best hypothesis, and beside it every other that cannot be excluded."""
        beliefs = believe(found, refined, self.grid.edge, self.config.least_probability)
        best, *others = [
            self._registration(target, source, one, belief, prior)
            for one, belief in zip(found, beliefs, strict=True)
            if one is found[0] or belief.possible
        ]
        return replace(best, alternatives=tuple(others), seconds=perf_counter() - start)

    def _registration(
        self, target: SpectralScan, source: SpectralScan, one: Verified, belief: Belief, prior: RelativePrior | None
    ) -> Registration:
        """One hypothesis as a registration between the sensor frames."""
        T = RigidTransform.from_components(self._shift(target, source, one.fit.R, one.fit.shift), one.fit.R)
        allowed, reason = self._allowed(T, prior)
        return Registration(
            T_target_source=T,
            covariance=fit_covariance(one, source.volume.center, self.grid),
            psr=one.psr,
            overlap=one.overlap,
            accepted=belief.accepted and allowed,
            seconds=0.0,
            reason=reason or belief.reason,
            probability=belief.probability if allowed else 0.0,
            step_psr=(
                ("rotation", one.refined.rotation_score),
                ("coarse", one.refined.coarse_psr),
                ("translation", one.psr),
            ),
        )

    def _allowed(self, T_target_source: RigidTransform, prior: RelativePrior | None) -> tuple[bool, str]:
        """Whether the vehicle could do this, once the pose is refined; and if not, why."""
        R, t = T_target_source.rotation, T_target_source.translation
        if not tilt_allowed(R, self.config.max_tilt):
            return False, (
                f"roll or pitch is {np.rad2deg(largest_tilt(R)):.0f} degrees; believed up to --max-tilt "
                f"{np.rad2deg(self.config.max_tilt):g}"
            )
        if prior is not None and not (prior.allows(R, _ROTATION_SLACK) and prior.allows_shift(t, R, self._slack)):
            return False, "it contradicts the scans' priors by more than four standard deviations"
        return True, ""

    def _shift(self, target: SpectralScan, source: SpectralScan, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return target.volume.center + shift * self.grid.voxel - R.apply(source.volume.center)

    @property
    def _slack(self) -> float:
        """What a coarse shift may be off by [m]."""
        return _SHIFT_SLACK * self.grid.voxel

    def _nothing(self, start: float) -> Registration:
        """The answer where priors leave no candidate: none, and nothing known."""
        unknown = np.diag(np.repeat([np.pi, self.grid.extent], 3) ** 2)
        return Registration(
            T_target_source=RigidTransform.identity(),
            covariance=unknown,
            psr=0.0,
            overlap=0.0,
            accepted=False,
            seconds=perf_counter() - start,
            reason="no pose that the bound on tilt and the scans' priors allow brings the scans together",
            probability=0.0,
        )

    def _coarsen(self, volume: Prepared) -> CoarseVolume:
        """The scan on the coarse grid."""
        edge = self._verifier.coarse_edge
        scale = np.array([edge / self.grid.edge] * 3 + [1.0], np.float32)
        points = self.device.to_device(volume.points.get() * scale)
        voxelize(self.device, points, edge, out=self._coarse_volume)
        return CoarseVolume(points, self._coarse_pomf.prepare(self._coarse_volume))
