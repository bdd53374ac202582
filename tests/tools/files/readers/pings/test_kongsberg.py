"""Kongsberg's datagrams in both byte orders and all forms of soundings; which sensors are believed."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.pings.line_file import read_line
from sonarmap.tools.files.readers.pings.recorded import RecordedLine
from tests.tools.files.readers.pings.datagrams import DEPTHS, EM, OLD, Recorder
from tests.tools.files.readers.pings.samples import LINE, SPEED, START, sample

ROUNDED = 0.011  # meters: half of a unit of distance, 2 cm


def read(folder: Path, content: bytes, suffix: str = ".all") -> RecordedLine:
    path = folder / f"line{suffix}"
    path.write_bytes(content)
    return read_line(path, [])


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("model", "name"), [(120, "120"), (3020, "3002")])
def test_depth_datagrams_are_read(tmp_path: Path, order: str, model: int, name: str) -> None:
    em = Recorder(model, order)
    line = read(tmp_path, em.file(LINE, swath=em.depths))
    np.testing.assert_allclose(line.points, LINE.kept, atol=ROUNDED)
    np.testing.assert_allclose(np.degrees(line.attitudes), LINE.attitudes, atol=0.02)
    np.testing.assert_allclose(line.fixes[:, :2], LINE.fixes, atol=1e-7)
    np.testing.assert_allclose(line.sensors[:, 2], -DEPTHS)
    assert (line.echo_sounder, line.sound_speed, line.rejected) == (f"Kongsberg EM{name}", SPEED, 0)
    assert line.notes == ("positions are those of system 1, which is active; not those of 2",)


@pytest.mark.parametrize("order", ["<", ">"])
def test_xyz_88_is_the_same_in_either_byte_order(tmp_path: Path, order: str) -> None:
    """And with sizes in another order than the numbers, as where files were written by a computer of another kind."""
    there = Recorder(2040, order, sizes="<>"[order == "<"])
    np.testing.assert_array_equal(read(tmp_path, there.file(LINE)).points, read(tmp_path, EM.file(LINE)).points)


def test_deep_soundings_are_unsigned_and_those_of_shallow_ones_signed(tmp_path: Path) -> None:
    """In units of 20 cm: 8 km are 40,000 of them. An EM 3000 on a vehicle has soundings above itself."""
    deep, shallow = sample(), sample()
    deep.points[..., 2] += 8000
    shallow.points[..., 2] = np.linspace(-20, 30, shallow.points.shape[1])
    em = Recorder(120)
    parts = [em.depths(deep, k, DEPTHS, units=(20, 20)) for k in range(12)]
    parts += [em.position(deep.stamps[k], *deep.fixes[k]) for k in range(12)]
    np.testing.assert_allclose(read(tmp_path, b"".join(parts)).points, deep.kept, atol=0.11)
    found = read(tmp_path, OLD.file(shallow, swath=OLD.depths))
    np.testing.assert_allclose(found.points, shallow.kept, atol=ROUNDED)


@pytest.mark.parametrize("depth", [-0.75, 1500.5])
def test_the_multiplier_of_the_transducers_depth_is_applied(tmp_path: Path, depth: float) -> None:
    """Above the water by heave, or 1.5 km down on a vehicle."""
    line = sample()
    line.points[..., 2] += depth
    parts = [OLD.depths(line, k, depth) for k in range(12)] + [
        OLD.position(t, *p) for t, p in zip(line.stamps, line.fixes, strict=True)
    ]
    found = read(tmp_path, b"".join(parts))
    np.testing.assert_allclose(found.sensors[:, 2], -depth, atol=1e-9)
    np.testing.assert_allclose(found.points, line.kept, atol=ROUNDED)


@pytest.mark.parametrize("form", ["depths", "swath", "swath with heave"])
def test_datagrams_of_mb_system_are_read(tmp_path: Path, form: str) -> None:
    """Places of pings come first, and flags of beams; there is no other position."""
    em = Recorder(300 if form == "depths" else 710, ">")
    parts = list[bytes]()
    for k in range(12):
        if form == "depths":
            parts.append(em.processed_depths(LINE, k, DEPTHS))
        else:
            parts.append(em.processed_swath(LINE, k, DEPTHS, heave=form.endswith("heave")))
    found = read(tmp_path, b"".join(parts), ".mb57" if form == "depths" else ".mb59")
    np.testing.assert_allclose(found.points, LINE.kept, atol=ROUNDED)
    np.testing.assert_allclose(found.fixes[:, :2], LINE.fixes, atol=1e-7)
    assert found.rejected == LINE.rejected.sum()


def test_a_ping_without_units_is_left_out(tmp_path: Path) -> None:
    parts = [OLD.depths(LINE, k, DEPTHS, units=(0 if k == 4 else 1, 2)) for k in range(12)]
    parts += [OLD.position(t, *p) for t, p in zip(LINE.stamps, LINE.fixes, strict=True)]
    found = read(tmp_path, b"".join(parts))
    assert len(found.stamps) == 11
    assert "1 datagram and 0 bytes left out; a datagram D has units of 0 cm" in found.notes[-1]


def swaths() -> list[bytes]:
    return [EM.swath(LINE, k, DEPTHS) for k in range(12)]


def positions(system: int = 0x81, off: float = 0.0) -> list[bytes]:
    fixes = (LINE.fixes + off).tolist()
    return [EM.position(t, *fix, system=system) for t, fix in zip(LINE.stamps, fixes, strict=True)]


@pytest.mark.parametrize(("speed", "course"), [(400, 12000), (0xFFFF, 12000), (400, 0xFFFF)])
def test_one_position_places_the_pings_around_it(tmp_path: Path, speed: int, course: int) -> None:
    """At 4 m/s and a course of 120 degrees, a ping a second later is 2 m south and 3.46 m east; without a speed it is
    there. Pings more than 2 s from the position are left out."""
    latitude, longitude = LINE.fixes[6].tolist()
    one = EM.position(LINE.stamps[6], latitude, longitude, speed=speed, course=course)
    found = read(tmp_path, b"".join([*swaths(), one]))
    np.testing.assert_allclose(found.stamps, LINE.stamps[2:11], atol=1e-3)
    after, moves = (found.stamps - LINE.stamps[6])[:, None], speed == 400 and course == 12000
    places = Georeference(latitude, longitude).local(found.fixes)[:, :2]
    np.testing.assert_allclose(places, after * np.array([3.4641, -2.0]) * moves, atol=0.02)
    said = "by its speed and course over ground" if moves else "there, as it has no speed"
    assert found.notes[0] == f"only one position: pings within 2 s of it are placed {said}"


def test_network_attitudes_fill_what_the_active_sensor_lacks(tmp_path: Path) -> None:
    """Datagrams A come a second later than those by network of the same sensor (0x6E), so a cut file lacks them; those
    of another one (0x3E) are not used."""
    late = [EM.network_motion(START, rows(5.0), system=0x3E), EM.network_motion(START, rows(3.25), system=0x6E)]
    found = read(tmp_path, b"".join([*swaths(), *positions(), EM.motion(START, rows(3.0)[:5]), *late]))
    np.testing.assert_allclose(np.degrees(found.attitudes[:, 0]), [3.0] * 5 + [3.25] * 7, atol=1e-6)
    assert found.notes == ()


def rows(roll: float) -> list[tuple[float, float, float]]:
    return [(0.5 * k, roll, 1.0) for k in range(12)]


def test_jumps_and_invalid_positions_are_ignored(tmp_path: Path) -> None:
    fixes = positions()
    fixes[5] = EM.position(LINE.stamps[5], LINE.fixes[5, 0] + 0.01, LINE.fixes[5, 1])  # 1.1 km off and back
    fixes[8] = EM.position(LINE.stamps[8], 0x7FFFFFFF / 2e7, 0x7FFFFFFF / 1e7)
    found = read(tmp_path, b"".join([*swaths(), *fixes]))
    np.testing.assert_allclose(found.fixes[:, :2], LINE.fixes, atol=1e-7)


@pytest.mark.parametrize(
    ("motions", "roll", "noted"),
    [
        ([EM.network_motion(START, rows(5.0))], 5.0, False),
        (
            [EM.network_motion(START, rows(5.0)), EM.motion(START, rows(3.0), system=2)],
            5.0,
            False,
        ),  # the other is unused
        ([EM.network_motion(START, rows(5.0), system=0xFF), EM.motion(START, rows(3.0))], 3.0, False),
        ([EM.motion(START, rows(3.0)), EM.motion(START, rows(7.0), system=0x12)], 3.0, False),
        ([EM.motion(START, rows(7.0), system=0x12), EM.motion(START, rows(3.0)[:5], system=2)], 7.0, True),
        ([EM.motion(START, rows(7.0), status=0x909A), EM.network_motion(START, rows(5.0))], 5.0, False),
    ],
    ids=["network", "network in use", "network unused", "the one in use", "none in use", "invalid"],
)
def test_the_active_sensor_gives_attitudes(tmp_path: Path, motions: list[bytes], roll: float, noted: bool) -> None:
    found = read(tmp_path, b"".join([*swaths(), *positions(), *motions]))
    np.testing.assert_allclose(np.degrees(found.attitudes[:, 0]), roll, atol=1e-6)
    assert any("no motion sensor is marked as active" in note for note in found.notes) == noted


def test_wrong_checksums_are_damage_unless_none_fits(tmp_path: Path) -> None:
    """One that does not fit is damage; where none does, they were not written. Other datagrams' do not count."""
    other = EM.datagram("R", START, bytes(33), wrong_sum=True)
    parts = [*positions(), other, *swaths()]
    assert read(tmp_path, b"".join(parts)).notes == ("12 pings without roll and pitch, taken as level",)
    swath = EM.swath(LINE, 4, DEPTHS)
    parts[-8] = swath[:-1] + bytes([swath[-1] ^ 1])
    found = read(tmp_path, b"".join(parts))
    assert len(found.stamps) == 11
    assert "damaged or cut" in found.notes[-1]
    none = [EM.datagram("X", t, x[20:-3], wrong_sum=True) for t, x in zip(LINE.stamps, swaths(), strict=True)]
    none += [EM.datagram("P", t, x[20:-3], wrong_sum=True) for t, x in zip(LINE.stamps, positions(), strict=True)]
    np.testing.assert_allclose(read(tmp_path, b"".join(none)).points, LINE.kept, atol=ROUNDED)


def test_without_an_active_system_that_with_most_positions_is_used(tmp_path: Path) -> None:
    found = read(tmp_path, b"".join([*swaths(), *positions(0x02), *positions(0x01, off=0.1)[:5]]))
    np.testing.assert_allclose(found.fixes[:, :2], LINE.fixes, atol=1e-7)
    assert "no position system is marked as active: that with most positions is taken" in found.notes


def test_the_second_head_of_an_em3000d_is_deeper(tmp_path: Path) -> None:
    line = sample()
    em = Recorder(3004, ">")
    parts = [em.depths(line, k, DEPTHS, rate=-150, first=125) for k in range(12)]  # beams 125 to 133
    found = read(
        tmp_path, b"".join([*parts, *(em.position(t, *p) for t, p in zip(line.stamps, line.fixes, strict=True))])
    )
    second = np.tile(np.arange(9) >= 3, (12, 1))[~line.rejected]
    np.testing.assert_allclose(found.points[~second], line.kept[~second], atol=ROUNDED)
    np.testing.assert_allclose(found.points[second], line.kept[second] + [0, 0, 1.5], atol=ROUNDED)
    assert found.echo_sounder == "Kongsberg EM3000D"


def test_ranges_alone_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line\.all: it holds raw ranges, but no soundings; wanted datagrams X"):
        read(tmp_path, b"".join([*positions(), EM.datagram("N", START, bytes(300))]))
