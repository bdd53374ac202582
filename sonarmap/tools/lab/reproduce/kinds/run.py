"""Pairs of every kind of scan, by every method, with what instruments know and without."""

from collections.abc import Sequence
from typing import ClassVar

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.tools.lab.reproduce.answer import answer, cells_of
from sonarmap.tools.lab.reproduce.evaluation.settings import BATCH
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome, Row, Value
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.kinds.figure import draw_kinds
from sonarmap.tools.lab.reproduce.kinds.navigation import navigation_cells
from sonarmap.tools.lab.reproduce.kinds.section import kinds_section
from sonarmap.tools.lab.reproduce.kinds.settings import (
    NAVIGATION,
    NAVIGATION_OVERLAPS,
    PRIORS,
    KindsSettings,
)
from sonarmap.tools.lab.reproduce.methods import METHOD_SOURCES, compared_methods, registrar
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.kinds.catalog import kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import KindPair


class Kinds(ByMethod):
    """Registers pairs of every kind; a job is five of them, what is known beforehand, and one method."""

    name = "kinds"
    sources: ClassVar[tuple[str, ...]] = (
        *METHOD_SOURCES,
        *(f"tools/lab/reproduce/kinds/{name}.py" for name in ("settings", "navigation")),
    )
    make_section, draw_pictures = staticmethod(kinds_section), staticmethod(draw_kinds)

    def jobs(self) -> Sequence[str]:
        """Kind, what is known, batch and method, as in swath/none/003/spectral; those of the same pairs in a row."""
        settings: KindsSettings = self.settings
        return [
            f"{kind}/{known}/{batch:03d}/{method}"
            for kind in settings.kinds
            for batch in range(settings.count // BATCH)
            for known in PRIORS
            for method in self.methods
            if known in settings.known(kind, method)
        ]

    def run(self, job: str) -> Outcome:
        """Register a batch by one method."""
        kind, known, batch, method = job.split("/")
        pairs = self.scans(kind, known == NAVIGATION, int(batch))
        return Outcome(tuple(self._row(pair, grid, known, method) for pair, grid in pairs))

    def make_scans(self, kind: str, navigated: bool, batch: int) -> Sequence[tuple[KindPair, Grid]]:
        """The pairs of a batch, without priors, each with its grid; one that its scene does not have is left out."""
        pairs = []
        for number in range(batch * BATCH, (batch + 1) * BATCH):
            try:
                pair = kind_pair(kind, number, self.settings.seed, NAVIGATION_OVERLAPS if navigated else None)
            except InputError:
                continue
            pairs.append((pair, choose_grid((pair.target, pair.source), self.settings.edge)))
        return pairs

    def _row(self, pair: KindPair, grid: Grid, known: str, method: str) -> Row:
        instruments = PRIORS[known]
        given = pair if instruments is None else pair.with_priors(instruments)
        registration = answer(registrar(method, grid, self.device), given.target, given.source)
        cells: dict[str, Value] = {
            name: getattr(pair, name) for name in ("kind", "number", "scene", "relief", "shared")
        }
        cells |= {"priors": known, "method": method, "voxel_m": grid.voxel}
        cells |= cells_of(registration, pair.T_target_source, grid.voxel)
        if known == NAVIGATION and given.target.prior is not None and given.source.prior is not None:
            cells |= navigation_cells(registration, pair.T_target_source, given.target.prior, given.source.prior)
        return cells


def create(request: Request) -> Kinds:
    """The experiment as the command line asks for it; `quick` is one batch of two kinds on half the voxels."""
    usual = KindsSettings(compared=compared_methods(request))
    settings = as_asked(usual, request, kinds=("patch", "swath"), pairs=BATCH, edge=64)
    return Kinds(settings, request.opened.selector)
