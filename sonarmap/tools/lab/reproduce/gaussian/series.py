"""The variants of the paper's chain that the experiment compares. A new one is a row of VARIANTS."""

from dataclasses import dataclass, fields, replace
from time import perf_counter
from types import MappingProxyType

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.gaussian.row import RANKED, ScoredRegistration, row_of
from sonarmap.tools.lab.simulate.plan import table1_pair


@dataclass(frozen=True, slots=True)
class ChainVariant:
    """A configuration of the paper's chain."""

    title: str  # what it does, in words
    config: HemisphereConfig  # of the spectral registration


# Name in tables and files -> variant
VARIANTS: MappingProxyType[str, ChainVariant] = MappingProxyType(
    {
        "paper": ChainVariant(
            "the paper's chain: the steps of Sect. 2.11 once, with the paper's windows, along the highest yaw peak",
            HemisphereConfig.paper(),
        ),
        "one peak": ChainVariant(
            "the chain along the highest yaw peak, with the rotation refined", HemisphereConfig(yaw_peaks=1)
        ),
        "six peaks": ChainVariant(
            "the chain along the six highest yaw peaks, with the rotation refined; these are the defaults of the "
            "method `hemisphere`",
            HemisphereConfig(yaw_peaks=6),
        ),
    }
)


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

    def register(self, index: int, seed: int, sigma2: float) -> list[tuple[Row, Row]]:
        """S`index` by every method: its row, and its times [s], those of preparing it and of registering it.

        The reference scan is prepared once for all scans of a series.

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
            which = {key: row[key] for key in ("grid", "sigma2", "seed", "scan", "method")}
            rows.append((row, which | {"prepare_s": seconds, "register_s": registration.seconds}))
        return rows

    def _prepare(self, scan: Scan) -> dict[str, tuple[LayeredScan, float]]:
        """The scan as every method needs it, by the method's name, and the seconds that took."""
        shared: dict[HemisphereConfig, tuple[LayeredScan, float]] = {}
        for registrar in self._registrars.values():
            if preparation_of(registrar.config) not in shared:
                start = perf_counter()
                prepared = registrar.prepare(scan)
                self.device.queue.finish()  # so that the registration's seconds are its own
                shared[preparation_of(registrar.config)] = prepared, perf_counter() - start
        return {name: shared[preparation_of(registrar.config)] for name, registrar in self._registrars.items()}


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
