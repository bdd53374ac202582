"""The spectral registration of two scans: the seven steps of Sect. 2.11, in order, on one screen."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kernels.device import Device
from kernels.errors import DeviceError, InputError
from kernels.peak import Peak
from spectral.grid import EDGES, Grid
from spectral.hemisphere import Hemisphere
from spectral.overlap import overlap, unwrap
from spectral.prepared import Prepared, Preparer
from spectral.refine import search_rotation
from spectral.result import Registration
from spectral.scan import Scan
from spectral.translation import Translation
from spectral.uncertainty import covariance


@dataclass(frozen=True, slots=True)
class SpectralConfig:
    """How to register.

    Attributes:
        yaw_peaks: how many yaw peaks are followed, each with its + 180 degrees; 1 is the paper.
        max_tilt: largest roll and largest pitch between two scans [rad] (Sect. 2.7).
        refinements: how often yaw and then roll and pitch are estimated again, on what the first round left over;
            0 is the paper.
        final_refinements: how often more for the hypothesis that the translation chose.
        search: whether its rotation is then moved to where the translation's peak is highest; False is the paper.
        use_strength: whether voxels hold the echo strength instead of the paper's occupancy.
        least_psr: the translation's peak-to-sidelobe ratio from which on a registration is believed, on a grid of up
            to 128 voxels per edge. On larger ones false peaks are higher, and it grows with (edge / 128)^0.75.
        least_distinction: how many times as high as that of any other hypothesis, or any other shift, it has to be.
        least_overlap: the share of points in common from which on it is believed.
    """

    yaw_peaks: int = 6
    max_tilt: float = float(np.deg2rad(35.0))
    refinements: int = 1
    final_refinements: int = 2
    search: bool = True
    use_strength: bool = False
    least_psr: float = 30.0
    least_distinction: float = 1.8
    least_overlap: float = 0.05

    def __post_init__(self) -> None:
        if self.yaw_peaks < 1 or self.refinements < 0 or self.final_refinements < 0:
            raise InputError(
                f"yaw_peaks is {self.yaw_peaks}, refinements {self.refinements} and {self.final_refinements}; "
                "wanted at least 1, 0 and 0"
            )
        if not 0 < self.max_tilt <= np.pi:
            raise InputError(f"--max-tilt {np.rad2deg(self.max_tilt):g}: wanted above 0 and up to 180 degrees")


@dataclass(frozen=True, slots=True)
class _Hypothesis:
    """A rotation, the translation's peak under it, and the peak-to-sidelobe ratios on the way there."""

    R: Rotation
    peak: Peak
    yaw_psr: float
    tilt_psr: float


class SpectralRegistrar:
    """Spectral registration on one device and grid; any two scans it prepared can be registered."""

    # Once the first round is through, what is left is small; the second looks no farther than this [rad].
    _HEADING_LEFT = float(np.deg2rad(20.0))
    _TILT_LEFT = float(np.deg2rad(15.0))
    # Hypotheses nearer than this to the best are the same one, not rivals [rad; voxels].
    _SAME_ROTATION = float(np.deg2rad(10.0))
    _SAME_SHIFT = 6.0
    # The unwraps show one hemisphere: a tilt of 90 degrees would carry its pole to the rim.
    _LARGEST_TILT = float(np.deg2rad(85.0))

    def __init__(self, device: Device, grid: Grid, config: SpectralConfig | None = None) -> None:
        """Plan everything that does not depend on the scans.

        Raises:
            DeviceError: the device cannot hold what the grid needs.
        """
        self.device, self.grid, self.config = device, grid, config or SpectralConfig()
        require_memory(device, grid.edge)
        self._hemisphere = Hemisphere(device, grid.edge)
        self._translation = Translation(device, grid.edge)
        self._preparer = Preparer(device, grid, self._hemisphere, self.config.use_strength)
        self._warm = False

    def prepare(self, scan: Scan) -> Prepared:
        """What the scan contributes to every pair: its spectra and, for the steps 1 and 4, its layers.

        Raises:
            InputError: the scan shows too little structure.
        """
        prepared = self._preparer.prepare(scan)
        if not self._warm:
            self._warm_up(prepared)
        return prepared

    def _warm_up(self, prepared: Prepared) -> None:
        """Launch every kernel that a pair needs: some drivers compile at the first launch, which takes seconds."""
        R = Rotation.identity()
        self._hemisphere.yaw_candidates(prepared.layers, prepared.layers, 1)
        self._hemisphere.heading(prepared.layers, prepared.magnitude, R, self._HEADING_LEFT)
        self._hemisphere.tilt(prepared.layers, prepared.magnitude, R, self._TILT_LEFT)
        self._translation.find_others(prepared, prepared, R, self._SAME_SHIFT)
        self._warm = True

    def register(self, target: Prepared, source: Prepared) -> Registration:
        """Find T_target_source; `accepted` says whether to believe it."""
        start = perf_counter()
        hypotheses = self._hypotheses(target, source)
        best = max(hypotheses, key=lambda hypothesis: hypothesis.peak.psr)
        best = self._settle(target, source, best)
        rival = self._rival(target, source, best, hypotheses)
        return self._conclude(target, source, best, rival, start)

    def _hypotheses(self, target: Prepared, source: Prepared) -> list[_Hypothesis]:
        """Steps 1 to 7 for each yaw candidate."""
        found = []
        # Steps 1, 2: yaw from the rotational unwraps
        for yaw in self._hemisphere.yaw_candidates(target.layers, source.layers, self.config.yaw_peaks):
            # Steps 3 to 5: roll and pitch from the rectangular unwraps, the spectrum turned back by yaw
            limit = min(self.config.max_tilt, self._LARGEST_TILT)
            tilt = self._hemisphere.tilt(target.layers, source.magnitude, yaw.R, limit)
            R = yaw.R if tilt is None else tilt.R * yaw.R
            R = self._refine(target, source, R, self.config.refinements)
            # Steps 6, 7: the translation, the scan turned back by all three angles
            peak = self._translation.find(target, source, R)
            found.append(_Hypothesis(R, peak, yaw.psr, 0.0 if tilt is None else tilt.psr))
        return found

    def _refine(self, target: Prepared, source: Prepared, R: Rotation, rounds: int) -> Rotation:
        """Estimate yaw, then roll and pitch, again, on what R leaves over."""
        for _ in range(rounds):
            heading = self._hemisphere.heading(target.layers, source.magnitude, R, self._HEADING_LEFT)
            R = R if heading is None else heading.R * R
            tilt = self._hemisphere.tilt(target.layers, source.magnitude, R, self._TILT_LEFT)
            R = R if tilt is None else tilt.R * R
        return R

    def _settle(self, target: Prepared, source: Prepared, best: _Hypothesis) -> _Hypothesis:
        """Refine the chosen hypothesis further; keep what has the higher translation peak."""
        R, peak = best.R, best.peak
        for _ in range(self.config.final_refinements):
            again = self._refine(target, source, R, 1)
            found = self._translation.find(target, source, again)
            if found.psr > peak.psr:
                R, peak = again, found
        if self.config.search:
            R, peak = search_rotation(self._translation, target, source, R, peak)
        return _Hypothesis(R, peak, best.yaw_psr, best.tilt_psr)

    def _rival(self, target: Prepared, source: Prepared, best: _Hypothesis, hypotheses: list[_Hypothesis]) -> float:
        """The peak-to-sidelobe ratio of the next best answer: another hypothesis, or another shift under the best."""
        ratios = [
            other.peak.psr
            for other in hypotheses
            if (best.R.inv() * other.R).magnitude() > self._SAME_ROTATION
            or np.linalg.norm(best.peak.shift - other.peak.shift) > self._SAME_SHIFT
        ]
        ratios += [peak.psr for peak in self._translation.find_others(target, source, best.R, self._SAME_SHIFT)]
        return max(ratios, default=0.0)

    def _conclude(
        self, target: Prepared, source: Prepared, best: _Hypothesis, rival: float, start: float
    ) -> Registration:
        """The transform between the sensor frames, its uncertainty, and whether to believe it."""
        voxel, R = self.grid.voxel, best.R
        voxels = unwrap(target, source, R, best.peak.shift, self.grid.edge)
        shift = target.center + voxels * voxel - R.apply(source.center)
        share = overlap(target, source, R, voxels)
        accepted, reason = self._judge(best, rival, share)
        return Registration(
            T_target_source=RigidTransform.from_components(shift, R),
            covariance=covariance(best.peak, R, source.center, self.grid, self._hemisphere.tilt_bin),
            psr=best.peak.psr,
            overlap=share,
            accepted=accepted,
            seconds=perf_counter() - start,
            reason=reason,
            step_psr=(
                ("yaw", best.yaw_psr),
                ("tilt", best.tilt_psr),
                ("translation", best.peak.psr),
                ("rival", rival),
            ),
        )

    def _judge(self, best: _Hypothesis, rival: float, share: float) -> tuple[bool, str]:
        """Whether to believe it, and why in words."""
        least, psr = self.config, best.peak.psr
        least_psr = least.least_psr * max(1.0, self.grid.edge / 128) ** 0.75
        _, pitch, roll = np.abs(best.R.as_euler("ZYX"))
        if psr < least_psr:
            return (
                False,
                f"the translation's peak is {psr:.1f} standard deviations high; believed from {least_psr:.0f} on",
            )
        if psr < least.least_distinction * rival:
            return False, (
                f"the translation's peak is {psr:.1f} standard deviations high and another answer's {rival:.1f}; "
                f"believed from {least.least_distinction:g} times as high on"
            )
        if share < least.least_overlap:
            return (
                False,
                f"the scans share {share:.1%} of their points; believed from {least.least_overlap:.0%} on",
            )
        if max(pitch, roll) > least.max_tilt + 2 * self._hemisphere.tilt_bin:
            return False, (
                f"roll and pitch are {np.rad2deg(roll):.0f} and {np.rad2deg(pitch):.0f} degrees; believed up to "
                f"--max-tilt {np.rad2deg(least.max_tilt):g}"
            )
        return True, (
            f"the translation's peak is {psr:.1f} standard deviations high, the next answer's {rival:.1f}; "
            f"{share:.0%} of the points are shared"
        )


def require_memory(device: Device, edge: int) -> None:
    """Refuse a grid that the device cannot hold, before anything is allocated.

    Raises:
        DeviceError: saying how much is needed and which grid would fit.
    """
    smaller = [e for e in reversed(EDGES) if e < edge]
    fitting = next((e for e in smaller if _fits(device, e)), None)
    device.require(*_memory(edge), hint=f"--grid {fitting}" if fitting else "another device")


def _fits(device: Device, edge: int) -> bool:
    try:
        device.require(*_memory(edge), hint="")
    except DeviceError:
        return False
    return True


def _memory(edge: int) -> tuple[int, int]:
    """What a pair needs on a grid: its largest single array and all of them together [bytes]."""
    half_spectrum = 8 * edge * edge * (edge // 2 + 8)
    layers = int(0.6 * edge / 2) + 1
    stack = 2 * layers * edge * edge
    tilt_spectra = 2 * layers * edge * (edge // 2 + 8) * 8
    prepared = half_spectrum * 3 // 2 + tilt_spectra * 3 // 2
    scratch = 3 * 4 * edge**3 + 3 * half_spectrum + 2 * 4 * stack + tilt_spectra
    return max(half_spectrum, tilt_spectra, 4 * edge**3), 2 * prepared + scratch
