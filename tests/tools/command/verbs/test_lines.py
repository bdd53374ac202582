"""`sonarmap map` and `inspect` of lines of an echo sounder: files in, corrected navigation and soundings out."""

import json
import re
import shutil
from pathlib import Path

import laspy
import numpy as np
import pytest

import sonarmap as sonarmap_package
from sonarmap.slam.pings.biases import Biases
from sonarmap.tools.files.geo import Projection
from sonarmap.tools.files.map_folder.folder import mapped_scans, read_map_folder
from sonarmap.tools.products.export.clouds import Cloud
from tests.samples.clutter_scans import done, printed, refused, said, sonarmap, table_of
from tests.samples.lines import HERE, gsf_of
from tests.slam.pings.simulated_lines import WRONG, Survey, simulated
from tests.tools.files.readers.pings.kmall_file import kmall
from tests.tools.files.readers.pings.samples import LINE
from tests.tools.products.export.test_clouds import same_as_fused

PINGS, LANES = 250, 3


def survey_of(folder: Path, survey: Survey) -> list[Path]:
    """Write the first recorded lines of a survey as GSF files."""
    return [gsf_of(folder / f"{k}.gsf", line) for k, line in enumerate(survey.recorded[:LANES])]


@pytest.fixture(scope="module")
def survey() -> Survey:
    return simulated(3, Biases(), rms=0.6, pings=PINGS, beams=128, constant=(1.0, 0.05))


@pytest.fixture(scope="module")
def mapped(survey: Survey, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with lines, and in out/ their map."""
    folder = tmp_path_factory.mktemp("lines")
    files = survey_of(folder, survey)
    where = f"{HERE.latitude},{HERE.longitude}"
    result = done(sonarmap("map", *files, "-o", folder / "out", "--origin", where))
    said(result, "patches of lines")
    return folder


@pytest.mark.slow
def test_corrected_navigation_is_nearer_to_the_truth(mapped: Path, survey: Survey) -> None:
    rows = table_of(mapped / "out" / "navigation.csv")
    assert [row["line"] for row in rows] == [f"{k}" for k in range(LANES) for _ in range(PINGS)]
    geodetic = np.array([[float(row[name]) for name in ("lat_deg", "lon_deg", "height_m")] for row in rows])
    found, true, before = (
        HERE.local(geodetic)[:, :2],
        *(np.concatenate([line.places for line in lines[:LANES]])[:, :2] for lines in (survey.true, survey.recorded)),
    )
    # an offset common to all lines cannot be observed
    errors = [np.linalg.norm((places - true) - (places - true).mean(axis=0), axis=1) for places in (found, before)]
    assert np.sqrt((errors[0] ** 2).mean()) < 0.4 * np.sqrt((errors[1] ** 2).mean())
    moved = np.array([[float(row[f"moved_{axis}_m"]) for axis in ("east", "north")] for row in rows])
    np.testing.assert_allclose(found - moved, before, atol=0.01)  # a GSF file has 1e-7 degrees
    headings = np.array([float(row["heading_deg"]) for row in rows])
    recorded = np.degrees(np.concatenate([line.attitudes[:, 2] for line in survey.recorded[:LANES]]))
    assert np.abs((headings - recorded + 180) % 360 - 180).max() < 1.0


@pytest.mark.slow
def test_soundings_match_the_true_positions(mapped: Path, survey: Survey) -> None:
    las = laspy.read(mapped / "out" / "soundings.laz")
    assert len(las.points) == sum(len(line.pings) for line in survey.recorded[:LANES])
    assert np.unique(np.asarray(las.point_source_id)).tolist() == [1, 2, 3]
    assert (np.asarray(las.classification) == 40).all()
    places = Projection.of(HERE).unproject(np.asarray(las.xyz))
    there = HERE.local(places)
    true = np.concatenate([line.world_points() for line in survey.true[:LANES]])
    off = there - true
    assert np.sqrt(((off - off.mean(axis=0)) ** 2).mean(axis=0))[2] < 0.1
    across = np.concatenate([line.points[:, 1] for line in survey.recorded[:LANES]])
    far = np.abs(across) > 5
    assert (np.sign(np.asarray(las["beam_angle"])[far]) == -np.sign(across[far])).all()  # positive to starboard


@pytest.mark.slow
def test_patch_test_removes_biases(tmp_path: Path) -> None:
    files = survey_of(tmp_path, simulated(4, WRONG, rms=0.6, pings=PINGS, beams=128))
    result = done(sonarmap("map", *files, "-o", tmp_path / "out", "--patch-test"))
    (roll,) = re.findall(r"patch test: .*roll ([+-][\d.]+)", " ".join(result.stderr.split()))
    assert float(roll) == pytest.approx(0.5, abs=0.05)
    recorded, found = (
        json.loads((tmp_path / "out" / "lines.json").read_text())[name] for name in ("patch_test", "crossings")
    )
    assert recorded["biases"]["roll_deg"] == pytest.approx(0.5, abs=0.05)  # of the lines as they were recorded
    assert found["after"]["all"]["p95_m"] < 0.5 * found["before"]["all"]["p95_m"]
    # soundings without the biases are those that the map was fused from
    folder = read_map_folder(tmp_path / "out")
    cloud = Cloud(folder, folder.parts[0], None, mapped_scans(folder))
    assert same_as_fused(folder, np.concatenate([portion.points for portion in cloud.portions()]))


def test_options_without_effect_on_lines_are_refused(survey: Survey, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("stamp,x_m,y_m\n0,0,0\n1,1,1\n")
    file = survey_of(tmp_path, survey)[0]
    refused(sonarmap("map", file, "-o", tmp_path, "--priors", log), "contain their own navigation", "leave --priors")
    refused(sonarmap("map", file, "-o", tmp_path, "--patch-test"), "two lines", "1 given")
    refused(sonarmap("map", file, "-o", tmp_path, "--patch", "-3"), "above 0")
    for verb in (("map", "-o", tmp_path), ("inspect",)):
        refused(sonarmap(*verb, file, "--heights", "ellipsoid"), "0.gsf: it has no heights above the ellipsoid")
    refused(sonarmap("map", file, "-o", tmp_path, "--frame", "frd"), "defines both")
    refused(sonarmap("map", file, "-o", tmp_path, "--range-scale", "1.02"), "--range-scale cannot be used")


def test_inspect_shows_lines(survey: Survey, tmp_path: Path) -> None:
    files = survey_of(tmp_path, survey)
    text = " ".join(done(sonarmap("inspect", files[0])).stdout.split())
    assert "250 pings, 32,000 soundings" in text
    assert "0.0 % rejected" in text
    (line,) = printed(sonarmap("inspect", files[1], "--json"))["lines"]
    assert line["pings"] == PINGS
    assert line["length"] == pytest.approx(2.4 * PINGS / 5, rel=0.1)


def test_inspect_says_what_heights_count_from(tmp_path: Path) -> None:
    (tmp_path / "line.kmall").write_bytes(kmall(LINE))
    said(done(sonarmap("inspect", tmp_path, "--heights", "ellipsoid")), "heights are above the ellipsoid")
    notes = printed(sonarmap("inspect", tmp_path, "--json"))["notes"]
    assert any("depths count from the water line, which was 44.75 m above the ellipsoid" in note for note in notes)


FILES = {"navigation.csv", "soundings.laz", "lines.json"}


def test_files_of_lines_are_listed_in_the_summary(mapped: Path, tmp_path: Path) -> None:
    summary = json.loads((mapped / "out" / "summary.json").read_text())
    assert set(summary["files"]) >= FILES
    assert summary["georeference"]["latitude"] == HERE.latitude


@pytest.mark.slow
def test_map_scans_accepts_a_folder_of_lines(mapped: Path) -> None:
    (mapped / "some").mkdir()
    for k in (1, 2):
        shutil.copy(mapped / f"{k}.gsf", mapped / "some")
    result = sonarmap_package.map_scans(mapped / "some")
    assert len(result.components) == 1
    assert set(result.surveys) == {0, 1}
    assert all(edge.kind == "loop" for edge in result.edges)  # along a line nothing is registered
