"""S0..S9 of Table 1 by every method, on one device and grid."""

from collections.abc import Sequence
from dataclasses import fields, replace
from time import perf_counter

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.gaussian.row import RANKED, GaussianRow, GaussianTime, row_of
from sonarmap.tools.lab.reproduce.gaussian.scored import ScoredRegistration
from sonarmap.tools.lab.reproduce.gaussian.variants import VARIANTS
from sonarmap.tools.lab.simulate.plan import table1_pair

# What a config says of pairs alone; two that differ in nothing else prepare a scan alike.
_OF_PAIRS = ("yaw_peaks", "max_tilt", "refinements", "final_refinements", "search", "acceptance")


class Series:
    """Registers pairs of Table 1 by every method; each holds its own plan on the device.

    The methods take turns on each pair, so that what else the machine does strikes all alike. A scan is prepared once
    for all methods that prepare alike.
    """

    def __init__(self, device: Device, grid: Grid, scene: str) -> None:
        """Plan every method.

        Raises:
            DeviceError: the device cannot hold what the grid needs.
        """
        self.device, self.grid, self.scene = device, grid, scene
        self._registrars = {name: HemisphereRegistrar(device, grid, method.config) for name, method in VARIANTS.items()}
        self._reference: tuple[tuple[int, float], dict[str, LayeredScan]] | None = None

    def register(self, index: int, seed: int, sigma2: float) -> list[tuple[GaussianRow, GaussianTime]]:
        """S`index` by every method; the reference scan is prepared once for all scans of a series.

        Raises:
            InputError: a scan that shows too little to be registered.
        """
        target, source, truth = table1_pair(index, seed, sigma2, self.scene)
        if self._reference is None or self._reference[0] != (seed, sigma2):
            self._reference = (seed, sigma2), {name: prepared for name, (prepared, _) in self._prepare(target).items()}
        rows = []
        for name, (candidate, seconds) in self._prepare(source).items():
            registration = self._registrars[name].register(self._reference[1][name], candidate)
            scored = ScoredRegistration(registration, truth, candidate.volume.center, self.grid.voxel)
            rank = yaw_rank(self._registrars[name], self._reference[1][name], candidate, truth)
            row = row_of(scored, (self.scene, sigma2, seed, index), name, self.grid.edge, rank)
            time = GaussianTime(self.grid.edge, sigma2, seed, index, name, seconds, registration.seconds)
            rows.append((row, time))
        return rows

    def _prepare(self, scan: Scan) -> dict[str, tuple[LayeredScan, float]]:
        """The scan as every method needs it, by the method's name, and the seconds that took."""
        shared: list[tuple[HemisphereConfig, tuple[LayeredScan, float]]] = []
        prepared_by_name = {}
        for name, registrar in self._registrars.items():
            preparation = preparation_of(registrar.config)
            known = _find(shared, preparation)
            if known is None:
                start = perf_counter()
                prepared = registrar.prepare(scan)
                self.device.queue.finish()  # so that the registration's seconds are its own
                known = prepared, perf_counter() - start
                shared.append((preparation, known))
            prepared_by_name[name] = known
        return prepared_by_name


def yaw_rank(registrar: HemisphereRegistrar, target: LayeredScan, source: LayeredScan, truth: RigidTransform) -> int:
    """The place of the right yaw among the RANKED highest peaks, each with its + 180 degrees; 0 where it is none."""
    peaks = registrar.hemisphere.yaw_candidates(target.layers, source.layers, RANKED)
    true = truth.rotation.as_euler("ZYX", degrees=True)[0]
    for k, peak in enumerate(peaks):
        off = peak.R.as_euler("ZYX", degrees=True)[0] - true
        if abs((off + 180) % 360 - 180) <= RIGHT_DEG:
            return k // 2 + 1
    return 0


def preparation_of(config: HemisphereConfig) -> HemisphereConfig:
    """What of a config decides how a scan is prepared: the rest as it is by default."""
    by_default = HemisphereConfig()
    kept = {field.name: getattr(by_default, field.name) for field in fields(config) if field.name in _OF_PAIRS}
    return replace(config, **kept)


def _find(
    shared: Sequence[tuple[HemisphereConfig, tuple[LayeredScan, float]]], preparation: HemisphereConfig
) -> tuple[LayeredScan, float] | None:
    return next((known for earlier, known in shared if earlier == preparation), None)
