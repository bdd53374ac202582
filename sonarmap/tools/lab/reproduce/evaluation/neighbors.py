"""Neighbors along paths over every scene, by every sensor: what a map is made of, by every method."""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.answer import answer, cells_of
from sonarmap.tools.lab.reproduce.evaluation.neighbors_section import neighbors_section
from sonarmap.tools.lab.reproduce.evaluation.settings import NeighborsSettings
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import METHOD_SOURCES, OURS, compared_methods, registrar
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.simulate.plan import louder, plan
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate


class Neighbors(ByMethod):
    """Registers each scan of a path to the one before; a job is one path and one method."""

    name = "neighbors"
    sources: ClassVar[tuple[str, ...]] = (
        *METHOD_SOURCES,
        "slam/survey_grid.py",
        "tools/lab/reproduce/evaluation/settings.py",
    )
    deciding = ("edge", "seed", "pairs", "peers")
    make_section = staticmethod(neighbors_section)

    def jobs(self) -> Sequence[str]:
        """Scene, sensor, noise and method, as in harbor/eclipse/1.0/spectral."""
        settings: NeighborsSettings = self.settings
        return [
            f"{scene}/{sensor}/{noise!r}/{method}"
            for scene in settings.scenes
            for sensor in settings.sensors
            for noise in settings.noises
            for method in self.methods
        ]

    def run(self, job: str) -> Outcome:
        """Register the neighbors of a path by one method; no rows where the sensor sees nothing from it."""
        scene, sensor, noise, method = job.split("/")
        try:
            path, count = self.scans(scene, sensor, float(noise)), self.settings.pairs
        except InputError:
            return Outcome(())
        grid, T = survey_grid(path.scans, self.settings.edge), path.truth.T_world_sensor
        built = registrar(method, grid, self.device)
        rows = []
        for k in range(count if method == OURS else min(count, self.settings.peers)):
            registration, truth = answer(built, path.scans[k], path.scans[k + 1]), T[k].inv() * T[k + 1]
            row = {"scene": scene, "sensor": sensor, "noise": float(noise), "pair": k, "method": method}
            row |= {"misleads": misleads(registration, truth, grid.voxel)}
            rows.append(row | cells_of(registration, truth, grid.voxel))
        return Outcome(tuple(rows))

    def make_scans(self, scene: str, sensor: str, noise: float) -> Simulation:
        """Along one path."""
        planned = louder(plan(scene, "lawnmower", sensor, self.settings.seed), noise)
        return simulate(replace(planned, count=self.settings.pairs + 1))


def misleads(registration: Registration, truth: RigidTransform, voxel: float) -> bool:
    """Whether a pose is off by more than is right along a direction that its covariance calls fixed.

    Fixed is where two standard deviations are no more than that; without a covariance, everywhere. The truth is
    T_target_source; `voxel` is the grid's [m].
    """
    xi: np.ndarray = (registration.T_target_source.inv() * truth).as_exp_coords()
    known = bool(np.isfinite(registration.covariance).all())
    covariance = registration.covariance if known else np.zeros((6, 6))
    for block, allowed in ((slice(0, 3), np.deg2rad(RIGHT_DEG)), (slice(3, 6), RIGHT_VOXELS * voxel)):
        variances, axes = np.linalg.eigh(covariance[block, block])
        fixed = axes[:, variances <= (allowed / 2) ** 2]
        if np.linalg.norm(fixed.T @ xi[block]) > allowed:
            return True
    return False


def create(request: Request) -> Neighbors:
    """The experiment as the command line asks for it; `quick` is two scenes by one sensor on half the voxels."""
    usual = NeighborsSettings(compared=compared_methods(request))
    quick = {"scenes": ("harbor", "wreck"), "sensors": ("eclipse",), "noises": (1.0,), "pairs": 3, "edge": 64}
    return Neighbors(as_asked(usual, request, **quick), request.opened.selector)
