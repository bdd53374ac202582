"""Rotations that priors allow: laws of relative poses, with values that distinguish all axes and signs."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.prior import UNMEASURED_TILT, RelativePrior, relative_prior
from sonarmap.spectral.scan import PosePrior
from tests.samples.relative_priors import (
    ALL,
    ATTITUDE,
    DEPTH,
    HEADING,
    INF,
    POSITION,
    SIGMAS,
    T_SOURCE,
    T_TARGET,
    T_TRUE,
    about_vertical,
    pair,
    prior,
    random_rotations,
)


class TestRelativePrior:
    def test_none_without_a_measurement_of_both_scans(self) -> None:
        known = prior(T_TARGET, *ALL)
        parts = prior(T_TARGET, ATTITUDE, DEPTH), prior(T_SOURCE, HEADING, POSITION)
        for priors in ((None, known), (known, None), (None, None), parts, (prior(T_TARGET), prior(T_SOURCE))):
            assert relative_prior(*priors) is None

    def test_the_measured_rotation(self) -> None:
        measured = pair(ATTITUDE, HEADING).R_target_source
        assert measured is not None
        np.testing.assert_allclose(measured.as_matrix(), T_TRUE.rotation.as_matrix(), atol=1e-14)
        assert pair(ATTITUDE).R_target_source is None
        assert pair(HEADING).R_target_source is None

    @pytest.mark.parametrize("kind", ALL)
    def test_one_measurement_of_both_scans_suffices(self, kind: slice) -> None:
        relative = relative_prior(prior(T_TARGET, kind), prior(T_SOURCE, kind))
        assert relative is not None
        known = [kind == known_kind for known_kind in ALL]
        assert [relative.knows_tilt, relative.knows_heading, relative.knows_position, relative.knows_depth] == known
        one = relative.target
        assert [one.knows_attitude, one.knows_heading, one.knows_position, one.knows_depth] == known


class TestRotations:
    def test_attitudes_leave_only_the_turn_about_the_vertical_free(self) -> None:
        relative = pair(ATTITUDE, sigmas=np.full(6, 1e-4))
        turns = Rotation.from_euler("Z", np.linspace(-3.1, 3.1, 40)[:, None])
        assert relative.allows(T_TARGET.rotation.inv() * turns * T_SOURCE.rotation).all()
        tilts = Rotation.from_rotvec([[0.01, 0, 0], [0, 0.01, 0], [-0.01, 0, 0], [0, -0.01, 0]])
        assert not relative.allows(T_TARGET.rotation.inv() * tilts * T_SOURCE.rotation).any()
        assert not relative.allows(random_rotations(2000, 1)).any()
        # about the target's own z is not about the vertical
        assert not pair(ATTITUDE).allows(Rotation.from_euler("Z", 0.5) * T_TRUE.rotation)

    @pytest.mark.parametrize("sign", [1, -1])
    def test_turns_are_allowed_within_four_sigmas_and_the_slack(self, sign: int) -> None:
        relative = pair(ATTITUDE, HEADING)
        sigma = np.hypot(0.05, 0.05)

        def turned(angle: float) -> Rotation:
            return T_TARGET.rotation.inv() * Rotation.from_euler("Z", sign * angle) * T_SOURCE.rotation

        assert relative.allows(turned(3.99 * sigma))
        assert not relative.allows(turned(4.01 * sigma))
        assert relative.allows(turned(4 * sigma + 0.09), slack=0.1)
        assert not relative.allows(turned(4 * sigma + 0.11), slack=0.1)

    @pytest.mark.parametrize("of", ["target", "source"])
    def test_roll_and_pitch_are_about_the_level_axes_of_their_own_scan(self, of: str) -> None:
        """Headings a quarter turn apart, and only one of the priors is coarse: 0.1 of roll, 0.01 of pitch."""
        coarse, fine = np.array([0.1, 0.01, 0.3, 1, 1, 1]), np.full(6, 1e-4)
        T_ahead, T_aside = about_vertical(0.0), about_vertical(np.pi / 2)  # forward is East, forward is North
        target, source = (coarse, fine) if of == "target" else (fine, coarse)
        relative = RelativePrior(PosePrior(T_ahead, target), PosePrior(T_aside, source))
        about_east, about_north = (Rotation.from_rotvec([0.2 * e, 0.2 * (1 - e), 0]) for e in (1, 0))
        allowed = [relative.allows(tilt * T_aside.rotation) for tilt in (about_east, about_north)]
        assert allowed == ([True, False] if of == "target" else [False, True])

    @pytest.mark.parametrize("kinds", [(HEADING,), (ATTITUDE, HEADING)])
    def test_swapped_scans_allow_the_inverse_rotations(self, kinds: tuple[slice, ...]) -> None:
        relative = pair(*kinds, sigmas=np.array([0.1, 0.3, 0.2, 1, 1, 1]))
        swapped = RelativePrior(relative.source, relative.target)
        near = Rotation.from_rotvec(np.random.default_rng(3).normal(scale=0.7, size=(2000, 3)))
        rotations = T_TRUE.rotation * near
        allowed = relative.allows(rotations, slack=0.03)
        assert 20 < allowed.sum() < 1980
        np.testing.assert_array_equal(swapped.allows(rotations.inv(), slack=0.03), allowed)

    def test_the_slack_applies_to_the_tilt_too(self) -> None:
        relative = pair(ATTITUDE, HEADING, sigmas=np.full(6, 1e-5))
        tilted = T_TARGET.rotation.inv() * Rotation.from_rotvec([0.06, 0.08, 0]) * T_SOURCE.rotation
        assert not relative.allows(tilted, slack=0.099)
        assert relative.allows(tilted, slack=0.101)


class TestHeadingsWithoutAttitude:
    @pytest.mark.parametrize(("attitudes", "widest"), [((HEADING,), 45.5), ((HEADING, ATTITUDE), 11.5)])
    def test_the_yaw_is_bounded(self, attitudes: tuple[slice, ...], widest: float) -> None:
        sigmas = np.full(6, 1e-6)
        target = prior(about_vertical(2.0), *attitudes, sigmas=sigmas)
        source = prior(about_vertical(1.2), HEADING, sigmas=sigmas)
        off = np.arange(-180.0, 180.0, 1.0)
        allowed = RelativePrior(target, source).allows(Rotation.from_euler("Z", -0.8 + np.deg2rad(off)[:, None]))
        assert np.abs(off[allowed]).max() == pytest.approx(np.floor(widest))
        assert (np.diff(np.flatnonzero(allowed)) == 1).all()

    @pytest.mark.slow
    @pytest.mark.parametrize("attitudes", [(), ("target",), ("source",)])
    def test_the_truth_is_allowed_at_any_roll_and_pitch_in_range(self, attitudes: tuple[str, ...]) -> None:
        rng = np.random.default_rng(5)
        yaws = rng.uniform(-np.pi, np.pi, (2, 600))
        tilts = rng.choice([-1, 1], (2, 600, 2)) * UNMEASURED_TILT * rng.uniform(0, 1, (2, 600, 2)) ** 0.2
        for k in range(600):
            R = [Rotation.from_euler("ZYX", [yaws[i, k], *tilts[i, k]]) for i in range(2)]
            priors = []
            for name, yaw, rotation in zip(("target", "source"), yaws[:, k], R, strict=True):
                known = name in attitudes
                R_measured = rotation if known else Rotation.from_euler("Z", yaw)
                kinds = (ATTITUDE, HEADING) if known else (HEADING,)
                measured = RigidTransform.from_rotation(R_measured)
                priors.append(prior(measured, *kinds, sigmas=np.full(6, 1e-6)))
            assert RelativePrior(*priors).allows(R[0].inv() * R[1])


class TestNormalized:
    def test_chi_squared_is_0_at_the_measured_pose_and_1_at_a_turn_of_one_sigma(self) -> None:
        assert pair(*ALL).normalized(T_TRUE) == (pytest.approx(0, abs=1e-20), 6)
        sigmas = [np.array([1e-3, 1e-3, heading, INF, INF, INF]) for heading in (0.03, 0.04)]
        relative = RelativePrior(PosePrior(T_TARGET, sigmas[0]), PosePrior(T_SOURCE, sigmas[1]))
        turned = T_TARGET.rotation.inv() * Rotation.from_euler("Z", 0.05) * T_SOURCE.rotation
        assert relative.normalized(RigidTransform.from_rotation(turned))[0] == pytest.approx(1.0)

    @pytest.mark.parametrize("kinds", [ALL, (ATTITUDE, HEADING, POSITION)])
    def test_swapped_scans_give_the_same_chi_squared_of_the_inverse(self, kinds: tuple[slice, ...]) -> None:
        relative = pair(*kinds)
        swapped = RelativePrior(relative.source, relative.target)
        moved = T_TRUE * RigidTransform.from_exp_coords([2e-4, -1e-4, 3e-4, 1, 2, 0.1])
        here, there = relative.normalized(moved), swapped.normalized(moved.inv())
        assert here[0] > 0.1
        assert there == (pytest.approx(here[0], rel=2e-3), here[1])


@pytest.mark.parametrize("of", ["target", "source"])
def test_an_unmeasured_heading_is_ignored(of: str) -> None:
    """Another heading in an unmeasured pose turns the axes of roll and pitch with it; their sigmas differ."""
    sigmas = np.array([0.05, 0.3, 1, 1, 1, 0.7])
    poses = {"target": T_TARGET, "source": T_SOURCE}
    turned = {**poses, of: about_vertical(1.3) * poses[of]}
    here, there = (
        RelativePrior(*(prior(T[name], ATTITUDE, DEPTH, sigmas=sigmas) for name in ("target", "source")))
        for T in (poses, turned)
    )
    rng = np.random.default_rng(13)
    rotations = T_TRUE.rotation * Rotation.from_rotvec(rng.normal(scale=0.5, size=(500, 3)))
    shifts = T_TRUE.translation + rng.normal(scale=8, size=(500, 3))
    assert 10 < here.allows(rotations).sum() < 490
    np.testing.assert_array_equal(here.allows(rotations), there.allows(rotations))
    np.testing.assert_array_equal(here.allows_shift(shifts, rotations), there.allows_shift(shifts, rotations))
    for T in RigidTransform.from_components(shifts, rotations)[:20]:
        assert here.normalized(T) == pytest.approx(there.normalized(T))


class TestPosePrior:
    @pytest.mark.parametrize(
        ("sigmas", "words"),
        [
            (np.ones(5), "shape"),
            ([1.0] * 6, "float64"),
            *((np.array([1, 1, heading, 1, 1, 1]), "above 0") for heading in (0.0, np.nan)),
            (np.array([INF, 1, 1, 1, 1, 1]), "roll and pitch"),
            (np.array([1, 1, 1, 1, INF, 1]), "East and North"),
        ],
    )
    def test_bad_sigmas_are_refused(self, sigmas: np.ndarray, words: str) -> None:
        with pytest.raises(InputError, match=words):
            PosePrior(RigidTransform.identity(), sigmas)

    def test_bad_poses_are_refused(self) -> None:
        off = (RigidTransform.from_translation(t) for t in ([0, np.nan, 0], [INF, 0, 0]))
        for T in (RigidTransform.concatenate([T_TARGET, T_SOURCE]), *off):
            with pytest.raises(InputError, match="finite"):
                PosePrior(T, SIGMAS)
