"""Whole structures that are moved or tilted in a fixed grid, with voxel noise (paper Sects. 2.7 and 3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from time import perf_counter

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereConfig, HemisphereRegistrar, LayeredScan
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import pair_error
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Settings, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.registrations import paper_grid, parameter_cells
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.scenes.solids import Mesh

_TRIANGLES_AT_ONCE = 20_000


def surface_points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Points all over a surface, at most `spacing` [m] apart, without randomness.

    Returns (N, 3) float32 [m] in the frame of the scene, with z shifted so that its range is centered at 0.
    """
    corners = mesh.vertices[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(1, np.ceil(longest / spacing)).astype(int)
    points = []
    for count in np.unique(steps):
        similar = corners[steps == count]
        weights = _barycentric(int(count))
        for first in range(0, len(similar), _TRIANGLES_AT_ONCE):
            some = similar[first : first + _TRIANGLES_AT_ONCE]
            points.append((weights @ some).reshape(-1, 3).astype(np.float32))
    cloud = np.concatenate(points)
    cloud[:, 2] -= (cloud[:, 2].min() + cloud[:, 2].max()) / 2
    return cloud


def occupy(points: np.ndarray, grid: Grid) -> np.ndarray:
    """(edge, edge, edge) bool: the voxels of a grid around the origin that contain any of `points` (N, 3) [m]."""
    cells = np.floor(points / grid.voxel + (grid.edge / 2 + 0.5)).astype(np.int64)
    inside = ((cells >= 0) & (cells < grid.edge)).all(axis=1)
    volume = np.zeros((grid.edge,) * 3, bool)
    volume[tuple(cells[inside].T)] = True
    return volume


def voxel_scan(occupied: np.ndarray, grid: Grid, name: str) -> Scan:
    """The centers of the occupied voxels as a scan; its frame has its origin at the center of the grid."""
    return Scan(((np.argwhere(occupied) - grid.edge / 2) * grid.voxel).astype(np.float32), name=name)


def _barycentric(count: int) -> np.ndarray:
    """(K, 3) barycentric weights of a raster of `count` steps per side of a triangle."""
    i, j = (steps.ravel() for steps in np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij"))
    within = i + j <= count
    first, second = i[within] / count, j[within] / count
    return np.column_stack([1 - first - second, first, second])


@dataclass(frozen=True, slots=True)
class VoxelNoise:
    """Uniform noise of a volume (paper Sect. 3, Fig. 11)."""

    swap: float  # share of the voxels in the region that are flipped, 0..1
    envelope: int | None  # extent of the region around the structure [voxels]; None: the whole grid


# The list in Sect. 3 of the paper: two widths of the envelope and the whole grid, each at two swap ratios
NOISES: Mapping[str, VoxelNoise] = {
    "D0": VoxelNoise(0.0, 0),
    "D1": VoxelNoise(1 / 100, 5),
    "D2": VoxelNoise(1 / 25, 5),
    "D3": VoxelNoise(1 / 100, 10),
    "D4": VoxelNoise(1 / 25, 10),
    "D5": VoxelNoise(1 / 100, None),
    "D6": VoxelNoise(1 / 25, None),
}


def swap(occupied: np.ndarray, noise: VoxelNoise, rng: np.random.Generator) -> np.ndarray:
    """A copy of a volume (N, N, N) bool in which exactly round(swap * region) voxels of the region are flipped.

    "1 out of 25 voxel is flipped" (paper Sect. 3); all choices are equally likely.
    """
    reached = envelope(occupied, noise.envelope)
    noisy = np.ascontiguousarray(occupied).copy()
    places = None if reached.all() else np.flatnonzero(reached)
    count = reached.size if places is None else len(places)
    chosen = rng.choice(count, round(noise.swap * count), replace=False, shuffle=False)
    noisy.reshape(-1)[chosen if places is None else places[chosen]] ^= True
    return noisy


def envelope(occupied: np.ndarray, margin: int | None) -> np.ndarray:
    """(N, N, N) bool: the structure and all voxels within `margin` voxels of it; None: all voxels.

    Distances are Chebyshev: the largest of the three index differences.
    """
    if margin is None:
        return np.ones(occupied.shape, bool)
    return maximum_filter(occupied, 2 * margin + 1, mode="constant")


_USUAL = {"scenes": ("floodgate", "clutter"), "noises": tuple(NOISES), "seeds": 2, "first_seed": 1, "edge": 256}
_QUICK = {"scenes": ("floodgate",), "seeds": 1}
# Lengths of the shifts in units of _DIRECTION
_TRANSLATION = _USUAL | {"steps": (4, 8, 12, 16, 20, 24, 28, 30, 32, 34, 36, 38, 40, 44, 48, 52, 56, 60)}
# Rotations about the center of the grid, with roll and pitch of `tilt_deg`
_ROTATION = _USUAL | {"noises": ("D0", "D2", "D4", "D6"), "tilt_deg": 10.0, "yaws_deg": tuple(range(8, 89, 8))}
# Every tilt, of roll, of pitch and of both, at every yaw
_LIMITS = _USUAL | {
    "noises": ("D0",),
    "edge": 128,
    "tilts_deg": (5, 10, 15, 20, 25, 30, 35),
    "yaws_deg": (-80, -40, 0, 40, 80),
}
SOURCES = (
    *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "structures")),
)
RIGHT_DEG, RIGHT_VOXELS = 2.0, 2.0
_SPACING = 0.7  # of the surface's points [voxels]; they miss hardly any voxel that it crosses
_DIRECTION = np.array([1.0, 2.0, 3.0])  # of all shifts, x, y, z [m]
_LEAST_COMMON = 0.01  # smallest share of the structure's voxels that stay in the grid
_FARTHEST = np.deg2rad(60.0)  # bound of roll and pitch, too wide to help


def create_translation(request: Request) -> Experiment:
    """Structures shifted out of the grid (Figs. 12, 14, 15)."""
    settings = as_asked(request, _TRANSLATION, _QUICK | {"noises": ("D0", "D4", "D6"), "steps": (16, 30, 40)})
    shifts = [RigidTransform.from_translation(step * _DIRECTION) for step in settings.steps]
    return _moved("translation", settings, request.opened, shifts)


def create_rotation(request: Request) -> Experiment:
    """Rotated structures (Figs. 16, 17)."""
    settings = as_asked(request, _ROTATION, _QUICK | {"noises": ("D0", "D4"), "yaws_deg": (8, 32, 64, 88)})
    angles = [(yaw, settings.tilt_deg, settings.tilt_deg) for yaw in settings.yaws_deg]
    turns = [RigidTransform.from_rotation(Rotation.from_euler("ZYX", turn, degrees=True)) for turn in angles]
    return _moved("rotation", settings, request.opened, turns)


def create_limits(request: Request) -> Experiment:
    """Errors of the resampling under tilt (Figs. 7 to 9); a job is all tilts of one kind at all yaws, as
    floodgate/1/both."""
    settings = as_asked(request, _LIMITS, _QUICK | {"tilts_deg": (10.0, 20.0, 35.0), "yaws_deg": (-40.0, 40.0)})
    kinds = ("none", "roll", "pitch", "both")
    jobs = [f"{scene}/{seed}/{kind}" for scene, seed in _structures(settings) for kind in kinds]
    structures = _Structures(settings, request.opened)

    def run(job: str) -> Outcome:
        scene, seed, kind = job.split("/")
        points = _surface(scene, int(seed), structures.grid.voxel)
        at_rest = structures.prepare(points, "D0", [0])
        rows, seconds = [], []
        for tilt in (0.0,) if kind == "none" else settings.tilts_deg:
            for yaw in settings.yaws_deg:
                start = perf_counter()
                pitch, roll = (tilt if kind in (angle, "both") else 0.0 for angle in ("pitch", "roll"))
                truth = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
                off = _steps(structures, structures.prepare(truth.apply(points), "D0", [0]), at_rest, truth)
                rows.append({"scene": scene, "seed": int(seed), "tilted": kind, "tilt_deg": tilt, "yaw_deg": yaw} | off)
                seconds.append({"job": job, "tilt_deg": tilt, "yaw_deg": yaw, "seconds": perf_counter() - start})
        return Outcome(tuple(rows), tuple(seconds))

    return Experiment("limits", settings, jobs, run, SOURCES)


class _Structures:
    """The paper's registration of structures that are voxels of a fixed grid, which they can leave."""

    def __init__(self, settings: Settings, device: Device) -> None:
        self.device, self.grid = device, paper_grid(settings.edge)

    @cached_property
    def registrar(self) -> HemisphereRegistrar:
        """The paper's chain."""
        return HemisphereRegistrar(self.device, self.grid, HemisphereConfig(centered=False))

    def prepare(self, points: np.ndarray, noise: str, seeds: Sequence[int]) -> LayeredScan:
        """The prepared scan of points as voxels, with noise determined by the seeds."""
        rng = np.random.default_rng(np.random.SeedSequence(seeds))
        occupied = swap(occupy(points, self.grid), NOISES[noise], rng)
        return self.registrar.prepare(voxel_scan(occupied, self.grid, noise))


@lru_cache(maxsize=1)
def _surface(scene: str, seed: int, voxel: float) -> np.ndarray:
    """(N, 3) float64 points all over a scene's surfaces, dense enough for voxels of this edge [m]."""
    return surface_points(build_scene(scene, seed).mesh, _SPACING * voxel).astype(np.float64)


def _structures(settings: Settings) -> list[tuple[str, int]]:
    """All combinations of scene and seed."""
    return [(scene, seed) for scene in settings.scenes for seed in all_seeds(settings)]


def _moved(name: str, settings: Settings, device: Device, motions: Sequence[RigidTransform]) -> Experiment:
    """An experiment on every motion T_target_source; a job is a structure with a noise, as floodgate/D0/1."""
    jobs = [f"{scene}/{noise}/{seed}" for scene, seed in _structures(settings) for noise in settings.noises]
    structures = _Structures(settings, device)

    def run(job: str) -> Outcome:
        """Register the structure at rest (source) to the moved structure (target), each with its own noise.

        Motions after which less than _LEAST_COMMON of the structure is in the grid are skipped.
        """
        scene, noise, number = job.split("/")
        seed, grid = int(number), structures.grid
        points = _surface(scene, seed, grid.voxel)
        extent = int(occupy(points, grid).sum())
        family = [seed, list(NOISES).index(noise)]
        source = structures.prepare(points, noise, [*family, 0])
        rows, seconds = [], []
        for number, T_target_source in enumerate(motions):
            moved = T_target_source.apply(points)
            common = float(occupy(moved, grid).sum() / extent)
            if common < _LEAST_COMMON:
                continue
            start = perf_counter()
            target = structures.prepare(moved, noise, [*family, number + 1])
            device.queue.finish()
            prepared = perf_counter() - start
            registration = structures.registrar.register(target, source)
            labels = {"scene": scene, "noise": noise, "seed": seed, "number": number}
            rows.append(labels | _moved_cells(T_target_source, registration, grid.voxel) | {"common": common})
            times = {"case": job, "number": number, "prepare_s": prepared, "register_s": registration.seconds}
            seconds.append(times)
        return Outcome(tuple(rows), tuple(seconds))

    return Experiment(name, settings, jobs, run, SOURCES)


def _moved_cells(truth: RigidTransform, registration: Registration, voxel: float) -> dict:
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


def _steps(structures: _Structures, target: LayeredScan, source: LayeredScan, truth: Rotation) -> dict[str, float]:
    """Cells of the errors of each step alone: yaw first, roll and pitch at the true yaw, and of the whole chain."""
    registrar = structures.registrar
    true_yaw = truth.as_euler("ZYX", degrees=True)[0]
    yaw = registrar.hemisphere.yaws(target.layers, source.layers)[0]
    yaw_off = np.rad2deg(yaw.R.as_rotvec()[2]) - true_yaw
    R_yaw = Rotation.from_euler("Z", true_yaw, degrees=True)
    tilt = registrar.hemisphere.tilt(target.layers, source.magnitude, R_yaw, _FARTHEST)
    R = R_yaw if tilt is None else tilt.R * R_yaw
    _, pitch, roll = R.as_euler("ZYX", degrees=True) - truth.as_euler("ZYX", degrees=True)
    chain = registrar.register(target, source)
    return {
        "yaw_off_deg": float((yaw_off + 90) % 180 - 90),  # the peak repeats after half a turn
        "yaw_psr": yaw.psr,
        "roll_off_deg": float(roll),
        "pitch_off_deg": float(pitch),
        "tilt_psr": 0.0 if tilt is None else tilt.psr,
        "chain_off_deg": float(np.rad2deg((truth.inv() * chain.T_target_source.rotation).magnitude())),
        "chain_shift_voxels": float(np.linalg.norm(chain.T_target_source.translation) / structures.grid.voxel),
    }
