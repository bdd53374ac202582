"""The unit of point times is found from the sweep; impossible times are named."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.command.overview import overview_of
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.bags.messages import CLOUD, cloud
from tests.samples.bags.writers import write_mcap
from tests.samples.cloud_files import put
from tests.samples.clutter_scans import printed, said, sonarmap

INTERVAL, SWEEP, START = 0.12, 0.1, 1.7e9
UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def survey(folder: Path, times: Callable[[np.ndarray, float], np.ndarray], interval: float = INTERVAL) -> Path:
    """Five scans of 300 points; `times` has the phases 0..1 of the sweep and the stamp."""
    rng = np.random.default_rng(3)
    phases = np.linspace(0, 1, 300)
    for k in range(5):
        stamp = START + k * interval
        points = rng.normal(0, 5, (300, 3))
        np.savez(folder / f"{k}.npz", points=points, stamp=np.array(stamp), times=times(phases, stamp))
    return folder


def check_sweeps(folder: Path, rounding: float = 2e-5) -> tuple[str, ...]:
    """That all scans have their times in seconds after the stamp; returns the notes."""
    read = read_scans([folder])
    for scan in read.scans:
        assert scan.times is not None
        np.testing.assert_allclose(scan.times, SWEEP * np.linspace(0, 1, 300), atol=rounding)
    assert overview_of([folder]).trial.sweep.seconds == pytest.approx(SWEEP, rel=2e-3)
    return read.notes


@pytest.mark.parametrize("offset", [0.0, 37.0, -18.0, 6.3e8, -START])
def test_seconds_by_any_clock(tmp_path: Path, offset: float) -> None:
    assert check_sweeps(survey(tmp_path, lambda phase, stamp: stamp + offset + SWEEP * phase)) == ()
    assert check_sweeps(survey(tmp_path, lambda phase, _: offset + SWEEP * phase)) == ()


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("kind", [np.float32, np.float64, np.uint32, np.int64])
def test_the_unit_is_found_from_the_sweep(tmp_path: Path, unit: str, kind: type) -> None:
    folder = survey(
        tmp_path, lambda phase, _: np.round(SWEEP * UNITS[unit] * phase, 0 if unit != "milliseconds" else 3)
    )
    if unit == "milliseconds" and kind not in (np.float32, np.float64):
        pytest.skip("whole milliseconds are too coarse to compare")
    for path in folder.iterdir():
        with np.load(path) as archive:
            arrays = dict(archive)
        np.savez(path, **arrays | {"times": arrays["times"].astype(kind)})
    assert check_sweeps(folder) == (f"the times of points are taken as {unit}, by which a sweep takes 0.1 s",)


@pytest.mark.parametrize("unit", UNITS)
def test_times_since_1970_in_any_unit(tmp_path: Path, unit: str) -> None:
    check_sweeps(survey(tmp_path, lambda phase, stamp: (stamp + SWEEP * phase) * UNITS[unit]))


@pytest.mark.parametrize("unit", ["milliseconds", "microseconds"])
@pytest.mark.parametrize("kind", ["f4", "u4"])
def test_units_of_a_message(tmp_path: Path, kind: str, unit: str) -> None:
    """As drivers of lidars write them: 1e5 times the phase."""
    rng, names = np.random.default_rng(3), ("x", "y", "z", "time")
    fields = [(name, "f4" if name != "time" else kind, 4 * k) for k, name in enumerate(names)]
    points = np.column_stack(
        [rng.normal(0, 5, (300, 3)), np.floor(SWEEP * UNITS[unit] * np.linspace(0, 1, 300))]
    ).astype(np.float32)
    stamps = START + INTERVAL * np.arange(5)
    records = [("/p", CLOUD, stamp, cloud(points, stamp, names=names, fields=fields, step=16)) for stamp in stamps]
    notes = check_sweeps(write_mcap(tmp_path / "a.mcap", records), 1.01e-3)  # whole milliseconds
    assert notes[0].startswith(f"the times of points are taken as {unit}, by which a sweep takes 0.1")


def test_seconds_of_slow_sweeps_stay_seconds(tmp_path: Path) -> None:
    folder = survey(tmp_path, lambda phase, _: 100 * phase, interval=120.0)
    assert read_scans([folder]).notes == ()
    assert overview_of([folder]).trial.sweep.seconds == pytest.approx(100.0)


def test_impossible_times_are_named_and_not_used(tmp_path: Path) -> None:
    folder = survey(tmp_path, lambda phase, _: 3e12 * phase)
    read = read_scans([folder])
    assert all(scan.times is None for scan in read.scans)
    assert "a sweep takes 3e+12 s by the times of its points, and 0.001 to 0.144 s are possible" in read.notes[0]


def test_inspect_says_how_long_a_sweep_takes(tmp_path: Path) -> None:
    folder = survey(tmp_path, lambda phase, _: 1e5 * phase)
    result = sonarmap("inspect", folder)
    assert "0.1 s from the first point of a scan to its last" in result.stdout
    said(result, "taken as microseconds")
    assert printed(sonarmap("inspect", folder, "--json"))["sweep_s"] == pytest.approx(SWEEP)
    put(tmp_path / "b.xyz", b"1 2 3\n4 5 6\n")
    assert "all points of a scan are of one time" in sonarmap("inspect", tmp_path / "b.xyz").stdout
