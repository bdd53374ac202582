"""Keys of scans; and jobs, which reach other processes bit by bit."""

import pickle
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import RigidTransform

import sonarmap.slam.execute.executor  # noqa: F401 - transforms on their way to other processes
from sonarmap.slam.execute.job import KeyedScan, PairJob, content_key, job_key, job_label
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import knowing
from tests.samples.surveys import random_transforms


@pytest.mark.parametrize("seed", range(9))
def test_a_job_reaches_another_process_as_it_is(seed: int) -> None:
    """A transform has all its bits; points on disk are read, and a scan of two pairs is sent once."""
    rng = np.random.default_rng(seed)
    points = PointStore(0).keep(rng.normal(size=(900, 3)).astype(np.float32))
    T_world_sensor, T_target_source = random_transforms(rng, 2)
    prior = PosePrior(T_world_sensor, np.array([1, 1, np.inf, np.inf, np.inf, 2.0]), turned=False)
    name, times = "a name\udce9 of \N{GREEK SMALL LETTER ALPHA}", points[:, 1].copy()
    scan = KeyedScan.of(Scan(points, points[:, 0] ** 2, 7.5, prior, name, -points, times))
    pair = PairJob(scan, scan, ExpectedPose.of(T_target_source, np.eye(6)))
    sent = bytes(ForkingPickler.dumps([pair, pair]))
    back = pickle.loads(sent)[1]
    assert len(sent) < 1.1 * (4 * 900 * 8 + 1000)
    assert back.source is back.target
    for array in ("points", "strength", "viewpoints", "times"):
        assert_array_equal(getattr(back.target.scan, array), getattr(scan.scan, array))
    assert (back.target.scan.name, back.target.scan.stamp, back.target.scan.prior.turned) == (name, 7.5, False)
    assert content_key(back.target.scan) == scan.content
    assert job_key(back, "") == job_key(pair, "")


POINTS = np.random.default_rng(2).normal(size=(30, 3)).astype(np.float32)
A = Scan(POINTS, name="a")


class TestKeys:
    @pytest.mark.parametrize("change", [{"name": "other"}, {"stamp": 7.0}, {"points": POINTS.copy(order="F")}])
    def test_names_stamps_and_layout_do_not_change_a_key(self, change: dict) -> None:
        assert content_key(replace(A, **change)) == content_key(A)

    def test_arrays_and_priors_change_a_key(self) -> None:
        T = RigidTransform.from_translation([1, 2, 3])
        known = PosePrior(T, knowing(slice(2), slice(2, 3)))
        changed = POINTS.copy()
        changed[3, 1] = np.nextafter(changed[3, 1], np.float32(9))
        scans = [
            A,
            Scan(changed),
            Scan(POINTS[::-1]),
            Scan(POINTS, np.ones(30, np.float32)),
            Scan(POINTS, np.zeros(30, np.float32)),
            Scan(POINTS, viewpoints=POINTS),
            Scan(POINTS, viewpoints=changed),
            Scan(POINTS, times=np.zeros(30, np.float32)),
            Scan(POINTS, times=np.ones(30, np.float32)),
            Scan(POINTS, prior=known),
            Scan(POINTS, prior=PosePrior(T, knowing(slice(2)))),
            Scan(POINTS, prior=PosePrior(RigidTransform.identity(), known.sigmas)),
        ]
        assert len({content_key(scan) for scan in scans}) == len(scans)


def test_a_label_can_be_stored_whatever_bytes_a_file_name_has() -> None:
    named = KeyedScan.of(replace(A, name="3 \udcff\n深"))
    assert job_label(PairJob(named, KeyedScan.of(A))) == "3 \\udcff\n深 - a"
