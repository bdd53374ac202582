"""Surveys whose scans instruments place: what no registration joins lies in the map all the same."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.edge import cut_edges
from sonarmap.slam.mapper import Mapper, MapperSettings
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.surveys import KnowingRegistrar, chain_edges, random_covariance, ring_poses, scans_of
from tests.slam.test_mapper import COVARIANCE, VOXEL, error, refuse

SIGMAS = np.array([0.02, 0.02, 0.03, 0.6, 0.6, 0.1])


def in_world(truth: RigidTransform, sigmas: np.ndarray = SIGMAS, seed: int = 1) -> list[Scan]:
    """Scans with priors that err as their sigmas say."""
    rng = np.random.default_rng(seed)
    priors = [
        RigidTransform.from_components(T.translation + rng.normal(0, np.minimum(sigmas[3:], 9.0)), T.rotation)
        for T in truth
    ]
    return [replace(scan, prior=PosePrior(T, sigmas)) for scan, T in zip(scans_of(truth), priors, strict=True)]


def halved(i: int, j: int, given: Registration) -> Registration:
    return refuse(given) if i <= 3 < j else given


@pytest.fixture(scope="module")
def truth() -> RigidTransform:
    return ring_poses(9, turns=0.5)


def mapped(truth: RigidTransform, sigmas: np.ndarray = SIGMAS, settings: MapperSettings | None = None) -> SurveyResult:
    return Mapper(KnowingRegistrar(truth, COVARIANCE, halved), VOXEL, settings).run(in_world(truth, sigmas))


def test_two_halves_that_nothing_joins_share_one_map(truth: RigidTransform) -> None:
    result = mapped(truth)
    assert result.components == (tuple(range(9)),)
    assert result.gaps == ((3, 4),)
    assert result.by_navigation == ()
    assert set(result.maps[0].scan.tolist()) == set(range(9))
    assert error(result, truth) < 0.5
    # pairs between them are tried as loops where they are no bridges: navigation says that they overlap
    tried = mapped(truth, settings=MapperSettings(bridge=1)).pairs
    assert any(pair.role == "loop" and pair.i <= 3 < pair.j for pair in tried)
    unknown = np.where([False, False, False, True, True, False], np.inf, SIGMAS)
    assert mapped(truth, unknown).components == ((0, 1, 2, 3), (4, 5, 6, 7, 8))


def test_a_scan_that_nothing_joins_lies_where_its_instruments_say() -> None:
    truth = ring_poses(10, turns=0.5)
    scans = in_world(truth)
    result = Mapper(KnowingRegistrar(truth, COVARIANCE, broken=("scan4",)), VOXEL).run(scans)
    assert result.components == (tuple(range(10)),)
    assert result.by_navigation == (4,)
    assert 4 in result.maps[0].scan
    prior = scans[4].prior
    assert prior is not None
    off = result.trajectory.T_world_sensor[4].translation - prior.T_world_sensor.translation
    np.testing.assert_allclose(off, 0, atol=1e-4)


def test_the_only_registration_between_two_parts_may_be_wrong_where_navigation_contradicts_it(
    truth: RigidTransform,
) -> None:
    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) != (3, 4):
            return halved(i, j, given)
        wrong = RigidTransform.from_exp_coords([0, 0, 0.6, 12.0, 5.0, 0])
        return replace(given, T_target_source=given.T_target_source * wrong)

    result = Mapper(KnowingRegistrar(truth, COVARIANCE, spoil), VOXEL).run(in_world(truth))
    assert (3, 4) not in {(edge.i, edge.j) for edge in result.edges}
    assert error(result, truth) < 0.5


def test_edges_between_poses_that_the_world_holds_are_not_necessary() -> None:
    T = ring_poses(6)
    covariance = random_covariance(np.random.default_rng(0))
    chain = chain_edges(T, covariance)
    assert cut_edges(6, chain) == set(range(5))
    assert cut_edges(6, chain, [1, 4]) == {0, 4}
    assert cut_edges(6, chain, [0, 2, 5]) == set()
