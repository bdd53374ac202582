"""Navigation of files that grow: what there is of them so far, whatever is being written."""

import pickle
from dataclasses import replace
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live.navigation import Navigation
from sonarmap.tools.command.navigation import NavigationReading, OdometryFile, PriorsFile
from tests.samples.clutter_scans import scan

SCANS = [Scan(scan(0)[:50], stamp=100.0 + k, name=f"dive#{k}") for k in range(5)]
HEAD = "stamp,roll_deg,pitch_deg,heading_deg,x_m,y_m,depth_m\n"


def row(stamp: float) -> str:
    return f"{stamp},0,0,90,{stamp - 100},2,3\n"


def navigation(priors: Path | None = None, odometry: Path | None = None) -> Navigation:
    return pickle.loads(
        pickle.dumps(
            Navigation(
                PriorsFile([] if priors is None else [priors], None if priors is None else "0.5,3,0.1,3"),
                OdometryFile(odometry),
                NavigationReading(),
            )
        )
    )


def known(scans: list[Scan], given: Navigation) -> list[float | None]:
    """The eastings that scans have."""
    priors = [each.prior for each in given(scans)[0]]
    return [None if prior is None else round(float(prior.T_world_sensor.translation[0]), 6) for prior in priors]


def test_scans_have_what_a_log_says_so_far(tmp_path: Path) -> None:
    path = tmp_path / "navigation.csv"
    given = navigation(path)
    assert known(SCANS, given) == [None] * 5  # there is no file yet
    path.write_text(HEAD)
    assert known(SCANS, given) == [None] * 5
    rows = [row(stamp) for stamp in np.arange(99.75, 104.5, 0.5)]
    path.write_text(HEAD + "".join(rows[:6]) + rows[6][:9])  # within a line
    assert known(SCANS, given) == [0.0, 1.0, 2.0, None, None]
    path.write_text(HEAD + "".join(rows))
    assert known(SCANS, given) == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_log_that_cannot_be_read_leaves_the_scans_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "navigation.csv"
    path.write_text(HEAD + "".join(map(row, np.arange(99.75, 104.5, 0.5))))
    scans, _ = navigation(path)(SCANS)
    path.write_bytes(b"\xff\x00 no table\n")
    again, _ = navigation(path)(scans)
    assert again == scans


@pytest.mark.parametrize("cut", [0, 12])
def test_dead_reckoning_covers_the_scans_as_far_as_it_goes(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "odometry.tum"
    text = "".join(f"{stamp} {stamp - 100} 0 0 0 0 0 1\n" for stamp in np.arange(99.5, 103.1, 0.5))
    path.write_text(text[: len(text) - cut])
    _, odometry = navigation(odometry=path)(SCANS)
    assert odometry is not None
    assert odometry.scans.tolist() == ([0, 1, 2, 3] if cut == 0 else [0, 1, 2])
    np.testing.assert_allclose(odometry.T_odom_sensor.translation[:, 0], odometry.scans, atol=1e-9)
    assert navigation(odometry=tmp_path / "nothing.tum")(SCANS)[1] is None


def nmea(clock: str, minutes: float) -> str:
    """A dated fix, and a heading."""
    bodies = [f"GPRMC,{clock},A,{6023 + minutes:.4f},N,00519.3260,E,1.0,0.0,150326,,,A", "HEHDT,90.0,T"]
    return "".join(f"${body}*{reduce(xor, body.encode()):02X}\r\n" for body in bodies)


def test_sentences_that_come_place_scans_as_far_as_they_go(tmp_path: Path) -> None:
    begun, path = 1773567000.0, tmp_path / "navigation.nmea"  # 2026-03-15 09:30 UTC
    scans = [replace(each, stamp=begun + k + 0.3) for k, each in enumerate(SCANS)]
    path.write_text("".join(nmea(f"0930{k:02d}.00", 0.001 * k) for k in range(3)))
    given = navigation(path)
    assert [each.prior is not None for each in given(scans)[0]] == [True, True, True, False, False]
    with path.open("a") as file:
        file.write("".join(nmea(f"0930{k:02d}.00", 0.001 * k) for k in range(3, 6)))
    priors = [each.prior for each in given(scans)[0]]
    assert all(prior is not None and prior.knows_position for prior in priors)
    assert [prior is not None and prior.knows_heading for prior in priors] == [False, True, True, True, True]
    north = [prior.T_world_sensor.translation[1] for prior in priors if prior is not None]
    np.testing.assert_allclose(np.diff(north), 1.857, atol=0.02)  # of 0.001 minutes there [m]
