"""Pairs of every kind: reproducible, true to the scene, over every relief, with the wanted overlap."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.tools.lab.simulate.kinds import imaging, partners, profiler, swath
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS, RELIEF_OF, KindPair, pair_draws
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene, surface_distance
from sonarmap.tools.lab.simulate.viewpoints import OVERLAP_RADIUS, mutual_overlap
from tests.samples.refusals import refuses
from tests.samples.scenes.simulated import QUIET

VIEWS = ("sonar3d15", "patch", "sound_speed", "range_bias", "moving")
SWEEPS = ("swath", "imaging", "profiler")


def _without_distortion(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, names in (
        (swath, ("ROLL_ERROR", "YAW_ERROR", "HEAVE_ERROR", "DRIFT", "ALONG")),
        (imaging, ("MOUNT", "DRIFT", "YAW_DRIFT", "TILTED_APERTURE")),
        (profiler, ("DRIFT", "TURNING_DRIFT", "HEAVE", "YAW_DRIFT")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, 1e-9)
    monkeypatch.setattr(profiler, "WIDTHS", (1e-9, 1e-9))
    for name in ("APERTURES", "MULTIPATH", "SIDE_LOBES"):
        monkeypatch.setattr(imaging, name, (1e-12, 1e-12))
    monkeypatch.setattr(partners, "noise_of", lambda *_: QUIET)


def _pair(kind: str, scene: str, overlaps: tuple[float, float] = (0.2, 0.9)) -> KindPair:
    return kind_pair(kind, SCAN_KINDS[kind].scenes.index(scene), 12, overlaps)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", ["sonar3d15", "patch", "swath"])
def test_a_pair_depends_only_on_kind_number_and_seed(kind: str):
    number = SCAN_KINDS[kind].scenes.index("shallow") if kind in SWEEPS else 5
    arguments = (kind, number, 31, (0.2, 0.9) if kind in SWEEPS else None)
    first, again = kind_pair(*arguments), kind_pair(*arguments)
    for one, other in ((first.target, again.target), (first.source, again.source)):
        assert_array_equal(one.points, other.points)
        assert_array_equal(one.strength, other.strength)
    assert_array_equal(first.T_target_source.as_matrix(), again.T_target_source.as_matrix())
    assert first.shared == again.shared
    assert not np.array_equal(kind_pair(kind, number, 32, arguments[-1]).source.points[:50], first.source.points[:50])


@pytest.mark.parametrize(("turn", "kind"), [(k % len(OVERLAPS), kind) for k, kind in enumerate([*VIEWS, *SWEEPS])])
@pytest.mark.slow
def test_the_number_of_a_pair_gives_scene_and_overlap(turn: int, kind: str):
    scenes = SCAN_KINDS[kind].scenes
    scene = "manifold" if kind in SWEEPS else scenes[turn]
    number = turn * len(scenes) + scenes.index(scene)
    pair = kind_pair(kind, number, 8)
    least, most = OVERLAPS[turn]
    assert least <= pair.shared <= most
    assert (pair.kind, pair.scene, pair.relief) == (kind, scene, RELIEF_OF[scene])
    assert (pair.target.prior, pair.source.prior) == (None, None)
    # vehicles float or hover level: within 10 degrees, those that sweep within 5
    for pose in (pair.T_world_target, pair.T_world_source):
        assert np.abs(pose.rotation.as_euler("ZYX")[1:]).max() <= np.deg2rad(5.0 if kind in SWEEPS else 10.0)
    if kind in SWEEPS:
        for scan in (pair.target, pair.source):
            assert (scan.viewpoints is not None) == (number % 2 == 0 and kind != "imaging")


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("kind", VIEWS)
def test_both_scans_of_single_views_lie_on_the_scene_at_their_true_poses(kind: str):
    """Up to noise and distortion; at the other scan's pose they do not."""
    number = SCAN_KINDS[kind].scenes.index("manifold")
    pair = kind_pair(kind, number, 12)
    mesh = build_scene("manifold", pair_draws(kind, number, 12).scene).mesh
    target, source = (scan.points.astype(np.float64) for scan in (pair.target, pair.source))
    for right, wrong, points in (
        (pair.T_world_target, pair.T_world_source, target),
        (pair.T_world_target * pair.T_target_source, pair.T_world_target, source),
    ):
        off = np.median(surface_distance(mesh, right.apply(points)))
        assert 0.001 < off < 0.1
        assert np.median(surface_distance(mesh, wrong.apply(points))) > 3 * off


@pytest.mark.slow
@pytest.mark.parametrize("kind", SWEEPS)
def test_without_noise_and_distortion_both_scans_lie_on_the_scene(kind: str, monkeypatch: pytest.MonkeyPatch):
    """The source lies on the scene when it is moved by T_target_source, and not when it is not moved."""
    _without_distortion(monkeypatch)
    pair = _pair(kind, "manifold")
    number = SCAN_KINDS[kind].scenes.index("manifold")
    mesh = build_scene("manifold", pair_draws(kind, number, 12).scene).mesh
    target, source = (scan.points.astype(np.float64) for scan in (pair.target, pair.source))
    moved = pair.T_target_source.apply(source)
    for points in (target, moved):
        # in the ray caster's single precision, a ray that grazes an edge hits the wrong side of it
        assert np.quantile(surface_distance(mesh, pair.T_world_target.apply(points)), 0.99) < 1e-4
    assert np.median(surface_distance(mesh, pair.T_world_target.apply(source))) > 0.02
    assert mutual_overlap(target, source, pair.T_target_source, OVERLAP_RADIUS * 48 / 256) == pytest.approx(
        pair.shared, abs=0.05
    )


def test_every_kind_covers_every_relief_and_every_scene_has_one():
    for kind in SCAN_KINDS.values():
        assert {RELIEF_OF[scene] for scene in kind.scenes} == set(RELIEF_OF.values())
    assert set(RELIEF_OF) == set(SCENE_KINDS)
    # odd, so that what alternates with the pairs' numbers, as a patch's viewpoints, does so in every scene
    assert len(SCAN_KINDS["patch"].scenes) % 2 == 1


def test_unknown_kinds_and_negative_numbers_are_refused():
    refuses("there are", kind_pair, "sidescan", 0, 0)
    refuses(">= 0", kind_pair, "patch", -1, 0)


def test_an_impossible_overlap_of_a_sweep_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(partners, "PLACES", 1)
    monkeypatch.setattr(partners, "TRIES", 3)
    refuses("widen the range", _pair, "swath", "shallow", (0.5, 0.5 + 1e-9))
