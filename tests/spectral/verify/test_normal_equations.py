"""How much the planes of two scans are worth beside instruments, direction by direction."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spectral.verify.calibration import CALIBRATION
from spectral.verify.normal_equations import NormalEquations, State, usual_covariance
from spectral.verify.pairs import Pairs

HESSIAN = np.diag([400.0, 300, 500, 90, 80, 70])
VARIANCE = np.array([0.5])


def of(shared: np.ndarray) -> np.ndarray:
    return usual_covariance(HESSIAN[None], shared[None], VARIANCE)[0]


def test_where_both_scans_show_the_same_planes_errors_are_the_usual_ones() -> None:
    expected = CALIBRATION.usual * 0.5 * np.linalg.inv(HESSIAN)
    np.testing.assert_allclose(of(HESSIAN), expected, rtol=1e-9)
    np.testing.assert_allclose(of(0.5 * HESSIAN), expected, rtol=1e-9)


@pytest.mark.parametrize("share", [0.0, -0.2, 0.01])
def test_what_noise_alone_seems_to_fix_is_worth_less(share: float) -> None:
    shared = HESSIAN.copy()
    shared[3, 3] *= share
    ratio = np.diag(of(shared)) / np.diag(of(HESSIAN))
    np.testing.assert_allclose(ratio, [1, 1, 1, 1 / CALIBRATION.usual, 1, 1], rtol=1e-6)


def test_it_turns_with_the_axes() -> None:
    turn = np.kron(np.eye(2), Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix())
    shared = HESSIAN * [1, 0.2, 0.1, 0.05, 0.15, 1]
    turned = usual_covariance((turn @ HESSIAN @ turn.T)[None], (turn @ shared @ turn.T)[None], VARIANCE)[0]
    np.testing.assert_allclose(turned, turn @ of(shared) @ turn.T, atol=1e-12)


class TestStretch:
    """The stretches eliminated by the Schur complement, beside the whole system solved at once."""

    @pytest.fixture
    def pairs(self) -> Pairs:
        rng = np.random.default_rng(3)
        normals, others = rng.normal(size=(2, 2, 40, 3))
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        others /= np.linalg.norm(others, axis=2, keepdims=True)
        return Pairs(
            near=rng.random((2, 40)) < 0.8,
            arms=20 * rng.normal(size=(2, 40, 3)),
            normals=normals,
            others=others,
            gaps=0.2 * rng.normal(size=(2, 40)),
            by_stretch=10 * rng.normal(size=(2, 40, 2)),
        )

    def test_pose_and_stretches_solve_the_equations_of_all_eight(self, pairs: Pairs) -> None:
        begin = State(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.full(2, 0.3), np.zeros((2, 2)), None)
        equations = NormalEquations.of(pairs, begin, np.full(2, 0.5), 1.0)
        moved, alone = equations.moved(pairs, begin)
        assert moved.stretch is not None
        whole = -np.linalg.solve(equations.hessian, equations.gradient[:, :, None])[:, :, 0]
        np.testing.assert_allclose(alone, whole[:, :6], atol=1e-6)
        np.testing.assert_allclose(moved.stretch, whole[:, 6:], atol=1e-6)
        np.testing.assert_allclose(moved.shift, whole[:, 3:6], atol=1e-6)
