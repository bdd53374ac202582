"""What a survey's summary says of its pairs and of its uncertainty, compared with the truth."""

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.map_folder.pairs import CHAIN
from sonarmap.tools.lab.evaluate.pairs import PairScore, score_pairs
from sonarmap.tools.lab.evaluate.pose_calibration import PoseCalibration, calibrate_poses
from sonarmap.tools.lab.evaluate.survey_summary import SurveySummary
from sonarmap.tools.lab.evaluate.trajectory import associate


def score_survey(summary: SurveySummary, truth: Trajectory) -> dict[str, PairScore]:
    """The scores of the survey's "sequential" pairs, and of its "loops", which are all others.

    Args:
        summary: of the survey.
        truth: true poses; each belongs to the scan of the same stamp.

    Raises:
        InputError: the summary and the truth have no stamp in common.
    """
    poses = {scan: truth.T_world_sensor[row] for scan, row in _by_scan(summary, truth).items()}
    chain = [pair for pair in summary.pairs if pair.role == CHAIN]
    loops = [pair for pair in summary.pairs if pair.role != CHAIN]
    return {"sequential": score_pairs(chain, poses, summary.voxel), "loops": score_pairs(loops, poses, summary.voxel)}


def calibrate_survey(summary: SurveySummary, estimate: Trajectory, truth: Trajectory) -> PoseCalibration | None:
    """Compare the errors of the poses of the estimate's component with their covariances.

    None where the summary has no covariances, or the component has no pose but the first.

    Raises:
        InputError: no stamp in common, or the component's first pose, to which the covariances are relative, is missing
            from the estimate or from the truth.
    """
    if summary.covariances is None:
        return None
    estimate_rows = _by_scan(summary, estimate)
    truth_rows = _by_scan(summary, truth)
    first = min(estimate_rows)
    number = next((n for n, component in enumerate(summary.components) if first in component), None)
    members = [] if number is None else list(summary.components[number])
    finite = set(np.flatnonzero(np.isfinite(summary.covariances).all(axis=(1, 2))).tolist())
    common = [scan for scan in members if scan in estimate_rows and scan in truth_rows and scan in finite]
    if not common or common[0] != members[0]:
        raise InputError(
            "the first pose of the estimate's component, to which the covariances are relative, is missing from the "
            "estimate or the truth, or has no covariance; give the trajectory and the summary of the same map and a "
            "truth that holds its first pose, or leave --summary out"
        )
    return calibrate_poses(
        estimate.T_world_sensor[[estimate_rows[scan] for scan in common]],
        truth.T_world_sensor[[truth_rows[scan] for scan in common]],
        summary.covariances[np.array(common)],
        () if number is None else summary.unmeasured[number],
    )


def _by_scan(summary: SurveySummary, trajectory: Trajectory) -> dict[int, int]:
    """{index of a scan: index of its pose in the trajectory}."""
    scans, poses = associate(summary.stamps, trajectory.stamps)
    return dict(zip(scans.tolist(), poses.tolist(), strict=True))
