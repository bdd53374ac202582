"""Registration by planes, in rooms of which everything is known."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.planes.registrar import PlaneRegistrar
from tests.samples.scenes.plane_rooms import CORRIDOR, ROOM, T_ROOM_TARGET, T_TARGET_SOURCE, look, look_twice

VOXEL = 1.0
REGISTRAR = PlaneRegistrar(VOXEL)


def register(target: Scan, source: Scan) -> Registration:
    return REGISTRAR.register(REGISTRAR.prepare(target), REGISTRAR.prepare(source))


def error(found: Registration, truth: RigidTransform = T_TARGET_SOURCE) -> np.ndarray:
    """xi (6,) of truth = found Exp(xi)."""
    return (found.T_target_source.inv() * truth).as_exp_coords()


def test_a_room_is_registered() -> None:
    scans = look_twice(ROOM, seed=1, sigma2=0.02)
    found = register(*scans)
    assert found.accepted, found.reason
    assert np.rad2deg(np.linalg.norm(error(found)[:3])) < 0.5
    assert np.linalg.norm(error(found)[3:]) < 0.1
    assert found.overlap > 0.9
    assert "planes agree" in found.reason


@pytest.mark.slow
def test_without_noise_it_is_exact() -> None:
    found = register(*look_twice(ROOM, seed=2))
    np.testing.assert_allclose(error(found), 0, atol=2e-3)  # a cell at an edge holds points of both walls


def test_every_wall_becomes_a_patch_with_its_true_plane_largest_first() -> None:
    patches = REGISTRAR.prepare(look(ROOM, T_ROOM_TARGET, seed=3, sigma2=0.01)).patches
    normal = ROOM[0] / np.linalg.norm(ROOM[0], axis=1, keepdims=True)
    distance = ROOM[1] - normal @ T_ROOM_TARGET.translation
    normal = T_ROOM_TARGET.rotation.inv().apply(normal)
    for n, d, patch_normal, patch_distance in zip(
        patches.normal[:6, None], patches.distance[:6, None], normal[None], distance[None], strict=False
    ):
        near = np.argmin(np.linalg.norm(patch_normal - n, axis=-1))
        np.testing.assert_allclose(patch_normal[near], n[0], atol=0.01)
        np.testing.assert_allclose(patch_distance[near], d[0], atol=0.1)
    assert (np.diff(patches.area) <= 0).all()
    assert {len(getattr(patches, field.name)) for field in fields(patches)} == {len(patches)}


@pytest.mark.slow
def test_swapped_scans_give_the_inverse_and_the_same_scans_the_same_bytes() -> None:
    target, source = look_twice(ROOM, seed=4, sigma2=0.02)
    there, again, back = register(target, source), register(target, source), register(source, target)
    assert there.T_target_source.as_matrix().tobytes() == again.T_target_source.as_matrix().tobytes()
    assert there.covariance.tobytes() == again.covariance.tobytes()
    np.testing.assert_allclose(error(back, there.T_target_source.inv()), 0, atol=0.02)


@pytest.mark.slow
def test_a_moved_source_moves_the_result() -> None:
    target, source = look_twice(ROOM, seed=5, sigma2=0.01)
    G = RigidTransform.from_components([0.8, -0.5, 0.3], Rotation.from_euler("ZYX", [0.6, 0.1, -0.05]))
    moved = Scan(G.apply(source.points).astype(np.float32))
    first, second = register(target, source), register(target, moved)
    np.testing.assert_allclose(error(second, first.T_target_source * G.inv()), 0, atol=0.06)


def test_parallel_walls_alone_are_not_believed_and_leave_their_directions_open() -> None:
    found = register(*look_twice(CORRIDOR, seed=7, sigma2=0.01))
    assert not found.accepted
    assert "no three of them span space" in found.reason
    sigmas = np.sqrt(np.linalg.eigvalsh(found.covariance[3:, 3:]))
    assert sigmas[0] < 1.0
    assert sigmas[1] > 30.0  # two directions, as large as the scan


def test_scans_without_planes_are_refused_in_words() -> None:
    rng = np.random.default_rng(8)
    blob = Scan((rng.normal(size=(4000, 3)) * 15 + (40, 0, 0)).astype(np.float32))
    found = register(blob, look(ROOM, T_ROOM_TARGET, seed=9))
    assert not found.accepted
    assert "0 and" in found.reason
    np.testing.assert_array_equal(found.T_target_source.as_matrix(), np.eye(4))
    assert np.diag(found.covariance)[3:].min() > 30.0**2


def test_two_rooms_that_share_nothing_are_refused() -> None:
    other = (np.array([[1, 0, 0], [-1, 1, 0], [-1, -2, 0], [0, 0.3, 1], [0, 0, -1]]), np.array([9.0, 11, 7, 5, 12]))
    assert not register(look(ROOM, T_ROOM_TARGET, seed=10, sigma2=0.02), look(other, T_ROOM_TARGET, seed=11)).accepted


@pytest.mark.slow
def test_points_far_off_the_lattice_do_no_harm() -> None:
    target, source = look_twice(ROOM, seed=12, sigma2=0.01)
    stray = Scan(np.vstack([source.points, np.array([[3e4, -2e4, 1e3]], np.float32)]))
    assert np.linalg.norm(error(register(target, stray))) < 0.1


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ((np.nan,), "voxel"),
        ((0.0,), "voxel"),
        ((1.0, 2.0), "max_tilt"),
    ],
)
def test_lengths_and_angles_that_are_none_are_refused(settings: tuple[float, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        PlaneRegistrar(*settings)


@pytest.mark.slow
def test_the_covariance_is_right_from_points_to_pose() -> None:
    """The normalized squared error over 40 noisy pairs averages 6 or somewhat less: what is estimated only widens."""
    normalized = []
    for seed in range(40):
        found = register(*look_twice(ROOM, seed=100 + seed, sigma2=0.03))
        xi = error(found)
        normalized.append(xi @ np.linalg.solve(found.covariance, xi))
    assert 2.5 < np.mean(normalized) < 8.0
