"""Warnings after mapping, and progress bars."""

import re
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
from sonarmap.tools.command.terminal import progress
from sonarmap.tools.products.output.faults import contradictions, faults
from tests.samples.clutter_scans import scan, write
from tests.samples.screens import on_screen
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

NAMES = [f"scan{k}" for k in range(24)]


def refusing(
    pairs: set[tuple[int, int]], broken: tuple[str, ...] = (), defects: set[tuple[int, int]] | None = None
) -> SurveyResult:
    """A survey in which `pairs` are refused, `broken` scans cannot be prepared, and `defects` raise an error."""
    truth = ring_poses(12, turns=0.3)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        if (i, j) in (defects or ()):
            raise InputError("a slice begins at 7")
        return replace(given, accepted=False, reason=f"too weak at {i}") if (i, j) in pairs else given

    return Mapper(KnowingRegistrar(truth, 1e-6 * np.eye(6), spoil, broken), 0.5).run(scans_of(truth))


def test_gaps_around_one_refused_scan_do_not_suggest_two_places_of_one_build() -> None:
    pairs = {(i, j) for i in range(12) for j in range(12) if 4 in (i, j) and abs(i - j) < 3}
    messages = [fault for fault in faults(refusing(pairs), NAMES) if fault.startswith("gap")]
    assert len(messages) == 2
    assert not any("of one build" in fault for fault in messages)


@pytest.mark.slow
def test_an_error_of_the_method_is_reported_and_the_map_is_incomplete() -> None:
    """Other pairs bridge the failed ones, and no gap between the scans is reported."""
    survey = refusing(set(), defects={(4, 5), (4, 6)})
    assert len(survey.components) == 1
    ended = [pair for pair in survey.pairs if pair.is_defect]
    assert [pair.scans for pair in ended] == [(4, 5), (4, 6)]
    (message,) = faults(survey, NAMES)
    assert message.startswith(f"2 of {len(survey.pairs)} pairs ended by an error of the method")
    assert message.endswith("scan4 and scan5: a slice begins at 7")
    assert not Mapped(survey, NAMES, Path(), 0).whole
    assert Mapped(refusing({(4, 5)}), NAMES, Path(), 0).whole


def test_a_map_joined_only_by_assumed_motion_is_incomplete() -> None:
    """Pairs searched near the assumed motion match there, even across two pools in one folder."""
    survey, away = refusing({(4, 5)}), ExpectedPose.of(RigidTransform.identity(), np.eye(6))
    sought = [replace(pair, expected=away) if pair.i < 5 <= pair.j else pair for pair in survey.pairs]
    joined = replace(survey, pairs=tuple(sought))
    assert [step.scans for step in joined.unconfirmed] == [(4, 5)]
    assert not Mapped(joined, NAMES, Path(), 0).whole
    assert faults(joined, NAMES)[0].startswith("between scan4 and scan5 only the usual motion joins the map, and pairs")
    assert faults(survey, NAMES)[0].startswith("gap between scan4 and scan5")
    free = next(pair for pair in survey.pairs if pair.role != "sequential" and pair.kept and pair.i < 5 <= pair.j)
    assert not replace(joined, pairs=(*(p for p in sought if p.scans != free.scans), free)).unconfirmed


def test_a_navigation_mistake_is_reported_first_and_the_map_is_incomplete() -> None:
    survey = replace(refusing(set()), mistake="they agree with depths in feet", understated={"depth": 4.0})
    assert faults(survey, NAMES)[0] == "they agree with depths in feet"
    assert not Mapped(survey, NAMES, Path(), 0).whole


def navigated(times: float, seed: int) -> SurveyResult:
    """A survey whose depths and positions err by `times` their stated sigmas."""
    truth, rng = ring_poses(12, turns=0.3), np.random.default_rng(seed)
    sigmas = np.array([np.inf, np.inf, np.inf, 0.5, 0.5, 0.1])
    scans = [
        replace(scan, prior=PosePrior(RigidTransform.from_translation(off) * T, sigmas))
        for scan, off, T in zip(scans_of(truth), times * rng.normal(0, sigmas[3:], (12, 3)), truth, strict=True)
    ]
    return Mapper(KnowingRegistrar(truth, 1e-6 * np.eye(6)), 0.5).run(scans)


@pytest.mark.slow
def test_contradicted_navigation_is_reported_first_and_the_map_is_incomplete() -> None:
    right, wrong = navigated(1.0, 0), navigated(6.0, 0)
    assert contradictions(right) == []
    assert Mapped(right, NAMES, Path(), 0).whole
    assert "err" in contradictions(wrong)[0]
    assert faults(wrong, NAMES)[0] == contradictions(wrong)[0]
    assert len(set(faults(wrong, NAMES))) == len(faults(wrong, NAMES))
    assert not Mapped(wrong, NAMES, Path(), 0).whole
    # depths that bend the chain make confident loops rejected
    refused = replace(right, pairs=tuple(replace(pair, edge=None) if pair.j % 3 else pair for pair in right.pairs))
    assert "accepted pairs are rejected, as they contradict navigation" in faults(refused, NAMES)[0]
    assert not Mapped(refused, NAMES, Path(), 0).whole
    # one pair of 87 % may be wrong by chance, three may not
    rejected = [
        replace(pair, registration=replace(pair.registration, probability=0.87))
        for pair in refused.pairs
        if not pair.kept and pair.registration is not None
    ]
    counts = [replace(refused, pairs=tuple(rejected[:n])).refused_for_navigation for n in (1, 3)]
    assert counts == [(0, 0), (3, 3)]


def test_only_the_three_most_important_warnings_are_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    survey = refusing({(1, 2), (3, 4), (8, 9)}, ("scan6",))
    messages = faults(survey, NAMES)
    assert len(messages) == 4
    assert messages[0].startswith("scan6 is in no map")
    mapped = Mapped(survey, NAMES[:12], tmp_path, 0)
    warn_of_faults(mapped)
    shown = capsys.readouterr().err.splitlines()
    assert shown[:3] == [f"warning: {sentence}" for sentence in messages[:3]]
    assert shown[3] == f"warning: 1 more: {tmp_path / 'summary.json'} (warnings)"


def test_the_track_length_excludes_the_step_between_surveys() -> None:
    survey = refusing(set())
    places = survey.trajectory.T_world_sensor.translation
    steps = np.sqrt(((places[1:] - places[:-1]) ** 2).sum(axis=1))
    assert way_length(survey) == pytest.approx(steps.sum())
    two = replace(survey, surveys=(0,) * 5 + (1,) * 7)
    assert way_length(two) == pytest.approx(steps.sum() - steps[4])


@pytest.mark.slow
def test_two_gaps_are_reported_singly_and_four_together() -> None:
    survey = refusing({(1, 2), (4, 5)})
    assert len(survey.components) == 1
    for k, sentence in zip((1, 4), faults(survey, NAMES), strict=True):
        assert sentence.startswith(f"gap between scan{k} and scan{k + 1}, bridged by other pairs")
        assert sentence.endswith(f"too weak at {k}")
    (many,) = faults(refusing({(k, k + 1) for k in (1, 3, 5, 7)}), NAMES)
    assert many.startswith("4 gaps between consecutive scans")


@pytest.mark.slow
def test_a_gap_between_measured_positions_is_no_fault() -> None:
    """Neighboring lines of swaths rarely overlap all along; positions place both of their ends. But positions that
    contradict a registration are a fault."""
    survey = refusing({(1, 2), (4, 5)})
    sigmas = np.array([np.inf, np.inf, np.inf, 0.5, 0.5, np.inf])
    graph, T = survey.solution.graph, survey.trajectory.T_world_sensor
    measured = replace(graph, priors=tuple((k, PosePrior(T[k], sigmas)) for k in (1, 2, 4)))
    placed = replace(survey, solution=replace(survey.solution, graph=measured))
    (gap,) = faults(placed, NAMES)
    assert gap.startswith("gap between scan4 and scan5")
    step = next(pair for pair in placed.pairs if pair.scans == (1, 2))
    assert step.registration is not None
    contradicted = replace(step, registration=replace(step.registration, accepted=True), reason="20 sigmas off")
    pairs = [contradicted if pair is step else pair for pair in placed.pairs]
    assert "gap between scan1 and scan2" in faults(replace(placed, pairs=tuple(pairs)), NAMES)[0]


LONG = "scan_008 - scan_009: accepted: it is right with a probability of 99.6 %: " + "the views agree and so on; " * 8
COUNTING = f"""
import time
from sonarmap.tools.command.terminal import growing_progress
with growing_progress("mapping") as step:
    for k in range(41):
        step(k, 57 if k < 20 else 1200, {LONG!r})
        time.sleep(0.05)
"""


@pytest.mark.parametrize("columns", [60, *(pytest.param(n, marks=pytest.mark.slow) for n in (80, 120))])
def test_a_long_message_does_not_hide_bar_count_and_time_left(columns: int) -> None:
    shown = on_screen(COUNTING, columns=columns, when=r"\b3\d/1200")
    line, words = shown.moment
    assert line.startswith("mapping ")
    assert "━" * 4 in line
    assert re.search(r"/1200 0:0\S+ 0:0\S+$", line)
    assert words.startswith("  scan_008 - scan_009: accepted")
    assert words.endswith("…")
    assert max(map(len, shown.moment)) <= columns
    assert len(shown.lines) == 1  # a finished bar becomes one line
    assert "40/1200" in shown.lines[0]


class TestProgress:
    def test_quiet_prints_nothing(self, capsys: pytest.CaptureFixture[str]) -> None:
        with progress("pairs", 2, quiet=True) as advance:
            advance("one")
            advance("two")
        assert capsys.readouterr() == ("", "")

    def test_a_pipe_gets_one_line(self, capsys: pytest.CaptureFixture[str]) -> None:
        with progress("pairs", 100) as advance:
            for _ in range(100):
                advance("a [note]")
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1
        assert printed.err.startswith("pairs: 100 of 100, ")
        assert printed.err.endswith("(a [note])\n")

    def test_time_left_is_estimated(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        clock = [0.0]
        monkeypatch.setattr("sonarmap.tools.command.terminal.time.monotonic", lambda: clock[0])
        with progress("pairs", 3) as advance:
            for clock[0] in (2.0, 6.0, 9.0):
                advance("")
        assert capsys.readouterr().err == "pairs: 2 of 3, 6.0 s, about 4 s left\npairs: 3 of 3, 9.0 s\n"

    def test_an_error_ends_the_progress_silently(self, capsys: pytest.CaptureFixture[str]) -> None:
        def fail_after_one() -> None:
            with progress("pairs", 2) as advance:
                advance("one")
                raise InputError("no")

        with pytest.raises(InputError):
            fail_after_one()
        assert capsys.readouterr().err == ""


GRID = ("--grid", "64")
SONARMAP = "from sonarmap.tools.command.main import run; run()"


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with scans/: three scans of one place, one of another, a copy, and a file that is not a scan."""
    folder = tmp_path_factory.mktemp("dive") / "scans"
    folder.mkdir()
    write(folder, a=scan(0), b=scan(1), b_copy=scan(1), c=scan(2), d=scan(3, scene=2))
    (folder / "e.ply").write_text("hello")
    return folder.parent


@pytest.mark.slow
def test_a_terminal_shows_that_the_map_is_incomplete(scans: Path) -> None:
    shown = on_screen(SONARMAP, "map", "scans", "scans/a.ply", "-o", "out", *GRID, folder=scans)
    assert shown.exit_code == 3
    assert len(shown.lines) <= 24  # including the summary
    start = next(k for k, line in enumerate(shown.lines) if line.startswith("scans "))
    assert shown.lines[start] == "scans     4 of 6 placed in one map (1 in no map, 1 cannot be read)"
    rows = [line.split()[0] for line in shown.lines[start : start + 6]]
    assert rows == ["scans", "loops", "track", "map", "time", "warning:"]
    words = " ".join(line.strip() for line in shown.lines)
    assert "warning: 1 of 5 scans is in no map" in words
    assert "next      sonarmap view out " in words
