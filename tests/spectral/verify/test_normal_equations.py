"""Weights of the planes of two scans against instruments, by direction."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from sonarmap.kernels.surface.refinement import Record
from sonarmap.spectral.verify.fit import CALIBRATION
from sonarmap.spectral.verify.icp import NormalEquations, State, usual_covariance

HESSIAN = np.diag([400.0, 300, 500, 90, 80, 70])
VARIANCE = np.array([0.5])


def of(shared: np.ndarray) -> np.ndarray:
    return usual_covariance(HESSIAN[None], shared[None], VARIANCE)[0]


def test_shared_planes_have_the_usual_covariance() -> None:
    expected = CALIBRATION.usual * 0.5 * np.linalg.inv(HESSIAN)
    np.testing.assert_allclose(of(HESSIAN), expected, rtol=1e-9)
    np.testing.assert_allclose(of(0.5 * HESSIAN), expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.0, -0.2, 0.01])
def test_information_of_noise_alone_gets_less_weight(share: float) -> None:
    shared = HESSIAN.copy()
    shared[3, 3] *= share
    ratio = np.diag(of(shared)) / np.diag(of(HESSIAN))
    np.testing.assert_allclose(ratio, [1, 1, 1, 1 / CALIBRATION.usual, 1, 1], rtol=1e-6)


BEGIN = State(Rotation.identity(2), np.zeros((2, 3)), np.full(2, 0.3), np.zeros((2, 2)), None)


class TestStretch:
    """Elimination of opposite stretches by the Schur complement, against the solution of the whole system."""

    def test_pose_and_opposite_stretches_solve_the_equations_of_all(self) -> None:
        rng = np.random.default_rng(3)
        jacobian = rng.normal(size=(2, 80, 8)) * [20, 20, 20, 1, 1, 1, 10, 10]
        moving = jacobian.transpose(0, 2, 1) @ jacobian
        turn = BEGIN.R.as_matrix()
        poses = {"turn": turn, "shift": BEGIN.shift, "width": BEGIN.width, "stretch": np.zeros((2, 2))}
        ends = {"next_turn": turn, "next_shift": BEGIN.shift, "next_stretch": np.zeros((2, 2))}
        sums = {"moving": moving, "whole": 1.5 * moving, "shared": 0.5 * moving, "doubts": np.zeros((2, 6))}
        gradient = 0.2 * (rng.normal(size=(2, 1, 80)) @ jacobian)[:, 0]
        record = Record(**poses, **sums, **ends, gradient=gradient, total=np.full(2, 80.0), squares=np.full(2, 0.3))
        equations = NormalEquations.of(record, BEGIN)
        moved, alone = equations.moved(BEGIN)
        opposite = block_diag(np.eye(6), [[1.0], [-1.0]])
        hessian, gradient = opposite.T @ equations.hessian @ opposite, equations.gradient @ opposite
        whole = -np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        assert moved.stretch is not None
        np.testing.assert_allclose(alone, whole[:, :6], atol=1e-6)
        np.testing.assert_allclose(moved.stretch, whole[:, 6:] * [1.0, -1.0], atol=1e-6)
        np.testing.assert_allclose(moved.shift, whole[:, 3:6], atol=1e-6)
