"""Maps by portions of their scans: the same with any portions and executor."""

from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
import pytest

from sonarmap.slam.execute.executor import Executor
from sonarmap.slam.execute.processes import spawned
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.map import crossing, portions
from sonarmap.slam.map.crossing import crossing_error
from sonarmap.slam.map.doubtful_points import component_maps
from sonarmap.slam.map.placed import PlacedScans
from sonarmap.slam.map.point_map import PointMap, fuse
from sonarmap.slam.map.portions import in_portions
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.room_scans import look, room_poses

VOXEL, COUNT = 0.25, 12
TRUTH = room_poses(COUNT)


@pytest.fixture(scope="module")
def scans() -> list[Scan]:
    rng = np.random.default_rng(3)
    return [look(T, rng, wild=0.03) for T in TRUTH]


@pytest.fixture(scope="module")
def workers() -> Iterator[Executor]:
    with spawned(2) as pool:
        yield Executor(pool, 2)


def maps_of(scans: list[Scan], executor: Executor | None) -> list[PointMap]:
    covariances = np.tile(np.diag(np.repeat([0.003, 0.03], 3) ** 2), (COUNT, 1, 1))
    surveys = [0] * 5 + [1] * (COUNT - 5)
    placed = PlacedScans.of(scans, TRUTH, VOXEL, None, covariances, surveys, executor)
    maps = component_maps(placed, Trajectory(np.arange(COUNT, dtype=float), TRUTH), executor=executor)
    assert maps.doubtful is not None
    layers = [each for layer in maps.layers.values() for each in (layer.clean, layer.doubtful)]
    return [maps.optimized, maps.doubtful, *layers]


def assert_same(one: PointMap, other: PointMap) -> None:
    for field in fields(PointMap):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), field.name)


@pytest.mark.slow
def test_two_workers_and_any_portions_give_the_same_maps(
    scans: list[Scan], workers: Executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = maps_of(scans, None)
    assert expected[0].removed
    assert len(expected[1].points)
    for count in (1, 5):
        monkeypatch.setattr(portions, "_MOST_SCANS", count)
        for executor in (Executor(), workers):
            for one, other in zip(maps_of(scans, executor), expected, strict=True):
                assert_same(one, other)


def test_the_map_of_scans_on_disk_is_the_same(scans: list[Scan]) -> None:
    store = PointStore(0)
    on_disk = [replace(scan, points=store.keep(scan.points)) for scan in scans]
    assert_same(fuse(PlacedScans.of(on_disk, TRUTH, VOXEL)), fuse(PlacedScans.of(scans, TRUTH, VOXEL)))


@pytest.mark.slow
def test_crossings_of_many_scans_come_from_an_even_sample(scans: list[Scan], monkeypatch: pytest.MonkeyPatch) -> None:
    names = [5 * k for k in range(COUNT)]
    placed = PlacedScans.of(scans, TRUTH, 1.0, names)
    assert {0, 5} <= {end for each in crossing_error(placed, TRUTH).crossings for end in (each.i, each.j)}
    monkeypatch.setattr(crossing, "SCANS", 4)
    taken = {end for each in crossing_error(placed, TRUTH).crossings for end in (each.i, each.j)}
    assert taken
    assert taken <= {0, 15, 30, 45}


def test_portions_are_consecutive_scans_with_few_enough_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(portions, "_MOST_POINTS", 100)
    monkeypatch.setattr(portions, "_MOST_SCANS", 3)
    scans = [Scan(np.ones((size, 3), np.float32)) for size in (60, 40, 1, 250, 10, 10, 10, 10)]
    done = dict(in_portions(Executor(), scans, sum, lambda places: ([len(scans[k].points) for k in places],)))
    assert done == {range(2): 100, range(2, 3): 1, range(3, 4): 250, range(4, 7): 30, range(7, 8): 10}
