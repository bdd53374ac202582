"""Kongsberg's .kmall: split, longer, short, late and doubled datagrams, flags, and which sensors count."""

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.clouds.cloud import scan_of_cloud
from sonarmap.tools.files.readers.pings.line_file import LineReading, line_clouds, placed, read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.refusals import refuses
from tests.tools.files.readers.pings.kmall_file import (
    DEPTH,
    HEIGHT,
    UNKNOWN,
    WATER,
    datagram,
    installation,
    kmall,
    motion,
    ping,
    position,
)
from tests.tools.files.readers.pings.samples import LINE, SPEED, START, sample

ROUNDED = 1e-5  # meters, of 32-bit numbers
NOWHERE = (UNKNOWN, UNKNOWN)
ABOVE = f"{HEIGHT - WATER:.2f} m above the ellipsoid"
HEIGHTS = f"depths count from the water line, which was {ABOVE}: --heights ellipsoid removes tides"


def read(folder: Path, content: bytes | Sequence[bytes], reading: LineReading | None = None) -> RecordedLine:
    path = folder / "line.kmall"
    path.write_bytes(content if isinstance(content, bytes) else b"".join(content))
    return read_line(path, [], reading or LineReading())


def level(stamp: float = START) -> bytes:
    """Attitudes of 0, for lines that have nothing to say about them."""
    return motion([(stamp + 0.25 * k, 0.0, 0.0) for k in range(-1, 30)])


def pings(**options) -> list[bytes]:
    return [part for k in range(12) for part in ping(LINE, k, **options)]


def same(found: RecordedLine) -> None:
    np.testing.assert_allclose(found.points, LINE.kept, atol=ROUNDED)
    np.testing.assert_allclose(found.fixes[:, :2], LINE.fixes, atol=1e-9)
    np.testing.assert_allclose(found.stamps, LINE.stamps, atol=1e-7)


def test_a_line_has_its_sounder_speed_and_heights(tmp_path: Path) -> None:
    found = read(tmp_path, kmall(LINE))
    same(found)
    assert (found.echo_sounder, found.sound_speed) == ("Kongsberg EM2042", SPEED)
    assert found.notes == (HEIGHTS,)
    for unknown in (-999.0, 0.0, np.nan):
        assert read(tmp_path, [level(), *pings(height=unknown)]).notes == ()
    assert found.below_water


@pytest.mark.parametrize("parts", [2, 5])
def test_parts_of_a_split_ping_are_joined(tmp_path: Path, parts: int) -> None:
    """In any order, and after parts of another fan with the same time."""
    same(read(tmp_path, kmall(LINE, parts=parts)))
    line = sample(2)
    line.stamps[1] = line.stamps[0]
    first, second = (ping(line, k, parts=parts) for k in (0, 1))
    mixed = [part for pair in zip(first, second, strict=True) for part in pair]
    found = read(tmp_path, [level(), *mixed])
    np.testing.assert_allclose(found.points, line.kept, atol=ROUNDED)
    backward = read(tmp_path, [level(), *first[::-1], *second[::-1]])
    np.testing.assert_array_equal(backward.points, found.points)
    assert backward.notes == (HEIGHTS,)


def test_a_ping_without_a_part_is_left_out(tmp_path: Path) -> None:
    parts = [ping(LINE, k, parts=3) for k in range(12)]
    del parts[4][1]
    parts[7][2] = datagram("#MRZ", LINE.stamps[7], struct.pack("<2H", 3, 4) + bytes(900))
    found = read(tmp_path, [level(), *(part for each in parts for part in each)])
    np.testing.assert_allclose(found.stamps, np.delete(LINE.stamps, [4, 7]), atol=1e-7)
    assert "3 datagrams and 0 bytes left out; a datagram #MRZ is part 4 of 3" in found.notes[-1]


def test_structures_of_later_versions_are_longer(tmp_path: Path) -> None:
    same(read(tmp_path, kmall(LINE, longer=4)))


def test_datagrams_may_come_in_any_order(tmp_path: Path) -> None:
    parts = [installation(START), *pings(), *(motion([(t, 3.0 + k, 1.0)]) for k, t in enumerate(LINE.stamps.tolist()))]
    whole = read(tmp_path, parts)
    shuffled = read(tmp_path, [parts[k] for k in np.random.default_rng(5).permutation(len(parts))])
    for name in ("points", "attitudes", "fixes", "stamps", "sensors"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(whole, name))
    assert "came late, now in order" in shuffled.notes[-1]


def test_a_doubled_tail_is_read_once(tmp_path: Path) -> None:
    content = b"".join([level(), *pings()])
    found = read(tmp_path, content + content[-3000:])
    same(found)
    assert found.notes[1] == "2 pings that the file has twice are read once"
    assert "damaged or cut: 0 datagrams and " in found.notes[-1]
    same(read(tmp_path, content + content[-4:]))  # only the size after the content


def test_damage_is_skipped_and_noted(tmp_path: Path) -> None:
    parts = [level(), *pings()]
    parts[3] = parts[3][:200] + parts[3][230:]
    short = bytearray(parts[6])
    struct.pack_into("<H", short, 20 + 4 + 12 + 152 + 96 + 6, 100)  # the size of a sounding
    parts[6] = bytes(short)
    found = read(tmp_path, parts)
    np.testing.assert_allclose(found.stamps, np.delete(LINE.stamps, [2, 5]), atol=1e-7)
    left_out = f"1 datagram and {len(parts[3]):,} bytes left out"
    assert f"{left_out}; a datagram #MRZ has structures of 100 bytes; wanted" in found.notes[-1]


def test_a_file_cut_before_its_first_ping_is_refused(tmp_path: Path) -> None:
    content = b"".join([level(), *pings()])
    words = r"it holds no soundings \(damaged or cut: 0 datagrams and 100 bytes left out\); wanted datagrams #MRZ"
    refuses(words, read, tmp_path, content[: len(level()) + 100])


@pytest.mark.parametrize("short", [False, True])
def test_pings_without_a_place_are_placed_by_position_datagrams(tmp_path: Path, short: bool) -> None:
    """Those of the active system that are valid; a short one has all that is needed."""
    places = [position(t, p, short=short) for t, p in zip(LINE.stamps.tolist(), LINE.fixes.tolist(), strict=True)]
    others = [position(LINE.stamps[3], (58.2, -11.2), status=0x11), position(LINE.stamps[4], NOWHERE)]
    found = read(tmp_path, [level(), *pings(fix=NOWHERE), *places, *others])
    same(found)
    assert found.notes == (HEIGHTS,)
    cut = datagram("#SPO", START, struct.pack("<4H", 8, 0, 1, 0) + bytes(20))
    assert "a datagram #SPO has 28 bytes of content; wanted at least 36" in read(tmp_path, [*pings(), cut]).notes[-1]


def test_one_position_datagram_is_enough(tmp_path: Path) -> None:
    one = position(LINE.stamps[6], LINE.fixes[6].tolist(), speed=4.0, course=120.0)
    found = read(tmp_path, [level(), *pings(fix=NOWHERE), one])
    assert found.notes[0].startswith("only one position: pings within 2 s of it are placed by its speed")
    assert len(found.stamps) == 9
    refuses("it holds no position near its pings", read, tmp_path, [level(), *pings(fix=NOWHERE)])


def test_attitudes_are_those_of_the_active_sensor(tmp_path: Path) -> None:
    """At 100 a second, without samples that are flagged."""
    times = (START - 0.5 + 0.01 * np.arange(800)).tolist()
    rows = [(t, 2.0 + 0.5 * (t - START), -1.0 + 0.25 * (t - START)) for t in times]
    rows[60] = (times[60], 99.0, 99.0)
    other = motion([(t, 50.0, 40.0) for t in times], status=0, system=1)
    found = read(tmp_path, [*pings(), other, motion(rows[:400], wrong=[60]), motion(rows[400:])])
    after = found.stamps - START
    expected = np.column_stack([2.0 + 0.5 * after, -1.0 + 0.25 * after, LINE.attitudes[:, 2]])
    np.testing.assert_allclose(np.degrees(found.attitudes), expected, atol=1e-4)
    assert found.notes == (HEIGHTS,)


def test_the_transducer_is_at_its_arm_and_depth(tmp_path: Path) -> None:
    """Level: 6.5 m forward and 1.75 m to starboard; the second one 1.5 m aft and 0.25 m to starboard."""
    first, second = (read(tmp_path, [installation(START), level(), *pings(transmitter=k)]) for k in (0, 1))
    np.testing.assert_allclose(first.sensors, [[6.5, -1.75, -DEPTH]] * 12, atol=1e-9)
    np.testing.assert_allclose(second.sensors, [[-1.5, -0.25, -DEPTH]] * 12, atol=1e-9)


def test_types_methods_and_classes_of_detections_reject_soundings(tmp_path: Path) -> None:
    """Kept are the bottom's, and extra ones of a class that the operator enabled."""
    kinds = [(0, 1, 0), (0, 2, 0), (1, 2, 6), (0, 2, 104), (0, 0, 0), (1, 1, 100), (1, 1, 107), (2, 1, 0), (2, 0, 0)]
    found = read(tmp_path, [level(), *ping(LINE, 0, kinds=np.array(kinds))])
    np.testing.assert_allclose(found.points, LINE.points[0, :4] * [1, -1, -1], atol=ROUNDED)
    assert found.rejected == 5


ON_ELLIPSOID = LineReading(heights="ellipsoid")


def ellipsoid_heights(line: RecordedLine) -> np.ndarray:
    """(N,) heights of the soundings [m] at an origin of height 0."""
    origin = line.origin()
    return origin.geodetic(line.placed(origin).world_points())[:, 2]


def test_heights_above_the_ellipsoid_are_those_of_the_reference_point_less_z(tmp_path: Path) -> None:
    """A sounding's z is down from the reference point, which is HEIGHT above the ellipsoid. With roll and pitch the
    horizontal arm of the transducer does not change its depth, which the file has."""
    found = read(tmp_path, kmall(LINE), ON_ELLIPSOID)
    z = LINE.points[~LINE.rejected][:, 2] + WATER
    np.testing.assert_allclose(ellipsoid_heights(found), HEIGHT - z, atol=1e-4)
    sensors = found.placed(found.origin()).places[:, 2] + found.sensors[:, 2]
    np.testing.assert_allclose(sensors, HEIGHT - WATER - DEPTH, atol=2e-3)  # a plane is 2 mm lower than the Earth
    assert found.notes == (HEIGHTS, "heights are above the ellipsoid")
    same(found)  # all else is as with the water line


def test_a_height_is_the_mean_of_a_minute(tmp_path: Path) -> None:
    """Waves of 1.5 s, whose heights are late, and a tide of 0.36 m in an hour: within each group the water is level."""
    wave = 0.1 * np.array([0.0, 1.0, -1.0] * 4)
    parts = [part for k in range(12) for part in ping(LINE, k, height=HEIGHT + wave[k])]
    later = replace(LINE, stamps=LINE.stamps + 3600)
    more = [part for k in range(12) for part in ping(later, k, height=HEIGHT - 0.36 + wave[k])]
    found = read(tmp_path, [level(), *parts, *more], ON_ELLIPSOID)
    expected = np.where(found.stamps < START + 60, HEIGHT - WATER, HEIGHT - WATER - 0.36)
    np.testing.assert_allclose(found.fixes[:, 2], expected, atol=1e-5)


def test_pings_without_a_height_get_that_of_others_or_are_left_out(tmp_path: Path) -> None:
    """Within half a minute; a file without any is refused by its name."""
    parts = [part for k in range(12) for part in ping(LINE, k, height=HEIGHT if k == 7 else -999.0)]
    far = replace(LINE, stamps=LINE.stamps + 60)
    parts += [part for k in range(3) for part in ping(far, k, height=0.0)]
    found = read(tmp_path, [level(), *parts], ON_ELLIPSOID)
    same(found)
    np.testing.assert_allclose(found.fixes[:, 2], HEIGHT - WATER, atol=1e-5)
    assert found.notes[-1].endswith("pings left out, without a height above the ellipsoid")
    words = "line.kmall: it has no heights above the ellipsoid; leave --heights ellipsoid out"
    refuses(words, read, tmp_path, [level(), *pings(height=-999.0)], ON_ELLIPSOID)
    refuses("heights above 'MSL': wanted surface or ellipsoid", LineReading, heights="MSL")


def test_patches_and_their_map_are_above_the_ellipsoid(tmp_path: Path) -> None:
    read(tmp_path, kmall(LINE))
    for reading, vertical, above in ((LineReading(), "surface", 0), (ON_ELLIPSOID, "ellipsoid", HEIGHT - WATER)):
        clouds = list(line_clouds(tmp_path / "line.kmall", [], reading))
        patches = {k: cloud.patch for k, cloud in enumerate(clouds) if cloud.patch is not None}
        scans = [scan_of_cloud(cloud, f"{k}", 0.0)[0] for k, cloud in enumerate(clouds)]
        there, georeference = placed(scans, patches)
        heights = [scan.prior.T_world_sensor.translation[2] for scan in there if scan.prior is not None]
        np.testing.assert_allclose(heights, above - DEPTH, atol=2e-3)
        assert georeference.vertical == vertical
    here = replace(georeference, vertical="MSL")
    refuses("--vertical MSL contradicts --heights ellipsoid", placed, scans, patches, here)
