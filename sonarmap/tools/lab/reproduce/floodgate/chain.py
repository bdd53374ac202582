"""The scans of Sect. 4 of the paper, simulated; consecutive registrations as rows, and rows as chains of poses."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, pair_error
from sonarmap.tools.lab.reproduce.answer import PARAMETERS, parameter_cells
from sonarmap.tools.lab.reproduce.experiment import Row, Value
from sonarmap.tools.lab.simulate.paths.stations import COLUMNS, PAPER_COUNT, ROWS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import mutual_overlap, shared_view
from sonarmap.tools.lab.simulate.shapes.solids import Mesh
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from sonarmap.tools.lab.simulate.simulation import Simulation, SimulationSettings, simulate

SCENE = "floodgate"
SCANS = PAPER_COUNT


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
def survey(seed: int, count: int = SCANS) -> FloodgateSurvey:
    """The survey from `seed`: the same seed, the same scans."""
    simulation = simulate(SimulationSettings(scene=SCENE, trajectory="paper18", count=count, seed=seed))
    poses = simulation.truth.T_world_sensor
    pairs = range(1, count)
    return FloodgateSurvey(
        scans=simulation.scans,
        T_world_sensor=poses,
        mesh=build_scene(SCENE, seed).mesh,
        overlap=tuple(_overlap(simulation, source) for source in pairs),
        shared=tuple(_shared(simulation, source) for source in pairs),
    )


def _overlap(simulation: Simulation, source: int) -> float:
    target, moved = simulation.scans[source - 1], simulation.scans[source]
    poses = simulation.truth.T_world_sensor
    return mutual_overlap(target.points, moved.points, poses[source - 1].inv() * poses[source])


def _shared(simulation: Simulation, source: int) -> float:
    """With as few beams as the way was laid out with."""
    settings = simulation.settings
    sensor = replace(settings.sensor, columns=COLUMNS, rows=ROWS)
    poses = simulation.truth.T_world_sensor
    return shared_view(build_scene(SCENE, settings.seed), sensor, poses[source - 1], poses[source])


RIGHT_M = 6.0  # three voxels of the paper's coarser grid [m]; one bar for all methods, whatever their voxels
PAIR, POSE = "pair", "pose"

MAP_MEDIAN, MAP_90, DISPLACED_90 = "map_median_m", "map_90_m", "displaced_90_m"


@dataclass(frozen=True, slots=True)
class Chain:
    """What one method made of one survey of N scans."""

    pairs: tuple[Row, ...]  # N - 1 rows of consecutive registrations, of the sources 1..N-1; none for the true poses
    poses: tuple[Row, ...]  # N rows of chained poses, of the scans 0..N-1

    @property
    def found(self) -> RigidTransform:
        """N estimated poses, T_first_sensor: in the frame of the first scan."""
        return self._chained("found")

    @property
    def true(self) -> RigidTransform:
        """N true poses, T_first_sensor."""
        return self._chained("true")

    @property
    def right(self) -> int:
        """How many pairs are right."""
        return sum(bool(row["right"]) for row in self.pairs)

    def column(self, name: str) -> np.ndarray:
        """(N,) float64 of the poses' rows."""
        return np.array([float(row[name]) for row in self.poses])

    def _chained(self, which: str) -> RigidTransform:
        return chain_poses(RigidTransform.identity(), [transform(row, which) for row in self.pairs])


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
    points, true_points = (_placed(survey, T_world_sensor) for T_world_sensor in (poses, true))
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


def _placed(survey: FloodgateSurvey, T_world_sensor: RigidTransform) -> np.ndarray:
    """The points of all scans at these poses, (P, 3) [m, world]."""
    scans = zip(T_world_sensor, survey.scans, strict=True)
    return np.concatenate([T.apply(scan.points.astype(np.float64)) for T, scan in scans])


def transform(row: Row, which: str) -> RigidTransform:
    """The T_target_source that a pair's row holds as "found" or as "true"."""
    x, y, z, yaw, roll, pitch = (float(row[f"{which}_{name}"]) for name in PARAMETERS)
    return RigidTransform.from_components([x, y, z], Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


def chains(rows: Sequence[Row]) -> dict[tuple[int, str, int], Chain]:
    """The chains of all rows, by seed, method and grid (0: none), in the order of the rows."""
    keys = dict.fromkeys(_key(row) for row in rows)
    return {key: Chain(_of(rows, key, PAIR), _of(rows, key, POSE)) for key in keys}


def _key(row: Row) -> tuple[int, str, int]:
    return int(row["seed"]), str(row["method"]), int(row["grid"])


def _of(rows: Iterable[Row], key: tuple[int, str, int], kind: str) -> tuple[Row, ...]:
    return tuple(row for row in rows if row["row"] == kind and _key(row) == key)
