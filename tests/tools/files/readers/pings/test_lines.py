"""Lines of multibeam echo sounders: soundings come back in the world, flags are honored, levers by hand arithmetic."""

import ctypes
import re
import struct
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gsfpy3_09 import bindings
from gsfpy3_09.enums import FileMode
from gsfpy3_09.gsfDataID import c_gsfDataID
from gsfpy3_09.gsfRecords import c_gsfRecords

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.pings.line_file import LineReading, line_clouds, read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.samples.refusals import refuses
from tests.tools.files.readers.pings import kmall_file
from tests.tools.files.readers.pings.datagrams import DEPTHS, EM, LAYOUT, SUFFIXES, written
from tests.tools.files.readers.pings.samples import (
    DRAFT,
    LINE,
    OFFSET,
    SPEED,
    START,
    Beams,
    Sample,
    fan,
    sample,
    write_gsf,
    xtf,
)

TOLERANCE = 0.002  # meters: what the formats round to
TURN = 0.02  # degrees, as .all rounds headings to 0.01


def read(path: Path, content: bytes | None = None) -> RecordedLine:
    if content is not None:
        path.write_bytes(content)
    notes: list[str] = []
    line = read_line(path, notes)
    assert notes == [f"{path.name}: {note}" for note in line.notes]
    return line


def in_the_world(line: Sample, origin: Georeference) -> np.ndarray:
    """(N, 3) East, North, Up of a sample's soundings, by hand: East of the origin, true North lies to the left."""
    places = origin.local(np.column_stack([line.fixes, np.zeros(len(line.stamps))]))
    convergence = (line.fixes[:, 1] - origin.longitude) * np.sin(np.radians(origin.latitude))
    heading = np.radians(line.attitudes[:, 2] - convergence)[:, None]
    x, y, z = np.moveaxis(line.points, 2, 0)
    east = places[:, :1] + x * np.sin(heading) + y * np.cos(heading)
    north = places[:, 1:2] + x * np.cos(heading) - y * np.sin(heading)
    return np.stack([east, north, -z], axis=-1)[~line.rejected]


@pytest.mark.parametrize(("deep", "draught"), [(1.5, 0.0), (0.0, 0.0), (0.0, 1.5)])
def test_depths_are_below_the_water_where_the_draught_is_known(tmp_path: Path, deep: float, draught: float) -> None:
    """By the file or by the user; where it is not, a note says so, and heights are above the transducer."""
    path, notes = tmp_path / "line.xtf", list[str]()
    path.write_bytes(xtf(LINE, fan(12), deep=deep))
    clouds = list(line_clouds(path, notes, LineReading(draught=draught)))
    known = [cloud.patch for cloud in clouds if cloud.patch is not None]
    heights = np.array([patch.geodetic[2] for patch in known])
    path.write_bytes(xtf(LINE, fan(12), deep=1.5))
    truth = [cloud.patch.geodetic[2] for cloud in line_clouds(path, [], LineReading()) if cloud.patch is not None]
    is_known = deep + draught > 0
    np.testing.assert_allclose(heights, np.array(truth) + (0.0 if is_known else 1.5), atol=TOLERANCE)
    assert all(patch.below_water == is_known for patch in known)
    assert any("--draught M" in note for note in notes) != is_known
    if deep == 0:
        with pytest.raises(InputError, match="has the depth of its transducer; leave --draught out"):
            list(line_clouds(path, [], LineReading(draught=1.0)))


@pytest.mark.parametrize("suffix", [".gsf", ".all", ".kmall"])
def test_soundings_are_placed_in_the_world(tmp_path: Path, suffix: str) -> None:
    line = read(written(tmp_path, suffix))
    np.testing.assert_allclose(line.stamps, LINE.stamps, atol=1e-3)
    np.testing.assert_allclose(line.points, LINE.kept, atol=TOLERANCE)
    np.testing.assert_allclose(np.degrees(line.attitudes), LINE.attitudes, atol=TURN)
    np.testing.assert_allclose(line.fixes[:, 0], LINE.fixes[:, 0], atol=1e-7)
    np.testing.assert_allclose(line.fixes[:, 1], LINE.fixes[:, 1], atol=1e-7)
    assert (line.beams, line.rejected) == (LINE.rejected.size, LINE.rejected.sum())
    assert line.origin() == Georeference(58.12346, -11.65432)
    for origin in (line.origin(), Georeference(58.2, -11.3)):  # 20 km away, where North turns by 0.3 degrees
        expected = in_the_world(LINE, origin)
        np.testing.assert_allclose(line.placed(origin).world_points(), expected, atol=0.015)
    np.testing.assert_allclose(line.placed(line.origin()).world_points()[0], in_the_world(LINE, line.origin())[0],
                               atol=TOLERANCE)  # fmt: skip


@pytest.mark.parametrize("equal_angles", [False, True])
def test_ranges_and_angles_become_soundings(tmp_path: Path, equal_angles: bool) -> None:
    """Of an R2Sonic: rolled to starboard by 10 degrees, a beam 20 degrees to starboard points 10 degrees to port."""
    line, beams = sample(), fan(len(LINE.stamps))
    found = read(tmp_path / "line.xtf", xtf(line, beams, equal_angles=equal_angles, tide=0.75))
    kept = np.ones(10, bool)
    kept[[2, 9]] = False
    for k, each in enumerate(beams):
        ranges, (roll, pitch, _) = each.times * SPEED / 2, np.radians(line.attitudes[k])
        across, down = ranges * np.sin(each.angles - roll), ranges * np.cos(each.angles - roll)
        # bow up: what is below the vehicle moves forward
        rows = np.column_stack([down * np.sin(pitch), -across, line.heave[k] - 1.5 - down * np.cos(pitch)])
        np.testing.assert_allclose(found.points[found.pings == k], rows[kept], atol=TOLERANCE)
    assert (found.beams, found.rejected) == (120, 24)
    assert (found.sound_speed, found.echo_sounder) == (SPEED, "R2Sonic 2024")
    np.testing.assert_allclose(found.sensors, np.column_stack([0 * line.heave, 0 * line.heave, line.heave - 1.5]))
    np.testing.assert_array_equal(found.fixes[:, 2], 0.75)
    assert not found.placed(found.origin()).beam_angles()[:4].max() > 0  # the first beams are on the port side


@pytest.mark.parametrize(
    ("mount", "angle", "expected"),
    [
        ((0.0, 0.0, 0.0), 30.0, (0, -5, -8.660)),
        ((10.0, 0.0, 0.0), 0.0, (0, 1.736, -9.848)),
        ((0.0, 10.0, 0.0), 0.0, (1.736, 0, -9.848)),
        ((0.0, 0.0, 90.0), 30.0, (-5, 0, -8.660)),
    ],
)
def test_the_mounting_of_an_array_turns_its_beams(tmp_path: Path, mount: tuple, angle: float, expected: tuple) -> None:
    """A beam of 10 m, by hand: starboard side down, down goes to port; bow up, forward; turned right, starboard is
    aft."""
    line = sample(1)
    line.attitudes[:], line.heave[:] = (0, 0, 0), 1.5
    beams = [Beams(np.full(2, 20 / SPEED), np.radians([angle - 1, angle]), np.full(2, 0b1011))]
    found = read(tmp_path / "line.xtf", xtf(line, beams, mount=mount))
    np.testing.assert_allclose(found.points[-1], expected, atol=TOLERANCE)


@pytest.mark.parametrize("lag", [0.0, 0.125])
def test_attitudes_of_an_xtf_are_interpolated(tmp_path: Path, lag: float) -> None:
    """As pings have the latest one, which may be old; steps are half a second."""
    found = read(tmp_path / "line.xtf", xtf(LINE, fan(12), lag=lag))
    expected = LINE.attitudes[:-1] + lag / 0.5 * np.diff(LINE.attitudes, axis=0)
    np.testing.assert_allclose(np.degrees(found.attitudes[:-1]), expected, atol=1e-4)


def test_gsf_has_longitude_before_latitude_in_the_file(tmp_path: Path) -> None:
    """gsfpy names them the wrong way round: the bytes decide. A ping is its time, longitude, latitude."""
    path = write_gsf(tmp_path / "line.gsf", LINE.first(1))
    content = path.read_bytes()
    place = content.find(struct.pack(">ii", int(START), round(START % 1 * 1e9)))
    longitude, latitude = struct.unpack_from(">ii", content, place + 8)
    assert (latitude, longitude) == (581234560, -116543210)
    line = read(path)
    assert (round(line.fixes[0, 0] * 1e7), round(line.fixes[0, 1] * 1e7)) == (latitude, longitude)


def test_the_transducer_of_a_gsf_is_placed_by_its_lever_arm(tmp_path: Path) -> None:
    line = sample(2)
    line.attitudes[:, :2], line.heave[:] = [(0, 0), (90, 0)], [0.25, 0.5]
    found = read(write_gsf(tmp_path / "line.gsf", line, tide=-0.75))
    x, y, z = OFFSET
    # level: forward, to port, its draft below the water, risen by heave; the water is 0.75 m above the datum
    np.testing.assert_allclose(found.sensors[0], [x, -y, -DRAFT + 0.25 + 0.75], atol=TOLERANCE)
    # rolled by a quarter, starboard down: what was down is to port, what was to starboard is down
    np.testing.assert_allclose(found.sensors[1], [x, z, (z - DRAFT) - y + 0.5 + 0.75], atol=TOLERANCE)
    np.testing.assert_allclose(found.points[:, 2], line.kept[:, 2] + 0.75, atol=TOLERANCE)
    np.testing.assert_array_equal(found.fixes[:, 2], 0.0)


def test_tides_of_a_gsf_are_applied_and_the_datum_is_noted(tmp_path: Path) -> None:
    """Either corrector was added to depths; the datum is told."""
    path, words = tmp_path / "line.gsf", [b"TIDAL_DATUM=MLLW"]
    by_gauge = read(write_gsf(path, LINE, tide=-0.75))
    by_gps = read(write_gsf(path, LINE, words=words, gps_tide_corrector=-0.75, sep=-31.5))
    np.testing.assert_allclose(by_gps.sensors, by_gauge.sensors, atol=1e-9)
    assert by_gauge.notes == ("depths are corrected for the tide: they count from a tidal datum",)
    assert by_gps.notes == ("depths are corrected for the tide: they count from MLLW, -31.50 m above the ellipsoid",)
    nulls = dict.fromkeys(("tide_corrector", "gps_tide_corrector", "depth_corrector"), 99.99)
    assert read(write_gsf(path, LINE, **nulls)).notes == ()


def test_the_depth_corrector_of_a_gsf_is_the_depth_of_a_submersible(tmp_path: Path) -> None:
    """Its depth is the depth corrector, from which the transducer lies by its lever; dynamic draft is none."""
    line = sample(2)
    line.attitudes[:, :2], line.heave[:] = 0, 0
    found = read(write_gsf(tmp_path / "line.gsf", line, depth_corrector=1200.0))
    np.testing.assert_allclose(found.sensors[:, 2], -1200.0 - OFFSET[2], atol=TOLERANCE)
    found = read(write_gsf(tmp_path / "line.gsf", line, depth_corrector=0.25))
    np.testing.assert_allclose(found.sensors[:, 2], -DRAFT, atol=TOLERANCE)


def test_flags_of_a_gsf_reject_soundings(tmp_path: Path) -> None:
    path = write_gsf(tmp_path / "line.gsf", LINE, ignored=(4,))
    line = read(path)
    assert line.rejected == LINE.rejected.sum() + (~LINE.rejected[4]).sum()
    assert 4 not in line.pings
    write_gsf(path, LINE, flags=False)
    assert read(path).rejected == 0


def test_the_transducer_of_a_kongsberg_is_placed_by_its_lever_arm(tmp_path: Path) -> None:
    """From the antenna of the active system to the transducer: 8.75 m forward, 1 m to starboard, 13.25 m down."""
    line = sample(3)
    line.attitudes[:, :2] = 0
    found = read(tmp_path / "line.all", EM.file(line))
    np.testing.assert_allclose(found.sensors, [[8.75, -1.0, -DEPTHS]] * 3, atol=TOLERANCE)
    line.attitudes[:, 1] = 30  # bow up: down becomes forward
    found = read(tmp_path / "line.all", EM.file(line))
    x = 8.75 * np.cos(np.pi / 6) + 13.25 * np.sin(np.pi / 6)
    np.testing.assert_allclose(found.sensors[1], [x, -1.0, -DEPTHS], atol=TOLERANCE)


def test_two_heads_make_one_line(tmp_path: Path) -> None:
    layout = LAYOUT.replace("STC=1", "STC=2") + "S2X=1.00,S2Y=-2.00,S2Z=3.00,"
    line = sample(4)
    line.attitudes[:, :2] = 0
    found = read(tmp_path / "line.all", EM.file(line, layout, heads=(101, 202), second=202))
    np.testing.assert_allclose(found.points, line.kept, atol=TOLERANCE)
    np.testing.assert_allclose(found.sensors[:, 0], [8.75, 3.25, 8.75, 3.25])
    np.testing.assert_allclose(found.sensors[:, 1], [-1.0, 2.75, -1.0, 2.75])


def test_pings_are_sorted_and_continue_across_the_date_line(tmp_path: Path) -> None:
    line = sample(6)
    line.fixes[:, 1] = [179.99996, 179.99998, 180.0, -179.99998, -179.99996, -179.99994]
    parts = [EM.swath(line, k, DEPTHS) for k in (1, 0, 3, 2, 5, 4)]
    parts += [EM.position(line.stamps[k], *line.fixes[k]) for k in range(6)]
    found = read(tmp_path / "line.all", b"".join(parts))
    np.testing.assert_allclose(np.abs(found.fixes[:, 1]), np.abs(line.fixes[:, 1]), atol=1e-7)
    np.testing.assert_array_equal(found.points, read(tmp_path / "line.all").points)
    assert found.notes == ("6 pings without roll and pitch, taken as level", "3 pings came late, now in order")
    assert np.ptp(found.placed(found.origin()).places[:, 0]) < 10


def test_pings_without_a_position_are_left_out(tmp_path: Path) -> None:
    parts = [EM.swath(LINE, k, DEPTHS) for k in range(12)]
    parts += [EM.position(LINE.stamps[k], *LINE.fixes[k]) for k in (0, 1)]
    parts += [EM.motion(LINE.stamps[0], [(0.5 * k, 1.0, 2.0) for k in range(12)])]
    found = read(tmp_path / "line.all", b"".join(parts))
    assert len(found.stamps) == 6  # two seconds after the last position
    assert found.notes == ("6 pings left out, without a valid time, position or attitude",)


WRONG: list[tuple[str, Callable[[], bytes], str]] = [
    (".xtf", lambda: b"", r"the file is empty \(0 bytes\)"),
    (".gsf", lambda: EM.file(LINE), r"holds a Kongsberg \.all file; wanted a GSF file: rename it to \.all"),
    (".all", lambda: b"%PDF-1.4 and more" * 9, r"holds binary content of no known kind; wanted a Kongsberg \.all file"),
    (".xtf", lambda: xtf(LINE, fan(3), kind=61), "it holds packets of type 61; of XTF .*: export the line as GSF"),
    (".xtf", lambda: xtf(LINE, fan(3), units=0), r"not in degrees \(NavUnits 0, wanted 3\)"),
    (".xtf", lambda: xtf(LINE, fan(3))[:900], "less than its header"),
    (".all", lambda: EM.position(START, 1.0, 2.0), "it holds no soundings; wanted datagrams X"),
    (
        ".wcd",
        lambda: EM.datagram("k", START, bytes(40)),
        "it holds a water column, but no soundings; .* the line's .all",
    ),
    (".all", lambda: EM.swath(LINE, 0, 1.0), "no position near its pings; record positions"),
    (".gsf", lambda: b"\0\0\0\x0c\0\0\0\x01GSF-v03.09\0\0", "it holds no ping with soundings"),
    (".gsf", lambda: b"\0\0\0\x0c\0\0\0\x01GSF-x03", "the GSF library cannot read it"),
    (".kmall", lambda: kmall_file.installation(START), "it holds no soundings; wanted datagrams #MRZ: give the line's"),
    (
        ".s7k",
        lambda: b"x",
        "unknown format '.s7k'; known are .gsf, .xtf, .all, .wcd, .mb56, .mb57, .mb58, .mb59, .kmall",
    ),
]


@pytest.mark.parametrize(("suffix", "content", "words"), WRONG, ids=range(len(WRONG)))
def test_unusable_lines_are_refused(tmp_path: Path, suffix: str, content: Callable[[], bytes], words: str) -> None:
    path = tmp_path / f"line{suffix}"
    path.write_bytes(content())
    refuses(rf"line{suffix}: .*{words}", read_line, path, [])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_was_cut_keeps_its_first_pings(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path, suffix)
    whole, content = read(path), path.read_bytes()
    cut = read(path, content[: len(content) * 2 // 3 + 5])
    assert 5 <= len(cut.stamps) <= 9
    np.testing.assert_allclose(cut.points, whole.points[: len(cut.points)], atol=1e-9)
    assert any("damaged or cut" in note for note in cut.notes)


@pytest.mark.parametrize("suffix", [".xtf", ".all", ".kmall"])
def test_pings_after_damage_are_kept(tmp_path: Path, suffix: str) -> None:
    path = written(tmp_path, suffix)
    content = path.read_bytes()
    middle = len(content) // 2
    damaged = read(path, content[:middle] + b"\x02\xff\xce\xfa\x03" + content[middle:])
    assert 11 <= len(damaged.stamps) <= 12
    assert any("damaged or cut" in note for note in damaged.notes)


def test_a_packet_with_a_wrong_count_is_left_out(tmp_path: Path) -> None:
    content = bytearray(xtf(LINE, fan(12)))
    at = content.find(b"R0") - 2  # the count of points, at the end of H0
    content[at : at + 2] = b"\xff\xff"
    line = read(tmp_path / "line.xtf", bytes(content))
    assert len(line.stamps) == 11
    words = r"1 ping and 0 bytes left out; the packet at byte 1,024 has a section of \d+ bytes; wanted at least 131,074"
    assert re.search(words, line.notes[-1])


def test_an_index_beside_an_xtf_is_not_unpickled(tmp_path: Path) -> None:
    path = written(tmp_path, ".xtf")
    path.with_suffix(".pyxtf_idx").write_bytes(b"cposix\nsystem\n(S'touch " + bytes(tmp_path / "ran") + b"'\ntR.")
    assert len(read(path).stamps) == 12
    assert not (tmp_path / "ran").exists()


def test_a_gsf_process_that_crashes_or_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sonarmap.tools.files.readers.pings import gsf

    path, child = write_gsf(tmp_path / "line.gsf", LINE), tmp_path / "child.py"
    real = gsf._CHILD.read_text()
    monkeypatch.setattr(gsf, "_CHILD", child)
    monkeypatch.setattr(gsf, "_START_TIMEOUT", 4.0)
    child.write_text("import os; os.abort()")
    refuses(r"line.gsf: the GSF library cannot read it \(ended with SIGABRT\)", read_line, path, [])
    printed = "_print_ping(record.mb_ping, parameters, out)\n"
    child.write_text(real.replace(printed, printed + "            while identity.record_number == 0: pass\n"))
    line = read(path)
    assert line.notes == ("the GSF library did not end within 4 s after 1 ping, which are kept: the file is damaged",)


def test_nominal_depths_of_a_gsf_are_noted(tmp_path: Path) -> None:
    path = write_gsf(tmp_path / "line.gsf", LINE, words=[b"DEPTH_CALCULATION=RELATIVE_TO_1500_MS"])
    assert read(path).notes == ("depths are those for a speed of sound of 1500 m/s; the file has no others",)


def test_packets_of_triton_equal_those_of_qinsy(tmp_path: Path) -> None:
    """They are those of QINSy where they hold the same."""
    there, other = (read(tmp_path / "line.xtf", xtf(LINE, fan(3), kind=kind)) for kind in (68, 65))
    np.testing.assert_array_equal(there.points, other.points)


def test_raw_positions_replace_missing_ones_of_pings(tmp_path: Path) -> None:
    found = read(tmp_path / "line.xtf", xtf(LINE, fan(12), lag=0.125, raw=True))
    expected = LINE.fixes[:-1] + 0.125 / 0.5 * np.diff(LINE.fixes, axis=0)
    np.testing.assert_allclose(found.fixes[: len(expected), :2], expected, atol=1e-9)


def test_a_gsf_library_that_does_not_load_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_gsf(tmp_path / "line.gsf", LINE)
    (tmp_path / "gsfpy3_09.py").write_text("raise Exception('no shared object')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gsfpy3_09", raising=False)
    refuses(r"line.gsf: the GSF library does not load on this machine \(no shared object\)", read_line, path, [])


def test_a_line_of_rejected_soundings_is_refused(tmp_path: Path) -> None:
    line = sample(3)
    line.rejected[:] = True
    path = write_gsf(tmp_path / "line.gsf", line)
    refuses("all 27 soundings of its 3 pings are rejected; --all-soundings keeps them", read, path)
    assert len(read_line(path, [], LineReading(all_soundings=True)).points) == 27


@pytest.mark.parametrize("suffix", [".gsf", ".all", ".kmall"])
def test_all_soundings_keep_what_the_file_flags(tmp_path: Path, suffix: str) -> None:
    line = read_line(written(tmp_path, suffix), [], LineReading(all_soundings=True))
    np.testing.assert_allclose(line.points, LINE.points.reshape(-1, 3) * [1, -1, -1], atol=TOLERANCE)
    np.testing.assert_array_equal(line.flagged, LINE.rejected.ravel())
    count = LINE.rejected.sum()
    assert line.notes[-1] == f"{count} soundings that the file flags as rejected kept (--all-soundings)"
    assert line.rejected == 0
    patches = list(line_clouds(tmp_path / f"line{suffix}", [], LineReading(all_soundings=True)))
    assert sum(len(patch.points) for patch in patches) == LINE.rejected.size


def test_a_single_beam_is_named_as_one(tmp_path: Path) -> None:
    """Pings of one beam, and GSF's own records of a single beam."""
    words = "line.gsf: a single beam: no swath to register; give lines of a multibeam .* `sonarmap compare MAP"
    one = replace(LINE, points=LINE.points[:, :1].copy(), rejected=LINE.rejected[:, :1])
    refuses(words, read, write_gsf(tmp_path / "line.gsf", one))
    opened, identity, record = ctypes.c_int(), c_gsfDataID(), c_gsfRecords()
    path = tmp_path / "line.gsf"
    assert bindings.gsfOpen(str(path).encode(), FileMode.GSF_CREATE, ctypes.byref(opened)) == 0
    record.sb_ping.ping_time.tv_sec, record.sb_ping.depth, identity.recordID = int(START), 31.5, 10
    for _ in range(3):
        assert bindings.gsfWrite(opened, ctypes.byref(identity), ctypes.byref(record)) > 0
    assert bindings.gsfClose(opened) == 0
    refuses(words, read, path)


def test_beams_without_a_detection_are_never_soundings(tmp_path: Path) -> None:
    """An R2Sonic's range of 0, and a GSF depth of 0."""
    beams = fan(12)
    beams[5].times[1] = 0.0
    without = sum(int((each.times == 0).sum()) for each in beams)
    path = tmp_path / "line.xtf"
    path.write_bytes(xtf(LINE, beams))
    line = read_line(path, [], LineReading(all_soundings=True))
    assert (line.rejected, line.flagged.sum()) == (without, 24)
    zero = sample()
    zero.points[3, 4, 2] = 0.0
    line = read_line(write_gsf(tmp_path / "line.gsf", zero), [], LineReading(all_soundings=True))
    assert line.rejected == 1
