"""Remedies chosen on the page of a dive: what options they become, and that a dive that is continued has them."""

from dataclasses import replace
from pathlib import Path

import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live.chosen import Reading, changes_scans, keep_chosen, kept_chosen
from sonarmap.tools.command.live.kept_keys import FOLDER, KeptKey, forget_dive, keep_key, kept_for, kept_keys
from sonarmap.tools.command.navigation import NavigationReading, PriorsFile
from sonarmap.tools.command.survey import PointReading
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.files.readers.incoming import Mark
from tests.samples.clutter_scans import scan

GIVEN = Reading(
    PriorsFile([Path("log.csv")], "0.5,3,0.1,3", "heading_deg=90-heading_deg"),
    NavigationReading(nav_offset=3.0),
    PointReading(range_scale=1.02, exclude_box=["0,0,0,1,1,1"]),
)
SIGN, SCALE = Remedy("correct_priors", ("heading_deg=-heading_deg",)), Remedy("range_scale", ("0.5",))


def test_remedies_add_to_the_given_options() -> None:
    chosen = [SIGN, Remedy("nav_offset", ("-1.5",)), SCALE, Remedy("exclude_box", ("2,0,0,3,1,1", "4,0,0,5,1,1"))]
    use = GIVEN.corrected([*chosen, Remedy("frame", ("frd",))])
    assert use.priors == replace(GIVEN.priors, correct_priors="heading_deg=-90+heading_deg")
    assert use.log == NavigationReading(nav_offset=1.5)
    assert use.points == PointReading(
        range_scale=0.51, exclude_box=["0,0,0,1,1,1", "2,0,0,3,1,1", "4,0,0,5,1,1"], frame="frd"
    )
    assert GIVEN.points.exclude_box == ["0,0,0,1,1,1"]
    assert [changes_scans(each) for each in chosen] == [False, False, True, True]


def test_a_remedy_twice_is_none() -> None:
    bare = Reading(PriorsFile([Path("log.csv")]), NavigationReading(), PointReading())
    assert bare.corrected([SIGN, SIGN]) == bare


def test_what_was_chosen_is_kept_for_the_same_dive(tmp_path: Path) -> None:
    with kept_for(tmp_path, ["dive.sonar"]):
        assert kept_chosen(tmp_path) == []
        keep_chosen(tmp_path, [SIGN, SCALE])
    with kept_for(tmp_path, ["dive.sonar"]):
        assert kept_chosen(tmp_path) == [SIGN, SCALE]
    with kept_for(tmp_path, ["another.sonar"]):
        assert kept_chosen(tmp_path) == []


@pytest.mark.parametrize("text", ["", "{", "7", "[[7]]", '{"a": 1}'])
def test_a_damaged_file_chooses_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "chosen.json").write_text(text)
    assert kept_chosen(tmp_path) == []


def test_the_scans_of_a_finished_map_are_kept(tmp_path: Path) -> None:
    (tmp_path / FOLDER).mkdir()
    for number, behind in enumerate([Mark(), Mark(), Mark("a", 3), Mark("a", 4)]):
        keep_key(tmp_path, number, KeptKey(Scan(scan(1), stamp=float(number)), None, behind, 0.5))
    forget_dive(tmp_path)
    assert [key.behind for key in kept_keys(tmp_path)] == [Mark(), Mark()]
