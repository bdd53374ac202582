"""The paper's registration of two scans: the seven steps of Sect. 2.11, in order, on one screen."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import tilt_allowed, tilt_reach
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.layers import Hemisphere, LayerSpectra
from sonarmap.spectral.hemisphere.match import Match, assess, differ, overlap, peak_covariance, unwrap
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.prepare.prepared import GridRegistrar, Prepared, Preparer
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.translation import SAME_SHIFT, Translation


@dataclass(frozen=True, slots=True)
class HemisphereConfig:
    """How to register two scans by `HemisphereRegistrar`.

    Attributes:
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7).
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
        centered: whether each scan's grid is centered on its points; else on the origin of its frame, and what lies
            outside is lost, as where volumes are shifted out of their frame in the paper's Sect. 3.
    """

    max_tilt: float = float(np.deg2rad(35.0))
    use_strength: bool = False
    centered: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"`max_tilt` is {np.rad2deg(self.max_tilt):g} degrees; give more than 0 and up to 180")


@dataclass(frozen=True, slots=True)
class LayeredScan:
    """What one scan contributes to every pair."""

    volume: Prepared  # its spectrum
    magnitude: Array  # device (N, N, N/2 + 1) float32, centered magnitude spectrum
    layers: LayerSpectra  # its layers' spectra, for the steps 1 and 4


class HemisphereRegistrar(GridRegistrar):
    """The paper's registration on one device and grid; any two scans it prepared can be registered."""

    # The unwraps show one hemisphere: a tilt of 90 degrees would carry its pole to the rim.
    _LARGEST_TILT = float(np.deg2rad(85.0))

    def __init__(self, device: Device, grid: Grid, config: HemisphereConfig | None = None) -> None:
        """Plan everything that does not depend on the scans.

        Raises:
            DeviceError: the device has too little memory.
        """
        self.config = config or HemisphereConfig()
        super().__init__(device, grid, memory_plan(grid.edge, "hemisphere"))
        self.hemisphere = Hemisphere(device, grid.edge)
        self._translation = Translation(device, grid.edge)
        self._preparer = Preparer(device, grid, self.config.use_strength, self.config.centered)

    def prepare(self, scan: Scan) -> LayeredScan:
        """A scan's spectra and, for the steps 1 and 4, its layers; InputError where it shows too little structure."""
        volume, magnitude = self._preparer.prepare(scan)
        return LayeredScan(volume, magnitude, self.hemisphere.prepare(magnitude))

    def register(self, target: LayeredScan, source: LayeredScan) -> Registration:
        """T_target_source of two scans from `prepare`, and whether to believe it; without a probability."""
        start = perf_counter()
        best, *others = sorted(self._matches(target, source), key=lambda match: -match.peak.psr)
        return self._conclude(target, source, best, self._rival(target, source, best, others), start)

    def _matches(self, target: LayeredScan, source: LayeredScan) -> list[Match]:
        """Steps 1 to 7, for the yaw of the highest peak and for its + 180 degrees."""
        matches: list[Match] = []
        # Steps 1, 2: yaw from the rotational unwraps
        for yaw in self.hemisphere.yaws(target.layers, source.layers):
            # Steps 3 to 5: roll and pitch from the rectangular unwraps, the spectrum turned back by yaw
            reach = min(tilt_reach(self.config.max_tilt), self._LARGEST_TILT)
            tilt = self.hemisphere.tilt(target.layers, source.magnitude, yaw.R, reach, self._may_tilt)
            R = yaw.R if tilt is None else tilt.R * yaw.R
            # Steps 6, 7: the translation, the scan turned back by all three angles
            peak = self._translation.find(target.volume, source.volume, R)
            matches.append(Match(R, peak, yaw.psr, 0.0 if tilt is None else tilt.psr))
        # what the vehicle cannot do must not win; where nothing else is left, it is refused in the end
        return [match for match in matches if self._may_tilt(match.R)] or matches

    def _may_tilt(self, R_target_source: Rotation) -> bool:
        return bool(tilt_allowed(R_target_source, self.config.max_tilt))

    def _rival(self, target: LayeredScan, source: LayeredScan, best: Match, others: list[Match]) -> float:
        """The peak-to-sidelobe ratio of the next best answer: the other yaw's, or another shift under the best."""
        ratios = [other.peak.psr for other in others if differ(best, other, self.grid.edge)]
        ratios += [peak.psr for peak in self._translation.find_others(target.volume, source.volume, best.R, SAME_SHIFT)]
        return max(ratios, default=0.0)

    def _conclude(
        self, target: LayeredScan, source: LayeredScan, best: Match, rival: float, start: float
    ) -> Registration:
        """The transform between the sensor frames, its uncertainty, and whether to believe it."""
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
