"""Logs of navigation from the command line: the options, what the summary says of them, and the template."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper import Mapper
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.instruments import values_of
from tests.samples.clutter_scans import refused_with_reason, said, scan, sonarmap, write

SIGMAS = ("--prior-sigmas", "0.5,3,0.25,4")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three scans, and a log beside them that has a row for each by its number."""
    write(tmp_path, **{f"scan_{k}": scan(k) for k in range(3)})
    rows = "".join(f"{k + 37};{60.3913 + k * 1e-5:.6f};5,3221;KP{k};{2 * k}\n" for k in range(3)).replace(".", ",")
    (tmp_path / "log.csv").write_text("stamp;Lat;Lon;Note;KP_DEPTH\n" + rows)
    return tmp_path


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Scan]:
    """The scans that a mapper is given, which then ends."""
    scans: list[Scan] = []

    def run(_: Mapper, given: tuple[Scan, ...], *__: object) -> None:
        scans.extend(given)
        raise InputError("enough")

    monkeypatch.setattr(Mapper, "run", run)
    return scans


def test_a_log_is_understood_by_the_options(folder: Path, seen: list[Scan]) -> None:
    options = ("--nav-columns", "depth_m=KP_DEPTH", "--nav-offset=-37", "--mount", "0,0,0,0,0,0.5")
    result = sonarmap(
        "map", folder, "-o", folder / "out", "--priors", folder / "log.csv", *SIGMAS, *options, "--grid", "16"
    )
    said(result, "enough", "not used: the columns 'Note'", "origin is the first fix, rounded: 60.39130, 5.32210")
    values = [values_of(one.prior.T_world_sensor) for one in seen if one.prior]
    np.testing.assert_allclose(np.array(values)[:, 5], [0.5, 2.5, 4.5])
    np.testing.assert_allclose(np.array(values)[:, 4], [0, 1.1142, 2.2284], atol=1e-3)


def test_the_summary_says_how_it_was_understood(folder: Path) -> None:
    pair = (folder / "scan_0.ply", folder / "scan_2.ply")
    (folder / "log.csv").write_text("File;Lat;Lon;Heading\nscan_0;60.5;5.25;90\nscan_2;60.5;5.25;90\n")
    options = ("--priors", folder / "log.csv", *SIGMAS, "--heading-reference", "grid", "--nav-crs", "EPSG:32632")
    result = sonarmap("map", *pair, "-o", folder / "out", *options, "--grid", "64")
    said(result, "--nav-crs has no effect without columns of easting and northing")
    assert sonarmap("map", *pair, "-o", folder / "out", *options[:-2], "--grid", "64").exit_code in (0, 3)
    summary = json.loads((folder / "out" / "summary.json").read_text())
    settings = summary["settings"]
    assert settings["heading_reference"] == "grid"
    assert settings["priors"] == str(folder / "log.csv")
    assert "mount" not in settings
    place = summary["georeference"]
    assert (place["latitude"], place["longitude"]) == (60.5, 5.25)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--nav-frame", "xyz"), ["--nav-frame is 'xyz'", "frd, ned, flu, enu"]),
        (("--time-scale", "glonass"), ["--time-scale is 'glonass'"]),
        (("--nav-offset", "soon"), ["--nav-offset is 'soon'", "auto"]),
        (("--nav-offset", "auto"), ["--nav-offset auto needs the sonar's own turn rates"]),
        (("--heading-reference", "magnetic"), ["--magnetic-declination DEG"]),
        (("--mount", "1,2"), ["--mount is '1,2'", "--mount 0,-30,0"]),
        (("--nav-columns", "deep=A"), ["'deep' is not known"]),
        (("--magnetic-declination", "500"), ["--magnetic-declination is 500"]),
    ],
)
def test_options_that_cannot_be(folder: Path, options: tuple[str, ...], words: list[str]) -> None:
    result = sonarmap("map", folder, "-o", folder / "out", "--priors", folder / "log.csv", *SIGMAS, *options)
    refused_with_reason(result)
    said(result, *words)
    pair = (folder / "scan_0.ply", folder / "scan_1.ply")
    said(sonarmap("register", *pair, "--priors", folder / "log.csv", *SIGMAS, *options), words[0])


def test_options_without_a_file_are_refused(folder: Path) -> None:
    result = sonarmap("map", folder, "-o", folder / "out", "--nav-frame", "enu")
    said(result, "--nav-frame has no effect without a file of navigation")


def test_a_template_is_filled_in_and_used(folder: Path, seen: list[Scan]) -> None:
    (folder / "log.csv").unlink()
    template = folder / "priors.csv"
    result = sonarmap("template", folder, "-o", template)
    assert result.exit_code == 0
    assert result.stdout == f"3 scans; written to {template}\n"
    with template.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["scan_0", "scan_1", "scan_2"]
    assert all(row["heading_deg"] == row["depth_sigma_m"] == "" for row in rows)
    rows[1]["depth_m"] = "7.5"
    with template.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    sonarmap("map", folder, "-o", folder / "out", "--priors", template, *SIGMAS, "--grid", "16")
    assert [one.prior and float(one.prior.T_world_sensor.translation[2]) for one in seen] == [None, -7.5, None]
    result = sonarmap("template", folder, "-o", template)
    assert result.exit_code == 2
    said(result, "is there already")
