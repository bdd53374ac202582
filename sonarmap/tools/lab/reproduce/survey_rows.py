"""Simulated surveys, and the row of the mapper's errors on a survey."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.map_error import Reference, map_error
from sonarmap.tools.lab.evaluate.pose_calibration import calibrate_poses
from sonarmap.tools.lab.evaluate.survey import score_pairs
from sonarmap.tools.lab.evaluate.trajectory import Evaluation, evaluate
from sonarmap.tools.lab.reproduce.experiments import Value
from sonarmap.tools.lab.reproduce.survey_mapped import MappedSurvey
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.scenes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import simulate

ROLES = ("sequential", "bridge", "loop")
BETWEEN = "between"  # pairs of different dives, whatever their role
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
    return cells | _calibration(survey, mapped) | _pairs(survey, mapped, voxel)


def _evaluated(survey: SimulatedSurvey, mapped: MappedSurvey) -> Evaluation:
    """The evaluation of the trajectory of the usable scans."""
    usable = [k for k, scan in enumerate(mapped.placed) if scan not in survey.unusable]
    return evaluate(mapped.trajectory.take(usable), survey.truth)


def _calibration(survey: SimulatedSurvey, mapped: MappedSurvey) -> dict[str, Value]:
    truth = survey.truth.T_world_sensor[list(mapped.placed)]
    calibration = calibrate_poses(mapped.trajectory.T_world_sensor, truth, mapped.covariances)
    cells = calibration.to_json() if calibration else {}
    return {key: cells.get(key, _NAN) for key in _CALIBRATION}


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
