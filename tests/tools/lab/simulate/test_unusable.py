"""Unusable scans of a simulated survey: as many as wanted, the others untouched, and told in the description."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.sensing.unusable import NOISY_BEAMS, STRAY_ECHOES, choose_unusable
from sonarmap.tools.lab.simulate.simulation import SimulationSettings, simulate
from tests.samples.clutter_scans import files_in, said, sonarmap
from tests.samples.simulated import COARSE

SETTINGS = SimulationSettings(trajectory="lawnmower", count=9, sensor=COARSE, seed=6)


@pytest.mark.parametrize(("share", "wanted"), [(0.0, 0), (0.05, 2), (0.3, 12), (0.95, 38)])
def test_as_many_as_wanted_are_chosen_and_never_the_first(share: float, wanted: int) -> None:
    faults = choose_unusable(share, 40, seed=3).faults
    assert len(faults) == wanted
    assert all(0 < number < 40 for number in faults)
    kinds = list(faults.values())
    assert abs(kinds.count("empty") - kinds.count("noise")) <= 1


def test_a_larger_share_keeps_the_scans_of_a_smaller_one() -> None:
    few, many = (choose_unusable(share, 50, seed=8).faults for share in (0.1, 0.4))
    assert few.items() <= many.items()
    assert choose_unusable(0.4, 50, seed=9).faults != many
    assert choose_unusable(0.4, 50, seed=8, dive=2).faults != many


def test_the_other_scans_and_the_truth_stay_bit_for_bit() -> None:
    sound, unusable = simulate(SETTINGS), simulate(replace(SETTINGS, unusable=0.45))
    assert len(unusable.faults) == 4
    assert_array_equal(sound.truth.T_world_sensor.as_matrix(), unusable.truth.T_world_sensor.as_matrix())
    for number, (one, other) in enumerate(zip(sound.scans, unusable.scans, strict=True)):
        assert (other.stamp, other.name) == (one.stamp, one.name)
        if number not in unusable.faults:
            assert_array_equal(one.points, other.points)
            assert_array_equal(one.strength, other.strength)


def test_an_unusable_scan_holds_what_its_kind_says() -> None:
    unusable = simulate(replace(SETTINGS, unusable=0.45))
    beams = COARSE.rows * COARSE.columns
    for number, kind in unusable.faults.items():
        scan = unusable.scans[number]
        low, high = STRAY_ECHOES if kind == "empty" else [round(share * beams) for share in NOISY_BEAMS]
        assert low <= len(scan.points) <= high
        ranges = np.linalg.norm(scan.points, axis=1)
        assert (ranges > COARSE.min_range - 1e-4).all()
        assert (ranges < COARSE.max_range + 1e-4).all()


@pytest.mark.parametrize("share", [-0.1, 1.0, 0.9, float("nan")])
def test_a_share_that_cannot_be_is_refused(share: float) -> None:
    with pytest.raises(InputError, match="unusable is"):
        replace(SETTINGS, unusable=share)


def test_the_description_tells_them_and_like_gives_them_again(tmp_path: Path) -> None:
    options = ("--trajectory", "lawnmower", "--scans", "4", "--seed", "6", "--unusable", "0.25", "--quiet")
    assert sonarmap("simulate", *options, "-o", tmp_path / "a").exit_code == 0
    described = json.loads((tmp_path / "a" / "description.json").read_text())
    assert described["settings"]["unusable"] == 0.25
    told = [row["unusable"] for row in described["scans"]]
    assert told == [choose_unusable(0.25, 4, seed=6).faults.get(number) for number in range(4)]
    assert told.count(None) == 3
    again = sonarmap("simulate", "--like", tmp_path / "a" / "description.json", "-o", tmp_path / "b", "--quiet")
    assert again.exit_code == 0
    assert files_in(tmp_path / "a") == files_in(tmp_path / "b")
    refused = sonarmap("simulate", *options[:-3], "--unusable", "1.5", "-o", tmp_path / "c")
    assert refused.exit_code == 2
    said(refused, "unusable is 1.5")
