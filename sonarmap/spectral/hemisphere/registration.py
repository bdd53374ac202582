"""The paper's registration of two scans: the seven steps of Sect. 2.11, in order, on one screen."""

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.covariance import peak_covariance
from sonarmap.spectral.hemisphere.layers import Hemisphere, LayerSpectra
from sonarmap.spectral.hemisphere.match import Acceptance, Match, assess, differ
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.overlap import overlap, unwrap
from sonarmap.spectral.prepare.prepared import GridRegistrar, Prepared, Preparer
from sonarmap.spectral.result import Registration
from sonarmap.spectral.rotation_search import search_rotation
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.tilt import tilt_allowed, tilt_reach
from sonarmap.spectral.translation import SAME_SHIFT, Translation


@dataclass(frozen=True, slots=True)
class HemisphereConfig:
    """How to register two scans by `HemisphereRegistrar`.

    Attributes:
        yaw_peaks: how many yaw peaks are followed, each with its + 180 degrees; 1 is the paper.
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7).
        refinements: how often yaw and then roll and pitch are estimated again, on what the first round left over;
            0 is the paper.
        final_refinements: how often more for the hypothesis that the translation chose.
        search: whether its rotation is then moved to where the translation's peak is highest; False is the paper.
        windowed: whether the unwraps that yaw is read from are windowed, as in the paper. On structures that are seen
            whole a window makes yaw exact; on what a sensor sees of them it costs a few of the right hypotheses.
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
        centered: whether each scan's grid is centered on its points; else on the origin of its frame, and what lies
            outside is lost, as where volumes are shifted out of their frame in the paper's Sect. 3.
        acceptance: the thresholds from which on a registration is accepted.

    Raises:
        InputError: a count or an angle out of its range.
    """

    yaw_peaks: int = 6
    max_tilt: float = float(np.deg2rad(35.0))
    refinements: int = 1
    final_refinements: int = 2
    search: bool = True
    windowed: bool = False
    use_strength: bool = False
    centered: bool = True
    acceptance: Acceptance = field(default_factory=Acceptance)

    def __post_init__(self) -> None:
        for name, least in (("yaw_peaks", 1), ("refinements", 0), ("final_refinements", 0)):
            if getattr(self, name) < least:
                raise InputError(f"`{name}={getattr(self, name)}` is too few; give at least {least}")
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"`max_tilt` is {np.rad2deg(self.max_tilt):g} degrees; give more than 0 and up to 180")

    @classmethod
    def paper(cls, centered: bool = True) -> "HemisphereConfig":
        """The paper's chain: the seven steps of Sect. 2.11 once, along the highest yaw peak."""
        once = cls(yaw_peaks=1, refinements=0, final_refinements=0, search=False)
        return replace(once, windowed=True, centered=centered)


@dataclass(frozen=True, slots=True)
class LayeredScan:
    """What one scan contributes to every pair."""

    volume: Prepared  # its spectrum
    magnitude: Array  # device (N, N, N/2 + 1) float32, centered magnitude spectrum
    layers: LayerSpectra  # its layers' spectra, for the steps 1 and 4


class HemisphereRegistrar(GridRegistrar):
    """The paper's registration on one device and grid; any two scans it prepared can be registered."""

    # Once the first round is through, what is left is small; the second looks no farther than this [rad].
    _HEADING_LEFT = float(np.deg2rad(20.0))
    _TILT_LEFT = float(np.deg2rad(15.0))
    # The unwraps show one hemisphere: a tilt of 90 degrees would carry its pole to the rim.
    _LARGEST_TILT = float(np.deg2rad(85.0))

    def __init__(self, device: Device, grid: Grid, config: HemisphereConfig | None = None) -> None:
        """Plan everything that does not depend on the scans.

        Args:
            device: from `choose_device`.
            grid: of every scan, as `choose_grid` makes it.
            config: None for the defaults.

        Raises:
            DeviceError: the device has too little memory.
        """
        self.config = config or HemisphereConfig()
        super().__init__(device, grid, memory_plan(grid.edge, "hemisphere"))
        self.hemisphere = Hemisphere(device, grid.edge, self.config.windowed)
        self._translation = Translation(device, grid.edge)
        self._preparer = Preparer(device, grid, self.config.use_strength, self.config.centered)

    def prepare(self, scan: Scan) -> LayeredScan:
        """A scan's spectra and, for the steps 1 and 4, its layers; InputError where it shows too little structure."""
        volume, magnitude = self._preparer.prepare(scan)
        return LayeredScan(volume, magnitude, self.hemisphere.prepare(magnitude))

    def register(self, target: LayeredScan, source: LayeredScan) -> Registration:
        """T_target_source of two scans from `prepare`, and whether to believe it; without a probability."""
        return self._register(target, source)

    def _register(self, target: LayeredScan, source: LayeredScan) -> Registration:
        """As `register`; the first pair twice, as drivers compile or load kernels meanwhile."""
        if not self._warm:
            self._warm = True
            self._register(target, source)
        start = perf_counter()
        matches = sorted(self._matches(target, source), key=lambda match: -match.peak.psr)
        first = matches[0]
        others = [match for match in matches if differ(first, match, self.grid.edge)]
        # the best other answer is refined alike: it may win, and if not, how high it comes out is what to compare with
        refined = [self._refine_further(target, source, match) for match in (first, *others[:1])]
        refined.sort(key=lambda match: (not self._may_tilt(match.R), -match.peak.psr))
        rival = self._rival(target, source, refined[0], refined[1:] + others[1:])
        return self._conclude(target, source, refined[0], rival, start)

    def _matches(self, target: LayeredScan, source: LayeredScan) -> list[Match]:
        """Steps 1 to 7 for each yaw candidate."""
        matches: list[Match] = []
        # Steps 1, 2: yaw from the rotational unwraps
        for yaw in self.hemisphere.yaw_candidates(target.layers, source.layers, self.config.yaw_peaks):
            # Steps 3 to 5: roll and pitch from the rectangular unwraps, the spectrum turned back by yaw
            reach = min(tilt_reach(self.config.max_tilt), self._LARGEST_TILT)
            tilt = self.hemisphere.tilt(target.layers, source.magnitude, yaw.R, reach, self._may_tilt)
            R = yaw.R if tilt is None else tilt.R * yaw.R
            R = self._refine(target, source, R, self.config.refinements)
            # Steps 6, 7: the translation, the scan turned back by all three angles
            peak = self._translation.find(target.volume, source.volume, R)
            matches.append(Match(R, peak, yaw.psr, 0.0 if tilt is None else tilt.psr))
        # what the vehicle cannot do must not win; where nothing else is left, it is refused in the end
        return [match for match in matches if self._may_tilt(match.R)] or matches

    def _may_tilt(self, R_target_source: Rotation) -> bool:
        return bool(tilt_allowed(R_target_source, self.config.max_tilt))

    def _refine(self, target: LayeredScan, source: LayeredScan, R: Rotation, rounds: int) -> Rotation:
        """Estimate yaw, then roll and pitch, again, on what R leaves over."""
        for _ in range(rounds):
            heading = self.hemisphere.heading(target.layers, source.magnitude, R, self._HEADING_LEFT)
            R = R if heading is None else heading.R * R
            tilt = self.hemisphere.tilt(target.layers, source.magnitude, R, self._TILT_LEFT)
            R = R if tilt is None else tilt.R * R
        return R

    def _refine_further(self, target: LayeredScan, source: LayeredScan, best: Match) -> Match:
        """Refine a match further; keep what has the higher translation peak."""
        R, peak = best.R, best.peak
        for _ in range(self.config.final_refinements):
            refined_R = self._refine(target, source, R, 1)
            refined_peak = self._translation.find(target.volume, source.volume, refined_R)
            if refined_peak.psr > peak.psr:
                R, peak = refined_R, refined_peak
        if self.config.search:
            R, peak = search_rotation(self._translation, target.volume, source.volume, R, peak)
        return Match(R, peak, best.yaw_psr, best.tilt_psr)

    def _rival(self, target: LayeredScan, source: LayeredScan, best: Match, others: list[Match]) -> float:
        """The peak-to-sidelobe ratio of the next best answer: another match, or another shift under the best."""
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
        accepted, reason = assess(best, rival, share, self.config.acceptance, self.config.max_tilt, self.grid)
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
