"""The paper's experiments on scans of the flood gate.

`create_gaussian` is for Table 1 (Sect. 3, Figs. 20, 21): scans at growing distances, with Gaussian noise along the
beams. `create_floodgate` is for Table 2 (Sect. 4, Figs. 22 to 31): maps of eighteen scans by chained registrations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.hemisphere import HemisphereRegistrar
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, pair_error
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, Value, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.registrations import finish_device, less_turns, paper_grid, parameter_cells, transform
from sonarmap.tools.lab.simulate.plan import table1_pair
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.scenes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from sonarmap.tools.lab.simulate.trajectories import COLUMNS, PAPER_COUNT, ROWS, TABLE1_COUNT, TABLE1_RIG
from sonarmap.tools.lab.simulate.viewpoints import shared_view
from sonarmap.tools.methods.registry import ALL_METHODS, build, is_installed

# The method was tuned on smaller seeds; grids of `edges` voxels per edge have the extent of the paper's
_TABLE1 = {"scene": "floodgate", "sigma2": (1.0, 2.0), "seeds": 10, "first_seed": 11, "edges": (128, 256)}
_TABLE1_SOURCES = (
    *("kernels", "spectral", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "paper_scans")),
)


def create_gaussian(request: Request) -> Experiment:
    """S0 to S9 on every grid, with every noise and seed; a job is one series, as 128/1.0/11."""
    settings = as_asked(request, _TABLE1, {"sigma2": (1.0,), "seeds": 1, "edges": (128,)})
    planned = lru_cache(maxsize=1)(lambda edge: HemisphereRegistrar(request.opened, paper_grid(edge)))

    def run(job: str) -> Outcome:
        edge, sigma2, seed = job.split("/")
        registrar = planned(int(edge))
        which: dict[str, Value] = {"grid": int(edge), "sigma2": float(sigma2), "seed": int(seed)}
        pair: dict[str, Value] = {"scene": settings.scene, "voxel_m": registrar.grid.voxel, **which}
        rows, times, reference = [], [], None
        for scan in range(TABLE1_COUNT):
            target, source, truth = table1_pair(scan, int(seed), float(sigma2), settings.scene)
            reference = reference or registrar.prepare(target)  # the same for all scans
            start = perf_counter()
            candidate = registrar.prepare(source)
            registrar.device.queue.finish()  # so that the time of the registration does not include it
            prepared = perf_counter() - start
            registration = registrar.register(reference, candidate)
            rows.append(row_of(registration, truth, candidate.volume.center, pair | {"scan": scan}))
            times.append(which | {"scan": scan, "prepare_s": prepared, "register_s": registration.seconds})
        return Outcome(tuple(rows), tuple(times))

    which = product(settings.edges, settings.sigma2, all_seeds(settings))
    jobs = [f"{edge}/{sigma2!r}/{seed}" for edge, sigma2, seed in which]
    return Experiment("gaussian", settings, jobs, run, _TABLE1_SOURCES)


_COLUMNS = ("scene", "grid", "voxel_m", "sigma2", "seed", "scan")


def row_of(registration: Registration, truth: RigidTransform, center: np.ndarray, pair: dict[str, Value]) -> Row:
    """The row of a registration with the true T_target_source and the cells of `pair`.

    "right" is by the error at the sensor; "center_m" is the error at the scan's `center` (3,) [m, frame of the source],
    far from the sensor. "wrong_step" is the first of the paper's steps that fails: yaw, tilt or
    translation; "" for a right result. "found_..." and "true_..." are Table 1's parameters, about the grid's center.
    """
    T, voxel = registration.T_target_source, float(pair["voxel_m"])
    error, steps = pair_error(T, truth), dict(registration.step_psr)
    center_m = float(np.linalg.norm(T.apply(center) - truth.apply(center)))
    is_right, turned_right = error.is_right(voxel), error.rotation_deg <= RIGHT_DEG
    estimated, true = (pose.rotation.as_euler("ZYX", degrees=True)[0] for pose in (T, truth))
    turned = "yaw" if abs(less_turns(estimated - true)) > RIGHT_DEG else "tilt"
    return {
        **{name: pair[name] for name in _COLUMNS},
        "right": is_right,
        "wrong_step": "" if is_right else "translation" if turned_right else turned,
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "translation_voxels": error.translation_m / voxel,
        "center_m": center_m,
        "right_at_center": turned_right and center_m <= RIGHT_VOXELS * voxel,
        "accepted": bool(registration.accepted),
        "psr": float(registration.psr),
        **{f"{step}_psr": float(steps[step]) for step in ("rival", "yaw", "tilt")},
        "overlap": float(registration.overlap),
        **parameter_cells(about_center(T), "found"),
        **parameter_cells(about_center(truth), "true"),
    }


def about_center(T_target_source: RigidTransform) -> RigidTransform:
    """A transform between sensor frames converted to one about the grid's center, as in Table 1."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    return T_grid_rig * T_target_source * T_grid_rig.inv()


COARSE = 128  # voxels per edge for methods that do not run on all of the paper's grids
# Method, in the order of the tables -> whether it runs on each of the paper's grids
COMPARED: Mapping[str, bool] = {
    **{"icp": False, "icp-plane": False, "fpfh-ransac": False, "kiss": False},
    **{"hemisphere": True, "spectral": True},
}
PAPER_METHODS = ("icp", "hemisphere", "spectral")  # two of the paper's three, and ours
TRUTH = "true poses"
# A survey per seed, each with its own bed, sea and noise; scans: number of scans from the start
_USUAL = {"methods": tuple(COMPARED), "edges": (128, 256), "seeds": 3, "first_seed": 1, "scans": PAPER_COUNT}
SOURCES = (
    *("tools/lab/simulate", "tools/lab/evaluate", *ALL_METHODS),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "paper_scans")),
)
SCENE = "floodgate"
RIGHT_M = 6.0  # bound of right translations for all methods: three voxels of the paper's coarser grid [m]
PAIR = "pair"  # value of the column "row", as is POSE
POSE = "pose"
MAP_MEDIAN = "map_median_m"
MAP_90 = "map_90_m"
DISPLACED_90 = "displaced_90_m"


def create_floodgate(request: Request) -> Experiment:
    """Every method registers every scan to the previous one; chaining the registrations gives a map.

    A job is a survey by one method on one grid, as 1/icp/0. `quick` maps one survey by the paper's methods and ours on
    one grid.
    """
    compared = {"methods": PAPER_METHODS} if request.quick else {}
    settings = as_asked(request, _USUAL, {**compared, "edges": (128,), "seeds": 1})
    left_out = tuple(name for name in settings.methods if not is_installed(name))
    settings.methods, settings.left_out = tuple(m for m in settings.methods if m not in left_out), left_out
    runs = [(TRUTH, 0)]
    for name in filter(settings.methods.__contains__, COMPARED):
        runs += [(name, edge) for edge in (settings.edges if COMPARED[name] else (0,))]
    jobs = [f"{seed}/{method}/{edge}" for seed in all_seeds(settings) for method, edge in runs]

    def run(job: str) -> Outcome:
        first, method, second = job.split("/")
        seed, edge = int(first), int(second)
        labels: dict[str, Value] = {"seed": seed, "method": method, "grid": edge}
        simulated = survey(seed, settings.scans)
        pairs, seconds, steps = [], [], None
        if method != TRUTH:
            grid = paper_grid(edge or COARSE)
            registrations, seconds = _chain(build(method, grid, request.opened.selector, seed), simulated.scans)
            steps = [registration.T_target_source for registration in registrations]
            pairs = [
                {"row": PAIR} | labels | pair_row(simulated, k, step.T_target_source, bool(step.accepted))
                for k, step in enumerate(registrations, 1)
            ]
        poses = [{"row": POSE} | labels | row for row in pose_rows(simulated, steps)]
        return Outcome((*pairs, *poses), tuple(labels | row for row in seconds))

    return Experiment("floodgate", settings, jobs, run, SOURCES)


def _chain(registrar: Registrar, scans: Sequence[Scan]) -> tuple[list[Registration], list[dict[str, Value]]]:
    """The registrations of every scan to the previous one, and the times of preparing and registering it [s]."""
    target = registrar.prepare(scans[0])
    registrar.register(target, target)  # untimed: compiles kernels and imports packages
    finish_device(registrar)
    registrations: list[Registration] = []
    seconds: list[dict[str, Value]] = []
    for k, scan in enumerate(scans[1:], 1):
        start = perf_counter()
        source = registrar.prepare(scan)
        finish_device(registrar)
        middle = perf_counter()
        registrations.append(registrar.register(target, source))
        seconds.append({"scan": k, "prepare_s": middle - start, "register_s": perf_counter() - middle})
        target = source
    return registrations, seconds


@dataclass(frozen=True, slots=True)
class FloodgateSurvey:
    """N scans of one scene in their order, with the ground truth."""

    scans: tuple[Scan, ...]  # in their sensor frames
    T_world_sensor: RigidTransform  # N true poses; the world is the scene's frame, East-North-Up
    mesh: Mesh  # the scene's true surface [m, world]
    # N - 1 shares of points in the view of the other of two consecutive scans, without noise, the smaller of both
    shared: tuple[float, ...]

    def step(self, source: int) -> RigidTransform:
        """The true T_target_source of the scan `source` relative to the previous one."""
        return self.T_world_sensor[source - 1].inv() * self.T_world_sensor[source]


@lru_cache(maxsize=1)
def survey(seed: int, count: int = PAPER_COUNT) -> FloodgateSurvey:
    """The survey of a seed. `shared` is computed with the number of beams of the path's layout."""
    simulation = simulate(SimulationSettings(scene=SCENE, trajectory="paper18", count=count, seed=seed))
    scans, T, scene = simulation.scans, simulation.truth.T_world_sensor, build_scene(SCENE, seed)
    sensor = replace(simulation.settings.sensor, columns=COLUMNS, rows=ROWS)
    return FloodgateSurvey(
        scans=scans,
        T_world_sensor=T,
        mesh=scene.mesh,
        shared=tuple(shared_view(scene, sensor, T[k - 1], T[k]) for k in range(1, count)),
    )


def chain_poses(first: RigidTransform, steps: Sequence[RigidTransform]) -> RigidTransform:
    """Chained poses: pose 0 is `first`, and pose k is pose k - 1 times the step T_{k-1}_k."""
    poses = [first]
    for step in steps:
        poses.append(poses[-1] * step)
    return RigidTransform.concatenate(poses)


def pair_row(survey: FloodgateSurvey, source: int, estimated: RigidTransform, accepted: bool) -> dict[str, Value]:
    """The row of the registration of the scan `source` to the previous one, with the truth."""
    truth = survey.step(source)
    error = pair_error(estimated, truth)
    return {
        "scan": source,
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "right": error.within(RIGHT_DEG, RIGHT_M),
        "accepted": accepted,
        "shared": survey.shared[source - 1],
        **parameter_cells(estimated, "found"),
        **parameter_cells(truth, "true"),
    }


def pose_rows(survey: FloodgateSurvey, steps: Sequence[RigidTransform] | None) -> list[dict[str, Value]]:
    """The rows of N poses, chained by N - 1 steps from the first true pose, or of the true poses if `steps` is None.

    A row has the pose's error and, for all points up to its scan, the median and 90th percentile of the distances from
    the true surface [m] and the 90th percentile of the distances from their true positions [m].
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
    """(P, 3): the points of all scans at these poses [m, world]."""
    scans = zip(T_world_sensor, survey.scans, strict=True)
    return np.concatenate([T.apply(scan.points.astype(np.float64)) for T, scan in scans])


def chained(pairs: Sequence[Row], which: str) -> RigidTransform:
    """N poses T_first_sensor, chained from the "found" or "true" transforms of the N - 1 pairs of a survey."""
    return chain_poses(RigidTransform.identity(), [transform(row, which) for row in pairs])
