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
from spectral.belief import Belief, believe
from spectral.bounds import Bounds
from spectral.grid import Grid
from spectral.icp import Fit, refine
from spectral.memory import require_memory
from spectral.prepared import Prepared, Preparer
from spectral.prior import relative_prior
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
        bounds = Bounds(self.config.max_tilt, relative_prior(target.prior, source.prior), self.grid.voxel)
        # where the spectra are alike over all rotations
        rotations = self._rotations(target, source, bounds)
        if not len(rotations.scores):
            return self._nothing(start)
        # where the scan would lie under each, and what the views say to that
        candidates = self._verifier.candidates(target, source, rotations)
        candidates = self._bounded(target, source, candidates, bounds)
        if not len(candidates.psr):
            return self._nothing(start)
        # the best few, refined, and judged again on the whole grid
        refined = self._refined(target, source, candidates, bounds)
        found = [self._verifier.verify(target, source, one) for one in refined[: self.config.finalists]]
        found.sort(key=lambda one: -one.score)
        found[0] = self._settle(target, source, found[0])
        return self._conclude(target, source, found, refined, bounds, start)

    def _rotations(self, target: SpectralScan, source: SpectralScan, bounds: Bounds) -> RotationPeaks:
        """The best rotations that may be meant, and the one that the instruments measured."""
        count = self.config.rotations
        found = self.so3.candidates(target.coefficients, source.coefficients, count, bounds.allow_rotations)
        measured = bounds.measured
        if measured is None:
            return found
        return RotationPeaks(Rotation.concatenate([found.R, measured]), np.append(found.scores, 0.0))

    def _bounded(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, bounds: Bounds
    ) -> Candidates:
        """Those candidates whose shift may be meant."""
        allowed = np.zeros(len(candidates.psr), dtype=bool)
        for turn in np.unique(candidates.turn):
            these = np.flatnonzero(candidates.turn == turn)
            R = candidates.R[int(these[0])]
            allowed[these] = bounds.allow_shifts(R, self._shift(target, source, R, candidates.shifts[these]))
        return candidates.only(allowed)

    def _refined(
        self, target: SpectralScan, source: SpectralScan, candidates: Candidates, bounds: Bounds
    ) -> list[Refined]:
        """The best candidates, polished roughly, best first; impossible ones only where there are no others."""
        best = self._verifier.best(target, source, candidates, self.config.hypotheses)
        fits = [
            refine(target.surface, source.surface, candidates.R[int(n)], candidates.shifts[n], _ROUGH, _ROUGH_POINTS)
            for n in best
        ]
        judged = self._verifier.judge(target, source, fits, [candidates.origin(n) for n in best])
        possible = [one for one in judged if not bounds.refusal(self._transform(target, source, one.fit))]
        return possible or judged

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
        return self._verifier.verify(target, source, self._verifier.judge(target, source, [fit], [one.origin])[0])

    def _conclude(
        self,
        target: SpectralScan,
        source: SpectralScan,
        found: list[Verified],
        refined: list[Refined],
        bounds: Bounds,
        start: float,
    ) -> Registration:
        """The result: the best hypothesis, and beside it every other that cannot be excluded."""
        covariances = [fit_covariance(one, source.volume.center, self.grid) for one in found]
        beliefs = believe(found, refined, covariances, self.grid, self.config.least_probability)
        best, *others = [
            self._registration(target, source, one, covariance, belief, bounds)
            for one, covariance, belief in zip(found, covariances, beliefs, strict=True)
            if one is found[0] or belief.possible
        ]
        return replace(best, alternatives=tuple(others), seconds=perf_counter() - start)

    def _registration(
        self,
        target: SpectralScan,
        source: SpectralScan,
        one: Verified,
        covariance: np.ndarray,
        belief: Belief,
        bounds: Bounds,
    ) -> Registration:
        """One hypothesis as a registration between the sensor frames."""
        T = self._transform(target, source, one.fit)
        refusal = bounds.refusal(T)
        return Registration(
            T_target_source=T,
            covariance=covariance,
            psr=one.psr,
            overlap=one.overlap,
            accepted=belief.accepted and not refusal,
            seconds=0.0,
            reason=refusal or belief.reason,
            probability=0.0 if refusal else belief.probability,
            step_psr=(
                ("rotation", one.refined.origin.rotation_score),
                ("coarse", one.refined.origin.coarse_psr),
                ("translation", one.psr),
            ),
        )

    def _transform(self, target: SpectralScan, source: SpectralScan, fit: Fit) -> RigidTransform:
        """T_target_source between the sensor frames."""
        return RigidTransform.from_components(self._shift(target, source, fit.R, fit.shift), fit.R)

    def _shift(self, target: SpectralScan, source: SpectralScan, R: Rotation, shift: np.ndarray) -> np.ndarray:
        """Where the source's sensor is in the target's frame (..., 3) [m], from shifts between the grids [voxels]."""
        return target.volume.center + shift * self.grid.voxel - R.apply(source.volume.center)

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
