"""Where the right pose is lost: pairs of every kind and of the continued Table 1, looked at stage by stage."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import pi
from typing import ClassVar

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.evidence.pairs import draw
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.funnel.section import funnel_section
from sonarmap.tools.lab.reproduce.funnel.settings import KINDS, STEPS, VARIANCES, FunnelSettings, funnel_settings
from sonarmap.tools.lab.reproduce.funnel.traced import TracingRegistrar
from sonarmap.tools.lab.reproduce.settings import paper_grid
from sonarmap.tools.lab.simulate.plan import table1_pair

TABLE1 = "S"  # what the sets of Table 1 begin with
_SHARE = 5  # a set of Table 1 has so many times fewer pairs


class Funnel(Experiment):
    """Traces pairs; a job is one of them, or the steps of one scene of Table 1 under one noise."""

    name = "funnel"
    sources: ClassVar[tuple[str, ...]] = (
        *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/funnel"),
        *(f"tools/lab/reproduce/{name}.py" for name in ("evidence/pairs", "evaluation/pair_set", "settings")),
    )
    make_section = staticmethod(funnel_section)
    settings: FunnelSettings
    device: Device

    def __init__(self, settings: FunnelSettings, device: Device) -> None:
        """One registrar is kept for pairs on one grid."""
        super().__init__(settings, device)
        self._registrar = lru_cache(maxsize=2)(self._planned)

    def jobs(self) -> Sequence[str]:
        """Set and number, as in swath-0003 or S1.0-0003; the sets in turns, so that a run that is stopped has some."""
        counts = dict.fromkeys(KINDS, self.settings.pairs)
        counts |= {f"{TABLE1}{variance!r}": -(-self.settings.pairs // _SHARE) for variance in VARIANCES}
        numbered = [(n / count, f"{name}-{n:04d}") for name, count in counts.items() for n in range(count)]
        return [job for _, job in sorted(numbered)]

    def run(self, job: str) -> Outcome:
        """Trace a pair, or those of the steps; none where the scene has no such pair or a scan shows too little."""
        name, _, number = job.partition("-")
        pairs = self._table1(name, int(number)) if name.startswith(TABLE1) else self._kind(name, int(number))
        rows: list[Row] = []
        for cells, target, source, truth, grid, any_tilt in pairs:
            registrar = self._registrar(grid.edge, any_tilt).with_voxel(grid.voxel)
            try:
                prepared = registrar.prepare(target), registrar.prepare(source)
            except InputError:
                continue
            traced = registrar.trace(*prepared, truth)
            if "final" in traced:
                rows.append(cells | traced)
        return Outcome(tuple(rows))

    def _kind(
        self, name: str, number: int
    ) -> Iterator[tuple[dict[str, Value], Scan, Scan, RigidTransform, Grid, bool]]:
        pair = next(draw(name, number, self.settings.seed, self.settings.edge), None)
        if pair is not None and pair.truth is not None and pair.grid.edge == self.settings.edge:
            cells = {"set": name, "scene": pair.cells["scene"], "relief": pair.cells["relief"]}
            yield cells, pair.target, pair.source, pair.truth, pair.grid, pair.any_tilt

    def _table1(
        self, name: str, number: int
    ) -> Iterator[tuple[dict[str, Value], Scan, Scan, RigidTransform, Grid, bool]]:
        for step in STEPS:
            target, source, truth = table1_pair(step, self.settings.seed + number, float(name.removeprefix(TABLE1)))
            cells: dict[str, Value] = {"set": f"{TABLE1}{step}", "scene": "floodgate", "relief": "rich"}
            yield cells, target, source, truth, paper_grid(self.settings.edge), False

    def _planned(self, edge: int, any_tilt: bool) -> TracingRegistrar:
        config = SpectralConfig(max_tilt=pi) if any_tilt else SpectralConfig()
        return TracingRegistrar(self.device, Grid(edge, 1.0), config)


def create(request: Request) -> Funnel:
    """The experiment as the command line asks for it."""
    return Funnel(funnel_settings(request), request.opened)
