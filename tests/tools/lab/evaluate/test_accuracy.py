"""Least accuracy of a small simulated survey, from its scans to its trajectory."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.lab.evaluate.survey import read_summary, score_survey
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from sonarmap.tools.lab.simulate.folder import write_simulation
from sonarmap.tools.lab.simulate.sensing.sensors import ECLIPSE
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.clutter_scans import sonarmap

COUNT, VOXEL = 6, 1.5


@pytest.mark.slow
def test_every_consecutive_pair_of_a_small_survey_is_right(tmp_path: Path) -> None:
    sensor = replace(ECLIPSE, columns=128, rows=96)
    simulation = simulate(SimulationSettings(count=COUNT, seed=33, sensor=sensor))
    write_simulation(simulation, tmp_path / "scans")
    out = tmp_path / "out"
    assert sonarmap("map", tmp_path / "scans", "-o", out, "--grid", "64", "--voxel", str(VOXEL)).exit_code == 0
    scores = score_survey(read_summary(out / "summary.json"), simulation.truth)
    assert scores["sequential"].kept_right == COUNT - 1
    assert scores["loops"].kept_wrong == 0
    result = evaluate(read_tum(out / "trajectory.tum"), simulation.truth)
    assert result.ate_m < VOXEL / 3
    assert np.max(result.rotation_deg) < 1.0
