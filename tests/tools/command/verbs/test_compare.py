"""`sonarmap compare` end to end: what it prints and writes, and its exit codes; and `sonarmap.compare`."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.clouds.ply import read_ply_columns
from sonarmap.tools.products.compare.detection import Verdict
from tests.samples.clutter_scans import (
    T_WORLD_SENSOR,
    clutter,
    done,
    files_in,
    printed,
    refused,
    said,
    sonarmap,
    table_of,
    write,
)
from tests.tools.products.export.finished import finished_map

GRID = ("--grid", "64")
MAPPING = (*GRID, "--map-voxel", "0.4", "--no-report", "--quiet")
KEYS = {"old", "new", "alignment", "voxel_m", "core_points", "level_of_detection_m", "sigmas_widened", "areas_m2"}
KEYS |= {"regions", "notes", "volume_sigmas_widened"}
REGION = {"number", "kind", "area_m2", "height_m", "volume_m3", "volume_sigma_m3", "unseen_m2", "core_points"}
REGION |= {"place_m", "lowest_m", "highest_m"}
FILES = {"changes.json", "changes.ply", "changes.csv", "changes.png"}


def scans(folder: Path, seed: int, poses: list[int], dug: float = 0.0, scene: int = 1) -> Path:
    """Scans of clutter over a bed, which is lower by `dug` [m] in a square of 4 m."""
    rng = np.random.default_rng(seed)
    clouds: dict[str, Any] = {}
    for pose in poses:
        flat = rng.uniform(-12, 12, (9000, 2))
        inside = (np.abs(flat - [6.0, -5.0]) < 2).all(axis=1)
        bed = np.column_stack([flat, -5.5 + 0.02 * flat[:, 0] - dug * inside])
        points = np.concatenate([clutter(scene), bed])
        points = points + rng.normal(0, 0.03, points.shape)
        clouds[f"scan_{pose}"] = T_WORLD_SENSOR[pose].inv().apply(points).astype(np.float32)
    write(folder, **clouds)
    return folder


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Maps of one place, of the same place later from other poses, and of another place."""
    root = tmp_path_factory.mktemp("compare")
    given = {
        "old": scans(root / "a", 1, [0, 1, 2]),
        "new": scans(root / "b", 2, [1, 2, 3], dug=1.0),
        "other": scans(root / "c", 3, [0, 1, 2], scene=2),
    }
    for name, folder in given.items():
        done(sonarmap("map", folder, "-o", root / name, *MAPPING))
    return {name: root / name for name in given}


@pytest.fixture(scope="module")
def compared(maps: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """The printed JSON and the output folder."""
    out = tmp_path_factory.mktemp("out")
    return printed(sonarmap("compare", maps["old"], maps["new"], "-o", out, *GRID, "--json")), out


@pytest.mark.slow
def test_only_the_hole_is_reported(compared: tuple[dict[str, Any], Path]) -> None:
    result, out = compared
    assert result.keys() == KEYS | {"aligned", "files"}
    assert set(files_in(out)) == FILES
    assert {Path(name).name for name in result["files"]} == FILES
    (region,) = result["regions"]
    assert region.keys() == REGION
    assert region["kind"] == "lost"
    assert abs(region["volume_m3"] + 16) < 2.5 * region["volume_sigma_m3"]
    # the old map's frame is that of its first scan
    np.testing.assert_allclose(region["place_m"][:2], [6.0, -5.0], atol=0.5)
    T_old_new = np.array(result["alignment"]["T_old_new"])
    truth = (T_WORLD_SENSOR[0].inv() * T_WORLD_SENSOR[1]).as_matrix()
    np.testing.assert_allclose(T_old_new, truth, atol=0.15)


@pytest.mark.slow
def test_the_files_agree_with_the_printed_json(compared: tuple[dict[str, Any], Path]) -> None:
    result, out = compared
    written = json.loads((out / "changes.json").read_text())
    assert written["regions"] == result["regions"]
    (row,) = table_of(out / "changes.csv")
    assert float(row["volume_m3"]) == pytest.approx(result["regions"][0]["volume_m3"], abs=1e-3)
    columns = read_ply_columns((out / "changes.ply").read_bytes())
    assert len(columns["verdict"]) == result["core_points"]
    assert (columns["region"] == 1).sum() == result["regions"][0]["core_points"]
    assert np.isnan(columns["distance"][columns["verdict"] == Verdict.OLD_ONLY]).all()
    with Image.open(out / "changes.png") as picture:
        assert picture.format == "PNG"


@pytest.mark.slow
def test_maps_on_the_earth_give_a_geotiff(maps: dict[str, Path], tmp_path: Path) -> None:
    place = ("--origin", "60.0,9.0,-3")
    result = done(sonarmap("compare", maps["old"], maps["old"], "-o", tmp_path, *GRID, *place))
    assert "0 regions changed" in result.stdout
    assert "nothing can have changed" in result.stderr
    assert set(files_in(tmp_path)) == FILES | {"changes.tif"}
    with rasterio.open(tmp_path / "changes.tif") as raster:
        distance, _, verdict = raster.read(masked=True)
        assert raster.crs.to_epsg() == 32632
    assert np.quantile(np.abs(distance.compressed()), 0.9) < 0.01
    assert (verdict.compressed() == Verdict.UNCHANGED).mean() > 0.5


def test_same_frame_compares_positions_on_the_earth(tmp_path: Path) -> None:
    """The later map's frame has its origin 20 m farther north; its points are the same."""
    old = finished_map(tmp_path / "old", georeference=Georeference(60.0, 9.0, height=-3.0))
    north = Georeference(60.0 + 20 / 111_412, 9.0, height=-3.0)
    given = ("--same-frame", "--json")
    same = printed(sonarmap("compare", old, old, "-o", tmp_path / "a", *given))
    assert same["alignment"] is None
    assert (same["regions"], same["areas_m2"]["new_only"]) == ([], 0)
    new = finished_map(tmp_path / "new", georeference=north)
    apart = printed(sonarmap("compare", old, new, "-o", tmp_path / "b", *given))
    assert apart["areas_m2"]["unchanged"] < 0.2 * same["areas_m2"]["unchanged"]
    other = finished_map(tmp_path / "other", georeference=replace(north, vertical="MSL"))
    refused(sonarmap("compare", old, other, "-o", tmp_path / "c", *given[:1]), "count from 'surface'")


@pytest.mark.slow
def test_maps_of_two_places_are_refused(maps: dict[str, Path], tmp_path: Path) -> None:
    given = ("compare", maps["old"], maps["other"], "-o", tmp_path / "x", *GRID)
    result = sonarmap(*given)
    assert result.exit_code == 3
    said(result, "cannot be aligned with")
    assert not files_in(tmp_path / "x")
    assert printed(sonarmap(*given, "--json"), exit_code=3)["aligned"] is False


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "wanted OLD and NEW, or --surveys"),
        (("new", "--surveys"), "leave NEW out"),
        (("--surveys",), "has one survey"),
        (("--surveys", "--same-frame"), "--same-frame has no effect"),
        (("new", "--reach", "0"), "above 0"),
        (("new", "--crs", "EPSG:32632"), "--crs has no effect"),
    ],
)
def test_invalid_arguments_are_refused(options: tuple[str, ...], words: str, tmp_path: Path) -> None:
    maps = {name: finished_map(tmp_path / name) for name in ("old", "new")}
    given = [maps.get(each, each) for each in options]
    refused(sonarmap("compare", maps["old"], *given, "-o", tmp_path), words)
    refused(sonarmap("compare", maps["old"], maps["new"], "-o", maps["new"]), "is a map's folder")


@pytest.mark.slow
def test_surveys_of_one_map_are_compared(maps: dict[str, Path], tmp_path: Path) -> None:
    root = maps["old"].parent
    done(sonarmap("map", root / "a", root / "b", "-o", tmp_path / "both", *MAPPING))
    result = printed(sonarmap("compare", tmp_path / "both", "--surveys", "-o", tmp_path / "out", "--json"))
    (pair,) = result["pairs"]
    assert (pair["old"], pair["new"], pair["alignment"]) == ("survey 0", "survey 1", None)
    assert set(files_in(tmp_path / "out" / "survey_0_1")) == FILES
    assert [region["kind"] for region in pair["regions"]] == ["lost"]
