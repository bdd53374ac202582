"""Pairs of every kind: the same from the same numbers, true, over every relief, sharing what was asked for."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair, scan_kind
from sonarmap.tools.lab.simulate.kinds.draws import pair_draws
from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS, RELIEF_OF, RELIEFS, KindPair, relief_of
from sonarmap.tools.lab.simulate.pairs import viewpoints
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, instruments_for
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance

VIEWS = ("patch", "sonar3d15", "sound_speed", "range_bias", "moving")


def _points(pair: KindPair) -> tuple[np.ndarray, np.ndarray]:
    return pair.target.points, pair.source.points


@pytest.mark.parametrize("kind", VIEWS)
def test_a_pair_is_its_kind_number_and_seed(kind: str):
    first, again = kind_pair(kind, 5, 31), kind_pair(kind, 5, 31)
    for one, other in zip(_points(first), _points(again), strict=True):
        assert_array_equal(one, other)
    assert_array_equal(first.T_target_source.as_matrix(), again.T_target_source.as_matrix())
    assert first.shared == again.shared
    assert not np.array_equal(kind_pair(kind, 5, 32).source.points[:50], first.source.points[:50])


@pytest.mark.parametrize("kind", VIEWS)
@pytest.mark.parametrize("turn", range(len(OVERLAPS)))
@pytest.mark.slow
def test_a_pair_is_as_its_number_says(kind: str, turn: int):
    scenes = SCAN_KINDS[kind].scenes
    pair = kind_pair(kind, turn * len(scenes) + turn, 8)
    least, most = OVERLAPS[turn]
    assert least <= pair.shared <= most
    assert (pair.scene, pair.relief) == (scenes[turn], RELIEF_OF[scenes[turn]])
    assert (pair.target.prior, pair.source.prior) == (None, None)
    # vehicles float level, within 10 degrees
    for pose in (pair.T_world_target, pair.T_world_source):
        assert np.abs(pose.rotation.as_euler("ZYX")[1:]).max() <= np.deg2rad(10.0)


@pytest.mark.parametrize("kind", VIEWS)
def test_both_scans_lie_on_the_scene_where_the_truth_says(kind: str):
    """But for noise and distortion; at the other's place they do not."""
    number = SCAN_KINDS[kind].scenes.index("manifold")
    pair = kind_pair(kind, number, 12)
    mesh = build_scene("manifold", pair_draws(kind, number, 12).scene).mesh
    target, source = (points.astype(np.float64) for points in _points(pair))
    for right, wrong, points in (
        (pair.T_world_target, pair.T_world_source, target),
        (pair.T_world_target * pair.T_target_source, pair.T_world_target, source),
    ):
        off = np.median(surface_distance(mesh, right.apply(points)))
        assert 0.001 < off < 0.1
        assert np.median(surface_distance(mesh, wrong.apply(points))) > 3 * off


@pytest.mark.parametrize("kind", VIEWS)
def test_every_kind_meets_every_relief(kind: str):
    assert {relief_of(scene) for scene in SCAN_KINDS[kind].scenes} == set(RELIEFS)


def test_every_scene_has_a_relief():
    assert set(RELIEF_OF) == set(SCENE_KINDS)
    with pytest.raises(InputError, match="moon"):
        relief_of("moon")


def test_the_frames_look_any_way_at_one_another():
    """Over an open bed, at little overlap: from beside, from across and head-on."""
    pairs = [kind_pair("sonar3d15", 2 + 5 * number, 4, (0.3, 0.9)) for number in range(8)]
    turned = np.abs([pair.T_target_source.rotation.as_euler("ZYX", degrees=True)[0] for pair in pairs])
    assert turned.max() > 90
    assert turned.min() < 30


def test_what_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match="there are"):
        scan_kind("sidescan")
    with pytest.raises(InputError, match=">= 0"):
        kind_pair("patch", -1, 0)
    monkeypatch.setattr(viewpoints, "TRIES", 20)
    with pytest.raises(InputError, match="widen the range"):
        kind_pair("sonar3d15", 4, 0, (0.4, 0.4 + 1e-9))


def test_instruments_err_by_their_sigmas_and_each_on_its_own():
    every, depth = Instruments(), instruments_for(["depth"])
    pair = kind_pair("sonar3d15", 4, 6)
    full, alone = pair.with_priors(every), pair.with_priors(depth)
    ups = []
    for scan, single, truth in (
        (full.target, alone.target, pair.T_world_target),
        (full.source, alone.source, pair.T_world_source),
    ):
        assert scan.prior is not None
        assert single.prior is not None
        off = (truth.translation - scan.prior.T_world_sensor.translation) / every.sigmas[3:]
        turned = (truth.rotation * scan.prior.T_world_sensor.rotation.inv()).magnitude()
        assert np.abs(off).max() < 5.0
        assert turned < 5.0 * np.linalg.norm(every.sigmas[:3])
        assert turned > 0
        assert single.prior.T_world_sensor.translation[2] == scan.prior.T_world_sensor.translation[2]
        assert np.isinf(single.prior.sigmas[:5]).all()
        ups.append(off[2])
    assert ups[0] != ups[1]
    assert_array_equal(full.source.points, pair.source.points)
