"""Points that only one scan saw where others looked are doubtful; points of two scans or in one view only stay."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.map.doubtful_points import CleanMap, clean_map, part_doubtful
from sonarmap.slam.map.free_space import Votes
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.map.point_map import PointMap
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.mapper_settings import MapperSettings
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.room_scans import look, room_distance, room_poses
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

VOXEL, COUNT = 0.25, 12
T = room_poses(COUNT)
EDGE = np.tan(np.radians(40))


def wall(place: tuple[float, float, float], x: float = 10.0, extra: tuple = (), hole: float = 0.0) -> Scan:
    """A scan of the plane x by 91 x 91 beams over 80 x 80 degrees, looking along x from a place [m].

    The last echoes are the `extra` places (n, 3) [m, world]; beams within `hole` of the axis are missing [rad].
    """
    y, z = np.meshgrid(np.linspace(-EDGE, EDGE, 91), np.linspace(-EDGE, EDGE, 91))
    kept = np.hypot(y, z) >= hole
    aim = np.stack([np.ones_like(y), y, z], axis=-1)[kept]
    far = np.array(extra, float).reshape(-1, 3) - place
    return Scan(np.vstack([aim * (x - place[0]), far]).astype(np.float32))


def mapped(places: list, scans: list[Scan], min_seen: int = 2, voxel: float = 0.5) -> CleanMap:
    return clean_map(PlacedScans.of(scans, RigidTransform.from_translation(np.array(places)), voxel), min_seen=min_seen)


def has(point_map: PointMap, place: tuple) -> bool:
    """Whether the map has a point within half a voxel of a place."""
    return bool((np.linalg.norm(point_map.points - place, axis=1) < 0.5 * point_map.voxel).any())


AT, ASIDE = (0.0, 0.0, 0.0), (0.3, 2.0, -0.4)


@pytest.mark.parametrize(
    ("echo", "where"),
    [((5.1, 0.2, 0.1), "before the wall, and the other scan sees the wall through it"), ((14.2, 0.3, 0.2), "behind")],
)
def test_a_false_echo_where_another_scan_looked_is_doubtful(echo: tuple, where: str) -> None:
    parted = mapped([AT, ASIDE], [wall(AT, extra=(echo,)), wall(ASIDE, extra=((15.0, -3.0, 2.0),))])
    assert has(parted.doubtful, echo), where
    assert has(parted.doubtful, (15.0, -3.0, 2.0))
    assert not has(parted.clean, echo)
    assert parted.clean.doubted == len(parted.doubtful.points)
    surface = np.abs(parted.doubtful.points[:, 0] - 10.0) < 0.5
    assert surface.sum() <= 0.01 * len(parted.clean.points)
    (row,) = np.flatnonzero(np.linalg.norm(parted.doubtful.points - echo, axis=1) < 0.25)
    assert parted.doubtful.looked is not None
    assert (parted.doubtful.seen[row], parted.doubtful.looked[row]) == (1, 2)


@pytest.mark.parametrize("echo", [(5.1, 0.2, 0.1), (14.2, 0.3, 0.2)])
def test_an_echo_where_no_other_scan_looked_stays(echo: tuple) -> None:
    """The other scan is far away and looks elsewhere, or there is none: a scan does not contradict itself."""
    away = (-60.0, 0.0, 0.0)
    for places, scans in (
        ([AT, away], [wall(AT, extra=(echo,)), wall(away, x=-50.0)]),
        ([AT], [wall(AT, extra=(echo,))]),
    ):
        parted = mapped(places, scans)
        assert has(parted.clean, echo)
        assert not len(parted.doubtful.points)


def test_a_pole_at_the_edge_that_only_one_scan_saw_stays() -> None:
    pole = tuple((9.0, -7.0, z) for z in np.arange(-3.0, 3.0, 0.2))  # only in the first scan's view
    there = (0.0, 8.0, 0.0)
    parted = mapped([AT, there], [wall(AT, extra=pole), wall(there)])
    assert all(has(parted.clean, place) for place in pole)
    # so does a room behind a hole in the wall, although the second scan sees the wall closed
    beyond = tuple((16.0, y, z) for y in np.arange(-2.4, 2.5, 0.25) for z in np.arange(-2.4, 2.5, 0.25))
    aside = (6.0, 7.0, 0.0)
    parted = mapped([AT, aside], [wall(AT, extra=beyond, hole=np.radians(12)), wall(aside)])
    inner = [place for place in beyond if np.hypot(place[1], place[2]) < 2.0]
    assert sum(has(parted.clean, place) for place in inner) > 0.95 * len(inner)


def test_an_echo_that_two_scans_saw_stays() -> None:
    echo = (14.2, 0.3, 0.2)
    places = [AT, ASIDE, (0.1, -2.0, 0.3)]
    scans = [wall(place, extra=(echo,) * (place in (AT, ASIDE))) for place in places]
    assert has(mapped(places, scans).clean, echo)
    assert has(mapped(places, scans, min_seen=3).doubtful, echo)


@pytest.fixture(scope="module")
def scans() -> list[Scan]:
    """Scans of a room with a pole from twelve poses, with 2 % of wild echoes."""
    rng = np.random.default_rng(5)
    return [look(pose, rng, wild=0.02) for pose in T]


@pytest.fixture(scope="module")
def parted(scans: list[Scan]) -> CleanMap:
    return clean_map(PlacedScans.of(scans, T, VOXEL))


def test_outliers_are_doubtful_and_the_surface_stays(parted: CleanMap) -> None:
    layers = [np.abs(room_distance(layer.points)) for layer in (parted.clean, parted.doubtful)]
    wrong, right = (np.array([test(d).sum() for d in layers]) for test in (lambda d: d > 0.75, lambda d: d < 0.1))
    assert wrong[1] > 3 * wrong[0]
    assert right[1] < 0.01 * right[0]


@pytest.mark.slow
def test_both_layers_together_are_the_map_without_the_rule(scans: list[Scan], parted: CleanMap) -> None:
    whole = clean_map(PlacedScans.of(scans, T, VOXEL), min_seen=1)
    assert not len(whole.doubtful.points)
    both = np.vstack([parted.clean.points, parted.doubtful.points])
    np.testing.assert_array_equal(both[np.lexsort(both.T)], whole.clean.points[np.lexsort(whole.clean.points.T)])
    assert parted.doubtful.seen.max() == 1
    assert parted.doubtful.looked is not None
    assert parted.doubtful.looked.min() >= 2
    assert parted.clean.removed == whole.clean.removed
    of_three = clean_map(PlacedScans.of(scans, T, VOXEL), min_seen=3)
    assert of_three.clean.doubted >= parted.clean.doubted
    assert of_three.doubtful.seen.max() == 2


def test_a_mapper_uses_min_seen() -> None:
    truth = ring_poses(3, turns=0.25)
    scans = scans_of(truth)
    registrar = KnowingRegistrar(truth, 1e-4 * np.eye(6))
    (whole,), (parted,) = (
        Mapper(registrar, 0.5, MapperSettings(LoopSettings(per_scan=0), min_seen=n)).run(scans).parts for n in (1, 2)
    )
    assert whole.doubtful is None
    assert parted.doubtful is not None
    assert len(whole.optimized.points) == len(parted.optimized.points) + len(parted.doubtful.points)
    with pytest.raises(InputError, match="min_seen=0"):
        MapperSettings(min_seen=0)


def row_of_points(seen: list[int], off: float) -> PointMap:
    """Points a voxel apart along x with `seen` counts; the last one lies `off` voxels beside their middle."""
    count = len(seen)
    points = np.zeros((count, 3))
    points[:-1, 0] = np.arange(count - 1)
    points[-1] = (count - 2) / 2, off, 0.0
    ones = np.ones(count, np.int32)
    return PointMap(points, np.full(count, 0.1, np.float32), None, 0 * ones, np.array(seen, np.int32), ones, ones, 1.0)


@pytest.mark.parametrize(
    ("seen", "off", "beside"),
    [
        ([3, 2, 2, 3, 1], 1.2, True),  # around it (2.0 voxels): 2, 2 and, 1.92 off, 3, 3: 2.5 on average
        ([3, 2, 2, 3, 1], 0.5, False),  # 0.71 voxels from points of two scans: one of them
        ([2, 1, 2, 2, 1], 1.2, False),  # 1.75 on average: the surface is hardly seen either
        ([3, 2, 2, 3, 1], 2.1, False),  # nothing around
    ],
)
def test_points_beside_a_surface_that_enough_scans_saw_are_doubtful(seen: list[int], off: float, beside: bool) -> None:
    point_map = row_of_points(seen, off)
    count = len(seen)
    vote = Votes(np.ones(count, int), np.zeros(count, int), np.full(count, 4), np.zeros(count, bool))
    parted = part_doubtful(point_map, vote)
    assert parted.doubtful.points.tolist() == (point_map.points[-1:].tolist() if beside else [])
    unasked = Votes(vote.agree, vote.contradict, point_map.seen.copy(), vote.behind)
    assert not len(part_doubtful(point_map, unasked).doubtful.points)  # no other scan looked
    # some points always stay
    point_map = row_of_points([1, 1, 1], 1.0)
    all_behind = Votes(np.zeros(3, int), np.zeros(3, int), np.full(3, 2), np.ones(3, bool))
    assert len(part_doubtful(point_map, all_behind).clean.points) == 3


@pytest.mark.slow
def test_order_and_names_of_scans_and_the_world_frame_do_not_matter(scans: list[Scan], parted: CleanMap) -> None:
    order = np.random.default_rng(2).permutation(COUNT)
    again = clean_map(PlacedScans.of([scans[k] for k in order], T[order], VOXEL, [100 + int(k) for k in order]))
    for one, other in ((parted.clean, again.clean), (parted.doubtful, again.doubtful)):
        distance, _ = KDTree(one.points).query(other.points)
        assert (distance > 1e-9).sum() <= 2  # rounding may move a point over a cell's rim
        assert abs(len(one.points) - len(other.points)) <= 2
    shift = RigidTransform.from_translation(VOXEL * np.array([40.0, -7.0, 11.0]))
    moved = clean_map(PlacedScans.of(scans, shift * T, VOXEL))
    # rounding may move a point over a cell's rim
    assert abs(moved.clean.doubted - parted.clean.doubted) <= 5
    assert abs(moved.clean.removed - parted.clean.removed) <= 2
    assert abs(len(moved.clean.points) - len(parted.clean.points)) <= 5
