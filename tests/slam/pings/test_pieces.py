"""A line cut into pieces, and moved to where a map has them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.pings.line import PingLine
from sonarmap.slam.pings.pieces import cut, moved, swath_width


def a_line(pings: int = 60, beams: int = 41, pause: float = 0.0) -> PingLine:
    """A bent line at 2 m/s with swinging attitudes over a bed with waves, 10 m deep, the transducer off the middle."""
    t = np.arange(pings) * 0.5
    t[pings // 2 :] += pause
    heading = np.radians(70 + 0.4 * t)
    places = np.column_stack([300 + 2 * t * np.sin(heading[0]), -80 + 2 * t * np.cos(heading[0]), 0.1 * np.sin(t)])
    attitudes = np.column_stack([np.radians(2 * np.sin(t)), np.radians(1 + np.cos(1.3 * t)), heading])
    sensors = np.tile([0.7, -0.3, -1.1], (pings, 1))
    across = np.linspace(-15, 14, beams)
    points = np.stack(
        np.broadcast_arrays(0.2 * np.sin(t)[:, None], across[None], -10 + np.sin(across / 3)[None]), axis=-1
    ).reshape(-1, 3)
    return PingLine("a", 1e9 + t, places, attitudes, sensors, np.repeat(np.arange(pings), beams), points)


def test_every_sounding_is_in_one_piece_at_its_place_in_the_line() -> None:
    line = a_line()
    pieces = cut(line, 12.0)

    assert [piece.first for piece in pieces] == [0, *(piece.last for piece in pieces[:-1])]
    assert pieces[-1].last == len(line.stamps)
    there = np.concatenate([piece.T_world_piece.apply(piece.points) for piece in pieces])
    np.testing.assert_allclose(there, line.world_points(), atol=1e-6)
    seen_from = np.concatenate([piece.T_world_piece.apply(piece.viewpoints) for piece in pieces])
    np.testing.assert_allclose(seen_from, line.world_sensors()[line.pings], atol=1e-6)
    for piece in pieces:
        np.testing.assert_allclose(piece.T_world_piece.translation, line.world_sensors()[piece.middle], atol=1e-9)
        assert piece.stamp == line.stamps[piece.middle]


def test_a_piece_is_half_a_swath_width_long_and_spans_no_pause() -> None:
    line = a_line(240)
    length = np.linalg.norm(line.places[-1] - line.places[0])

    assert swath_width(line) == pytest.approx(29.0)
    assert len(cut(line)) == round(length / 14.5)
    paused = a_line(240, pause=600.0)
    assert 120 in [piece.first for piece in cut(paused)]
    assert len(cut(a_line(9), 1000.0)) == 2  # one piece has nothing to be registered to


def test_fans_of_the_same_time_are_in_one_piece() -> None:
    """Of an echo sounder with two receivers and two swaths a ping: four fans, 1 ms apart or at once."""
    line = a_line(60)
    stamps = np.repeat(line.stamps[::4], 4) + np.tile([0.0, 0.0, 0.001, 0.001], 15)
    pieces = cut(replace(line, stamps=stamps), 15.0)
    assert len(pieces) == len(cut(line, 15.0))


def test_a_line_without_soundings_or_a_length_below_0_is_refused() -> None:
    line = a_line()
    with pytest.raises(InputError, match="no soundings that are not rejected"):
        cut(PingLine("b", line.stamps, line.places, line.attitudes, line.sensors, line.pings[:0], line.points[:0]))
    with pytest.raises(InputError, match="wanted a length above 0"):
        cut(line, -2.0)


def test_a_rigid_motion_of_all_pieces_moves_the_line() -> None:
    line = a_line()
    pieces = cut(line, 12.0)
    about = RigidTransform.from_translation([310.0, -70.0, -5.0])
    T_new_old = about * RigidTransform.from_components(
        [1.5, -0.8, 0.3], Rotation.from_euler("ZYX", [0.02, 0.01, -0.03])
    )
    T_new_old = T_new_old * about.inv()
    T = RigidTransform.concatenate([T_new_old * piece.T_world_piece for piece in pieces])
    middles = np.array([piece.middle for piece in pieces])
    after, _ = moved(line, middles, T, _covariances(len(pieces)))

    at_middles = np.isin(line.pings, middles)  # between them the interpolated correction is not quite rigid
    np.testing.assert_allclose(
        after.world_points()[at_middles], T_new_old.apply(line.world_points())[at_middles], atol=1e-6
    )
    off = np.linalg.norm(after.world_points() - T_new_old.apply(line.world_points()), axis=1)
    between = (line.pings >= middles[0]) & (line.pings <= middles[-1])  # beyond them it is constant
    assert off[between].max() < 0.02
    R_vehicle = T_new_old.rotation * line.T_world_level.rotation * line.R_level_vehicle
    found = after.T_world_level.rotation * after.R_level_vehicle
    assert np.degrees((R_vehicle.inv() * found).magnitude()[middles]).max() < 1e-4


def test_sigmas_are_along_the_axes_of_the_world() -> None:
    line = a_line()
    heading = line.attitudes[0, 2]
    pieces = cut(line, 12.0)
    T = RigidTransform.concatenate([piece.T_world_piece for piece in pieces])
    covariance = np.diag([0.01, 0.02, 0.03, 3.0, 1.0, 0.5]) ** 2  # along the vehicle's x 3 m
    _, sigmas = moved(line, np.array([p.middle for p in pieces]), T, np.stack([covariance] * len(pieces)))

    east = np.hypot(3.0 * np.sin(heading), np.cos(heading))
    north = np.hypot(3.0 * np.cos(heading), np.sin(heading))
    np.testing.assert_allclose(sigmas[0], [*sigmas[0, :2], 0.03, east, north, 0.5], rtol=1e-9)


def _covariances(count: int) -> np.ndarray:
    return np.stack([np.diag(np.full(6, 0.01))] * count)


def test_a_map_that_agrees_moves_nothing() -> None:
    line = a_line()
    pieces = cut(line, 12.0)
    T = RigidTransform.concatenate([piece.T_world_piece for piece in pieces])
    same, sigmas = moved(line, np.array([p.middle for p in pieces]), T, _covariances(len(pieces)))

    np.testing.assert_allclose(same.world_points(), line.world_points(), atol=1e-9)
    np.testing.assert_allclose(same.places, line.places, atol=1e-9)
    np.testing.assert_allclose(same.attitudes, line.attitudes, atol=1e-9)
    assert sigmas.shape == (len(line.stamps), 6)
