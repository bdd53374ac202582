"""Surveys that are decided again: from registrations that are kept, rule by rule."""

from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.decisions.run import RULES, USUAL, Decisions, DecisionSettings
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


def test_it_needs_a_folder_and_scans() -> None:
    with pytest.raises(InputError, match="2 or more"):
        DecisionSettings(scans=1)
    with pytest.raises(ValueError, match="no folder"):
        create("decisions", Request())
