"""Where the right pose is lost: pairs of every kind and of the continued Table 1, looked at stage by stage."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import islice
from math import pi
from typing import ClassVar

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.lab.reproduce.evidence.pairs import EvidencePair, draw
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Value, in_turns
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.funnel.section import funnel_section
from sonarmap.tools.lab.reproduce.funnel.settings import KINDS, STEPS, VARIANCES, FunnelSettings
from sonarmap.tools.lab.reproduce.funnel.traced import TracingRegistrar
from sonarmap.tools.lab.reproduce.kinds.settings import NOTHING
from sonarmap.tools.lab.reproduce.settings import as_asked, paper_grid
from sonarmap.tools.lab.simulate.kinds.kind import relief_of
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
        """Set and number, as in swath-0003 or S1.0-0003."""
        counts = dict.fromkeys(KINDS, self.settings.pairs)
        counts |= {f"{TABLE1}{variance!r}": -(-self.settings.pairs // _SHARE) for variance in VARIANCES}
        return in_turns(counts)

    def run(self, job: str) -> Outcome:
        """Trace a pair, or those of the steps; none where the scene has no such pair or a scan shows too little."""
        name, _, number = job.partition("-")
        pairs = self._table1(name, int(number)) if name.startswith(TABLE1) else self._kind(name, int(number))
        rows: list[Row] = []
        for pair in pairs:
            registrar = self._registrar(pair.grid.edge, pair.any_tilt).with_voxel(pair.grid.voxel)
            try:
                prepared = registrar.prepare(pair.target), registrar.prepare(pair.source)
            except InputError:
                continue
            if pair.truth is not None:
                rows.append(pair.cells | registrar.trace(*prepared, pair.truth))
        return Outcome(tuple(rows))

    def _kind(self, name: str, number: int) -> Sequence[EvidencePair]:
        """The first pair of a draw, of which nothing is known but the points, on the usual grid."""
        first = list(islice(draw(name, number, self.settings.seed, self.settings.edge), 1))
        return [pair for pair in first if pair.grid.edge == self.settings.edge]

    def _table1(self, name: str, number: int) -> Iterator[EvidencePair]:
        for step in STEPS:
            pair = table1_pair(step, self.settings.seed + number, float(name.removeprefix(TABLE1)))
            cells: dict[str, Value] = {"set": f"{TABLE1}{step}", "number": number, "scene": "floodgate"}
            cells |= {"relief": relief_of("floodgate"), "known": NOTHING, "apart": 0}
            yield EvidencePair(cells, *pair, paper_grid(self.settings.edge))

    def _planned(self, edge: int, any_tilt: bool) -> TracingRegistrar:
        config = SpectralConfig(max_tilt=pi) if any_tilt else SpectralConfig()
        return TracingRegistrar(self.device, Grid(edge, 1.0), config)


def create(request: Request) -> Funnel:
    """The experiment as the command line asks for it; `quick` is one pair of each kind on half the voxels."""
    return Funnel(as_asked(FunnelSettings(), request, pairs=1, edge=64), request.opened)
