"""Whole structures under noise of the voxels (Sect. 3): a volume and the same one moved, each with noise of its own."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property, lru_cache
from time import perf_counter
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.answer import parameter_cells
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.settings import as_asked
from sonarmap.tools.lab.reproduce.structures.moved_section import (
    draw_rotation,
    draw_translation,
    rotation_section,
    translation_section,
)
from sonarmap.tools.lab.reproduce.structures.settings import (
    RIGHT_DEG,
    RIGHT_VOXELS,
    RotationSettings,
    StructureSettings,
    TranslationSettings,
)
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.structure import NOISES, occupy, surface_points, swap, voxel_scan

_SPACING = 0.7  # of the surface's points [voxels]: next to no voxel that it crosses stays void
_DIRECTION = np.array([1.0, 2.0, 3.0])  # of every shift, x, y, z: a step is one such vector [m]
_LEAST_COMMON = 0.01  # share of the structure's voxels that has to be left in the frame


class StructureExperiment(Experiment):
    """The paper's registration on structures in a grid that stands still; it is the frame that they move out of."""

    sources: ClassVar[tuple[str, ...]] = (
        "tools/lab/reproduce/settings.py",
        *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate", "tools/lab/reproduce/answer.py"),
        *(f"tools/lab/reproduce/structures/{name}.py" for name in ("moved", "settings")),
    )

    @cached_property
    def registrar(self) -> HemisphereRegistrar:
        """The paper's chain."""
        return HemisphereRegistrar(self.device, self.settings.grid, HemisphereConfig.paper(centered=False))

    def structure(self, scene: str, seed: int) -> np.ndarray:
        """Points (N, 3) float64 [m] all over a scene's surfaces, dense enough for the grid's voxels."""
        return _structure(scene, seed, _SPACING * self.settings.grid.voxel)

    def prepare(self, points: np.ndarray, noise: str, seeds: Sequence[int]) -> LayeredScan:
        """Points as voxels with noise, prepared; `seeds` decide the noise."""
        rng = np.random.default_rng(np.random.SeedSequence(seeds))
        occupied = swap(occupy(points, self.settings.grid), NOISES[noise], rng)
        return self.registrar.prepare(voxel_scan(occupied, self.settings.grid, noise))


class MovedStructures(StructureExperiment):
    """Every motion of every structure under every noise: a job is a scene, a noise and a seed."""

    @abstractmethod
    def motions(self) -> list[RigidTransform]:
        """T_target_source, in order: each moves every structure."""

    def jobs(self) -> Sequence[str]:
        """As in "floodgate/D0/1"."""
        settings: StructureSettings = self.settings
        return [f"{scene}/{noise}/{seed}" for scene, seed in settings.structures for noise in settings.noises]

    def run(self, job: str) -> Outcome:
        """Register the structure at rest (source) to the same one moved (target), one motion after the other.

        A motion that moves it out of the frame, but for a hundredth, is passed over: nothing is left to register.
        """
        scene, noise, number = job.split("/")
        seed, grid = int(number), self.settings.grid
        points = self.structure(scene, seed)
        extent = int(occupy(points, grid).sum())
        family = [seed, list(NOISES).index(noise)]
        source = self.prepare(points, noise, [*family, 0])
        rows, seconds = [], []
        for number, T_target_source in enumerate(self.motions()):
            moved = T_target_source.apply(points)
            common = float(occupy(moved, grid).sum() / extent)
            if common < _LEAST_COMMON:
                continue
            start = perf_counter()
            target = self.prepare(moved, noise, [*family, number + 1])
            self.device.queue.finish()
            prepared = perf_counter() - start
            registration = self.registrar.register(target, source)
            begin = {"scene": scene, "noise": noise, "seed": seed, "number": number}
            rows.append(begin | _cells(T_target_source, registration, grid.voxel) | {"common": common})
            times = {"case": job, "number": number, "prepare_s": prepared, "register_s": registration.seconds}
            seconds.append(times)
        return Outcome(tuple(rows), tuple(seconds))


def _cells(truth: RigidTransform, registration: Registration, voxel: float) -> dict:
    error = pair_error(registration.T_target_source, truth)
    steps = dict(registration.step_psr)
    return {
        **parameter_cells(truth, "true"),
        **parameter_cells(registration.T_target_source, "found"),
        "distance_m": float(np.linalg.norm(truth.translation)),
        "rotation_deg": error.rotation_deg,
        "translation_voxels": error.translation_m / voxel,
        "right": error.within(RIGHT_DEG, RIGHT_VOXELS * voxel),
        "accepted": registration.accepted,
        **{"psr": registration.psr, "yaw_psr": steps["yaw"], "tilt_psr": steps["tilt"]},
    }


@lru_cache(maxsize=1)
def _structure(scene: str, seed: int, spacing: float) -> np.ndarray:
    return surface_points(build_scene(scene, seed).mesh, spacing).astype(np.float64)


class Translation(MovedStructures):
    """Whole structures shifted out of the frame (Figs. 12, 14, 15)."""

    name = "translation"
    make_section, draw_pictures = staticmethod(translation_section), staticmethod(draw_translation)

    def motions(self) -> list[RigidTransform]:
        """The shifts."""
        return [RigidTransform.from_translation(step * _DIRECTION) for step in self.settings.steps]


def create_translation(request: Request) -> Translation:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)}
    return Translation(as_asked(TranslationSettings(), request, **quick), request.opened)


class Turns(MovedStructures):
    """Whole structures turned (Figs. 16, 17)."""

    name = "rotation"
    make_section, draw_pictures = staticmethod(rotation_section), staticmethod(draw_rotation)

    def motions(self) -> list[RigidTransform]:
        """The turns about the middle of the grid."""
        tilt = self.settings.tilt_deg
        angles = [(yaw, tilt, tilt) for yaw in self.settings.yaws_deg]
        return [RigidTransform.from_rotation(Rotation.from_euler("ZYX", turn, degrees=True)) for turn in angles]


def create_rotation(request: Request) -> Turns:
    """The experiment as the command line asks for it."""
    quick = {"scenes": ("floodgate",), "seeds": 1, "noises": ("D0", "D4"), "yaws_deg": (8, 32, 64, 88)}
    return Turns(as_asked(RotationSettings(), request, **quick), request.opened)
