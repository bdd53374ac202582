"""How many prepared scans a worker keeps, and what it hands on."""

from copy import deepcopy
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.pair_text import from_text
from sonarmap.slam.execute.scan_key import scan_key
from sonarmap.slam.execute.worker import PairJob, Worker, prepared_limit
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.result import Registration
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of


@pytest.mark.parametrize(
    ("memory", "workers", "least", "most"),
    [(2**40, 1, 128, 128), (2**34, 1, 40, 127), (2**34, 16, 8, 8), (2**26, 1, 2, 2)],
)
def test_as_many_scans_stay_prepared_as_are_useful(memory: int, workers: int, least: int, most: int) -> None:
    registrar: Any = SimpleNamespace(device=SimpleNamespace(memory=memory), grid=SimpleNamespace(edge=128))
    kept = prepared_limit(registrar, workers)
    assert least <= kept <= most
    assert kept <= 8 or kept * memory_plan(128).scan <= memory / 8
    without_a_device: Any = SimpleNamespace()
    assert prepared_limit(without_a_device) == 8


class Instruments(KnowingRegistrar):
    """What instruments said is in its registrations, and beside it what the scans alone say."""

    def register(self, target: Any, source: Any) -> Registration:
        alone = super().register(target, source)
        return replace(
            alone,
            T_target_source=RigidTransform.identity(),
            covariance=np.eye(6),
            T_by_scans=alone.T_target_source,
            covariance_by_scans=alone.covariance,
        )


def test_a_worker_hands_on_what_the_scans_alone_say() -> None:
    """The graph holds the instruments' measurements: it would count them twice."""
    poses, covariance = ring_poses(4), random_covariance(np.random.default_rng(2))
    sources: Any = {scan_key(scan): SimpleNamespace(load=partial(deepcopy, scan)) for scan in scans_of(poses)}
    scans = list(sources)
    pairs = [PairJob(scans[0], scans[1]), PairJob(scans[3], scans[1])]
    with_them, without = (
        Worker(of(poses, covariance), 2).register(pairs, sources) for of in (Instruments, KnowingRegistrar)
    )
    assert [text.content for text in with_them] == [text.content for text in without]
    registration, failure = from_text(with_them[1].content)
    assert registration is not None
    assert failure == ""
    np.testing.assert_array_equal(registration.covariance, covariance)
    assert registration.T_by_scans is None
