"""Surveys that are decided again: from registrations that are kept, rule by rule."""

from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.decisions.run import RULES, USUAL, Decisions, DecisionSettings
from sonarmap.tools.lab.reproduce.decisions.section import decisions_section
from sonarmap.tools.lab.reproduce.experiments import Request, create

SETTINGS = DecisionSettings(("floodgate",), seeds=1, first_seed=5, scans=5, edge=64)


@pytest.mark.slow
def test_what_was_registered_is_decided_again(tmp_path: Path) -> None:
    experiment = Decisions(tmp_path, SETTINGS, None)
    assert experiment.jobs() == ["floodgate-5"]
    rows = {row["rule"]: row for row in experiment.run("floodgate-5").rows}
    assert list(rows) == list(RULES)
    whole, chained = rows[USUAL], rows["without loops"]
    assert int(whole["registered"]) >= int(whole["pairs"]) > 4 == chained["pairs"]
    assert chained["loop_kept_right"] == 0 < int(whole["loop_kept_right"])
    assert (tmp_path / "floodgate-5.sqlite").is_file()
    again = Decisions(tmp_path, SETTINGS, None).run("floodgate-5").rows
    assert list(again) == [{**row, "registered": 0} for row in rows.values()]


def test_the_page_shows_rules_then_scenes_then_the_worst_maps_first() -> None:
    def row(rule: str, scene: str, seed: int, error: float) -> dict[str, str | int | float]:
        fates = {
            f"{role}_{fate}": 1 for role in ("sequential", "bridge", "loop") for fate in ("kept_right", "kept_wrong")
        }
        refused = {f"{role}_refused_right": 0 for role in ("sequential", "bridge", "loop")}
        poses = {"scans": 5, "placed": 5, "within_95": 0.75, "nees_mean": 6.0, "ate_after_voxels": error}
        return {"rule": rule, "scene": scene, "seed": seed} | fates | refused | poses

    scenes = [("wreck", 1, 0.2), ("wreck", 2, 0.4), ("seabed", 1, 3.0)]
    rows = [row(rule, *scene) for rule in (USUAL, "a bound") for scene in scenes]
    section = decisions_section(rows, [], SETTINGS)
    short, rules, by_scene, worst = section.tables
    assert short.rows[1][2] == "9 of 18"
    assert [line[:2] for line in rules.rows] == [
        (USUAL, "rich"), (USUAL, "weak"), ("a bound", "rich"), ("a bound", "weak"),
    ]  # fmt: skip
    assert [line[0] for line in by_scene.rows] == ["seabed", "wreck"]
    assert [line[0] for line in worst.rows] == ["seabed 1", "wreck 2", "wreck 1"]
    assert dict(zip(rules.headings, rules.rows[0], strict=True))["ATE [voxels]"] == "0.30, 0.40"
    assert dict(zip(rules.headings, rules.rows[0], strict=True))["in the ellipsoid"] == "75.0 %"


def test_it_needs_a_folder_and_scans() -> None:
    with pytest.raises(InputError, match="2 or more"):
        DecisionSettings(scans=1)
    with pytest.raises(ValueError, match="no folder"):
        create("decisions", Request())
