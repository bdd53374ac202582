"""The scans of Sect. 4 of the paper, simulated, and the methods; consecutive registrations as rows, rows as poses."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, pair_error
from sonarmap.tools.lab.reproduce.answer import PARAMETERS, parameter_cells
from sonarmap.tools.lab.reproduce.experiment import Row, Value
from sonarmap.tools.lab.reproduce.rows import grouped, where
from sonarmap.tools.lab.simulate.paths.stations import COLUMNS, PAPER_COUNT, ROWS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap, shared_view
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate

VOXEL = 2.0  # of methods without a grid of their own [m]


@dataclass(frozen=True, slots=True)
class FloodgateMethod:
    """A method of the comparison."""

    title: str  # what it does, in words
    on_grids: bool  # whether it runs once on each of the paper's grids
    color: str  # in the figures
    mark: str  # in the figures
    in_figures: bool = True  # whether the maps and motions are drawn; those of the paper's methods and this project's


TRUTH = "true poses"
Run = tuple[str, int]  # a method and the voxels per edge of its grid, 0 of none
# Name, as `build` of tools/methods/registry.py knows it -> method, in the order of tables and figures
COMPARED: MappingProxyType[str, FloodgateMethod] = MappingProxyType(
    {
        "icp": FloodgateMethod("ICP, point to point, started at the identity, as in Sect. 4.2", False, "tab:red", "x"),
        "icp-plane": FloodgateMethod("ICP, point to plane, started at the identity", False, "tab:brown", "+", False),
        "planes": FloodgateMethod("registration of planes by consensus, as in Sect. 4.3", False, "tab:orange", "s"),
        "fpfh-ransac": FloodgateMethod("FPFH features and RANSAC, then ICP", False, "tab:pink", "v", False),
        "kiss": FloodgateMethod("KISS-Matcher, then ICP", False, "tab:olive", "^", False),
        "hemisphere": FloodgateMethod("the paper's spectral chain, as in Sect. 4.4", True, "tab:green", "o"),
        "spectral": FloodgateMethod("this project's default method", True, "tab:blue", "D"),
    }
)


def label(method: str, edge: int) -> str:
    """A method and its grid as people read it: "icp", "spectral 128³"."""
    return f"{method} {edge}³" if edge else method


def runs(methods: Iterable[str], edges: Iterable[int]) -> tuple[Run, ...]:
    """Method and voxels per edge of every run, in the order of COMPARED; 0 for a method without a grid."""
    chosen, grids = set(methods), tuple(edges)
    return tuple(
        (name, edge)
        for name, method in COMPARED.items()
        if name in chosen
        for edge in (grids if method.on_grids else (0,))
    )


SCENE = "floodgate"


@dataclass(frozen=True, slots=True)
class FloodgateSurvey:
    """N scans of one scene, in the order in which they were taken."""

    scans: tuple[Scan, ...]  # in their sensor frames
    T_world_sensor: RigidTransform  # their true poses; the world is the scene's frame, East-North-Up
    mesh: Mesh  # the scene's true surface [m, world]
    # N - 1 shares of points that truly have a counterpart in the scan before, the smaller of both ways
    overlap: tuple[float, ...]
    # N - 1 shares of what a scan shows that lies in the view of the scan before, the smaller of both ways, without
    # noise
    shared: tuple[float, ...]

    def step(self, source: int) -> RigidTransform:
        """The true T_target_source of the pair source - 1 (target), source (source)."""
        return self.T_world_sensor[source - 1].inv() * self.T_world_sensor[source]


@lru_cache(maxsize=1)
def survey(seed: int, count: int = PAPER_COUNT) -> FloodgateSurvey:
    """The survey from `seed`: the same seed, the same scans. Views are compared with the beams of the path's layout."""
    simulation = simulate(SimulationSettings(scene=SCENE, trajectory="paper18", count=count, seed=seed))
    scans, T, scene = simulation.scans, simulation.truth.T_world_sensor, build_scene(SCENE, seed)
    sensor = replace(simulation.settings.sensor, columns=COLUMNS, rows=ROWS)
    return FloodgateSurvey(
        scans=scans,
        T_world_sensor=T,
        mesh=scene.mesh,
        overlap=tuple(
            mutual_overlap(scans[k - 1].points, scans[k].points, T[k - 1].inv() * T[k]) for k in range(1, count)
        ),
        shared=tuple(shared_view(scene, sensor, T[k - 1], T[k]) for k in range(1, count)),
    )


RIGHT_M = 6.0  # three voxels of the paper's coarser grid [m]; one bar for all methods, whatever their voxels
PAIR, POSE = "pair", "pose"

MAP_MEDIAN, MAP_90, DISPLACED_90 = "map_median_m", "map_90_m", "displaced_90_m"


def chain_poses(first: RigidTransform, steps: Sequence[RigidTransform]) -> RigidTransform:
    """Pose k is pose k - 1 times the step T_{k-1}_k, whether it was accepted or not; pose 0 is `first`."""
    poses = [first]
    for step in steps:
        poses.append(poses[-1] * step)
    return RigidTransform.concatenate(poses)


def pair_row(survey: FloodgateSurvey, source: int, estimated: RigidTransform, accepted: bool) -> dict[str, Value]:
    """The row of one registration of the scan `source` to the one before it, with the truth."""
    truth = survey.step(source)
    error = pair_error(estimated, truth)
    return {
        "scan": source,
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "right": error.within(RIGHT_DEG, RIGHT_M),
        "accepted": accepted,
        "overlap": survey.overlap[source - 1],
        "shared": survey.shared[source - 1],
        **parameter_cells(estimated, "found"),
        **parameter_cells(truth, "true"),
    }


def pose_rows(survey: FloodgateSurvey, steps: Sequence[RigidTransform] | None) -> list[dict[str, Value]]:
    """The rows of all poses that the steps chain from the first true one, with the map of the scans so far.

    Args:
        survey: N scans.
        steps: N - 1 registrations; None for the true poses.

    Returns:
        N rows: the pose's error, and median and 90th percentile of the distances [m] of all points of the scans up to
        it, at their poses, to the true surface; the 90th percentile of how far they are from their own true places.
    """
    true = survey.T_world_sensor
    poses = true if steps is None else chain_poses(true[0], steps)
    points, true_points = (placed(survey, T_world_sensor) for T_world_sensor in (poses, true))
    distance, displaced = surface_distance(survey.mesh, points), np.linalg.norm(points - true_points, axis=1)
    ends = np.cumsum([len(scan.points) for scan in survey.scans])
    rows: list[dict[str, Value]] = []
    for scan, end in enumerate(ends):
        error = pair_error(poses[scan], true[scan])
        median, high = np.quantile(distance[:end], [0.5, 0.9])
        rows.append(
            {
                "scan": scan,
                "rotation_deg": error.rotation_deg,
                "translation_m": error.translation_m,
                MAP_MEDIAN: float(median),
                MAP_90: float(high),
                DISPLACED_90: float(np.quantile(displaced[:end], 0.9)),
            }
        )
    return rows


def placed(survey: FloodgateSurvey, T_world_sensor: RigidTransform) -> np.ndarray:
    """The points of all scans at these poses, (P, 3) [m, world]."""
    scans = zip(T_world_sensor, survey.scans, strict=True)
    return np.concatenate([T.apply(scan.points.astype(np.float64)) for T, scan in scans])


def transform(row: Row, which: str) -> RigidTransform:
    """The T_target_source that a pair's row holds as "found" or as "true"."""
    x, y, z, yaw, roll, pitch = (float(row[f"{which}_{name}"]) for name in PARAMETERS)
    return RigidTransform.from_components([x, y, z], Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


def chained(pairs: Sequence[Row], which: str) -> RigidTransform:
    """N poses, T_first_sensor, that the N - 1 pairs of one survey chain, as "found" or as "true"."""
    return chain_poses(RigidTransform.identity(), [transform(row, which) for row in pairs])


def by_run(rows: Iterable[Row], kind: str) -> dict[Run, list[Row]]:
    """The rows of PAIR or POSE, all surveys, by run in order; the true poses have no pairs."""
    return grouped(where(rows, row=kind), "method", "grid")
