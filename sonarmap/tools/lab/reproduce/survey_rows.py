"""Simulated surveys, and the rows of a system's errors on a survey: one for the map, and one per pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map.cell import outline, overlapping
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.evaluate.map_error import Reference, map_error
from sonarmap.tools.lab.evaluate.pose_calibration import calibrate_poses
from sonarmap.tools.lab.evaluate.survey import score_pairs
from sonarmap.tools.lab.evaluate.trajectory import Evaluation, evaluate
from sonarmap.tools.lab.reproduce.experiments import Row, Value
from sonarmap.tools.lab.reproduce.survey_mapped import MappedSurvey
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.scenes.solids import Mesh
from sonarmap.tools.lab.simulate.simulation import simulate

MAP, POSE = "map", "pose"  # values of the column "row"
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


def survey_rows(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> tuple[Row, ...]:
    """All rows of a system's result for a survey with voxels of this edge [m].

    Trajectories are aligned over the usable scans; a map also contains unusable scans that the system places.
    """
    before, after = _evaluated(survey, mapped)
    row = {"row": MAP} | estimate_cells(survey, mapped, voxel)
    row |= _map(survey, mapped, after, voxel) | _recall(survey, mapped, voxel)
    return (row, *_poses(before, after))


def estimate_cells(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of the errors of poses and pairs, as at the start of the row of the map."""
    before, after = _evaluated(survey, mapped)
    cells = _placed(survey, mapped, len(after.stamps)) | {"voxel_m": voxel} | _errors(before, after, voxel)
    return cells | _calibration(survey, mapped) | _pairs(survey, mapped, voxel)


def _evaluated(survey: SimulatedSurvey, mapped: MappedSurvey) -> tuple[Evaluation | None, Evaluation]:
    """The evaluations of the trajectories before loop closure (None if unknown) and after."""
    usable = [k for k, scan in enumerate(mapped.placed) if scan not in survey.unusable]
    after = evaluate(mapped.trajectory.take(usable), survey.truth)
    return None if mapped.chained is None else evaluate(mapped.chained.take(usable), survey.truth), after


def _placed(survey: SimulatedSurvey, mapped: MappedSurvey, usable: int) -> dict[str, Value]:
    return {
        "scans": len(survey.scans),
        "unusable": len(survey.unusable),
        "placed": usable,
        "placed_unusable": len(mapped.placed) - usable,
        "components": mapped.components,
    }


def _errors(before: Evaluation | None, after: Evaluation, voxel: float) -> dict[str, Value]:
    ates = {"before": before.ate_m if before else _NAN, "after": after.ate_m}
    return {
        **{f"ate_{when}_m": ate for when, ate in ates.items()},
        **{f"ate_{when}_voxels": ate / voxel for when, ate in ates.items()},
        "ate_after_deg": float(np.sqrt(np.mean(after.rotation_deg**2))),
    }


def _calibration(survey: SimulatedSurvey, mapped: MappedSurvey) -> dict[str, Value]:
    calibration = None
    if mapped.covariances is not None:
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


def _map(survey: SimulatedSurvey, mapped: MappedSurvey, after: Evaluation, voxel: float) -> dict[str, Value]:
    """Cells of the map's errors, for all points and for those that several scans saw, which excludes stray echoes."""
    surface = Reference("the true surface", "surface", lambda points: surface_distance(survey.mesh, points))
    cells: dict[str, Value] = {}
    for name, points in (("map", mapped.points), ("map_twice", mapped.points[mapped.seen >= 2])):
        error = map_error(after.T_truth_estimate.apply(points), surface, voxel) if len(points) else None
        cells |= {f"{name}_points": len(points)}
        cells |= {f"{name}_{key}": getattr(error, key, _NAN) for key in ("median_m", "p90_m", "within_voxel")}
    before, after_loops = mapped.crossings
    return cells | {"crossing_before_m": before, "crossing_after_m": after_loops}


def _recall(survey: SimulatedSurvey, mapped: MappedSurvey, voxel: float) -> dict[str, Value]:
    """Cells of the recall of revisits, among the scans that have a signature."""
    signed = sorted(mapped.signatures)
    shares, count = [_NAN] * len(AMONG), 0
    if signed:
        places = PlaceIndex(np.stack([mapped.signatures[k] for k in signed]), survey.dives[signed])
        again = revisits([survey.scans[k] for k in signed], survey.truth.T_world_sensor[signed], voxel)
        index, _ = places.nearest(AMONG[-1], GAP)
        shares, count = recall(index, again), int(again.any(axis=1).sum())
    return {"revisited": count, **{f"recall_{k}": share for k, share in zip(AMONG, shares, strict=True)}}


def _poses(before: Evaluation | None, after: Evaluation) -> list[Row]:
    """A row per usable scan with its aligned estimated positions and its true position [m]."""
    trajectories = {"true": after.T_true, "after": after.T_aligned} | ({"before": before.T_aligned} if before else {})
    places = {name: T.translation.tolist() for name, T in trajectories.items()}
    return [
        {"row": POSE, "scan": int(stamp)}
        | {f"{axis}_{name}_m": place[k][n] for name, place in places.items() for n, axis in enumerate("xyz")}
        for k, stamp in enumerate(after.stamps.tolist())
    ]


OVERLAP = 0.4  # smallest overlap of a scan with its revisit at the true poses
GAP = 5  # the indices of a scan and its revisit differ by more than this
AMONG = (1, 5, 10)  # numbers of candidates for which recall is computed


def revisits(scans: Sequence[Scan], truth: RigidTransform, voxel: float) -> np.ndarray:
    """(N, N) bool: whether two of N scans, in the order of the survey, see the same place at different times; `voxel`
    is the survey's [m]."""
    cell = LoopSettings().cell_voxels * voxel
    pairs, _ = overlapping([outline(scan, cell) for scan in scans], truth, cell, OVERLAP)
    i, j = pairs[pairs[:, 1] - pairs[:, 0] > GAP].T
    again = np.zeros((len(scans), len(scans)), bool)
    again[i, j] = again[j, i] = True
    return again


def recall(index: np.ndarray, again: np.ndarray) -> list[float]:
    """Share of the scans with a revisit (`again`) that have one among their first 1, 5, 10 candidates; NaN without any.

    `index` (N, 10) has the candidates of each scan, the most similar first, and -1 for missing ones.
    """
    right = hits(index, again)
    return [float(right[:, :k].any(axis=1).mean()) if len(right) else float("nan") for k in AMONG]


def hits(index: np.ndarray, again: np.ndarray) -> np.ndarray:
    """(M, 10) bool: whether each candidate is a revisit, for the M scans that have one."""
    right = np.take_along_axis(again, np.maximum(index, 0), axis=1) & (index >= 0)
    return right[again.any(axis=1)]
