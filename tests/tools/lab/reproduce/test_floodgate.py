"""The maps of the flood gate: tables, times, pictures, and the experiment as a whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.floodgate.chain import Chain, FloodgateSurvey, chains
from sonarmap.tools.lab.reproduce.floodgate.methods import TRUTH, runs
from sonarmap.tools.lab.reproduce.floodgate.run import (
    OTHER_METHODS,
    PAPER_METHODS,
    Floodgate,
    FloodgateSettings,
    create,
)
from sonarmap.tools.lab.reproduce.floodgate.section import remarks
from sonarmap.tools.lab.reproduce.floodgate.tables import (
    PAPER_ICP,
    ate_m,
    by_seed,
    map_90,
    map_table,
    pair_table,
    pose_table,
    times_tables,
    verdict_table,
)
from sonarmap.tools.lab.reproduce.pages.section_text import verdicts
from sonarmap.tools.lab.reproduce.rows import all_rows, all_seconds
from tests.samples.experiments.floodgate_rows import flat_survey, outcomes


@pytest.fixture(scope="module")
def now() -> FloodgateSurvey:
    return flat_survey()


Chains = dict[tuple[int, str, int], Chain]


@pytest.fixture(scope="module")
def made(now: FloodgateSurvey) -> Chains:
    """Two surveys alike, with every method's one error."""
    return chains(all_rows(outcomes(now, {"icp": 9.0, "planes": 0.8, "hemisphere": 4.0, "spectral": 0.4}, seeds=2)))


class TestTables:
    def test_the_errors_of_every_run(self, made: Chains) -> None:
        lines = {row[0]: row[1:] for row in map_table(made).rows}
        assert lines["icp"][:3] == ("3 / 3", "3 / 3", "1 / 1")
        assert lines["hemisphere 256³"][:3] == ("4 / 4", "3 / 3", "0 / 0")
        assert lines["icp"][7:] == ("9.00 / 9.00", "0.0 / 0.0")
        assert lines[TRUTH][:3] == ("", "", "")

    def test_the_trajectory_error_is_after_alignment(self, made: Chains) -> None:
        """Two poses of five are 9 m from the rest: no alignment makes that nothing, and every one less than 9 m."""
        assert all(0 < error < 9 * np.sqrt(0.24) + 1e-9 for error in by_seed(made, ("icp", 0), ate_m))
        assert by_seed(made, ("icp", 0), ate_m) > by_seed(made, ("hemisphere", 256), ate_m)

    def test_wrong_pairs_are_counted_in_brackets(self, made: Chains) -> None:
        rows = pair_table(made).rows
        assert [row[0] for row in rows] == ["0 → 1", "1 → 2", "2 → 3", "3 → 4"]
        assert rows[1][1:4] == ("80 %", "70 %", "0.0°, 9.00 m [2]")
        assert rows[0][3] == "0.0°, 0.00 m"
        assert [row[1] for row in pose_table(made).rows] == ["0.0°, 0.00 m", *["0.0°, 9.00 m"] * 3]

    def test_the_verdicts_follow_the_maps(self, now: FloodgateSurvey) -> None:
        """Maps so good, or so bad, as their errors say; the same rows with the names exchanged say the opposite."""

        def said(errors: dict[str, float]) -> dict[str, str]:
            return {row[0]: row[-1] for row in verdict_table(chains(all_rows(outcomes(now, errors)))).rows}

        good = said({"icp": 9.0, "planes": 0.2, "spectral": 0.1})
        assert set(good.values()) == {"holds"}
        assert len(good) == 5
        bad = said({"icp": 0.2, "planes": 0.1, "spectral": 9.0})
        assert bad["the map by planes"] == "holds"
        assert {claim for claim, word in bad.items() if word == "does not hold"} == bad.keys() - {"the map by planes"}

    def test_a_verdict_in_some_surveys(self, now: FloodgateSurvey) -> None:
        first = outcomes(now, {"planes": 0.1})
        second = {
            f"2{job[1:]}": Outcome(tuple({**row, "seed": 2} for row in outcome.rows))
            for job, outcome in outcomes(now, {"planes": 9.0}).items()
        }
        (row,) = verdict_table(chains(all_rows(first | second))).rows
        assert row[-1] == "holds in 1 of 2 surveys"

    def test_two_grids_are_compared(self, now: FloodgateSurvey) -> None:
        fine = outcomes(now, {"spectral": 0.1})
        coarse = {
            job.replace("256", "128"): Outcome(tuple({**row, "grid": 128} for row in outcome.rows))
            for job, outcome in outcomes(now, {"spectral": 8.0}).items()
            if "spectral" in job
        }
        rows = {row[0]: row[-1] for row in verdict_table(chains(all_rows(fine | coarse))).rows}
        assert rows["spectral 128³ beside spectral 256³"] == "does not hold"
        assert rows["the map by spectral 256³"] == "holds"
        assert rows["the map by spectral 128³"] == "does not hold"

    def test_remarks_name_the_wrong_pairs_and_the_order(self, made: Chains) -> None:
        text = remarks(made)
        assert "**icp**: 6/8" in text
        assert "Wrong: 1 → 2 of seed 1 (80 % shared view)" in text
        assert "Of what a scan shows, 60 to 90 % is in view" in text
        assert "Accepted though wrong: 2 of 2." in text
        order = text[text.index("best first") :]
        named = [order.index(name) for name in ("spectral 256³", "planes", "hemisphere 256³", "icp")]
        assert named == sorted(named)
        assert map_90(made[1, "spectral", 256]) < map_90(made[1, "icp", 0])


class TestTimes:
    def test_the_papers_table(self) -> None:
        """As printed: seventeen pairs; least and largest as the text says."""
        assert len(PAPER_ICP) == 17
        assert (min(PAPER_ICP), max(PAPER_ICP)) == (1.27, 47.36)
        assert sum(PAPER_ICP) / 17 == pytest.approx(21.346, abs=5e-4)

    def test_ours_beside_it(self, now: FloodgateSurvey) -> None:
        summary, pairs = times_tables(all_seconds(outcomes(now, {"icp": 9.0, "spectral": 0.1})))
        # 2, 3, 6, 11 s
        assert summary.rows[0] == (
            "icp",
            "",
            "1.27",
            "21.403",
            "47.36",
            "0.50",
            "2.00",
            "5.50",
            "4.50",
            "11.00",
            "2.44",
        )
        assert pairs.rows[2] == ("2 → 3", "28.17", "6.00", "6.00")
        assert pairs.rows[-1] == ("average", "21.403", "5.500", "5.500")


class TestExperiment:
    def test_jobs_are_pairs_and_maps(self) -> None:
        settings = FloodgateSettings(methods=("spectral", "icp"), edges=(64, 128), seeds=2, first_seed=5, scans=3)
        jobs = Floodgate(settings).jobs()
        assert jobs[:4] == ["5/true poses/0/map", "5/icp/0/01", "5/icp/0/02", "5/icp/0/map"]
        assert jobs[-3:] == ["6/spectral/128/01", "6/spectral/128/02", "6/spectral/128/map"]
        assert len(jobs) == len(set(jobs)) == 2 * (1 + 3 * 3)

    def test_the_lineups_order(self) -> None:
        assert runs(("spectral", "icp"), (128, 256)) == (("icp", 0), ("spectral", 128), ("spectral", 256))

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            ({"methods": ("alchemy",)}, "no method is called alchemy"),
            ({"methods": ()}, "no method"),
            ({"seeds": 0}, "at least one"),
            ({"first_seed": -1}, "none below 0"),
            ({"scans": 1}, "2 to 18"),
            ({"edges": (103,)}, "`edge=103`"),
        ],
    )
    def test_refusals(self, arguments: dict[str, object], words: str) -> None:
        with pytest.raises(InputError, match=words):
            FloodgateSettings(**arguments)  # pyright: ignore[reportArgumentType]

    def test_what_the_command_line_asks_for(self) -> None:
        quick, full = (create(Request(quick=quick)).settings for quick in (True, False))
        assert (quick.methods, quick.edges, quick.seeds) == (PAPER_METHODS, (128,), 1)
        assert set(full.methods) | set(full.left_out) == set(PAPER_METHODS) | set(OTHER_METHODS)
        assert (full.edges, full.scans) == ((128, 256), 18)
        asked = create(Request(seeds=2, seed=0, grid=64)).settings
        assert (asked.edges, asked.all_seeds) == ((64,), range(0, 2))

    def test_what_is_not_installed_is_told(self, now: FloodgateSurvey, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("sonarmap.tools.lab.reproduce.floodgate.run.is_installed", lambda name: name != "kiss")
        experiment = create(Request())
        assert experiment.settings.left_out == ("kiss",)
        assert "kiss" not in experiment.settings.methods
        introduction = experiment.section(all_rows(outcomes(now, {"icp": 9.0})), ()).introduction
        assert "Not installed, so left out: kiss." in introduction

    @pytest.mark.slow
    def test_two_runs_give_the_same_rows_and_pictures_whatever_they_took(self, tmp_path: Path) -> None:
        """A map whose pairs were registered in an earlier run is the same as well; times are in no picture."""
        settings = FloodgateSettings(methods=("icp", "hemisphere"), edges=(32,), seeds=1, first_seed=3, scans=3)
        made: list[tuple[dict[str, Outcome], dict[str, bytes]]] = []
        for name, times in (("a", 1.0), ("b", 100.0)):
            experiment, device = Floodgate(settings, choose_device(None)), choose_device(None)
            done = {job: experiment.run(job) for job in experiment.jobs()}
            alone = "3/hemisphere/32/map"
            assert Floodgate(settings, device).run(alone) == done[alone]
            slower = {
                job: replace(outcome, seconds=tuple({**row, "register_s": times} for row in outcome.seconds))
                for job, outcome in done.items()
            }
            (tmp_path / name).mkdir()
            experiment.draw(tmp_path / name, all_rows(slower))
            section = experiment.section(all_rows(slower), all_seconds(slower))
            verdicts(section)
            assert {path.name for path in (tmp_path / name).iterdir()} == set(section.pictures)
            pictures = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
            assert all(len(content) < 300_000 for content in pictures.values())
            made.append(({job: replace(outcome, seconds=()) for job, outcome in done.items()}, pictures))
        assert made[0] == made[1]
