"""How much the planes of two scans are worth beside instruments, direction by direction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
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


BEGIN = State(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.full(2, 0.3), np.zeros((2, 2)), None)


class TestStretch:
    """Opposite stretches eliminated by the Schur complement, beside the whole system solved at once."""

    @pytest.fixture
    def pairs(self) -> Pairs:
        rng = np.random.default_rng(3)
        normals, others = rng.normal(size=(2, 2, 40, 3))
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        others /= np.linalg.norm(others, axis=2, keepdims=True)
        near = rng.random((2, 40)) < 0.8
        return Pairs(
            near=near,
            inner=near & (rng.random((2, 40)) < 0.7),
            arms=20 * rng.normal(size=(2, 40, 3)),
            normals=normals,
            others=others,
            gaps=0.2 * rng.normal(size=(2, 40)),
            by_stretch=10 * rng.normal(size=(2, 40, 2)),
        )

    @pytest.mark.parametrize("inner", [False, True])
    def test_pose_and_opposite_stretches_solve_the_equations_of_all(self, pairs: Pairs, inner: bool) -> None:
        pairs = pairs if inner else replace(pairs, inner=None)
        equations = NormalEquations.of(pairs, BEGIN, np.full(2, 0.5), 1.0)
        moved, alone = equations.moved(pairs, BEGIN)
        opposite = block_diag(np.eye(6), [[1.0], [-1.0]])
        hessian, gradient = opposite.T @ equations.hessian @ opposite, equations.gradient @ opposite
        whole = -np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        assert moved.stretch is not None
        np.testing.assert_allclose(alone, whole[:, :6], atol=1e-6)
        np.testing.assert_allclose(moved.stretch, whole[:, 6:] * [1.0, -1.0], atol=1e-6)
        np.testing.assert_allclose(moved.shift, whole[:, 3:6], atol=1e-6)


class TestDoubt:
    """What noisy normals seem to hold along a plane: nothing, but for chance."""

    @staticmethod
    def of_a_plane(seed: int, tilt: float = 0.0) -> tuple[NormalEquations, Pairs]:
        """Points of a level plane, some of which lean by `tilt`; normals of both scans are off independently."""
        rng = np.random.default_rng(seed)
        count = 400
        true = np.tile([0.0, 0.0, 1.0], (count, 1))
        true[::4] = [np.sin(tilt), 0.0, np.cos(tilt)]
        normals, others = (true + 0.2 * rng.normal(size=(count, 3)) for _ in range(2))
        pairs = Pairs(
            near=np.ones((1, count), bool),
            inner=None,
            arms=np.zeros((1, count, 3)),
            normals=normals[None],
            others=others[None],
            gaps=np.zeros((1, count)),
            by_stretch=None,
        )
        begin = State(np.eye(3)[None], np.zeros((1, 3)), np.full(1, 0.3), None, None)
        return NormalEquations.of(pairs, begin, np.full(1, 0.5), 1.0), pairs

    def test_it_is_the_spread_of_what_chance_gives(self) -> None:
        found, doubts = [], []
        for seed in range(300):
            equations, pairs = self.of_a_plane(seed)
            found.append(equations.shared_information(pairs)[0, 3, 3])
            doubts.append(equations.shared_doubt(pairs, np.eye(6)[None])[0, 3])
        assert abs(np.mean(found)) < 3 * np.std(found) / np.sqrt(300)
        assert np.mean(doubts) == pytest.approx(np.std(found), rel=0.1)

    def test_what_planes_do_hold_is_far_above_it(self) -> None:
        equations, pairs = self.of_a_plane(0, tilt=0.9)
        held = equations.shared_information(pairs)[0, 3, 3]
        assert held > 5 * equations.shared_doubt(pairs, np.eye(6)[None])[0, 3]

    def test_it_is_along_the_axes_that_are_asked_for(self) -> None:
        equations, pairs = self.of_a_plane(1)
        turn = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
        axes = np.kron(np.eye(2), turn)
        turned = replace(pairs, normals=pairs.normals @ turn, others=pairs.others @ turn)
        begin = State(np.eye(3)[None], np.zeros((1, 3)), np.full(1, 0.3), None, None)
        same = NormalEquations.of(turned, begin, np.full(1, 0.5), 1.0).shared_doubt(turned, np.eye(6)[None])
        np.testing.assert_allclose(equations.shared_doubt(pairs, axes[None])[0, 3:], same[0, 3:], rtol=1e-9)
