"""The spectral registration of two scans: rotations from all of SO(3), verified, refined, judged; on one screen."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.errors import InputError
from kernels.opencl.device import Device
from kernels.points.voxelize import voxelize
from kernels.pomf.spectrum import Pomf
from spectral.grid import Grid
from spectral.memory import require_memory
from spectral.prepare.prepared import Prepared, Preparer
from spectral.prepare.range_image import range_image
from spectral.prepare.signature import signature
from spectral.prepare.spectral_scan import CoarseVolume, SpectralScan
from spectral.prepare.surface import smooth_surface
from spectral.prior import relative_prior
from spectral.result import Registration
from spectral.scan import Scan
from spectral.so3 import RotationPeaks, So3
from spectral.verify.bounds import Bounds
from spectral.verify.covariance import fit_covariance
from spectral.verify.hypothesis import Verified
from spectral.verify.hypothesis_test import Contest
from spectral.verify.probability import Belief, believe
from spectral.verify.verifier import Verifier

Refinement = Literal["icp", "spectral"]


@dataclass(frozen=True, slots=True)
class SpectralConfig:
    """How to register.

    Attributes:
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7); pi for any.
        hypotheses: how many distinct rotations are followed.
        shortlist: how many of the poses that these lead to are refined.
        finalists: how many of them are compared on the whole grid, with as many that are found there.
        refinement: what makes the result finer than voxels and bins: "icp", point to plane on the surfaces, or
            "spectral", the translation's peak, which is climbed over the rotation.
        least_probability: what makes a registration believed.
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
    """

    max_tilt: float = float(np.deg2rad(35.0))
    hypotheses: int = 12
    shortlist: int = 6
    finalists: int = 3
    refinement: Refinement = "icp"
    least_probability: float = 0.85
    use_strength: bool = False

    def __post_init__(self) -> None:
        if min(self.hypotheses, self.shortlist, self.finalists) < 1:
            raise InputError(
                f"hypotheses is {self.hypotheses}, shortlist {self.shortlist}, finalists {self.finalists}; wanted at "
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
        self._pool = ThreadPoolExecutor(os.cpu_count())
        self._warm = False

    def prepare(self, scan: Scan) -> SpectralScan:
        """What the scan contributes to every pair: its spectra, its layers' harmonics, its surface and its view.

        Raises:
            InputError: the scan shows too little structure.
        """
        volume = self._preparer.prepare(scan)
        points = self.grid.to_voxels(scan.points, volume.center)
        coefficients = self.so3.analyze(volume.magnitude)
        prepared = SpectralScan(
            volume=volume,
            coarse=self._coarsen(volume),
            coefficients=self.so3.prepare(coefficients),
            signature=signature(coefficients),
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
        contest = Contest(self._verifier, self._pool, self.grid, target, source, self._bounds(target, source))
        # where the spectra are alike over all rotations
        rotations = self.rotations(target, source)
        if not len(rotations.scores):
            return self._nothing(start)
        # where the scan would lie under each
        candidates = contest.candidates(rotations)
        if not len(candidates.psr):
            return self._nothing(start)
        # the best of these by what the scans saw, refined, and compared on the whole grid
        finalists = contest.refined(candidates, self.config.shortlist)[: self.config.finalists]
        found = contest.compared(finalists + contest.missed(finalists))
        return self._conclude(contest, contest.settled(found, self.config.refinement == "spectral"), start)

    @staticmethod
    def signature(prepared: SpectralScan) -> np.ndarray:
        """(K,) float32, nearly the same however the scan's points are turned and moved; for a `PlaceIndex`."""
        return prepared.signature

    def rotations(self, target: SpectralScan, source: SpectralScan) -> RotationPeaks:
        """Those that `register` follows: the best that may be meant, and the one that the instruments measured."""
        bounds = self._bounds(target, source)
        count = self.config.hypotheses
        found = self.so3.candidates(target.coefficients, source.coefficients, count, bounds.allow_rotations)
        measured = bounds.measured
        if measured is None:
            return found
        return RotationPeaks(Rotation.concatenate([found.R, measured]), np.append(found.scores, 0.0))

    def _bounds(self, target: SpectralScan, source: SpectralScan) -> Bounds:
        return Bounds(self.config.max_tilt, relative_prior(target.prior, source.prior), self.grid.voxel)

    def _conclude(self, contest: Contest, found: list[Verified], start: float) -> Registration:
        """The result: the best hypothesis, and beside it every other that cannot be excluded."""
        covariances = [fit_covariance(one, contest.source.volume.center, self.grid) for one in found]
        beliefs = believe(found, covariances, self.grid, self.config.least_probability)
        best, *others = [
            self._registration(contest, one, covariance, belief)
            for one, covariance, belief in zip(found, covariances, beliefs, strict=True)
            if one is found[0] or belief.possible
        ]
        return replace(best, alternatives=tuple(others), seconds=perf_counter() - start)

    @staticmethod
    def _registration(contest: Contest, one: Verified, covariance: np.ndarray, belief: Belief) -> Registration:
        """One hypothesis as a registration between the sensor frames."""
        T = contest.transform(one.fit)
        refusal = contest.bounds.refusal(T)
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
                ("candidate", one.refined.origin.psr),
                ("translation", one.psr),
            ),
        )

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
