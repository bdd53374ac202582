"""Real files of Kongsberg, where the folder of shared data lies beside the checkout, against a second decoding of their
bytes at the manuals' offsets. themachinethatgoesping (0.37) found the same numbers in all of their pings."""

import json
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np
import pytest

from sonarmap.tools.files.map_folder.folder import mapped_scans, read_map_folder
from sonarmap.tools.files.readers.pings.line_file import LineReading, read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.clutter_scans import done, printed, sonarmap, table_of
from tests.samples.places import DATA

FOLDER = DATA / "real" / "kongsberg"
NEAR = 0.01  # meters
# {file: fans, soundings, accepted soundings}
KMALL = {
    "OS01_1927233285749584930": (6, 2960, 2294),
    "OS01_3143030977387811190": (6, 2960, 2354),
    "OS01_3302724264148330173": (5, 2448, 2425),
    "OS03_2233208777057696242": (5, 2448, 2118),
    "OS03_4033476991022010987": (5, 2448, 2448),
}
ALL = {
    "em2040_57m": (12, 4800, 4787),
    "em2040_two_receivers": (12, 4800, 4799),
    "em2040c_one_position": (35, 14000, 13555),
}


def real(name: str) -> Path:
    path = FOLDER / name
    if not path.is_file():
        pytest.skip("shared/data/real/kongsberg is not beside the checkout")
    return path


def fans_of_kmall(content: bytes) -> Iterator[tuple[float, np.ndarray, np.ndarray, float]]:
    """Stamp, latitude and longitude of each fan, (n, 3) latitudes, longitudes and heights of its accepted soundings,
    those that the echo sounder itself computed, and the height of the water line above the ellipsoid."""
    start = 0
    while start < len(content):
        size, kind = struct.unpack_from("<I4s", content, start)
        if kind == b"#MRZ":
            seconds, rest = struct.unpack_from("<II", content, start + 12)
            place = np.array(struct.unpack_from("<dd", content, start + 36 + 124))
            (water,) = struct.unpack_from("<f", content, start + 36 + 108)
            (height,) = struct.unpack_from("<f", content, start + 36 + 140)
            sectors, each = struct.unpack_from("<HH", content, start + 36 + 92)
            received = start + 36 + 152 + sectors * each
            (count,) = struct.unpack_from("<H", content, received + 2)
            rows = list[tuple[float, float, float]]()
            for k in range(count):
                sounding = received + 32 + 120 * k
                if content[sounding + 3] == 0 and content[sounding + 4] > 0:
                    north, east, down = struct.unpack_from("<fff", content, sounding + 88)
                    rows.append((place[0] + north, place[1] + east, water - down))
            yield seconds + rest * 1e-9, place, np.array(rows).reshape(-1, 3), height - water
        start += size


def fans_of_all(content: bytes) -> Iterator[tuple[int, float, np.ndarray]]:
    """Time of day [ms], heading [deg] and (n, 3) accepted soundings of each fan: forward, starboard, down from the
    water."""
    start = 0
    while start < len(content):
        size, _, kind = struct.unpack_from("<IBB", content, start)
        if kind == ord("X"):
            (moment,) = struct.unpack_from("<I", content, start + 12)
            heading, _, deep, count = struct.unpack_from("<HHfH", content, start + 20)
            rows = [struct.unpack_from("<3fHBbBb", content, start + 40 + 20 * k) for k in range(count)]
            kept = [(x, y, z + deep) for z, y, x, *_, detection, cleaning in rows if detection < 128 and cleaning >= 0]
            yield moment, heading / 100, np.array(kept)
        start += 4 + size


def check_counts(line: RecordedLine, counts: tuple[int, int, int]) -> None:
    assert (len(line.stamps), line.beams, len(line.points)) == counts


@pytest.mark.parametrize("name", KMALL)
def test_soundings_of_a_kmall_are_where_the_echo_sounder_places_them(name: str) -> None:
    path = real(f"{name}.kmall")
    line = read_line(path, [])
    check_counts(line, KMALL[name])
    origin = line.origin()
    placed = line.placed(origin)
    fans = sorted(fans_of_kmall(path.read_bytes()), key=lambda fan: fan[0])
    for k, (stamp, place, soundings, _) in enumerate(fans):
        assert line.stamps[k] == pytest.approx(stamp, abs=1e-6)
        np.testing.assert_allclose(placed.places[k], origin.local(np.array([[*place, 0.0]]))[0], atol=NEAR)
        there = placed.world_points()[placed.pings == k]
        np.testing.assert_allclose(there, origin.local(soundings) if len(soundings) else there, atol=NEAR)
    assert any("depths count from the water line, which was 4" in note for note in line.notes)


@pytest.mark.parametrize("name", KMALL)
def test_heights_above_the_ellipsoid_are_those_of_the_bytes(name: str) -> None:
    """The mean of a file, as it is shorter than a minute; on the still water of OS03 that is the height of each fan."""
    path = real(f"{name}.kmall")
    line = read_line(path, [], LineReading(heights="ellipsoid"))
    origin = line.origin()
    heights = origin.geodetic(line.placed(origin).world_points())[:, 2]
    fans = sorted(fans_of_kmall(path.read_bytes()), key=lambda fan: fan[0])
    levels = np.array([level for *_, level in fans])
    for k, (_, _, soundings, level) in enumerate(fans):
        np.testing.assert_allclose(heights[line.pings == k], soundings[:, 2] + levels.mean(), atol=NEAR)
        assert not name.startswith("OS03") or abs(level - levels.mean()) < 0.001


def heights_in_cells(path: Path, cell: float) -> dict[tuple[int, int], float]:
    """Median height [m] of the soundings in each cell of easting and northing."""
    heights = defaultdict[tuple[int, int], list[float]](list)
    for east, north, height in laspy.read(path).xyz.tolist():
        heights[int(east // cell), int(north // cell)].append(height)
    return {key: float(np.median(values)) for key, values in heights.items()}


@pytest.mark.slow
def test_two_visits_agree_above_the_ellipsoid(tmp_path: Path) -> None:
    """Half an hour apart, between which the tide rose by 0.36 m."""
    visits = [tmp_path / "before", tmp_path / "after"]
    for out, name in zip(visits, ("OS03_4033476991022010987", "OS03_2233208777057696242"), strict=True):
        path = real(f"{name}.kmall")
        done(sonarmap("map", path, "-o", out, "--heights", "ellipsoid"))
        summary = json.loads((out / "summary.json").read_text())
        assert (summary["settings"]["heights"], summary["georeference"]["vertical"]) == ("ellipsoid", "ellipsoid")
        line = read_line(path, [], LineReading(heights="ellipsoid"))
        heights = [float(row["height_m"]) for row in table_of(out / "navigation.csv")]
        np.testing.assert_allclose(heights, line.fixes[:, 2], atol=NEAR)
        np.testing.assert_allclose(
            mapped_scans(read_map_folder(out))[0].points, line.points - line.sensors[2], atol=NEAR
        )
    changes = printed(sonarmap("compare", *visits, "--same-frame", "-o", tmp_path / "changes", "--json"))
    assert changes["regions"] == []
    assert changes["level_of_detection_m"] < 0.05
    areas = changes["areas_m2"]
    assert areas["unchanged"] > 0.6 * sum(areas.values())
    # as `compare` estimates a common shift of the maps first, the heights of their soundings, in cells of 0.25 m
    before, after = (heights_in_cells(out / "soundings.laz", 0.25) for out in visits)
    rises = [after[cell] - before[cell] for cell in before.keys() & after.keys()]
    assert len(rises) > 50
    assert abs(np.median(rises)) < 0.05


@pytest.mark.parametrize("name", ALL)
def test_soundings_of_an_all_file_are_those_of_its_bytes(name: str) -> None:
    path = real(f"{name}.all")
    line = read_line(path, [])
    check_counts(line, ALL[name])
    fans = sorted(fans_of_all(path.read_bytes()), key=lambda fan: fan[0])
    for k, (moment, heading, soundings) in enumerate(fans):
        assert line.stamps[k] % 86400 == pytest.approx(moment / 1000, abs=1e-4)
        assert np.degrees(line.attitudes[k, 2]) == pytest.approx(heading, abs=0.005)
        np.testing.assert_allclose(line.points[line.pings == k], soundings * [1, -1, -1], atol=NEAR)


def test_the_active_position_system_is_named_and_places_the_pings() -> None:
    """The only position of system 1: 51.63925635, 2.5650142 at 73.861 s, 2.42 m/s with a course of 174.24 degrees."""
    line = read_line(real("em2040_two_receivers.all"), [])
    assert line.notes[0] == "positions are those of system 1, which is active; not those of 3"
    north = (line.fixes[:, 0] - 1032785127 / 2e7) * 111_320
    np.testing.assert_allclose(north, 2.42 * np.cos(np.radians(174.24)) * (line.stamps % 1000 - 73.861), atol=NEAR)
    assert not any("level" in note for note in line.notes)


@pytest.mark.parametrize("name", [*(f"{name}.kmall" for name in KMALL), *(f"{name}.all" for name in ALL)])
def test_inspect_reads_every_file(name: str) -> None:
    counts = (KMALL | ALL)[name.partition(".")[0]]
    (line,) = printed(done(sonarmap("inspect", real(name), "--json")))["lines"]
    assert (line["pings"], line["beams"], line["beams"] - line["rejected"]) == counts
