"""Values that no instrument measured, as -9999: all rows that hold them are left out, and none of the right ones."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.navigation.faults import fault_notes, usable_rows
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from sonarmap.tools.files.readers.scans import stamps_of
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, scans_at

COUNT = 3600
SECONDS = np.arange(COUNT)
RNG = np.random.default_rng(5)
SWELL = 12 + 0.5 * np.sin(SECONDS / 50) + RNG.normal(0, 0.03, COUNT)
DIVE = np.interp(SECONDS, [0, 300, 330, 1800, 1860, 3540, 3570], [0, 0, 12, 14, 30, 28, 0])
RIGHT = {
    "swell": SWELL,
    "rounded": np.round(SWELL, 1),
    "standing still": np.full(COUNT, 12.34),
    "standing in two places": np.interp(SECONDS, [1500, 1530], [7.5, 16.5]),
    "a measurement held for five rows": np.repeat(SWELL[::5], 5),
    "dive from the surface": DIVE + np.where(DIVE > 0, RNG.normal(0, 0.02, COUNT), 0),
}


def log(column: int, values: np.ndarray) -> NavigationLog:
    rows = np.full((len(values), 6), np.nan)
    rows[:, column] = values
    if column in (0, 1):
        rows[:, 1 - column] = 0.5
    lines, times = np.arange(len(values)) + 2, START + np.arange(len(values))
    return NavigationLog("stamp", lines, ("",) * len(values), times, rows, np.full_like(rows, np.nan))


def left_out(given: NavigationLog, column: int) -> np.ndarray:
    return np.isnan(usable_rows(given)[0].values[:, column])


def rows_of(count: int, where: str) -> np.ndarray:
    if where == "evenly":
        return np.linspace(0, COUNT - 1, count).round().astype(int)
    if where == "in a block":
        return 1000 + np.arange(count)
    return np.sort(np.random.default_rng(count).choice(COUNT, count, replace=False))


@pytest.mark.parametrize("name", RIGHT)
def test_right_rows_are_kept(name: str) -> None:
    assert not left_out(log(5, RIGHT[name]), 5).any()


@pytest.mark.parametrize("where", ["evenly", "anywhere", "in a block"])
@pytest.mark.parametrize("count", [1, 5, 11, 60, 600, 1500])
@pytest.mark.parametrize("constant", [-9999.0, 9999.0, -1.0, 65535.0])
def test_all_of_a_constant_are_left_out_and_no_other(constant: float, count: int, where: str) -> None:
    for name in ("swell", "rounded", "standing still", "a measurement held for five rows"):
        values, rows = RIGHT[name].copy(), rows_of(count, where)
        values[rows] = constant
        assert np.flatnonzero(left_out(log(5, values), 5)).tolist() == rows.tolist(), name


def test_four_constants_in_a_log_are_counted_by_value() -> None:
    values, rows = SWELL.copy(), rows_of(1500, "anywhere")
    values[rows] = np.array([-9999.0, 9999.0, -1.0, 65535.0])[np.arange(1500) % 4]
    usable, faults = usable_rows(log(5, values))
    assert np.flatnonzero(np.isnan(usable.values[:, 5])).tolist() == rows.tolist()
    notes = fault_notes(faults)
    for value in ("-9999", "9999", "-1", "65535"):
        assert any(note.startswith("375 depths are left out") and f": {value}, far from" in note for note in notes)


def test_the_surface_before_a_dive_and_after_it_is_kept_beside_a_constant() -> None:
    values, rows = RIGHT["dive from the surface"].copy(), 400 + rows_of(600, "anywhere") * 3000 // COUNT
    values[rows] = -9999.0
    out = np.flatnonzero(left_out(log(5, values), 5))
    assert out.tolist() == np.unique(rows).tolist()


def test_a_pitch_of_minus_one_is_right_and_one_of_minus_99_is_not() -> None:
    pitch = np.round(-1 + RNG.normal(0, 0.3, COUNT), 1)
    assert (pitch == -1).sum() > 300
    assert not left_out(log(1, pitch), 1).any()
    rows = rows_of(600, "anywhere")
    pitch[rows] = -99.0
    assert np.flatnonzero(left_out(log(1, pitch), 1)).tolist() == rows.tolist()


@pytest.mark.parametrize("count", [1, 5, 11, 60])
def test_single_leaps_in_any_number_are_left_out(count: int) -> None:
    values, rows = SWELL.copy(), rows_of(count, "anywhere")
    values[rows] += RNG.uniform(6, 20, count) * RNG.choice([-1, 1], count)
    assert np.flatnonzero(left_out(log(5, values), 5)).tolist() == rows.tolist()


def test_a_log_names_constants_as_it_has_them(tmp_path: Path) -> None:
    """In feet, in a heading, and in latitude and longitude, of which the first row is one."""
    lines = ["Time,Depth (ft),Heading,Lat,Lon,Roll,Pitch"]
    for k in range(120):
        missing = k % 11 == 0
        depth, heading = ("-9999", "9999.0") if missing else (f"{40 + 0.1 * np.sin(k):.2f}", f"{90 + k / 10:.1f}")
        place = ("-1", "-1") if missing else (f"{60 + k * 1e-6:.7f}", "5.3")
        lines.append(",".join([f"{START + k:.1f}", depth, heading, *place, "65535" if missing else "1.5", "0.5"]))
    values, navigated, notes = read(
        tmp_path / "log.csv", "\n".join([*lines, ""]), scans=scans_at(START + 5, START + 55.5)
    )
    np.testing.assert_allclose(values[:, 5], 40 * 0.3048, atol=0.1)
    np.testing.assert_allclose(values[:, 2], [90.5, 95.55], atol=1e-6)
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(60, abs=1e-4)
    said = "\n".join(notes)
    assert "11 depths are left out (lines 2, 13, 24, 35, 46 and 6 more): -9999, far from" in said
    assert "11 headings are left out (lines 2, 13, 24, 35, 46 and 6 more): 9999.0, which no instrument" in said
    assert "11 attitudes are left out" in said
    assert "11 rows are at -1, -1, as without a fix" in said


@pytest.mark.parametrize("constant", ["-1", "-9999", "65535", "9999"])
@pytest.mark.parametrize("count", [1, 11, 600, 1500])
def test_headings_through_north(tmp_path: Path, constant: str, count: int) -> None:
    """Some are nearer to a constant than to one another."""
    headings = [f"{(355 + 0.01 * k) % 360:.2f}" for k in range(COUNT)]
    for row in rows_of(count, "anywhere"):
        headings[row] = constant
    text = "Time,Heading\n" + "".join(f"{START + k},{heading}\n" for k, heading in enumerate(headings))
    (tmp_path / "log.csv").write_text(text)
    log = read_navigation(tmp_path / "log.csv", NavigationSettings(), None, np.zeros(0), [])
    usable, faults = usable_rows(log)
    assert len(faults) == count
    wanted = (355 + 0.01 * SECONDS) % 360
    wanted[rows_of(count, "anywhere")] = np.nan
    np.testing.assert_allclose(usable.values[:, 2], wanted, atol=0.006)


def test_impossible_numbers_of_many_values_are_no_constant(tmp_path: Path) -> None:
    text = "Time,Heading\n" + "".join(f"{START + k},{90 + (400 + k) * (k % 3 == 0)}\n" for k in range(60))
    refuses("Heading|heading_deg is 490; wanted degrees within 360", read, tmp_path / "log.csv", text)


def test_half_of_the_rows_twenty_years_ahead_are_named(tmp_path: Path) -> None:
    ahead = 20 * 365.25 * 86400
    for pick in (lambda k: k % 2, lambda k: k >= 30):
        rows = [f"{START + k + ahead * bool(pick(k)):.1f},{10 + 0.01 * k:.2f}" for k in range(60)]
        scans = scans_at(START + 4, START + 20)
        values, _, notes = read(tmp_path / "log.csv", "\n".join(["time,depth", *rows, ""]), scans=scans)
        np.testing.assert_allclose(values[:, 5], [10.04, 10.2], atol=1e-6)
        assert any("30 rows are left out" in note and "20.0 years after that of the other" in note for note in notes)


def test_half_of_the_scans_twenty_years_ahead_are_named() -> None:
    stamps = [START + k + 20 * 365.25 * 86400 * (k % 2) for k in range(60)]
    kept, (note,) = stamps_of(stamps, [True] * 60)
    assert kept == stamps
    assert "30 of 60 scans are 20.0 years after those of the others" in note
    assert stamps_of([START + k for k in range(60)], [True] * 60)[1] == []
    assert stamps_of([float(k) for k in range(60)], [True] * 60)[1] == []


def test_rows_beyond_the_scans_are_used_and_cause_no_complaint(tmp_path: Path) -> None:
    rows = "".join(f"{START + k:.1f},{10 + 0.1 * k:.2f}\n" for k in range(-500, 500, 4))
    values, _, notes = read(tmp_path / "log.csv", "time,depth\n" + rows, scans=scans_at(START + 1, START + 3))
    np.testing.assert_allclose(values[:, 5], [10.1, 10.3], atol=1e-6)
    assert not any("before the first scan" in note or "left out" in note for note in notes)
