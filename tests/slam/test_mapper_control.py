"""Maps held by control points: into the world without navigation, by parts, in a dense stream."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.control import ControlPoint
from sonarmap.slam.loops.settings import LoopSettings
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.stream.keys import KeySettings
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.slam.tie import Tie
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from tests.samples.surveys import KnowingRegistrar, position_error, random_covariance, ring_poses, scans_of

VOXEL = 0.5
COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)
T_WORLD = RigidTransform.from_components([310.0, -45.0, -12.0], Rotation.from_euler("ZYX", [2.1, 0.2, -0.1]))
RING = ring_poses(24)
TRUTH = T_WORLD * RING
SCANS = scans_of(RING)


def points(scans: list[int], check: tuple[int, ...] = (), truth: RigidTransform = TRUTH) -> list[ControlPoint]:
    """A point in each of these scans, known to 5 cm."""
    rng = np.random.default_rng(3)
    picked = {k: np.array([2.0, 1.0, -1.0]) + rng.normal(size=3) for k in scans}
    known = {k: truth[k].apply(place) + 0.05 * rng.normal(size=3) for k, place in picked.items()}
    use = {k: "check" if k in check else "control" for k in scans}
    return [ControlPoint(f"P{k}", k, picked[k], known[k], np.full(3, 0.05), use[k]) for k in scans]


def error(result: SurveyResult, truth: RigidTransform = TRUTH) -> float:
    return position_error(result.trajectory.T_world_sensor, truth)


def test_points_bring_a_map_into_the_world_and_register_nothing() -> None:
    registrar = KnowingRegistrar(RING, 4 * COVARIANCE)
    alone = Mapper(registrar, VOXEL).run(SCANS)
    asked, registrar.pairs = registrar.pairs, []
    held = Mapper(registrar, VOXEL).run(SCANS, control=points([0, 5, 9, 14, 19], check=(9,)))
    assert registrar.pairs == asked
    assert error(alone) > 100
    assert error(held) < 0.25
    assert held.solution.graph.anchors == ()
    used = {each.point.name: each for each in held.control}
    assert max(np.linalg.norm(each.residual) for each in held.control) < 0.3
    assert used["P9"].point.use == "check"
    assert "P9" not in {each.name for each in held.solution.graph.control}
    assert all(each.in_world and not each.left_out for each in held.control)
    np.testing.assert_allclose(
        used["P5"].estimated, held.trajectory.T_world_sensor[5].apply(used["P5"].point.point), atol=1e-12
    )
    (component,) = held.maps
    assert np.abs(component.points.mean(axis=0) - TRUTH.translation.mean(axis=0)).max() < 8


def test_a_blunder_is_named_and_does_not_move_the_map() -> None:
    control = points([0, 5, 9, 14, 19])
    control[2] = replace(control[2], known=control[2].known + np.array([3.0, -2.0, 0.0]))
    result = Mapper(KnowingRegistrar(RING, 4 * COVARIANCE), VOXEL).run(SCANS, control=control)
    assert [each.point.name for each in result.control if each.left_out] == ["P9"]
    assert error(result) < 0.3


def test_check_points_alone_measure_a_map_that_navigation_places() -> None:
    sigmas = np.array([0.01, 0.01, 0.03, 0.5, 0.5, 0.1])
    priors = {k: PosePrior(TRUTH[k], sigmas) for k in range(0, 24, 3)}
    scans = [replace(scan, prior=priors.get(k)) for k, scan in enumerate(SCANS)]
    plain, checked = (
        Mapper(KnowingRegistrar(RING, COVARIANCE), VOXEL).run(scans, control=control)
        for control in ([], points([1, 8, 16], check=(1, 8, 16)))
    )
    np.testing.assert_array_equal(
        plain.trajectory.T_world_sensor.as_matrix(), checked.trajectory.T_world_sensor.as_matrix()
    )
    assert all(each.in_world for each in checked.control)
    assert max(np.linalg.norm(each.residual) for each in checked.control) < 0.6
    lost = Mapper(KnowingRegistrar(RING, COVARIANCE), VOXEL).run(SCANS, control=points([1, 8], check=(1, 8)))
    assert not any(each.in_world for each in lost.control)


def test_parts_that_points_place_share_the_world() -> None:
    def spoil(i: int, j: int, given: Registration) -> Registration:
        return replace(given, accepted=False, probability=0.0) if i <= 11 < j else given

    def run(control: list[ControlPoint], *ties: Tie) -> SurveyResult:
        return Mapper(KnowingRegistrar(RING, COVARIANCE, spoil), VOXEL).run(SCANS, control=control, ties=ties)

    assert len(run([]).components) == 2
    whole = run(points([0, 4, 9, 13, 17, 22]))
    assert whole.components == (tuple(range(24)),)
    assert error(whole) < 0.3
    lacking = run(points([0, 4, 9, 17]))
    assert len(lacking.components) == 2
    assert lacking.solution.graph.gauge.unmeasured.keys() == {12}
    first = lacking.trajectory.take(range(12)).T_world_sensor.translation
    assert np.linalg.norm(first - TRUTH[:12].translation, axis=1).max() < 0.4
    joined = run(points([0, 4, 9]), Tie(10, 13, "add"))
    assert len(joined.components) == 1
    assert error(joined) < 1.0


def test_points_of_scans_between_the_key_scans_count() -> None:
    dense = ring_poses(60, turns=0.5)
    truth = T_WORLD * dense
    settings = MapperSettings(LoopSettings(per_scan=0), keys=KeySettings(3.0))
    mapper = Mapper(KnowingRegistrar(dense, COVARIANCE), VOXEL, settings)
    scans = scans_of(dense)
    keys = mapper.run(scans).keys
    assert keys is not None
    between = [k for k in range(60) if k not in keys]
    control = points([between[1], keys[3], between[len(between) // 2], between[-2], keys[-2]], truth=truth)
    result = mapper.run(scans, control=control)
    assert result.keys == keys
    assert error(result, truth) < 0.5
    assert all(each.in_world for each in result.control)
    control[1] = replace(control[1], known=control[1].known + np.array([0.0, 20.0, 0.0]))
    named = mapper.run(scans, control=control)
    assert [each.point.scan for each in named.control if each.left_out] == [keys[3]]
    assert error(named, truth) < 0.8


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"ties": [Tie(2, 24, "reject")]}, "of scan 24; there are 24"),
        ({"ties": [Tie(2, 4, "reject"), Tie(2, 4, "accept")]}, "two ties"),
        ({"control": [replace(points([3])[0], scan=-1)]}, "there are 24"),
    ],
)
def test_what_is_of_no_scan_is_refused(said: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Mapper(KnowingRegistrar(RING, COVARIANCE), VOXEL).run(SCANS, **said)
