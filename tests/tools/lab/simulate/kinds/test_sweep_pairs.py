"""Pairs of swaths, stacks and sweeps: the same from the same numbers, true, over every relief, sharing as asked."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds import imaging, partners, profiler, swath
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.draws import pair_draws
from sonarmap.tools.lab.simulate.kinds.kind import OVERLAPS, RELIEFS, KindPair, relief_of
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS, mutual_overlap
from sonarmap.tools.lab.simulate.shapes.surface import surface_distance
from tests.samples.simulated import QUIET

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


def _pair(kind: str, scene: str, overlaps: tuple[float, float] = (0.2, 0.9), seed: int = 12) -> KindPair:
    return kind_pair(kind, SCAN_KINDS[kind].scenes.index(scene), seed, overlaps)


@pytest.mark.parametrize("kind", SWEEPS)
def test_a_pair_is_its_kind_number_and_seed(kind: str):
    first, again = _pair(kind, "shallow"), _pair(kind, "shallow")
    for one, other in ((first.target, again.target), (first.source, again.source)):
        assert_array_equal(one.points, other.points)
        assert_array_equal(one.strength, other.strength)
    assert_array_equal(first.T_target_source.as_matrix(), again.T_target_source.as_matrix())
    assert not np.array_equal(_pair(kind, "shallow", seed=13).source.points[:50], first.source.points[:50])


@pytest.mark.parametrize("kind", SWEEPS)
@pytest.mark.parametrize("turn", range(len(OVERLAPS)))
@pytest.mark.slow
def test_a_pair_is_as_its_number_says(kind: str, turn: int):
    scenes = SCAN_KINDS[kind].scenes
    number = turn * len(scenes) + scenes.index("manifold")
    pair = kind_pair(kind, number, 8)
    least, most = OVERLAPS[turn]
    assert least <= pair.shared <= most
    assert (pair.kind, pair.scene, pair.relief) == (kind, "manifold", "twins")
    # a vehicle that floats or hovers is level within a few degrees
    for pose in (pair.T_world_target, pair.T_world_source):
        assert np.abs(pose.rotation.as_euler("ZYX")[1:]).max() <= np.deg2rad(5.0)
    for scan in (pair.target, pair.source):
        assert (scan.viewpoints is not None) == (number % 2 == 0 and kind != "imaging")


@pytest.mark.parametrize("kind", SWEEPS)
def test_without_noise_and_distortion_both_scans_lie_on_the_scene(kind: str, monkeypatch: pytest.MonkeyPatch):
    """The source moved by T_target_source lies on it with the target, and nowhere else."""
    _without_distortion(monkeypatch)
    pair = _pair(kind, "manifold")
    number = SCAN_KINDS[kind].scenes.index("manifold")
    mesh = build_scene("manifold", pair_draws(kind, number, 12).scene).mesh
    target, source = (scan.points.astype(np.float64) for scan in (pair.target, pair.source))
    moved = pair.T_target_source.apply(source)
    for points in (target, moved):
        # a ray that grazes an edge is met on the wrong side of it by the ray caster's single precision
        assert np.quantile(surface_distance(mesh, pair.T_world_target.apply(points)), 0.99) < 1e-4
    assert np.median(surface_distance(mesh, pair.T_world_target.apply(source))) > 0.02
    assert mutual_overlap(target, source, pair.T_target_source, OVERLAP_RADIUS * 48 / 256) == pytest.approx(
        pair.shared, abs=0.05
    )


@pytest.mark.parametrize("kind", SWEEPS)
def test_noise_and_distortion_leave_most_points_near_the_scene(kind: str):
    pair = _pair(kind, "shallow")
    scenes = SCAN_KINDS[kind].scenes
    mesh = build_scene("shallow", pair_draws(kind, scenes.index("shallow"), 12).scene).mesh
    off = surface_distance(mesh, pair.T_world_source.apply(pair.source.points.astype(np.float64)))
    assert 0.005 < np.median(off) < 0.4


@pytest.mark.parametrize("kind", SWEEPS)
def test_every_kind_meets_every_relief(kind: str):
    assert {relief_of(scene) for scene in SCAN_KINDS[kind].scenes} == set(RELIEFS)


@pytest.mark.parametrize("kind", SWEEPS)
def test_an_overlap_that_cannot_be_had_is_refused(kind: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(partners, "PLACES", 1)
    monkeypatch.setattr(partners, "TRIES", 3)
    with pytest.raises(InputError, match="widen the range"):
        _pair(kind, "shallow", (0.5, 0.5 + 1e-9))
