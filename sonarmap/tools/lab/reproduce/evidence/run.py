"""All that a registration measures of pairs of every sort, with the truth."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import ClassVar

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.evidence.pairs import EvidencePair, draw
from sonarmap.tools.lab.reproduce.evidence.recorder import Recorder
from sonarmap.tools.lab.reproduce.evidence.section import evidence_section
from sonarmap.tools.lab.reproduce.evidence.settings import EvidenceSettings
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, in_turns
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked

_MEASURING = ("registration", "grid", "scan", "expected", "prior", "prior_pair", "so3", "tilt", "translation")


class EvidenceOfPairs(Experiment):
    """Registers pairs of every sort; a job is one draw of a set."""

    name = "evidence"
    # what measures, not what judges
    sources: ClassVar[tuple[str, ...]] = (
        *("kernels", "spectral/prepare", "spectral/verify", *(f"spectral/{name}.py" for name in _MEASURING)),
        *("tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/evidence"),
        "tools/lab/reproduce/evaluation/pair_set.py",
    )
    make_section = staticmethod(evidence_section)
    settings: EvidenceSettings
    device: Device

    def jobs(self) -> Sequence[str]:
        """Set and number, as in swath-0003."""
        return in_turns(self.settings.counts)

    def run(self, job: str) -> Outcome:
        """Register the pairs of a draw."""
        name, _, number = job.partition("-")
        registering = _Registering(self.device)
        pairs = draw(name, int(number), self.settings.seed, self.settings.edge)
        return Outcome(tuple(row for pair in pairs for row in registering.rows(pair)))


class _Registering:
    """Registers the pairs of a draw; a scan is prepared once for each grid."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._recorders: dict[object, Recorder] = {}
        self._prepared: dict[object, SpectralScan] = {}

    def rows(self, pair: EvidencePair) -> list[Row]:
        """One of each hypothesis; none where a scan shows too little, or nothing is possible."""
        config = SpectralConfig(max_tilt=pi) if pair.any_tilt else SpectralConfig()
        key = pair.grid, config
        recorder = self._recorders[key] = self._recorders.get(key) or Recorder(self._device, pair.grid, config)
        try:
            target, source = (self._prepare(recorder, scan) for scan in (pair.target, pair.source))
        except InputError:
            return []
        if pair.expected is None:
            recorder.register(target, source)
        else:
            recorder.register_expected(target, source, pair.expected)
        pair_cells = pair.cells | {"edge": pair.grid.edge, "voxel_m": pair.grid.voxel}
        pair_cells |= {"related": pair.truth is not None}
        return [pair_cells | cells for cells in recorder.cells(pair.truth)]

    def _prepare(self, recorder: Recorder, scan: Scan) -> SpectralScan:
        key = id(recorder), id(scan.points)
        if key not in self._prepared:
            self._prepared[key] = recorder.prepare(scan)
        return replace(self._prepared[key], prior=scan.prior)


def create(request: Request) -> EvidenceOfPairs:
    """The experiment as the command line asks for it; `quick` is one draw of each set on half the voxels."""
    usual, draws = EvidenceSettings(), request.pairs or (1 if request.quick else None)
    if draws is not None:
        usual = replace(usual, counts=dict.fromkeys(usual.counts, draws))
    return EvidenceOfPairs(as_asked(usual, request, edge=64), request.opened)
