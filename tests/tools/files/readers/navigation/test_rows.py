"""Rows that cannot be are named by their lines, and right ones are left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.navigation.faults import fault_notes, usable_rows
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from tests.tools.files.readers.navigation.logs import START, read, require_words, scans_at


def log(count: int = 120, seed: int = 2, every: float = 1.0) -> NavigationLog:
    """A vehicle at 1.5 m/s along lanes of 30 s, with noise."""
    rng = np.random.default_rng(seed)
    times = START + every * np.arange(count)
    lane = ((times - START) // 30).astype(int)
    along = 1.5 * np.where(lane % 2, 30 - (times - START) % 30, (times - START) % 30)
    aside = (times - START) / 3
    values = np.column_stack([rng.normal(0, 2, (count, 2)), np.where(lane % 2, 270.0, 90.0), along, aside])
    values = np.column_stack([values, 12 + 0.5 * np.sin(times / 20)])
    values[:, 2:] += rng.normal(0, [3.0, 0.5, 0.5, 0.05], (count, 4))
    values[:, 2] %= 360
    lines = np.arange(2, count + 2)
    return NavigationLog("stamp", lines, ("",) * count, times, values, np.tile([0.5] * 6, (count, 1)))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("every", [0.2, 1.0, 5.0])
def test_correct_rows_are_kept(seed: int, every: float) -> None:
    given = log(120, seed, every)
    usable, faults = usable_rows(given)
    assert faults == []
    np.testing.assert_array_equal(usable.values, given.values)


def test_impossible_positions_and_depths_are_left_out() -> None:
    given = log()
    values = given.values.copy()
    values[20, 3:5] += [300.0, -40.0]
    values[50:53, 3:5] += [80.0, 0.0]
    values[70, 5] = 0.0
    values[90, 3:5] = np.nan
    values[100, 3:5] += [-90.0, 0.0]  # what lies between two that are wrong is right
    usable, faults = usable_rows(replace(given, values=values))
    assert [(fault.line, fault.kind) for fault in faults] == [
        (22, "position"), (52, "position"), (53, "position"), (54, "position"), (72, "depth"), (102, "position")
    ]  # fmt: skip
    assert np.isnan(usable.values[[20, 50, 51, 52], 3]).all()
    assert np.isfinite(usable.values[20, 5])
    assert np.isnan(usable.values[70, 5])
    assert fault_notes(faults)[0].startswith(
        "5 positions are left out (lines 22, 52, 53, 54, 102): far from the rows around"
    )
    assert fault_notes(faults)[1].startswith("1 depth is left out (line 72): far from")


def test_wrong_times_are_left_out() -> None:
    given = log()
    times = given.times.copy()
    times[10] += 3600.0
    usable, (fault,) = usable_rows(replace(given, times=times))
    assert (fault.line, fault.kind) == (12, "time")
    assert np.isnan(usable.values[10]).all()


def test_a_wrong_row_does_not_affect_its_scan(tmp_path: Path) -> None:
    rows = [f"{START + k:.1f},{1.5 * k + (400 if k == 7 else 0):.2f},{0.1 * (k % 3):.2f},2.5" for k in range(40)]
    text = "\n".join(["time,x,y,depth", *rows, ""])
    values, _, notes = read(tmp_path / "log.csv", text, scans=scans_at(START + 7, START + 20))
    assert values[0, 3] == pytest.approx(10.5)
    assert any("1 position is left out (line 9)" in note for note in notes)
    upside_down = text.replace(",2.5", ",-2.5")
    require_words(
        tmp_path / "log.csv", ["-2.5 m", "above the water", "height_m=depth"], read, tmp_path / "log.csv", upside_down
    )


def test_a_known_top_speed_finds_smaller_jumps() -> None:
    given = log()
    values = given.values.copy()
    values[40, 3:5] += [9.0, 0.0]
    assert usable_rows(replace(given, values=values))[1] == []
    assert [fault.line for fault in usable_rows(replace(given, values=values), fastest=2.0)[1]] == [42]


def test_rows_within_a_second_of_whole_seconds_are_checked() -> None:
    given = log(300, every=0.2)
    times, values = np.floor(given.times), given.values.copy()
    rows = np.arange(3, 300, 7)
    assert usable_rows(replace(given, times=times))[1] == []
    values[rows, 5] = -9999.0
    usable, faults = usable_rows(replace(given, times=times, values=values))
    assert np.flatnonzero(np.isnan(usable.values[:, 5])).tolist() == rows.tolist()
    assert {fault.kind for fault in faults} == {"depth"}


def test_short_logs_and_rows_with_names_are_not_checked() -> None:
    given = log(11)
    assert usable_rows(given) == (given, [])
    named = replace(log(), key="name")
    assert usable_rows(named) == (named, [])


def random_log(seed: int) -> NavigationLog:
    """A vehicle that dives, turns, stops and rolls; rows of 0.1 to 10 s, rounded, some repeated or sent in bursts."""
    rng = np.random.default_rng(seed)
    count, every = int(rng.integers(30, 1500)), float(rng.choice([0.1, 0.2, 1, 2, 5, 10]))
    times = START + every * np.sort(np.arange(count) + (seed % 3 == 0) * rng.uniform(-0.6, 0.6, count))
    steps = np.diff(times, prepend=times[0] - every)

    def held(choices: list[float], rows: int) -> np.ndarray:
        return np.repeat(rng.choice(choices, count // rows + 1), rows)[:count]

    heading = np.cumsum(held([0, 0, 0, 3, -3, 20, -30], 15) * (1.0 if every < 2 else 0.2) * steps) + rng.uniform(0, 360)
    speed, wave, error = held([0, 0, 0.3, 0.8, 1.5], 20), rng.choice([0, 0.5, 3, 10]), rng.choice([0.01, 0.3, 2])
    east, north = (np.cumsum(speed * steps * f(np.radians(heading))) for f in (np.sin, np.cos))
    depth = np.clip(np.cumsum(held([0, 0, 0, 0.3, -0.3, 0.5], 25) * steps), 0, None)
    depth += (depth > 0) * rng.normal(0, rng.choice([0, 0.005, 0.05]), count)
    roll, pitch = wave * np.sin(1.05 * times), 0.5 * wave * np.sin(0.9 * times)
    values = np.column_stack([roll, pitch, heading, east, north, depth])
    values[:, :5] += rng.normal(0, [0.2, 0.2, rng.choice([0.05, 0.5, 3]), error, error], (count, 5))
    values[:, 2] %= 360
    values = np.round(values, seed % 4)
    if seed % 5 == 0:
        values = np.repeat(values[::5], 5, axis=0)[:count]
    return NavigationLog("stamp", np.arange(count), ("",) * count, times, values, np.full((count, 6), np.nan))


@pytest.mark.parametrize(("count", "most"), [(40, 1), pytest.param(400, 8, marks=pytest.mark.slow)])
def test_right_rows_of_random_logs_are_kept(count: int, most: int) -> None:
    wrong = {seed: faults for seed in range(count) if (faults := usable_rows(random_log(seed))[1])}
    assert len(wrong) <= most, wrong
