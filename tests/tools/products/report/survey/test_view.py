"""What pictures say of a survey: its name and date, its parts, and what its coordinates and depths count from."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.products.report.naming import plain_text, survey_date, survey_name
from sonarmap.tools.products.report.survey.frame import frame_of
from sonarmap.tools.products.report.survey.view import part_view
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT = 8
START = 1_483_228_790.25  # 2016-12-31, ten seconds before midnight
HERE = Georeference(60.3913, -5.3221, 3.5, "MSL")
NAMES = [f"s{k}" for k in range(COUNT)]
MEASURED = ("tilt_x", "tilt_y", "heading", "east", "north", "up")


@pytest.fixture(scope="module")
def mapped() -> SurveyResult:
    """Five scans in a ring, and three that nothing joins to them."""
    truth = ring_poses(COUNT, radius=4.0)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        apart = (i < COUNT - 3) != (j < COUNT - 3)
        return replace(given, accepted=False, reason="spoiled") if apart else given

    scans = [replace(scan, stamp=START + 4 * k) for k, scan in enumerate(scans_of(truth, reach=4.0))]
    return Mapper(KnowingRegistrar(truth, 1e-4 * np.eye(6), spoil), 0.5).run(scans)


def measured(result: SurveyResult, *unmeasured: str, part: int = 0) -> SurveyResult:
    """As if instruments had measured all of a part but these."""
    members = result.components[part]
    free = np.array([name in unmeasured for name in MEASURED])
    gauge = SimpleNamespace(unconstrained=[(members[0], free)] if unmeasured else [])
    graph: Any = SimpleNamespace(priors=[(members[1], None)], known=[], gauge=gauge)
    solution: Any = SimpleNamespace(graph=graph)
    return replace(result, solution=solution)


class TestFrame:
    def test_without_instruments_it_is_the_first_scan_s(self, mapped: SurveyResult) -> None:
        frame = frame_of(mapped, 0, None)
        assert (frame.across, frame.up, frame.north) == ("x [m]", "y [m]", False)
        assert "direction of North is not known" in frame.note
        assert (frame.height, frame.sigmas) == ("height relative to the first scan [m]", "against the first scan")
        assert frame.level(np.array([-3.0, 2.0])).tolist() == [-3, 2]

    @pytest.mark.parametrize(
        ("here", "origin", "below", "levels"),
        [
            (None, "the origin of the navigation", "the zero of the navigation's heights", [3, -2]),
            # z = -3 is half a meter above the sea
            (HERE, "60.3913000° N, 5.3221000° W (WGS84)", "mean sea level", [-0.5, -5.5]),
        ],
    )
    def test_instruments_tell_east_north_and_depth(
        self, mapped: SurveyResult, here: Georeference | None, origin: str, below: str, levels: list[float]
    ) -> None:
        frame = frame_of(measured(mapped), 0, here)
        assert (frame.across, frame.up, frame.north) == ("East [m]", "North [m]", True)
        assert frame.note == f"East and North count from {origin}."
        assert (frame.height, frame.sigmas) == (f"depth below {below} [m]", "in the world")
        assert frame.level(np.array([-3.0, 2.0])).tolist() == pytest.approx(levels)
        other = frame_of(measured(mapped), 1, here)
        assert (other.across, other.zero) == ("x [m]", None)  # nothing places the other part

    @pytest.mark.parametrize("heading", [90.0, 40.0, 300.0])
    def test_on_the_earth_by_the_user_s_word_north_is_up(self, mapped: SurveyResult, heading: float) -> None:
        here = replace(HERE, heading=heading, height=0.0)
        frame = frame_of(mapped, 0, here)
        points = np.array([[3.0, 7.0, -1.0], [-20.0, 5.0, 2.0]])
        on_earth = replace(here, heading=90.0).local(here.geodetic(points))  # East and North, by degrees
        np.testing.assert_allclose(frame.flat(points), on_earth[:, :2], atol=1e-6)
        assert (frame.north, frame.zero) == (True, None)
        assert "No instrument measured the heading" in frame.note
        assert ("East." if heading == 90 else f"to {heading:g}°") in frame.note
        assert frame_of(mapped, 1, here).across == "x [m]"  # the smaller part lies elsewhere
        raised = frame_of(mapped, 0, HERE)  # the user's height makes depths
        assert (raised.height, raised.zero) == ("depth below mean sea level [m]", -3.5)

    def test_what_instruments_left_unmeasured_counts_from_the_first_scan(self, mapped: SurveyResult) -> None:
        frame = frame_of(measured(mapped, "east", "north"), 0, None)
        assert (frame.across, frame.note) == ("East [m]", "East and North count from the first scan's place.")
        assert "against the first scan" in frame.sigmas
        frame = frame_of(measured(mapped, "heading", "east", "north"), 0, None)
        assert (frame.across, frame.zero) == ("x [m]", 0.0)
        assert frame_of(measured(mapped, "up"), 0, None).zero is None


class TestView:
    def test_title_and_size(self, mapped: SurveyResult) -> None:
        view = part_view(mapped, 1, NAMES, {"inputs": ["/somewhere/harbor"]})
        assert view.title == "harbor, 2016-12-31 to 2017-01-01, part 1 of 2"
        assert view.size == f"5 scans, {len(mapped.maps[0].points):,} points, voxel 0.5 m"
        other = part_view(mapped, 2, NAMES, {"inputs": ["/somewhere/harbor"]})
        assert other.title == "harbor, 2017-01-01, part 2 of 2"
        assert (other.scans, other.names) == ((5, 6, 7), ("s5", "s6", "s7"))
        assert all(set(pair.scans) <= {5, 6, 7} for pair in other.pairs)
        counted = replace(mapped, trajectory=replace(mapped.trajectory, stamps=np.arange(8.0)))
        assert part_view(counted, 2, NAMES, {}).title == "part 2 of 2"

    def test_surveys_have_the_names_of_their_folders(self, mapped: SurveyResult) -> None:
        two = replace(mapped, surveys=(0, 0, 0, 1, 1, 1, 1, 1))
        names = [f"{'monday' if k < 3 else 'dives/tuesday'}/scan_{k}.ply" for k in range(COUNT)]
        view = part_view(two, 1, names, {})
        assert view.survey_names == {0: "survey 0 (monday)", 1: "survey 1 (dives/tuesday)"}
        assert view.legs() == {0: [0, 1, 2], 1: [3, 4]}
        assert part_view(two, 1, NAMES, {}).survey_names == {0: "survey 0", 1: "survey 1"}


class TestNames:
    @pytest.mark.parametrize(
        ("inputs", "name"),
        [
            (["a/harbor.sonar"], "harbor.sonar"),
            (["a/scans/"], "scans"),
            (["a/scans/*.ply"], "scans"),
            (["a/scans/[0-4]*.ply", "a/scans/9.ply"], "scans, 9.ply"),
            (["a", "b", "x/c", "d"], "a, b, c and others"),
            ([f"a/scans/{k}.ply" for k in range(4)], "scans"),
            (["a/1.ply", "a/2.ply"], "1.ply, 2.ply"),
            (["a/x", "b/x"], "x"),
            ([], ""),
        ],
    )
    def test_of_a_survey(self, inputs: list[str], name: str) -> None:
        assert survey_name(inputs) == name

    def test_of_the_folder_where_it_runs_and_dates_and_plain_text(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "harbor").mkdir()
        monkeypatch.chdir(tmp_path / "harbor")
        assert survey_name(["."]) == "harbor"
        assert survey_date(np.array([START, START + 5])) == "2016-12-31"
        assert survey_date(np.array([START + 20, START])) == "2016-12-31 to 2017-01-01"
        assert survey_date(np.arange(4.0)) == ""
        assert plain_text("a$b\n\udcffc") == r"a\$b??c"
        assert plain_text("abcdefghijklmnop", 7) == "abc…nop"
        assert plain_text("abcdefg", 7) == "abcdefg"
