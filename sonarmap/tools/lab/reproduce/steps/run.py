"""Table 1 of the paper and its continuation to S12, on several scenes, by every method."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.result import Registrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.evaluation.answer import answer, claims, errors
from sonarmap.tools.lab.reproduce.evaluation.experiment import SOURCES
from sonarmap.tools.lab.reproduce.evaluation.methods import OURS, compared_methods, registrar
from sonarmap.tools.lab.reproduce.experiment import Outcome, Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.rows import all_rows
from sonarmap.tools.lab.reproduce.steps.figure import draw_steps
from sonarmap.tools.lab.reproduce.steps.section import PICTURE, steps_section
from sonarmap.tools.lab.reproduce.steps.settings import StepsSettings
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_MOST
from sonarmap.tools.lab.simulate.plan import table1_pair


class Steps:
    """Registers S0..S12 to the reference scan; a job is one scene, seed, noise and method."""

    name: ClassVar[str] = "steps"
    sources: ClassVar[tuple[str, ...]] = SOURCES

    def __init__(self, settings: StepsSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self.methods = settings.compared.methods
        self.deciding: Mapping[str, Any] = {"edge": settings.edge}
        self._device, self._grid = device, settings.grid
        self._registrars: dict[str, Registrar] = {}
        self._series: tuple[str, list[tuple[Scan, Scan, RigidTransform]]] | None = None

    def jobs(self) -> Sequence[str]:
        """Scene, seed, noise and method, as in floodgate/101/1.0/spectral."""
        settings: StepsSettings = self.settings
        return [
            f"{settings.scenes[k % len(settings.scenes)]}/{settings.first_seed + k}/{sigma2!r}/{method}"
            for k in range(settings.seeds)
            for sigma2 in settings.sigma2
            for method in self.methods
            if method == OURS or k < settings.peers
        ]

    def run(self, job: str) -> Outcome:
        """Register S0 to S12 by one method."""
        series, _, method = job.rpartition("/")
        scene, seed, sigma2 = series.split("/")
        if method not in self._registrars:
            self._registrars[method] = registrar(method, self._grid, self._device)
        begin = {"scene": scene, "seed": int(seed), "sigma2": float(sigma2), "method": method}
        rows: list[Row] = []
        for step, (target, source, truth) in enumerate(self._pairs(series)):
            registration = answer(self._registrars[method], target, source)
            rows.append(begin | {"step": step} | errors(registration, truth, self._grid.voxel) | claims(registration))
        return Outcome(tuple(rows))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """How far each method gets."""
        return steps_section(all_rows(outcomes), self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Success over the steps."""
        draw_steps(folder / PICTURE, all_rows(outcomes), self.methods)

    def _pairs(self, series: str) -> list[tuple[Scan, Scan, RigidTransform]]:
        """Of one scene, seed and noise; kept for the methods to come."""
        if self._series is None or self._series[0] != series:
            scene, seed, sigma2 = series.split("/")
            steps = range(TABLE1_MOST)
            self._series = series, [table1_pair(step, int(seed), float(sigma2), scene) for step in steps]
        return self._series[1]


def create(request: Request) -> Steps:
    """The experiment as the command line asks for it; `quick` is one seed and one noise on half the voxels.

    Raises:
        InputError: an option's value will not do.
    """
    usual, quick = StepsSettings(), request.quick
    settings = StepsSettings(
        scenes=(request.scene,) if request.scene else usual.scenes,
        sigma2=request.sigma2 or (usual.sigma2[:1] if quick else usual.sigma2),
        seeds=request.seeds or (1 if quick else usual.seeds),
        peers=request.seeds or usual.peers,
        first_seed=usual.first_seed if request.seed is None else request.seed,
        edge=request.grid or (64 if quick else usual.edge),
        compared=compared_methods(request),
    )
    return Steps(settings, request.opened.selector)
