"""A survey's own account of its pairs and of its uncertainty, beside the truth."""

import numpy as np

from kernels.errors import InputError
from slam.graph.trajectory import Trajectory
from tools.evaluate.pairs import CHAIN, PairScore, score_pairs
from tools.evaluate.pose_calibration import PoseCalibration, calibrate_poses
from tools.evaluate.trajectory import associate
from tools.readers.summary import SurveyAccount


def score_survey(account: SurveyAccount, truth: Trajectory) -> dict[str, PairScore]:
    """The scores of its "sequential" pairs, and of its "loops", which are all others.

    Args:
        account: of the survey.
        truth: true poses; they belong to scans by their stamps.

    Raises:
        InputError: no stamp in common.
    """
    poses = {scan: truth.T_world_sensor[row] for scan, row in _by_scan(account, truth).items()}
    chain = [pair for pair in account.pairs if pair.role == CHAIN]
    loops = [pair for pair in account.pairs if pair.role != CHAIN]
    return {"sequential": score_pairs(chain, poses, account.voxel), "loops": score_pairs(loops, poses, account.voxel)}


def calibrate_survey(account: SurveyAccount, estimate: Trajectory, truth: Trajectory) -> PoseCalibration | None:
    """Hold the poses of the estimate's component against their covariances.

    None where the summary has no covariances, or the component no pose beside its anchor.

    Raises:
        InputError: no stamp in common, or the component's first pose, which the covariances are against, is missing
            from the estimate or from the truth.
    """
    if account.covariances is None:
        return None
    found = _by_scan(account, estimate)
    true = _by_scan(account, truth)
    members = next((list(one) for one in account.components if min(found) in one), [])
    told = set(np.flatnonzero(np.isfinite(account.covariances).all(axis=(1, 2))).tolist())
    common = [k for k in members if k in found and k in true and k in told]
    if not common or common[:1] != members[:1]:
        raise InputError(
            "the first pose of the estimate's component, which the covariances of the others are against, is not in "
            "both trajectories, or has none; give the trajectory and the summary of one map, and a truth that holds "
            "its first pose, or leave --summary out"
        )
    return calibrate_poses(
        estimate.T_world_sensor[[found[k] for k in common]],
        truth.T_world_sensor[[true[k] for k in common]],
        account.covariances[np.array(common)],
    )


def _by_scan(account: SurveyAccount, trajectory: Trajectory) -> dict[int, int]:
    """The pose of each scan that has one, by index."""
    scans, poses = associate(account.stamps, trajectory.stamps)
    return dict(zip(scans.tolist(), poses.tolist(), strict=True))
