"""`sonarmap inspect LOG`: what a log of navigation holds, every line's fate, and what it says at the scans' times."""

from pathlib import Path

import numpy as np
import pytest

from tests.samples.clutter_scans import done, printed, refused, said, sonarmap
from tests.tools.files.readers.navigation.logs import START

ROWS = 100


def table(*changed: tuple[int, str]) -> str:
    """A log at 1 Hz along East; some rows are others."""
    rows = [
        f"{START + k:.0f},{60 + 1e-7 * (k % 3):.7f},{5 + 2.7e-5 * k:.7f},{90 + k % 2},{12.5},7" for k in range(ROWS)
    ]
    for row, text in changed:
        rows[row] = text
    return "\n".join(["time,lat,lon,hdg,depth (m),pings", *rows, ""])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "nav.csv"
    path.write_text(table((30, f"{START + 30:.0f},60.1,5.0008,91,12.5,7"), (50, f"{START + 50:.0f},,,,,7")))
    return path


def scans(folder: Path, start: float) -> Path:
    folder.mkdir()
    for k in range(3):
        points = np.random.default_rng(k).normal(size=(50, 3)).astype(np.float32)
        np.savez(folder / f"s{k}.npz", points=points, stamp=start + 5.0 * k)
    return folder


def test_a_log_as_json(log: Path) -> None:
    found = printed(sonarmap("inspect", log, "--json"))
    assert (found["rows"], found["clock"]["rate_hz"], found["clock"]["gaps"]) == (ROWS, pytest.approx(1.0), 0)
    assert found["clock"]["start_utc"] == "2026-07-01 09:30:00"
    assert set(found["columns"]) == {"heading_deg", "x_m", "y_m", "depth_m"}
    assert found["columns"]["depth_m"] == {"rows": ROWS - 1, "least": 12.5, "median": 12.5, "most": 12.5}
    assert found["columns"]["x_m"]["rows"] == ROWS - 2
    assert found["speed_mps"]["median"] == pytest.approx(1.5, rel=0.02)
    (fault,) = found["left_out"]
    assert (fault["line"], fault["kind"]) == (32, "position")
    assert found["scans"] is None
    assert any("not used: the columns 'pings'" in note for note in found["notes"])
    assert found["next"].startswith("sonarmap map SCANS --priors ")


def test_in_words_with_a_picture(log: Path, tmp_path: Path) -> None:
    result = done(sonarmap("inspect", log, "--plot", tmp_path / "nav.png"))
    words = " ".join(result.stdout.split())
    for each in ("nav.csv", "100 rows", "1 rows per second, no gaps", "line 32: position: far from the rows around"):
        assert each in words
    assert (tmp_path / "nav.png").read_bytes().startswith(b"\x89PNG")


def test_beside_scans(log: Path, tmp_path: Path) -> None:
    found = printed(sonarmap("inspect", log, scans(tmp_path / "with", START + 10), "--json"))
    assert found["scans"] == {
        "count": 3,
        "covered": dict.fromkeys(("heading_deg", "x_m", "y_m", "depth_m"), 3),
        "apart": "",
    }
    result = sonarmap("inspect", log, scans(tmp_path / "hour", START + 3610))
    assert result.exit_code == 3
    said(result, "no row is at the time of a scan", "wanted stamps of one clock")


def test_what_is_no_log(log: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.csv"
    points = np.random.default_rng(0).normal(size=(50, 4)).round(3)
    cloud.write_text("x,y,z,time\n" + "\n".join(",".join(map(str, row)) for row in points.tolist()) + "\n")
    assert printed(sonarmap("inspect", cloud, "--json"))["scans"] == 1
    refused(sonarmap("inspect", cloud, "--plot", tmp_path / "p.png"), "--plot", "log of navigation")
    bad = tmp_path / "bad.csv"
    bad.write_text(table((7, f"{START + 7:.0f},sixty,5,90,12,7")))
    refused(sonarmap("inspect", bad), "bad.csv: line 9", "sixty")
    nmea = tmp_path / "ship.nmea"
    nmea.write_text("$GPGGA,093000.00,6000.0000,N,00500.0000,E,1,08,1.0,0.0,M,,M,,*5B\n")
    assert sonarmap("inspect", nmea).exit_code == 2  # its times have no date
