"""NMEA 0183 and TUM files as navigation; sentences of which the checksums are those of published examples."""

from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.readers.instruments import COLUMNS
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings, parse_columns, parse_talkers
from sonarmap.tools.files.writers.poses import write_tum
from tests.samples.places import DATA
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, scans_at

# The examples of the protocol's usual descriptions, whose checksums others worked out
PUBLISHED = (
    "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47",
    "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A",
    "$GPVTG,054.7,T,034.4,M,005.5,N,010.2,K*48",
)
T_1994 = 764426119.0  # 1994-03-23 12:35:19 UTC


def sentence(body: str) -> str:
    return f"${body}*{reduce(xor, body.encode()):02X}"


def dive(first: float = START, count: int = 11, dated: bool = True, headings: int = 5) -> str:
    """A fix a second to the North by 0.01 minutes each, five headings between, and what else is on the wire."""
    lines: list[str] = []
    for k in range(count):
        clock = np.datetime64(round((first + k) * 1000), "ms").item()
        of_day = clock.strftime("%H%M%S.00")
        lines.append(sentence(f"GPGGA,{of_day},6023.{478 + 10 * k:03d}0,N,00519.3260,E,4,12,0.6,2.1,M,44.0,M,,"))
        if dated:
            date = clock.strftime("%d%m%y")
            place = f"6023.{478 + 10 * k:03d}0,N,00519.3260,E"
            lines.append(sentence(f"GNRMC,{of_day},A,{place},1.0,0.0,{date},,,R"))
        lines += [sentence(f"HEHDT,{(355 + k + (j + 1) / (headings + 1)) % 360:.3f},T") for j in range(headings)]
        lines.append(sentence("SDDBT,30.1,f,9.2,M,5.0,F"))
    return "\r\n".join(lines) + "\r\n"


def test_published_sentences_are_read(path: Path) -> None:
    text = "\n".join(PUBLISHED)
    values, navigated, notes = read(path, text, scans=scans_at(T_1994))
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(48 + 7.038 / 60, abs=1e-5)
    assert navigated.georeference.longitude == pytest.approx(11 + 31 / 60, abs=1e-5)
    assert np.abs(values[0, 3:5]).max() < 1
    assert any("1 VTG" in note and "1 places of RMC" in note for note in notes)


def test_positions_and_headings_are_interpolated_to_the_scans(path: Path) -> None:
    values, navigated, _ = read(path, dive(), scans=scans_at(START + 2.5, START + 7))
    origin = navigated.georeference
    assert origin is not None
    lat = 60 + (23.478 + 0.01 * np.array([2.5, 7])) / 60
    _, _, way = Geod(ellps="WGS84").inv([5.3221] * 2, [60.3913] * 2, [5.3221] * 2, lat)
    np.testing.assert_allclose(values[:, 4], way, atol=0.01)
    np.testing.assert_allclose(values[:, 2], [357.5, 2], atol=0.2)  # through North; by the lines, not exactly in time
    assert np.isnan(values[:, [0, 1, 5]]).all()


def test_prefixes_are_skipped_and_damaged_lines_left_out(path: Path) -> None:
    """A logger's own stamps before the sentences; a digit lost, a line cut, garbage, a year that no calendar has."""
    lines = [f"2026-07-01 11:30:0{k % 10}.125 <- COM3: {line}" for k, line in enumerate(dive().splitlines())]
    lines[3] = lines[3].replace("6", "7", 1) if "*" not in lines[3] else lines[3].replace(".", "", 2)
    lines[8] = lines[8][:-4]
    lines.insert(5, "\xff\x00 garbage")
    lines.append(sentence("GPZDA,224001,27,06,99999999999999999999,00,00"))
    values, _, notes = read(path, "\n".join(lines).encode("latin-1"), scans=scans_at(START + 5))
    assert np.isfinite(values[0, [2, 3, 4]]).all()
    assert any(note.startswith(f"{path}: 3 sentences have a wrong checksum or field") for note in notes)


def test_dates_come_from_rmc_zda_or_the_scans(path: Path) -> None:
    scans = scans_at(START + 4)
    wanted, *_ = read(path, dive(), scans=scans)
    values, _, notes = read(path, dive(dated=False), scans=scans)
    np.testing.assert_allclose(values, wanted, atol=0.2)
    assert any("the first is taken to be of 2026-07-01" in note for note in notes)
    values, *_ = read(path, dive(dated=False) + sentence("GPZDA,093011.00,01,07,2026,00,00") + "\n", scans=scans)
    np.testing.assert_allclose(values[:, 3:5], wanted[:, 3:5], atol=1e-6)
    refuses("no date, and neither have the scans", read, path, dive(dated=False), scans=scans_at(1, 2))


@pytest.mark.parametrize("dated", [True, False])
def test_times_continue_over_midnight(path: Path, dated: bool) -> None:
    midnight = 1782950400.0  # 2026-07-02 00:00:00 UTC
    values, *_ = read(path, dive(midnight - 5, dated=dated), scans=scans_at(midnight - 2, midnight + 3))
    np.testing.assert_allclose(np.diff(values[:, 4]), 5 * 18.57, atol=0.1)


@pytest.mark.parametrize(
    "text",
    [
        "$GPGGA,123519,4807.038,N,01131.000,E,0,08,0.9,545.4,M,46.9,M,,*46\n",  # no fix
        PUBLISHED[2],
        sentence("HEHDT,45.0,T"),  # no time
        sentence("GPGGA,123519,4867.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),  # 67 minutes
        sentence("GPGGA,123519,4807.038,E,01131.000,N,1,08,0.9,545.4,M,46.9,M,,"),
    ],
)
def test_logs_without_a_fix_or_a_heading_are_refused(path: Path, text: str) -> None:
    refuses(r"log\.csv has no sentence with a fix or a heading and a time", read, path, text, scans=scans_at(T_1994))


def test_a_tum_trajectory_is_read_as_navigation(path: Path) -> None:
    times = START + np.arange(0.0, 12.0)
    R = Rotation.from_euler("ZYX", [[3 * k, 10, -20] for k in range(12)], degrees=True)
    poses = RigidTransform.from_components(np.outer(times - START, [1, 2, -0.5]), R)
    write_tum(path, Trajectory(times, poses))
    sigmas: dict[str, float] = dict(zip(COLUMNS, (0.5, 0.5, 3.0, 2.0, 2.0, 0.1), strict=True))
    scans = scans_at(START + 3, START + 6.5)
    first, second = (scan.prior for scan in navigate(scans, path, NavigationSettings(sigmas=sigmas)).scans)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(first.T_world_sensor.as_matrix(), poses[3].as_matrix(), atol=1e-6)
    np.testing.assert_allclose(second.T_world_sensor.translation, [6.5, 13, -3.25], atol=1e-6)
    np.testing.assert_allclose(first.sigmas, [*np.radians([0.5, 0.5, 3]), 2, 2, 0.1])
    refuses("no standard deviations; give --prior-sigmas", navigate, scans, path)


def test_sigmas_follow_the_quality_of_each_fix(tmp_path: Path) -> None:
    """The receiver says of each fix what it is, unless the user says how much they err."""
    path = tmp_path / "ship.nmea"
    lines = dive(count=7).splitlines()
    for quality, start in ((",E,1,", 3), (",E,2,", 5)):  # RTK from 0 to 2 s, none from 3, differential from 5
        for line in range(8 * start, 8 * start + 16):
            body = lines[line].removeprefix("$").rsplit("*", 1)[0].replace(",E,4,", quality)
            lines[line] = sentence(body)
    path.write_text("\r\n".join(lines))

    def priors(notes: list[str], settings: NavigationSettings) -> np.ndarray:
        scans = navigate(scans_at(START + 1, START + 3.5, START + 5.5), path, settings, notes=notes).scans
        return np.stack([scan.prior.sigmas for scan in scans if scan.prior is not None])

    notes = list[str]()
    sigmas = priors(notes, NavigationSettings())
    np.testing.assert_allclose(sigmas[:, 3:5], [[0.05] * 2, [3.0] * 2, [1.5] * 2])
    np.testing.assert_allclose(sigmas[:, 2], np.radians(1.0))
    assert not np.isfinite(sigmas[:, [0, 1, 5]]).any()
    assert any("3 of RTK (0.05 m), 2 of GNSS (3 m), 2 of DGNSS (1.5 m); --prior-sigmas" in note for note in notes)
    assert any("heading 1 degrees (gyrocompass); --prior-sigmas" in note for note in notes)
    given = priors([], NavigationSettings(sigmas={"x_m": 0.7, "y_m": 0.7, "heading_deg": 2.0}))
    np.testing.assert_allclose(given[:, 2:5], [[np.radians(2.0), 0.7, 0.7]] * 3)


def _fixes(talker: str, north: float, quality: int = 1, count: int = 20, kind: str = "GGA", first: int = 0) -> str:
    """Fixes of a second each, so many minutes north of a dive's start."""
    lines: list[str] = []
    for k in range(first, first + count):
        clock = np.datetime64(round((START + k) * 1000), "ms").item()
        place = f"60{23.478 + north:07.4f},N,00519.3260,E"
        rmc = f"A,{place},1.0,0.0,{clock.strftime('%d%m%y')},,,{'NADPRFEMS'[quality]}"
        body = f"{place},{quality},12,0.6,2.1,M,44.0,M,," if kind == "GGA" else rmc
        lines.append(sentence(f"{talker}{kind},{clock.strftime('%H%M%S.00')},{body}"))
    return "\n".join([*lines, ""])


def _headings(talker: str, heading: float) -> str:
    return "".join(f"{sentence(f'{talker}HDT,{heading:.1f},T')}\n{_fixes('GP', 0, 4, 1, first=k)}" for k in range(20))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_fixes("GP", 0) + _fixes("IN", 0.1), "positions of its talkers GP and IN are 185 m apart"),
        (_fixes("GP", 0) + _fixes("IN", 0.1, kind="RMC"), "positions of its talkers GP and IN are 185 m apart"),
        (_fixes("GP", 0, 4) + _fixes("GN", 0.001, 4), "positions of its talkers GP and GN are 1.85 m apart"),
        (_headings("HE", 350) + _headings("IN", 20), "headings of its talkers HE and IN are 30 degrees apart"),
    ],
)
def test_two_vehicles_in_a_log_are_refused(path: Path, text: str, words: str) -> None:
    given = NavigationSettings(sigmas={})
    path.write_text(text)
    with pytest.raises(InputError, match=f"{words}.*--nmea-talker"):
        navigate(scans_at(START + 3), path, given)


def test_a_chosen_talker_or_talkers_that_agree_are_used(path: Path) -> None:
    """One that is chosen, and receivers that agree."""
    both, scans = _fixes("GP", 0) + _fixes("IN", 0.1), scans_at(START + 3)
    _, navigated, notes = read(path, both, NavigationSettings(talkers=parse_talkers("in")), scans=scans)
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(60 + 23.578 / 60, abs=1e-5)
    assert any("not used: 20 GPGGA" in note for note in notes)
    values, *_ = read(path, _fixes("GP", 0) + _fixes("GN", 0.001), scans=scans)
    assert np.abs(values[0, 3:5]).max() < 2.5
    refuses("no sentence of HE .*with a fix", read, path, both, NavigationSettings(talkers=("HE",)), scans=scans)
    refuses("--nmea-talker is 'GPS'", parse_talkers, "GPS")
    table = "stamp,depth_m,depth_sigma_m\n1,2,3\n"
    refuses("no NMEA sentences.*--nmea-talker has no", read, path, table, NavigationSettings(talkers=("GP",)))


@pytest.mark.parametrize("kind", ["GGA", "RMC"])
def test_estimated_manual_and_simulated_fixes_are_left_out(path: Path, kind: str) -> None:
    false = "".join(_fixes("GP", 9, quality, 3, kind, first=20 + 3 * quality) for quality in (6, 7, 8))
    scans = scans_at(START + 3, START + 39)
    values, _, notes = read(path, _fixes("GP", 0, kind=kind) + false, scans=scans)
    assert np.isfinite(values[:, 3]).tolist() == [True, False]
    assert any("no receiver measured are left out: 3 estimated, 3 manual, 3 simulated" in note for note in notes)
    refuses("3 estimated, 3 manual, 3 simulated", read, path, false, scans=scans)


def test_rmc_is_used_where_gga_is_missing(path: Path) -> None:
    text = _fixes("GP", 0, 4, 1, first=25) + _fixes("GP", 0, count=50, kind="RMC")
    values, _, notes = read(path, text, scans=scans_at(START, START + 25, START + 49))
    assert np.isfinite(values[:, 3:5]).all()
    assert any("not used: 1 places of RMC" in note for note in notes)


def test_a_real_log_of_two_talkers_is_read() -> None:
    log = DATA / "real" / "navigation" / "pygpsdata-nmea4.log"
    if not log.is_file():
        pytest.skip("shared/data/real/navigation is not beside the checkout")
    notes = list[str]()
    found = read_navigation(log, NavigationSettings(), None, np.zeros(0), notes)
    assert any("2 of GNSS (3 m)" in note for note in notes)
    assert np.isfinite(found.values[:, 3]).sum() == 2


def test_options_of_tables_have_no_effect(path: Path) -> None:
    for settings in (NavigationSettings(columns=parse_columns("depth_m=a")), NavigationSettings(time_scale="gps")):
        refuses("has no effect", read, path, dive(), settings)
