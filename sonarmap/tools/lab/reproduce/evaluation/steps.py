"""Table 1 of the paper and its continuation to S12, on several scenes, by every method."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar

from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.answer import answer, cells_of
from sonarmap.tools.lab.reproduce.evaluation.settings import StepsSettings
from sonarmap.tools.lab.reproduce.evaluation.steps_section import draw_steps, steps_section
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome, Row
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import METHOD_SOURCES, OURS, compared_methods, registrar
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_MOST
from sonarmap.tools.lab.simulate.plan import table1_pair


class Steps(ByMethod):
    """Registers S0..S12 to the reference scan; a job is one scene, seed, noise and method."""

    name = "steps"
    sources: ClassVar[tuple[str, ...]] = (
        *METHOD_SOURCES,
        "tools/lab/reproduce/settings.py",
        "tools/lab/reproduce/evaluation/settings.py",
    )
    deciding = ("edge",)
    make_section, draw_pictures = staticmethod(steps_section), staticmethod(draw_steps)

    def __init__(self, settings: StepsSettings, device: str | None = None) -> None:
        """`device` as `choose_device` takes it."""
        super().__init__(settings, device)
        self._registrar = cache(lambda method: registrar(method, settings.grid, device))

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
        scene, seed, sigma2, method = job.split("/")
        begin = {"scene": scene, "seed": int(seed), "sigma2": float(sigma2), "method": method}
        rows: list[Row] = []
        for step, (target, source, truth) in enumerate(self.scans(scene, int(seed), float(sigma2))):
            registration = answer(self._registrar(method), target, source)
            rows.append(begin | {"step": step} | cells_of(registration, truth, self.settings.grid.voxel))
        return Outcome(tuple(rows))

    def make_scans(self, scene: str, seed: int, sigma2: float) -> list[tuple[Scan, Scan, RigidTransform]]:
        """Target, source and truth of every step."""
        return [table1_pair(step, seed, sigma2, scene) for step in range(TABLE1_MOST)]


def create(request: Request) -> Steps:
    """The experiment as the command line asks for it; `quick` is one seed and one noise on half the voxels."""
    usual = StepsSettings(compared=compared_methods(request))
    usual = replace(usual, peers=request.seeds or usual.peers)
    quick: dict[str, Any] = {"sigma2": usual.sigma2[:1], "seeds": 1, "edge": 64}
    return Steps(as_asked(usual, request, **quick), request.opened.selector)
