"""Table 1 of the paper and its continuation to S12, on several scenes, by every method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from spectral.grid import Grid
from spectral.result import Registrar
from spectral.scan import Scan
from tools.reproduce.evaluation.answer import answer, claims, errors
from tools.reproduce.evaluation.lineup import OURS, Lineup, lineup, registrar
from tools.reproduce.experiment import Outcome, Row, Section
from tools.reproduce.experiments import Request
from tools.reproduce.steps.figure import draw_steps
from tools.reproduce.steps.section import PICTURE, steps_section
from tools.simulate.pairs.table1 import table1_pair
from tools.simulate.paths.trajectories import TABLE1_MOST
from tools.simulate.scenes.catalog import SCENE_KINDS

EXTENT = 256.0  # of the grid [m], as large as the paper's
STEPS_SCENES = ("floodgate", "harbor", "bridge", "wreck")
FIRST_SEED = 101  # nothing was chosen on scenes and noises of these seeds


@dataclass(frozen=True, slots=True)
class StepsSettings:
    """What is run.

    Attributes:
        scenes: keys of SCENE_KINDS; the seeds go round over them.
        sigma2: variances of the range noise at the largest range [m^2], each.
        seeds: how many scenes and noises, counted from `first_seed`.
        peers: how many of them, the first, the methods beside ours register, as they take ten times as long.
        first_seed: >= 0.
        edge: voxels per edge; the grid is as large as the paper's, whatever their number.
        lineup: the methods.
    """

    scenes: tuple[str, ...] = STEPS_SCENES
    sigma2: tuple[float, ...] = (1.0, 2.0, 4.0)
    seeds: int = 20
    peers: int = 12
    first_seed: int = FIRST_SEED
    edge: int = 128
    lineup: Lineup = field(default_factory=Lineup)

    def __post_init__(self) -> None:
        unknown = [scene for scene in self.scenes if scene not in SCENE_KINDS]
        if unknown or not self.scenes:
            raise InputError(
                f"no scene is called {', '.join(unknown) or 'nothing'}; there are {', '.join(SCENE_KINDS)}"
            )
        if not self.sigma2 or not all(np.isfinite(v) and v >= 0 for v in self.sigma2):
            given = ", ".join(f"{v:g}" for v in self.sigma2) or "no value"
            raise InputError(f"--sigma2: {given}; wanted variances of 0 m^2 or more, as in --sigma2 1 --sigma2 2")
        if self.seeds < 1 or self.first_seed < 0:
            raise InputError(
                f"{self.seeds} seeds from {self.first_seed} on; wanted at least one, and none below 0, "
                "as in --seeds 3 --seed 1"
            )

    @property
    def grid(self) -> Grid:
        """That all pairs share."""
        Grid(self.edge, 1.0)
        return Grid(self.edge, EXTENT / self.edge)


class Steps:
    """Registers S0..S12 to the reference scan; a job is one scene, seed, noise and method."""

    name: ClassVar[str] = "steps"

    def __init__(self, settings: StepsSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        self.settings: Any = settings
        self.methods = settings.lineup.methods
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
            found = answer(self._registrars[method], target, source)
            rows.append(begin | {"step": step} | errors(found, truth, self._grid.voxel) | claims(found))
        return Outcome(tuple(rows))

    def section(self, outcomes: Mapping[str, Outcome]) -> Section:
        """How far each method gets."""
        return steps_section([row for one in outcomes.values() for row in one.rows], self.settings)

    def draw(self, folder: Path, outcomes: Mapping[str, Outcome]) -> None:
        """Success over the steps."""
        draw_steps(folder / PICTURE, [row for one in outcomes.values() for row in one.rows], self.methods)

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
        lineup=lineup(request),
    )
    return Steps(settings, request.opened.selector)
