"""The key of a scan: of its content alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.scan_key import content_key
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.relative_priors import knowing

POINTS = np.random.default_rng(2).normal(size=(30, 3)).astype(np.float32)
A = Scan(POINTS, name="a")


class TestKeys:
    @pytest.mark.parametrize("change", [{"name": "other"}, {"stamp": 7.0}, {"points": POINTS.copy(order="F")}])
    def test_names_stamps_and_layout_decide_nothing(self, change: dict) -> None:
        assert content_key(replace(A, **change)) == content_key(A)

    def test_points_strengths_viewpoints_and_priors_decide(self) -> None:
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
            Scan(POINTS, prior=known),
            Scan(POINTS, prior=PosePrior(T, knowing(slice(2)))),
            Scan(POINTS, prior=PosePrior(RigidTransform.identity(), known.sigmas)),
        ]
        assert len({content_key(scan) for scan in scans}) == len(scans)
