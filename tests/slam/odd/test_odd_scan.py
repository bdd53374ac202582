"""Scans that are mirrored or in feet: which are named, and what is left of the map."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.constants import foot
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.mapper import Mapper
from sonarmap.slam.odd.odd_scan import Change
from sonarmap.slam.parts import unplaced
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.products.output.faults import faults
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT, VOXEL = 12, 0.5
TRUTH = ring_poses(COUNT, turns=0.4)
SCANS = scans_of(TRUTH)
NAMES = [scan.name for scan in SCANS]


class Seeing(KnowingRegistrar):
    """Right about scans that are as they were; as unsure of others as a registration is; `blind` to what is wrong."""

    def __init__(self, blind: bool = False) -> None:
        super().__init__(TRUTH, 1e-6 * np.eye(6))
        self.blind = blind

    def prepare(self, scan: Scan) -> Any:
        prepared: Any = super().prepare(scan)
        prepared.by = np.median(scan.points / SCANS[prepared.index].points, axis=0)
        return prepared

    def register(self, target: Any, source: Any) -> Registration:
        given = super().register(target, source)
        by = source.by / target.by
        fits = self.blind or (by.min() > 0.7 and by.max() < 1.4)
        return replace(given, accepted=bool(fits), probability=0.98 if fits else 0.1)


def with_odd(changes: dict[int, Change]) -> list[Scan]:
    return [changes[k].of(scan) if k in changes else scan for k, scan in enumerate(SCANS)]


def mapped(scans: list[Scan], registrar: KnowingRegistrar | None = None, **arguments: Any) -> SurveyResult:
    return Mapper(registrar or Seeing(), VOXEL).run(scans, **arguments)


@pytest.mark.parametrize("scan", [6, 0])
@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (Change("y"), "mirrored", "the sign of y changed"),
        (Change(factor=1 / foot), "feet", "in feet"),
    ],
)
@pytest.mark.quick_cases(1)
def test_faulty_scan_is_named_and_left_out(scan: int, change: Change, kind: str, words: str) -> None:
    result = mapped(with_odd({scan: change}))
    (odd,) = result.odd
    assert (odd.scan, odd.kind, odd.change.axes) == (scan, kind, change.axes)
    assert odd.change.factor == pytest.approx(1 / change.factor, rel=1e-3)
    assert unplaced(result.components) == [scan]
    (named, *others) = faults(result, NAMES)
    assert named.startswith(f"scan{scan} ")
    assert words in named
    assert not [fault for fault in others if "gap" in fault or "in no map" in fault]


def test_scan_that_fits_a_neighbor_is_not_faulty() -> None:
    """As a mirrored scan of a symmetric place: what a registration holds is never left out."""

    class Partly(Seeing):
        def register(self, target: Any, source: Any) -> Registration:
            self.blind = {target.index, source.index} <= {5, 6}
            return super().register(target, source)

    result = mapped(with_odd({5: Change("y")}), Partly())
    assert result.odd == ()
    assert len(result.components) == 1


def test_ordinary_survey_has_no_faulty_scan_and_tries_no_pair_twice() -> None:
    registrar = Seeing()
    assert mapped(SCANS, registrar).odd == ()
    assert len(set(registrar.pairs)) == len(registrar.pairs)


def test_change_also_changes_viewpoints() -> None:
    points = np.ones((3, 3), np.float32)
    changed = Change("y", 2.0).of(Scan(points, viewpoints=points))
    np.testing.assert_array_equal(changed.points, [[2, -2, 2]] * 3)
    assert changed.viewpoints is not None
    np.testing.assert_array_equal(changed.viewpoints, changed.points)
    assert changed.points.dtype == changed.viewpoints.dtype == np.float32


@pytest.mark.slow
def test_navigation_does_not_place_a_faulty_scan() -> None:
    sigmas = np.array([np.inf, np.inf, np.inf, 0.1, 0.1, 0.1])
    at = [PosePrior(RigidTransform.from_translation(T.translation), sigmas) for T in TRUTH]
    scans = [replace(scan, prior=prior) for scan, prior in zip(with_odd({5: Change("y")}), at, strict=True)]
    result = mapped(scans)
    assert [odd.scan for odd in result.odd] == [5]
    assert unplaced(result.components) == [5]


@pytest.mark.slow
def test_several_faulty_scans_are_named_also_side_by_side() -> None:
    changes = {3: Change("y"), 4: Change("z"), 8: Change(factor=foot)}
    assert [odd.scan for odd in mapped(with_odd(changes)).odd] == [3, 4, 8]
