"""`sonarmap export`, `map --export` and `view` end to end."""

import json
import webbrowser
from pathlib import Path

import laspy
import numpy as np
import pytest

from sonarmap.tools.command.output import EarthPlace
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.writers.atomic import locked
from tests.samples.clutter_scans import done, files_in, printed, refused, said, scan, sonarmap, write
from tests.tools.products.export.finished import finished_map

ORIGIN = ("--origin", "60.3913,5.3221,-3")


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_map(tmp_path_factory.mktemp("mapped"))


def test_formats_are_repeated_or_separated_by_commas(mapped: Path, tmp_path: Path) -> None:
    result = done(sonarmap("export", mapped, "-o", tmp_path, "--format", "laz,KMZ", "--format", "laz", *ORIGIN))
    names = {"map.laz", "map.laz.json", "map.kmz", "map.kmz.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert all(name in result.stdout for name in names)
    assert "no heading was measured" in result.stderr


def test_misspelled_formats_are_refused_with_a_suggestion(mapped: Path, tmp_path: Path) -> None:
    refused(sonarmap("export", mapped, "-o", tmp_path, "--format", "xyz,las"), "did you mean laz?")


def test_a_map_without_an_origin_exports_points_in_its_own_frame(mapped: Path, tmp_path: Path) -> None:
    refused(sonarmap("export", mapped, "-o", tmp_path, "--format", "laz"), "or --crs map for points and grids")
    done(sonarmap("export", mapped, "-o", tmp_path, "--format", "laz,copc", "--crs", "map"))
    las, part = laspy.read(tmp_path / "map.laz"), read_map_folder(mapped).parts[0]
    np.testing.assert_allclose(las.xyz, part.points, rtol=0, atol=5.1e-4)
    assert las.header.parse_crs() is None
    description = json.loads((tmp_path / "map.copc.laz.json").read_text())
    assert description["frame"].startswith("the map's")
    assert description["crs"] is None


def test_json_lists_the_files(mapped: Path, tmp_path: Path) -> None:
    result = sonarmap("export", mapped, "-o", tmp_path, "--format", "kmz", *ORIGIN, "--json")
    description = json.loads(result.stdout)
    assert description["files"] == [str(tmp_path / "map.kmz"), str(tmp_path / "map.kmz.json")]
    assert (description.keys(), description["grids"]) == ({"files", "notes", "grids"}, [])
    assert "exporting" not in result.stderr


def test_vertical_reference_heading_and_crs_are_exported(mapped: Path, tmp_path: Path) -> None:
    out = finished_map(tmp_path / "out")
    options = ("--origin-heading", "12.5", "--vertical", "EGM96")
    for extra in ((), ("--crs", "EPSG:25832")):
        done(sonarmap("export", out, "-o", tmp_path / "gis", "--format", "laz", *ORIGIN, *options, *extra))
        description = json.loads((tmp_path / "gis" / "map.laz.json").read_text())
        assert (description["vertical_epsg"], description["origin"]["x_axis_true_heading_deg"]) == (5773, 12.5)
        assert description["crs"]["epsg"] == (25832 if extra else 32632)


@pytest.mark.parametrize(
    ("origin", "height"),
    [
        ("60.3913,5.3221", 0),
        ("60 23 28.68 N, 5 19 19.56 E, -3.5", -3.5),
        ("60,3913; 5,3221; 2,5", 2.5),
        ("EPSG:25832:297353.9327,6700648.3452,-12.5", -12.5),
    ],
)
def test_formats_of_an_origin(origin: str, height: float) -> None:
    here = EarthPlace(origin=origin).georeference()
    assert here is not None
    assert (here.latitude, here.longitude, here.height) == pytest.approx((60.3913, 5.3221, height), abs=1e-7)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--format", "laz", "--origin", "60,3913"), "wanted latitude"),
        (("--format", "laz", "--origin", "297400,6700600"), "as in --origin EPSG:32632:297400,6700600"),
        (("--format", "laz", "--vertical", "MSL"), "without --origin"),
        (("--format", "laz", *ORIGIN, "--vertical", "LAT"), "vertical reference"),
        (("--format", "laz", *ORIGIN, "--crs", "EPSG:4326"), "--crs"),
        (("--format", "geotiff", *ORIGIN, "--cell", "0"), "above 0"),
        (("--format", "csv", *ORIGIN, "--points", "all"), "need a format of points; give one of laz"),
        (("--format", "geotiff,gpkg", *ORIGIN, "--crs", "map"), "gpkg, which is on the Earth"),
        (("--format", "bag"), "where the map lies on the Earth, which bag needs; give --origin"),
        (("--format", "bag", *ORIGIN, "--crs", "EPSG:4326"), "is WGS 84; wanted a projected one in meters"),
        (("--format", "laz,bag", *ORIGIN, "--crs", "map"), "bag, which is on the Earth"),
        (("--format", "depths", "--crs", "map"), "depths, which is on the Earth"),
        (("--format", "laz", *ORIGIN, "--points", "all"), "does not say where the map's scans are"),
    ],
)
def test_invalid_options_are_refused(mapped: Path, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    result = sonarmap("export", mapped, "-o", tmp_path / "gis", *options)
    refused(result, words)
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.rglob("*.*"))


def test_map_exports_into_its_own_folder(tmp_path: Path) -> None:
    write(tmp_path / "scans", **{f"scan_{k}": scan(k) for k in range(2)})
    out = tmp_path / "out"
    run = ("map", tmp_path / "scans", "-o", out, "--grid", "64", *ORIGIN, "--vertical", "MSL")
    summary = printed(sonarmap(*run, "--export", "laz", "--export", "kmz,xyz", "--crs", "EPSG:25832", "--json"))
    exported = {f"map.{kind}" for kind in ("laz", "laz.json", "kmz", "kmz.json", "xyz", "xyz.json")}
    assert exported < set(summary["files"])
    place = {"latitude": 60.3913, "longitude": 5.3221, "height": -3.0}
    assert summary["georeference"] == place | {"vertical": "MSL", "heading": 90.0}
    assert [row["name"] for row in summary["inputs"]] == ["scan_0.ply", "scan_1.ply"]
    assert all(len(row["sha256"]) == 64 and row["bytes"] > 1000 for row in summary["inputs"])
    description = json.loads((out / "map.laz.json").read_text())
    assert description["inputs"] == summary["inputs"]
    assert (description["crs"]["epsg"], description["vertical_epsg"]) == (25832, 5714)

    # the map has an origin now; the next run without --export removes the exports
    again = sonarmap("export", out, "-o", tmp_path / "gis", "--format", "laz", "--crs", "EPSG:25832", "--quiet")
    assert again.exit_code == 0, again.stderr
    assert (tmp_path / "gis" / "map.laz").read_bytes() == (out / "map.laz").read_bytes()
    assert sonarmap(*run).exit_code == 0
    assert not exported & {path.name for path in out.iterdir()}


@pytest.mark.parametrize(
    ("options", "there", "words"),
    [
        (("--export", "laz"), "", "--origin"),
        (("--priors", "nav.csv", *ORIGIN, "--origin-heading", "20"), "", "--origin-heading"),  # headings were measured
        (("--export", "laz,eiva-position", *ORIGIN), "", "eiva-position needs stamps from 631152000 to 4102444800 s"),
        (("--export", "laz", *ORIGIN), "map.laz", "map.laz exists and"),
        (("--export", "geotiff", *ORIGIN), "grid.qml", "grid.qml exists and"),
    ],
)
def test_map_refuses_exports_before_mapping(
    tmp_path: Path, options: tuple[str, ...], there: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if exports would replace a file of the user; not even a journal is written."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "scans", scan_0=scan(0), scan_1=scan(1))
    (tmp_path / "nav.csv").write_text("name,heading_deg,heading_sigma_deg\nscan_0.ply,10,1\nscan_1.ply,12,1\n")
    if there:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / there).write_text("mine")
    refused(sonarmap("map", "scans", "-o", "out", "--grid", "64", *options), words)
    assert (tmp_path / "out").exists() == bool(there)
    assert not there or files_in(tmp_path / "out") == {there: b"mine"}


MCAP = ("--format", "mcap", "--quiet")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write(tmp_path / "scans", scan_0=scan(0), scan_1=scan(1))
    return finished_map(tmp_path / "out")


def commands(out: Path) -> dict[str, tuple[str | Path, ...]]:
    return {
        "map": ("map", out.parent / "scans", "-o", out, "--grid", "64"),
        "view": ("view", out, "--rebuild", "--no-open"),
        "export into it": ("export", out, "-o", out, *MCAP),
        "export of another into it": ("export", out.parent / "other", "-o", out, *MCAP),
        "export from it": ("export", out, "-o", out.parent / "gis", *MCAP),
    }


@pytest.mark.parametrize("verb", commands(Path()))
def test_all_verbs_are_refused_while_another_run_writes(out: Path, verb: str) -> None:
    finished_map(out.parent / "other")
    before = files_in(out)
    with locked(out, writing=True):
        result = sonarmap(*commands(out)[verb])
    refused(result, f"{out} is in use: another run of sonarmap is writing to it", "Wait until it has ended")
    assert files_in(out) == before
    assert not (out.parent / "gis").exists()


@pytest.mark.parametrize("verb", ["view", "export into it", "export from it"])
def test_only_readers_run_while_another_run_reads(out: Path, verb: str) -> None:
    with locked(out, writing=False):
        result = sonarmap(*commands(out)[verb])
    assert (result.exit_code == 0) == (verb == "export from it")
    assert sonarmap(*commands(out)[verb]).exit_code == 0


def test_view_opens_a_report_in_a_locked_folder(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webbrowser.open", lambda address: True)
    (out / "report.html").write_text("it")
    with locked(out, writing=True):
        assert sonarmap("view", out).exit_code == 0


@pytest.fixture
def opened_urls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that the browser was to open."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: addresses.append(address) or True)
    return addresses


def test_view_writes_and_opens_the_report(tmp_path: Path, opened_urls: list[str]) -> None:
    out = finished_map(tmp_path / "out ü #1")
    refused(sonarmap("view", out), "has no report.html", "--rebuild")
    written = sonarmap("view", out, "--rebuild", "--no-open")
    assert (written.exit_code, opened_urls) == (0, [])
    assert (out / "report.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    (out / "report.html").write_text("old")
    done(sonarmap("view", out))
    assert (out / "report.html").read_text() == "old"
    assert opened_urls == [(out / "report.html").as_uri()]
    assert opened_urls[0].endswith("out%20%C3%BC%20%231/report.html")
    done(sonarmap("view", out, "--rebuild"))
    assert (out / "report.html").read_text(encoding="utf-8") != "old"


@pytest.mark.parametrize("options", [(), ("--rebuild",)])
def test_view_refuses_folders_without_a_map(tmp_path: Path, opened_urls: list[str], options: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    for name in ("file", "empty", "missing"):
        refused(sonarmap("view", tmp_path / name, *options), str(tmp_path / name), "`sonarmap map` wrote")
    assert opened_urls == []


def test_view_without_a_browser_names_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    out = finished_map(tmp_path / "out")
    result = sonarmap("view", out, "--rebuild")
    assert result.exit_code == 2
    said(result, "no browser can be opened here", "report.html")
    assert (out / "report.html").exists()
