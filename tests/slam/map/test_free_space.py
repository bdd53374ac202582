"""Removal of outliers that other scans looked through, and distances between crossings that overlap."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.map import crossing
from sonarmap.slam.map.crossing import APART, PER_SCAN, CrossingError, crossing_error
from sonarmap.slam.map.doubtful_points import clean_map
from sonarmap.slam.map.free_space import ball_search, uncontradicted, votes
from sonarmap.slam.map.placed import PlacedScans, beams_of
from sonarmap.slam.map.point_map import PointMap, fuse
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.room_scans import RADIUS, look, pole_distance, room_distance, room_poses

VOXEL, COUNT = 0.25, 16
SIGMAS = np.repeat([0.003, 0.03], 3)  # of the poses [rad, m]


def clear(point_map: PointMap, placed: PlacedScans) -> PointMap:
    """The map without points that free space contradicts."""
    return point_map.take(uncontradicted(point_map, votes(point_map, placed)))


def scans_at(T: RigidTransform, wild: float) -> list[Scan]:
    rng = np.random.default_rng(3)
    return [look(pose, rng, wild=wild) for pose in T]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(("wild", "moved"), [(0.02, True), (0.05, False)])
def test_wild_echoes_are_removed_and_surfaces_stay(wild: float, moved: bool) -> None:
    truth = room_poses(COUNT)
    scans = scans_at(truth, wild)
    errors = np.random.default_rng(4).normal(size=(COUNT, 6)) * SIGMAS
    T = truth * RigidTransform.from_exp_coords(errors) if moved else truth
    covariances = np.tile(np.diag(SIGMAS**2), (COUNT, 1, 1)) if moved else np.zeros((COUNT, 6, 6))
    placed = PlacedScans.of(scans, T, VOXEL, covariances=covariances)
    before = fuse(placed)
    after = clear(before, placed)
    assert clean_map(placed, min_seen=1).clean.removed == len(before.points) - len(after.points)

    far, off = 3 * VOXEL, [room_distance(each.points) for each in (before, after)]
    wrong, right = (np.array([(d > far).sum(), (np.abs(d) < VOXEL).sum()]) for d in off)
    assert right[0] < 0.3 * wrong[0]  # of the outliers in the open
    assert right[1] > 0.999 * wrong[1]  # of the surface
    thin = [(pole_distance(one.points) < RADIUS).sum() for one in (before, after)]
    assert thin[0] > 80
    assert thin[1] > 0.99 * thin[0]


@pytest.mark.slow
def test_removal_is_reproducible_and_needs_certain_poses() -> None:
    T = room_poses(COUNT)
    scans = scans_at(T, 0.02)
    first, second = clean_map(PlacedScans.of(scans, T, VOXEL)).clean, clean_map(PlacedScans.of(scans, T, VOXEL)).clean
    assert first.removed > 100
    for name in ("points", "sigma", "scan", "seen", "count", "survey"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    # with uncertain poses it is unknown whether beams passed a point
    vague = np.tile(np.diag(np.repeat([0.2, 2.0], 3) ** 2), (COUNT, 1, 1))
    assert clean_map(PlacedScans.of(scans, T, VOXEL, covariances=vague)).clean.removed == 0


@pytest.mark.parametrize("ordered", [True, False])
def test_ball_search_agrees_with_all_distances(ordered: bool) -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(2000, 3)) * [20, 5, 1] + [1e6, -3e5, 40]
    if ordered:  # by cells along x, as in a map
        points = points[np.argsort(np.floor(points[:, 0]), kind="stable")]
    within = ball_search(points)
    for _ in range(20):
        center, radius = points[rng.integers(2000)] + rng.normal(size=3), float(rng.uniform(0.1, 9))
        wanted = np.flatnonzero(((points - center) ** 2).sum(axis=1) < radius**2)
        np.testing.assert_array_equal(within(center, radius), wanted)
    assert not len(within(points[0] + 1e5, 5.0))


CROSSED, COARSE = 14, 0.3


@pytest.fixture(scope="module")
def scans() -> list:
    rng = np.random.default_rng(1)
    return [look(T, rng) for T in poses()]


def poses() -> RigidTransform:
    """Two passes over the same places."""
    T = room_poses(CROSSED)
    return RigidTransform.concatenate([T[:7], T[:7]])


def test_a_shifted_pass_shows_in_the_crossing_error(scans) -> None:
    """A diagonal shift by 0.4 m along each axis is 0.4 m across every wall."""
    truth = poses()
    shift = RigidTransform.from_translation([0.4, 0.4, 0.4])
    drifted = RigidTransform.concatenate([truth[:7], shift * truth[7:]])
    surveys = [0] * 7 + [1] * 7
    found = crossing_error(PlacedScans.of(scans, truth, COARSE, surveys=surveys), drifted)
    assert found.before is not None
    assert found.after is not None
    assert found.after.median < 0.02  # ranges have a noise of 0.02 m, means of a voxel less
    np.testing.assert_allclose(found.before.median, 0.4, atol=0.03)
    assert found.before.most >= found.before.median
    assert all(surveys[one.i] != surveys[one.j] for one in found.crossings)
    turned = crossing_error(PlacedScans.of(scans, shift * truth, COARSE, surveys=surveys), shift * drifted)
    # pyrefly: ignore[missing-attribute]
    np.testing.assert_allclose(turned.before.median, found.before.median, atol=0.01)


def test_only_scans_far_apart_cross_and_each_only_a_few_times(scans) -> None:
    names = [2 * k for k in range(CROSSED)]
    found = crossing_error(PlacedScans.of(scans, poses(), COARSE, names), poses())
    assert found.crossings
    taken = [end for one in found.crossings for end in (one.i, one.j)]
    assert max(taken.count(end) for end in taken) <= PER_SCAN
    assert all(one.i in names and one.j - one.i >= APART for one in found.crossings)
    assert all(one.before == one.after for one in found.crossings)
    assert CrossingError.of([found, found]).crossings == found.crossings * 2  # of two components together


def test_crossings_of_many_scans_come_from_an_even_sample(scans, monkeypatch: pytest.MonkeyPatch) -> None:
    placed = PlacedScans.of(scans, poses(), COARSE, [5 * k for k in range(CROSSED)])
    monkeypatch.setattr(crossing, "SCANS", 7)
    taken = {end for each in crossing_error(placed, poses()).crossings for end in (each.i, each.j)}
    assert taken
    assert taken <= {10 * k for k in range(7)}


def test_a_single_pass_has_no_crossings_and_a_wrong_number_of_poses_is_refused(scans) -> None:
    found = crossing_error(PlacedScans.of(scans[:7], poses()[:7], COARSE), poses()[:7])
    assert found == CrossingError(())
    assert (found.before, found.after) == (None, None)
    assert crossing_error(PlacedScans.of(scans[:1], poses()[:1], COARSE), poses()[:1]) == CrossingError(())
    with pytest.raises(InputError, match="14 scans and 13 poses"):
        crossing_error(PlacedScans.of(scans, poses(), COARSE), poses()[:13])


def test_every_view_votes_on_a_point() -> None:
    """Every view contradicts a point in front of a wall, and agrees with a point on it."""
    T = RigidTransform.from_translation([[0.0, 3.0, 0.0], [0.4, 3.5, 0.2], [-0.5, 4.0, -0.3]])
    scans = scans_at(T, 0.0)
    points = Scan(np.array([[6.0, 4.0, 0.5], [12.0, 4.0, 0.5]], np.float32))
    probe = fuse(PlacedScans.of([points], RigidTransform.identity(1), VOXEL))
    found = votes(probe, PlacedScans.of(scans, T, VOXEL))
    assert found.contradict.tolist() == [3, 0]
    assert found.agree.tolist() == [0, 3]
    unsure = np.tile(np.diag(np.repeat([0.5, 5.0], 3) ** 2), (3, 1, 1))
    vague = votes(probe, PlacedScans.of(scans, T, VOXEL, covariances=unsure))
    assert not vague.contradict.any()


@pytest.mark.slow
def test_layers_have_only_the_scans_and_views_of_their_survey() -> None:
    """A wall of the first survey that the second looks through stays in the first one's layer."""
    T = room_poses(COUNT)
    scans = scans_at(T, 0.0)
    surveys = [0] * 4 + [1] * (COUNT - 4)
    place = np.array([-3.0, 3.0, 0.0])
    block = place + np.random.default_rng(1).uniform(-0.4, 0.4, (400, 3))
    changed = [Scan(np.vstack([scans[0].points, T[0].inv().apply(block)]).astype(np.float32)), *scans[1:]]
    of_surveys = PlacedScans.of(changed, T, VOXEL, surveys=surveys).by_survey
    layers = {number: clean_map(placed).clean for number, placed in of_surveys.items()}
    assert list(layers) == [0, 1]
    assert {tuple(np.unique(layer.survey)) for layer in layers.values()} == {(0,), (1,)}
    assert set(layers[0].scan.tolist()) == {0, 1, 2, 3}
    assert PlacedScans.of(scans, T, VOXEL).by_survey == {}

    def blocks(point_map: PointMap) -> int:
        return int((np.abs(point_map.points - place) < 0.4).all(axis=1).sum())

    together = clean_map(PlacedScans.of(changed, T, VOXEL, surveys=surveys), min_seen=1).clean
    assert blocks(layers[0]) > 2 * blocks(together)
    assert blocks(layers[1]) == 0


def test_a_single_view_or_none_contradicts_nothing() -> None:
    T = room_poses(6)
    scans = scans_at(T, 0.05)
    one = PlacedScans.of(scans[:1], T[:1], VOXEL)
    alone = fuse(one)
    assert len(clear(alone, one).points) == len(alone.points)
    both = Scan(np.vstack([scans[0].points, 0.4 * scans[0].points]))  # like scans of two places merged
    assert not beams_of(both.points, VOXEL).single
    placed = PlacedScans.of([both], T[:1], VOXEL)
    found = votes(fuse(placed), placed)
    assert not found.agree.any()
    assert not found.contradict.any()
