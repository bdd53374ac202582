"""Scans that jump off the path of their neighbors."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.stream.refine import find_jumps

FLOOR = np.array([0.005, 0.005, 0.005, 0.04, 0.04, 0.04])


def track(count: int = 60, seed: int = 3) -> tuple[np.ndarray, RigidTransform]:
    """Times and poses along a bend, with the noise of registrations."""
    rng = np.random.default_rng(seed)
    times = 0.2 * np.arange(count) + 1e9
    turn = Rotation.from_euler("Z", 0.03 * np.arange(count)[:, None])
    places = np.column_stack([0.2 * np.arange(count), 0.003 * np.arange(count) ** 2, np.zeros(count)])
    noise = RigidTransform.from_exp_coords(rng.normal(size=(count, 6)) * [0.01, 0.01, 0.01, 0.02, 0.02, 0.02])
    return times, RigidTransform.from_components(places, turn) * noise


def jumped(T: RigidTransform, scans: dict[int, list[float]]) -> RigidTransform:
    moves = np.zeros((len(T), 6))
    for k, move in scans.items():
        moves[k, 3:] = move
    return T * RigidTransform.from_exp_coords(moves)


def test_a_steady_track_has_no_jumps() -> None:
    times, T = track()
    assert len(find_jumps(T, times, np.zeros(60, int), np.zeros(60, bool), FLOOR).scans) == 0


def test_jumps_are_found_and_placed_between_their_neighbors() -> None:
    times, T = track()
    found = find_jumps(jumped(T, {7: [0.8, -0.3, 0.1], 30: [0, 0, 0.9], 31: [0, 0.1, -0.7]}), times, *_free(60), FLOOR)
    assert found.scans.tolist() == [7, 30, 31]
    off = np.linalg.norm(found.T.translation - T[found.scans].translation, axis=1)
    assert off.max() < 0.15
    assert (off < 4 * np.linalg.norm(found.sigmas[:, 3:], axis=1)).all()
    assert (found.sigmas[1] >= found.sigmas[0]).all()  # its neighbors are farther apart
    assert found.back.all()


def test_runs_are_separate_and_fixed_scans_never_jump() -> None:
    times, T = track()
    runs, fixed = _free(60)
    runs[20:], fixed[40] = 1, True
    gone = jumped(T, {k: [5.0, 0, 0] for k in range(20, 60)} | {40: [5.8, 0, 0]})
    found = find_jumps(gone, times, runs, fixed, FLOOR)
    assert not {19, 20, 40} & set(found.scans.tolist())


def _free(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(count, int), np.zeros(count, bool)


def test_two_scans_have_no_jumps() -> None:
    times, T = track(2)
    assert len(find_jumps(T, times, *_free(2), FLOOR).scans) == 0


def test_a_vehicle_that_stays_after_a_jump_is_not_back() -> None:
    times, T = track()
    stays = jumped(T, {k: [3.0, 0, 0] for k in range(30, 60)})
    found = find_jumps(stays, times, *_free(60), FLOOR)
    assert {29, 30} & set(found.scans.tolist())
    assert not found.back.any()
