"""What the experiments on whole structures share: a volume and the same one moved, each with noise of its own."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.shapes.structure import NOISES, occupy, surface_points, swap, voxel_scan

EXTENT = 256.0  # of the grid [m]; the paper has 256 voxels of 1 m
RIGHT_DEG, RIGHT_VOXELS = 2.0, 2.0
TRANSLATION, ROTATION = ("x", "y", "z"), ("yaw", "roll", "pitch")
_SPACING = 0.7  # of the surface's points [voxels]: next to no voxel that it crosses stays void
_LEAST_COMMON = 0.01  # share of the structure's voxels that has to be left in the frame


@dataclass(frozen=True, slots=True)
class MovedStructure:
    """One series: a scene, a noise, a seed. Its key is a job's.

    Attributes:
        scene: a key of SCENE_KINDS.
        noise: a key of NOISES.
        seed: of the scene and of the noise.
    """

    scene: str
    noise: str
    seed: int

    @property
    def key(self) -> str:
        """As in "floodgate/D0/1"."""
        return f"{self.scene}/{self.noise}/{self.seed}"

    @classmethod
    def of(cls, key: str) -> "MovedStructure":
        """The case with this key."""
        scene, noise, seed = key.split("/")
        return cls(scene, noise, int(seed))


class VoxelSeries:
    """The paper's registration on structures that are moved whole, in a grid that stands still (Sect. 3)."""

    def __init__(self, device: Device, edge: int) -> None:
        """Nothing is planned before it is used."""
        self.device, self.grid = device, Grid(edge, EXTENT / edge)

    @cached_property
    def registrar(self) -> HemisphereRegistrar:
        """The paper's chain; the grid is the frame that structures move out of."""
        return HemisphereRegistrar(self.device, self.grid, HemisphereConfig.paper(centered=False))

    def structure(self, scene: str, seed: int) -> np.ndarray:
        """Points (N, 3) float64 [m] all over a scene's surfaces, dense enough for the grid's voxels."""
        return _structure(scene, seed, _SPACING * self.grid.voxel)

    def prepare(self, points: np.ndarray, noise: str, seeds: Sequence[int]) -> LayeredScan:
        """Points as voxels with noise, prepared; `seeds` decide the noise."""
        rng = np.random.default_rng(np.random.SeedSequence(seeds))
        occupied = swap(occupy(points, self.grid), NOISES[noise], rng)
        return self.registrar.prepare(voxel_scan(occupied, self.grid, noise))

    def run(self, case: MovedStructure, motions: Sequence[RigidTransform]) -> Outcome:
        """Register the structure at rest (source) to the same one moved (target), one motion after the other.

        A motion that carries it out of the frame, but for a hundredth, is passed over: nothing is left to register.
        """
        points = self.structure(case.scene, case.seed)
        extent = int(occupy(points, self.grid).sum())
        family = [case.seed, list(NOISES).index(case.noise)]
        source = self.prepare(points, case.noise, [*family, 0])
        rows, seconds = [], []
        for number, T_target_source in enumerate(motions):
            moved = T_target_source.apply(points)
            common = float(occupy(moved, self.grid).sum() / extent)
            if common < _LEAST_COMMON:
                continue
            start = perf_counter()
            target = self.prepare(moved, case.noise, [*family, number + 1])
            self.device.queue.finish()
            prepared = perf_counter() - start
            registration = self.registrar.register(target, source)
            rows.append(_row(case, number, T_target_source, registration, self.grid) | {"common": common})
            times = {"prepare_s": prepared, "register_s": registration.seconds}
            seconds.append({"case": case.key, "number": number, **times})
        return Outcome(tuple(rows), tuple(seconds))


def parameters(T: RigidTransform) -> np.ndarray:
    """x, y, z [m] and yaw, roll, pitch [degrees], (6,), in the paper's order."""
    yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
    return np.array([*T.translation, yaw, roll, pitch])


def _row(case: MovedStructure, number: int, truth: RigidTransform, registration: Registration, grid: Grid) -> dict:
    estimated = registration.T_target_source
    error = pair_error(estimated, truth)
    steps = dict(registration.step_psr)
    names = (*(f"{name}_m" for name in TRANSLATION), *(f"{name}_deg" for name in ROTATION))
    return {
        **{"scene": case.scene, "noise": case.noise, "seed": case.seed, "number": number},
        **{f"true_{name}": value for name, value in zip(names, parameters(truth).tolist(), strict=True)},
        **{f"found_{name}": value for name, value in zip(names, parameters(estimated).tolist(), strict=True)},
        "distance_m": float(np.linalg.norm(truth.translation)),
        "rotation_deg": error.rotation_deg,
        "translation_voxels": error.translation_m / grid.voxel,
        "right": error.within(RIGHT_DEG, RIGHT_VOXELS * grid.voxel),
        "accepted": registration.accepted,
        **{"psr": registration.psr, "yaw_psr": steps["yaw"], "tilt_psr": steps["tilt"]},
    }


@lru_cache(maxsize=1)
def _structure(scene: str, seed: int, spacing: float) -> np.ndarray:
    return surface_points(build_scene(scene, seed).mesh, spacing).astype(np.float64)
