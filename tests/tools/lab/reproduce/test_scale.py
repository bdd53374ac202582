"""Made-up surveys: what is made up is as told, and a short one is mapped, measured and shown."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, SCALE, Request, create, members
from sonarmap.tools.lab.reproduce.rows import all_rows, all_seconds
from sonarmap.tools.lab.reproduce.scale.made_up import MadeUpRegistrar, make_up
from sonarmap.tools.lab.reproduce.scale.measured import WHOLE, ScaleSettings
from sonarmap.tools.lab.reproduce.scale.run import Scale


def test_errors_are_of_the_size_that_is_told_and_little_is_shared_far_away(tmp_path: Path) -> None:
    survey = make_up(tmp_path, 400, 200, seed=2)
    T, registrar = survey.T_world_sensor, MadeUpRegistrar(survey.T_world_sensor, 2)
    squared, refused = [], 0
    for k in range(399):
        if np.linalg.norm((T[k].inv() * T[k + 1]).translation) > 8:  # from lane to lane
            continue
        told = registrar.register(*(registrar.prepare(survey.scans[k + n]) for n in (0, 1)))
        refused += not told.accepted
        error = (told.T_target_source.inv() * T[k].inv() * T[k + 1]).as_exp_coords()
        if told.accepted:
            squared.append(error @ np.linalg.solve(told.covariance, error))
    assert np.mean(squared) == pytest.approx(6 / 7, rel=0.1)  # variances that are told are seven times as large
    assert 1 <= refused <= 25
    assert not registrar.register(0, 399).accepted
    assert registrar.register(0, 399).overlap == 0


def test_scans_of_one_place_show_the_same_bed(tmp_path: Path) -> None:
    survey = make_up(tmp_path, 40, 3000, seed=3)
    first, second = (survey.T_world_sensor[k].apply(survey.scans[k].points.astype(np.float64)) for k in (0, 1))
    apart = np.linalg.norm(first[:, None, :2] - second[None, ::10, :2], axis=2)
    height = first[apart.argmin(axis=0), 2] - second[::10, 2]
    assert np.median(np.abs(height[apart.min(axis=0) < 0.3])) < 0.15


@pytest.mark.slow
def test_a_short_survey_is_mapped_and_measured() -> None:
    settings = ScaleSettings(counts=(60, 90), points=2000)
    experiment = Scale(settings)
    assert experiment.jobs() == ["7/60", "7/90"]
    outcomes = {job: experiment.run(job) for job in experiment.jobs()}
    for outcome, count in zip(outcomes.values(), settings.counts, strict=True):
        (row,) = outcome.rows
        assert (row["scans"], row["placed"], row["wrong_kept"]) == (count, count, 0)
        assert float(row["ate_m"]) < 0.3
        assert int(row["kept_loops"]) > count / 3
        whole = next(row for row in outcome.seconds if row["stage"] == WHOLE)
        assert float(whole["processor_s"]) > 0.1
        assert 20 < float(whole["memory_mib"]) < 2000
    section = experiment.section(all_rows(outcomes), all_seconds(outcomes))
    assert [line[-1] for line in section.tables[0].rows][::2] == ["0 scans are missing in it"] * 2
    assert [line[0] for line in section.times[0].rows] == ["60", "90"]
    assert "map fused" in [line[0] for line in section.times[1].rows]


def test_it_is_an_experiment_of_its_own_group() -> None:
    assert members(SCALE) == ("scale",)
    assert EXPERIMENTS["scale"].timed
    quick = create("scale", Request(quick=True, seed=3, seeds=2))
    assert quick.jobs() == ["3/100", "3/200", "4/100", "4/200"]


@pytest.mark.slow
def test_time_grows_in_proportion_and_memory_stays_small() -> None:
    """3,000 scans in three times of 1,000, to the power of 1.15 at most."""
    settings = ScaleSettings(counts=(1000, 3000))
    measured = [Scale(settings).run(f"7/{count}") for count in settings.counts]
    seconds = [float(row["processor_s"]) for outcome in measured for row in outcome.seconds if row["stage"] == WHOLE]
    assert seconds[1] < 3**1.15 * seconds[0]
    assert all(float(row["memory_mib"]) < 2048 for outcome in measured for row in outcome.seconds)
    assert all(float(outcome.rows[0]["ate_m"]) < 0.3 for outcome in measured)
