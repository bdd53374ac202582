"""What the user is warned of after mapping, and what the table says of refused pairs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.command.mapped import Mapped, warn_of_faults, way_length
from sonarmap.tools.products.output.faults import contradictions, faults
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses, scans_of

NAMES = [f"scan{k}" for k in range(24)]


def told_of(covariance: np.ndarray) -> tuple[float, list[str]]:
    """By how much loops moved a pose [m], and what is said."""
    truth = ring_poses(24)
    survey = Mapper(KnowingRegistrar(truth, covariance), 0.5).run(scans_of(truth))
    return survey.moved, faults(survey, NAMES)


@pytest.mark.slow
def test_loops_that_change_nothing_are_told() -> None:
    covariance = random_covariance(np.random.default_rng(0), 0.004, 0.03)
    moved, told = told_of(1e-8 * covariance)
    assert moved < 1e-4
    assert len(told) == 1
    assert "loops were kept, but no pose moved by more than 0.001 voxels" in told[0]
    moved, told = told_of(covariance)
    assert moved > 0.05
    assert told == []


def refusing(
    pairs: set[tuple[int, int]], broken: tuple[str, ...] = (), defects: set[tuple[int, int]] | None = None
) -> SurveyResult:
    """A survey of which these pairs are refused, these scans cannot be prepared, and these pairs end by an error."""
    truth = ring_poses(12, turns=0.3)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) in (defects or ()):
            raise InputError("a slice begins at 7")
        return replace(given, accepted=False, reason=f"too weak at {i}") if (i, j) in pairs else given

    return Mapper(KnowingRegistrar(truth, 1e-6 * np.eye(6), spoil, broken), 0.5).run(scans_of(truth))


def test_a_scan_that_only_bridges_pass_over_is_no_hint_at_twins() -> None:
    pairs = {(i, j) for i in range(12) for j in range(12) if 4 in (i, j) and abs(i - j) < 3}
    told = [fault for fault in faults(refusing(pairs), NAMES) if fault.startswith("gap")]
    assert len(told) == 2
    assert not any("of one build" in fault for fault in told)


@pytest.mark.slow
def test_an_error_of_the_method_is_named_and_the_map_is_not_whole() -> None:
    """Though other pairs bridge it: it says nothing of the scans, and is not told as a gap of theirs."""
    survey = refusing(set(), defects={(4, 5), (4, 6)})
    assert len(survey.components) == 1
    ended = [pair for pair in survey.pairs if pair.is_defect]
    assert [pair.scans for pair in ended] == [(4, 5), (4, 6)]
    assert ended[0].reason == "failed: an error of the method, not of the scans: a slice begins at 7"
    (told,) = faults(survey, NAMES)
    assert told == (
        f"2 of {len(survey.pairs)} pairs ended by an error of the method, whatever the scans show, as scan4 "
        "and scan5: a slice begins at 7"
    )
    assert not Mapped(survey, NAMES, Path(), 0).whole
    assert Mapped(refusing({(4, 5)}), NAMES, Path(), 0).whole


def test_a_map_that_only_the_usual_motion_joins_is_not_whole() -> None:
    """Pairs sought where the motion has them are found there, as in the second of two pools in one folder."""
    survey, away = refusing({(4, 5)}), ExpectedPose.of(RigidTransform.identity(), np.eye(6))
    sought = [replace(pair, expected=away) if pair.i < 5 <= pair.j else pair for pair in survey.pairs]
    joined = replace(survey, pairs=tuple(sought))
    assert [step.scans for step in joined.unconfirmed] == [(4, 5)]
    assert not Mapped(joined, NAMES, Path(), 0).whole
    assert faults(joined, NAMES)[0].startswith("between scan4 and scan5 only the usual motion joins the map, and pairs")
    assert faults(survey, NAMES)[0].startswith("gap between scan4 and scan5")
    free = next(pair for pair in survey.pairs if pair.role != "sequential" and pair.kept and pair.i < 5 <= pair.j)
    assert not replace(joined, pairs=(*(p for p in sought if p.scans != free.scans), free)).unconfirmed


def test_a_mistake_of_the_navigation_stands_first_and_the_map_is_not_whole() -> None:
    survey = replace(refusing(set()), mistake="they agree with depths in feet", understated={"depth": 4.0})
    assert faults(survey, NAMES)[0] == "they agree with depths in feet"
    assert not Mapped(survey, NAMES, Path(), 0).whole


def navigated(times: float, seed: int) -> SurveyResult:
    """A survey with depths and positions that err so many times as much as they say."""
    truth, rng = ring_poses(12, turns=0.3), np.random.default_rng(seed)
    sigmas = np.array([np.inf, np.inf, np.inf, 0.5, 0.5, 0.1])
    scans = [
        replace(scan, prior=PosePrior(RigidTransform.from_translation(off) * T, sigmas))
        for scan, off, T in zip(scans_of(truth), times * rng.normal(0, sigmas[3:], (12, 3)), truth, strict=True)
    ]
    return Mapper(KnowingRegistrar(truth, 1e-6 * np.eye(6)), 0.5).run(scans)


@pytest.mark.slow
def test_navigation_that_the_map_contradicts_is_said_first_and_the_map_is_not_to_be_trusted() -> None:
    right, wrong = navigated(1.0, 0), navigated(6.0, 0)
    assert contradictions(right) == []
    assert Mapped(right, NAMES, Path(), 0).whole
    assert "err" in contradictions(wrong)[0]
    assert faults(wrong, NAMES)[0] == contradictions(wrong)[0]
    assert len(set(faults(wrong, NAMES))) == len(faults(wrong, NAMES))
    assert not Mapped(wrong, NAMES, Path(), 0).whole
    # depths that bend a chain have the sure loops refused
    refused = replace(right, pairs=tuple(replace(pair, edge=None) if pair.j % 3 else pair for pair in right.pairs))
    assert "accepted pairs are rejected, as they contradict navigation" in faults(refused, NAMES)[0]
    assert not Mapped(refused, NAMES, Path(), 0).whole
    # one pair of 87 % may be wrong by chance, three may not
    rejected = [
        replace(each, registration=replace(each.registration, probability=0.87))
        for each in refused.pairs
        if not each.kept and each.registration is not None
    ]
    counts = [replace(refused, pairs=tuple(rejected[:n])).refused_for_navigation for n in (1, 3)]
    assert counts == [(0, 0), (3, 3)]


def test_the_most_important_stand_first_and_few_are_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    survey = refusing({(1, 2), (3, 4), (8, 9)}, ("scan6",))
    told = faults(survey, NAMES)
    assert len(told) == 4
    assert told[0].startswith("scan6 is in no map")
    mapped = Mapped(survey, NAMES[:12], tmp_path, 0)
    warn_of_faults(mapped)
    shown = capsys.readouterr().err.splitlines()
    assert shown[:3] == [f"warning: {sentence}" for sentence in told[:3]]
    assert shown[3] == f"warning: 1 more, and all in full: {tmp_path / 'summary.json'} (warnings), or --verbose"
    warn_of_faults(mapped, verbose=True)
    assert capsys.readouterr().err.splitlines() == [f"warning: {sentence}" for sentence in told]


def test_the_way_is_that_of_every_map_and_survey() -> None:
    survey = refusing(set())
    places = survey.trajectory.T_world_sensor.translation
    steps = np.sqrt(((places[1:] - places[:-1]) ** 2).sum(axis=1))
    assert way_length(survey) == pytest.approx(steps.sum())
    two = replace(survey, surveys=(0,) * 5 + (1,) * 7)
    assert way_length(two) == pytest.approx(steps.sum() - steps[4])


@pytest.mark.slow
def test_a_scan_that_is_to_blame_is_told_once() -> None:
    assert faults(refusing(set(), ("scan4",)), NAMES) == ["scan4 is in no map: it is of no use; drop it"]
    (several,) = faults(refusing(set(), ("scan4", "scan8")), NAMES)
    assert several == "2 scans are in no map: scan4, scan8; the first: it is of no use; drop it"


@pytest.mark.slow
def test_each_gap_is_told_and_many_together() -> None:
    survey, why = refusing({(1, 2), (4, 5)}), ": refused by the registration: too weak at"
    assert len(survey.components) == 1
    twins = ", bridged by other pairs, as two places of one build would be too, such as two tanks (then give the scans "
    twins += "before and after in folders of their own)"
    assert faults(survey, NAMES) == [f"gap between scan{k} and scan{k + 1}{twins}{why} {k}" for k in (1, 4)]
    (many,) = faults(refusing({(k, k + 1) for k in (1, 3, 5, 7)}), NAMES)
    assert many == f"4 gaps between consecutive scans{twins}, as between scan1 and scan2{why} 1"
