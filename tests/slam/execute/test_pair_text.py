"""Results of pairs as text, bit by bit; the result that a worker passes on, and its number of prepared scans."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.job import KeyedScan, PairJob
from sonarmap.slam.execute.pair_text import from_text, signature_from_text, signature_to_text, to_text
from sonarmap.slam.execute.worker import Worker, prepared_limit
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.result import Registration
from tests.samples.surveys import KnowingRegistrar, random_covariance, random_transforms, ring_poses, scans_of

ODD = [float("nan"), float("inf"), -0.0, 5e-324, 0.1 + 0.2]


def registrations(seed: int, depth: int = 2) -> Registration:
    """A random result with two alternatives, nested `depth` levels deep."""
    rng = np.random.default_rng(seed)
    psr, overlap, seconds, probability = rng.choice([*ODD, *rng.normal(size=5)], 4)
    return Registration(
        T_target_source=random_transforms(rng, 2)[0] * random_transforms(rng, 2)[1],
        covariance=random_covariance(rng) if depth else np.diag([np.inf, np.nan, 1, 2, 3, -0.0]),
        psr=psr,
        overlap=overlap,
        accepted=bool(seed % 2),
        seconds=seconds,
        reason='she said "ö"\n\udcff',
        probability=probability,
        step_psr=(("rotation", float(rng.normal())), ("translation", float("nan"))),
        alternatives=tuple(registrations(seed + k, depth - 1) for k in (1, 2)) if depth else (),
        evidence=(("view", float(rng.choice(ODD))), ("p_psr", float(rng.normal())))[: seed % 3],
    )


def bits(registration: Registration) -> list[object]:
    """All fields of a result, floats by their bits."""
    numbers = [registration.psr, registration.overlap, registration.seconds, registration.probability]
    return [
        registration.T_target_source.as_matrix().tobytes(),
        (registration.covariance.tobytes(), registration.covariance.dtype, registration.covariance.shape),
        np.array(numbers).tobytes(),
        (registration.accepted, registration.reason),
        [(name, np.float64(psr).tobytes()) for name, psr in registration.step_psr],
        [(name, np.float64(value).tobytes()) for name, value in registration.evidence],
        [bits(other) for other in registration.alternatives],
    ]


@pytest.mark.parametrize("seed", range(4))
def test_a_registration_comes_back_bit_by_bit(seed: int) -> None:
    given = registrations(seed)
    text = to_text(given)
    returned, failure = from_text(text)
    assert returned is not None
    assert bits(returned) == bits(given)
    assert (to_text(returned), failure) == (text, "")


def test_numpy_numbers_and_a_failure_come_back() -> None:
    psr: Any = np.float32(0.1)
    accepted: Any = np.bool_(True)
    given = Registration(RigidTransform.identity(), np.eye(6), psr, 0.2, accepted, 0.1, step_psr=(("a", psr),))
    found, _ = from_text(to_text(replace(given, evidence=(("b", psr),))))
    assert found is not None
    assert (found.psr, found.accepted, found.step_psr) == (float(psr), True, (("a", float(psr)),))
    assert found.evidence == (("b", float(psr)),)
    reason = "scan 3 lies in one plane; give another «scan»"
    assert from_text(to_text(None, reason)) == (None, reason)


@pytest.mark.parametrize("signature", [None, np.array([0.1, np.nan, -0.0, 3e38, np.inf], np.float32)])
def test_a_signature_comes_back_bit_by_bit(signature: np.ndarray | None) -> None:
    returned = signature_from_text(signature_to_text(signature))
    if signature is None:
        assert returned is None
    else:
        assert returned is not None
        assert_array_equal(returned.view(np.uint32), signature.view(np.uint32))


class Instruments(KnowingRegistrar):
    """Its results include instruments, beside the result of the scans alone."""

    def register(self, target: Any, source: Any) -> Registration:
        alone = super().register(target, source)
        return replace(
            alone,
            T_target_source=RigidTransform.identity(),
            covariance=np.eye(6),
            T_by_scans=alone.T_target_source,
            covariance_by_scans=alone.covariance,
        )


def test_a_worker_passes_on_the_result_of_the_scans_alone() -> None:
    """The graph has the instruments' measurements, and would count them twice."""
    poses, covariance = ring_poses(4), random_covariance(np.random.default_rng(2))
    scans = [KeyedScan.of(scan) for scan in scans_of(poses)]
    pairs = [PairJob(scans[0], scans[1]), PairJob(scans[3], scans[1])]
    with_them, without = (Worker(of(poses, covariance), 2).run(pairs) for of in (Instruments, KnowingRegistrar))
    assert [text.content for text in with_them] == [text.content for text in without]
    registration, failure = from_text(with_them[1].content)
    assert registration is not None
    assert failure == ""
    np.testing.assert_array_equal(registration.covariance, covariance)
    assert registration.T_by_scans is None


def test_memory_and_workers_limit_the_prepared_scans() -> None:
    def limit(memory: int, workers: int = 1) -> int:
        registrar: Any = SimpleNamespace(device=SimpleNamespace(memory=memory), grid=SimpleNamespace(edge=128))
        return prepared_limit(registrar, workers)

    assert limit(2**40) >= limit(2**33) > limit(2**34, 16) > limit(2**26) >= 2
    assert limit(2**33) * memory_plan(128).scan <= 2**33 / 3
    without_a_device: Any = SimpleNamespace()
    assert prepared_limit(without_a_device) >= 2


def test_scans_are_prepared_again_in_each_round_only_as_far_as_they_do_not_fit() -> None:
    count, kept, rounds = 40, 30, 4
    poses = ring_poses(count)
    registrar = KnowingRegistrar(poses, random_covariance(np.random.default_rng(2)))
    scans = [KeyedScan.of(scan) for scan in scans_of(poses)]
    worker = Worker(registrar, kept)
    for _ in range(rounds):
        worker.run([PairJob(*pair) for pair in pairwise(scans)])
    assert registrar.most_alive == kept + 1
    # a scan that is used twice at a time, as here, has to be prepared once a round at most
    assert registrar.prepared.total() <= count + (rounds - 1) * (count - kept + 4)
