"""Maps of whole surveys: errors of poses and maps, right and wrong pairs, time and memory.

`create_decisions` maps surveys with other thresholds of the graph, from registrations that a folder keeps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.execute.journal import Journal
from sonarmap.slam.execute.runner import Execution
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.slam.survey_grid import survey_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.map_error import Reference, map_error
from sonarmap.tools.lab.evaluate.pose_calibration import calibrate_poses
from sonarmap.tools.lab.evaluate.survey import score_pairs
from sonarmap.tools.lab.evaluate.trajectory import Evaluation, evaluate
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, Value, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.survey_mapped import MappedSurvey, map_survey, mapped_of
from sonarmap.tools.lab.simulate.kinds.kind import ROUGH_SCENES
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.scenes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import simulate
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.methods.registry import ALL_METHODS, DEFAULT_METHOD, Setup, find_method

DIVES = "dives"
_USUAL = {
    "scene": "floodgate",
    "seeds": 1,
    "first_seed": 5,
    "counts": (50, 100, 200),  # scans of each survey
    "dive": 60,  # scans of each of two dives over one place; 0 for none
    "unusable": 0.03,  # share of the scans without echoes of the scene
    "edge": 128,  # voxels per edge; the voxel fits the survey
}
_ORDER = (2, 1)  # in which the mapper gets the dives
_MAPPING = (
    *("slam", "tools/lab/simulate", "tools/lab/evaluate"),
    *(f"tools/lab/reproduce/{name}.py" for name in ("survey", "survey_mapped")),
)
SOURCES = (*_MAPPING, "tools/products/output", *ALL_METHODS)


def create(request: Request) -> Experiment:
    """A job is a survey, as floodgate-5/200, or two dives, as floodgate-5/dives. `quick` maps twelve scans on a grid of
    half the edge."""
    settings = as_asked(request, _USUAL, {"counts": (12,), "dive": 0, "edge": 64})

    def run(job: str) -> Outcome:
        labels = _named(job)
        dives = _ORDER if labels["survey"] == DIVES else (1,)
        count = settings.dive if labels["survey"] == DIVES else int(labels["survey"])
        survey = simulate_survey(settings.scene, int(labels["seed"]), count, settings.unusable, dives)
        scans, grid = len(survey.scans), survey_grid(survey.scans, settings.edge)
        mapped = map_survey(survey.scans, survey.dives.tolist(), grid, request.opened.selector)
        times: dict[str, Value] = {"scans": scans, "total_s": mapped.seconds, "per_scan_s": mapped.seconds / scans}
        times |= {"peak_memory_mib": mapped.memory / 2**20}
        return Outcome((labels | survey_cells(survey, mapped, grid.voxel),), (labels | times,))

    surveys = [*settings.counts, *([DIVES] if settings.dive else [])]
    jobs = [f"{settings.scene}-{seed}/{survey}" for seed in all_seeds(settings) for survey in surveys]
    return Experiment("survey", settings, jobs, run, SOURCES)


def _named(job: str) -> dict[str, Value]:
    """Cells that identify a job; "survey" is the number of its scans, or DIVES."""
    place, survey = job.split("/")
    scene, _, seed = place.rpartition("-")
    return {"scene": scene, "seed": int(seed), "survey": survey}


_DECISIONS = {"scenes": ROUGH_SCENES, "seeds": 5, "first_seed": 7202, "scans": 24, "edge": 128}
USUAL = "as usual"  # the rule of the default settings
RULES: Mapping[str, LoopSettings] = {
    USUAL: LoopSettings(),
    "answers agree within 3 sigmas": LoopSettings(bound=3.0),
    "one round of loops": LoopSettings(rounds=1, most_rounds=1),
    "without loops": LoopSettings(per_scan=0),
}
_DECISIONS_SOURCES = (*_MAPPING, *find_method(DEFAULT_METHOD).sources)


def create_decisions(request: Request) -> Experiment:
    """A job is a survey by every rule, as wreck-7202; its journal is read from the folder, or created there.

    `quick` maps six scans of a wreck on a grid of half the edge.
    """
    settings = as_asked(request, _DECISIONS, {"scenes": ("wreck",), "seeds": 1, "scans": 6, "edge": 64})
    folder, planned = request.chosen_folder, list[SpectralRegistrar]()

    def row(survey: SimulatedSurvey, rule: str, journal: Journal) -> Row:
        setup = Setup(survey_grid(survey.scans, settings.edge), request.opened.selector)
        if not planned:  # the registrar's tables are computed once
            planned.append(SpectralRegistrar(choose_device(setup.device), setup.grid))
        registrar = planned[0].with_voxel(setup.grid.voxel)
        key = method_key(DEFAULT_METHOD, setup, registrar)
        execution = Execution(Worker(registrar, prepared_limit(registrar)), journal=journal, method=key)
        mapper = Mapper(registrar, setup.grid.voxel, MapperSettings(loops=RULES[rule]), execution)
        result = mapper.run(survey.scans)
        registered = sum(not pair.from_journal for pair in execution.timings.pairs)
        cells = estimate_cells(survey, mapped_of(result), setup.grid.voxel)
        return cells | {"odd": len(result.odd), "registered": registered}

    def run(job: str) -> Outcome:
        scene, _, seed = job.rpartition("-")
        survey = simulate_survey(scene, int(seed), settings.scans, 0.0)
        folder.mkdir(parents=True, exist_ok=True)
        with Journal(folder / f"{job}.sqlite") as journal:
            labels = {"scene": scene, "seed": int(seed)}
            return Outcome(tuple({"rule": rule, **labels, **row(survey, rule, journal)} for rule in RULES))

    jobs = [f"{scene}-{seed}" for seed in all_seeds(settings) for scene in settings.scenes]
    return Experiment("decisions", settings, jobs, run, _DECISIONS_SOURCES)


ROLES = ("sequential", "bridge", "loop")
BETWEEN = "between"  # pairs of different dives, of any role
FATES = ("kept_right", "kept_wrong", "refused_right", "refused_wrong")
_CALIBRATION = ("within_95", "position_within_95", "nees_mean", "position_nees_mean")
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class SimulatedSurvey:
    """N simulated scans, and the ground truth."""

    scans: tuple[Scan, ...]  # in order of the dives; the stamps are 0, 1, 2, ...
    truth: Trajectory  # true poses; the world is the scene's frame, East-North-Up
    dives: np.ndarray  # (N,) int, the number of each scan's survey, as given to the mapper
    unusable: frozenset[int]  # the scans that show nothing of the scene
    mesh: Mesh  # the scene's true surface [m, world]


def simulate_survey(scene: str, seed: int, count: int, unusable: float, dives: Sequence[int] = (1,)) -> SimulatedSurvey:
    """Simulate `count` scans of each dive over a scene of SCENE_KINDS, a share of them unusable."""
    settings = replace(plan(scene, "lawnmower", None, seed), count=count, unusable=unusable)
    runs = [simulate(replace(settings, dive=dive)) for dive in dives]
    scans = [scan for run in runs for scan in run.scans]
    poses = RigidTransform.concatenate([run.truth.T_world_sensor for run in runs])
    return SimulatedSurvey(
        scans=tuple(replace(scan, stamp=float(k), name=f"scan_{k:03d}") for k, scan in enumerate(scans)),
        truth=Trajectory(np.arange(len(scans), dtype=np.float64), poses),
        dives=np.repeat(np.arange(len(runs)), count),
        unusable=frozenset(number + k * count for k, run in enumerate(runs) for number in run.faults),
        mesh=build_scene(scene, seed).mesh,
    )


def survey_cells(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of the mapper's result for a survey with voxels of this edge [m].

    Trajectories are aligned over the usable scans; a map also contains unusable scans that the mapper places.
    """
    return estimate_cells(survey, mapped, voxel) | _map(survey, mapped, voxel)


def estimate_cells(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of the errors of poses and pairs, the first ones of `survey_cells`."""
    evaluated = _evaluated(survey, mapped)
    usable = len(evaluated.stamps)
    cells: dict[str, Value] = {
        "scans": len(survey.scans),
        "unusable": len(survey.unusable),
        "placed": usable,
        "placed_unusable": len(mapped.placed) - usable,
        "components": mapped.components,
        "voxel_m": voxel,
        "ate_after_m": evaluated.ate_m,
        "ate_after_voxels": evaluated.ate_m / voxel,
        "ate_after_deg": float(np.sqrt(np.mean(evaluated.rotation_deg**2))),
    }
    truth = survey.truth.T_world_sensor[list(mapped.placed)]
    calibration = calibrate_poses(mapped.trajectory.T_world_sensor, truth, mapped.covariances)
    values = calibration.to_json() if calibration else {}
    cells |= {key: values.get(key, _NAN) for key in _CALIBRATION}
    return cells | _pairs(survey, mapped, voxel)


def _evaluated(survey: SimulatedSurvey, mapped: MappedSurvey) -> Evaluation:
    """The evaluation of the trajectory of the usable scans."""
    usable = [k for k, scan in enumerate(mapped.placed) if scan not in survey.unusable]
    return evaluate(mapped.trajectory.take(usable), survey.truth)


def _pairs(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of right and wrong pairs by role; kept pairs with an unusable scan are counted separately."""
    usable = [k for k in range(len(survey.scans)) if k not in survey.unusable]
    truth = {k: survey.truth.T_world_sensor[k] for k in usable}
    chosen = {role: [pair for pair in mapped.pairs if pair.role == role] for role in ROLES}
    chosen[BETWEEN] = [pair for pair in mapped.pairs if survey.dives[pair.target] != survey.dives[pair.source]]
    cells: dict[str, Value] = {}
    for name, pairs in chosen.items():
        score = score_pairs(pairs, truth, voxel)
        counts = (score.kept_right, score.kept_wrong, score.rejected_right, score.rejected_wrong)
        cells |= {f"{name}_{fate}": count for fate, count in zip(FATES, counts, strict=True)}
    kept = sum(pair.kept for pair in mapped.pairs if survey.unusable & {pair.target, pair.source})
    return cells | {"pairs": len(mapped.pairs), "unusable_kept": kept}


def _map(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of the map's errors, for all points and for those that several scans saw, which excludes stray echoes."""
    surface = Reference("the true surface", "surface", lambda points: surface_distance(survey.mesh, points))
    T_truth_estimate = _evaluated(survey, mapped).T_truth_estimate
    cells: dict[str, Value] = {}
    for name, points in (("map", mapped.points), ("map_twice", mapped.points[mapped.seen >= 2])):
        error = map_error(T_truth_estimate.apply(points), surface, voxel) if len(points) else None
        cells |= {f"{name}_points": len(points)}
        cells |= {f"{name}_{key}": getattr(error, key, _NAN) for key in ("median_m", "p90_m", "within_voxel")}
    return cells
