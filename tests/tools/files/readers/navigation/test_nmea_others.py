"""NMEA 0183 sentences beside GGA, RMC and HDT, with and without checksums, and the strings of TSS1."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.instruments import sigmas_of
from sonarmap.tools.files.readers.navigation.overview import is_log, read_navigation
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.refusals import refuses
from tests.tools.files.readers.navigation.logs import START, read, scans_at
from tests.tools.files.readers.navigation.test_nmea import sentence

SCAN = scans_at(START + 10, START + 15.5)


def clock(k: float) -> str:
    return np.datetime64(round((START + k) * 1000), "ms").item().strftime("%H%M%S.%f")[:9]


def place(k: float) -> str:
    return f"60{23.478 + 0.01 * k:07.4f},N,00519.3260,E"


def log(*bodies: str, count: int = 30, checked: bool = True) -> str:
    """Lines a second, in which {t} is the time, {p} the place and {h} a heading of 90 degrees and k."""
    lines = [body.format(t=clock(k), p=place(k), h=f"{90 + k:.1f}") for k in range(count) for body in bodies]
    return (
        "\r\n".join([line if line[0] == ":" else sentence(line) if checked else f"${line}" for line in lines]) + "\r\n"
    )


POSITIONS = {
    "GNS and ZDA": ("GNZDA,{t},01,07,2026,00,00", "GNGNS,{t},{p},AANN,06,5.88,56.0,48.5,,,V"),
    "GLL alone": ("GPGLL,{p},{t},A,A",),
    "GLL of old": ("GPGLL,{p},{t},A",),
    "GGA without the rest": ("GPGGA,{t},{p},1",),
}


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("name", POSITIONS)
def test_positions_of_other_sentences_are_read(path: Path, name: str, checked: bool) -> None:
    values, navigated, notes = read(path, log(*POSITIONS[name], checked=checked), scans=SCAN)
    assert is_log(path)
    assert navigated.georeference is not None
    assert navigated.georeference.latitude == pytest.approx(60 + 23.478 / 60, abs=1e-5)
    np.testing.assert_allclose(np.diff(values[:, 4]), 5.5 * 18.57, atol=0.1)
    count = 60 if "ZDA" in name else 30
    assert any(f"{count} sentences have no checksum" in note for note in notes) is not checked


def test_a_line_that_lost_its_checksum_is_damaged_where_others_have_one(path: Path) -> None:
    """And it is read where no sentence of that kind has one."""
    lines = log("GPGLL,{p},{t},A,A", "HEHDT,{h},T").splitlines()
    lines[8], lines[10] = lines[8][:-6], lines[10][:-1]
    lines = [line.partition("*")[0] if "HDT" in line else line for line in lines]
    _, _, notes = read(path, "\n".join(lines), scans=SCAN)
    assert any("2 sentences have a wrong checksum or field" in note for note in notes)
    assert any("30 sentences have no checksum" in note for note in notes)


@pytest.mark.parametrize(
    ("body", "wanted", "sigmas"),
    [
        ("PASHR,{t},{h},T,-0.62,0.25,,0.029,0.030,0.502,2,3", (-0.62, 0.25, 0), (0.029, 0.030, 0.502)),
        ("PRDID,-1.50,2.50,{h}", (2.5, -1.5, 0), (0.5, 0.5, 1.0)),
        ("HCHDG,{h},1.5,W,4.0,E", (np.nan, np.nan, 2.5), (np.nan, np.nan, 3.0)),
        ("HEHDT,{h},T", (np.nan, np.nan, 0), (np.nan, np.nan, 1.0)),
        (":00FFFD 0004F-0012 0048", (-0.12, 0.48, np.nan), (0.5, 0.5, np.nan)),
    ],
)
@pytest.mark.parametrize("checked", [True, False])
def test_attitude_and_headings(
    path: Path, body: str, wanted: tuple[float, ...], sigmas: tuple[float, ...], checked: bool
) -> None:
    """`wanted`: roll, pitch, and the heading less that of the log."""
    path.write_text(log("GPGGA,{t},{p},4,12,0.6,2.1,M,44.0,M,,", body, checked=checked))
    found = navigate(SCAN, path, NavigationSettings()).scans
    values, *_ = read(path, path.read_bytes(), scans=SCAN)
    tolerance = 0.01 if "{t}" in body else 0.6  # others are placed between the lines
    np.testing.assert_allclose(values[:, 2], np.array([100, 105.5]) + wanted[2], atol=tolerance)
    np.testing.assert_allclose(values[:, :2], [wanted[:2]] * 2, atol=1e-6)
    assert found[0].prior is not None
    stated = np.where(np.isfinite(own := sigmas_of(found[0].prior)), own, np.nan)
    np.testing.assert_allclose(
        stated[:3], np.where(np.isfinite(sigmas), np.fmax(*[np.array(sigmas)] * 2), np.nan), rtol=0.1
    )


@pytest.mark.parametrize("checked", [True, False])
def test_attitude_alone_is_read(path: Path, checked: bool) -> None:
    values, *_ = read(path, log("PASHR,{t},{h},T,-0.62,0.25,,0.029,0.030,0.502,2,3", checked=checked), scans=SCAN)
    np.testing.assert_allclose(values[:, :3], [[-0.62, 0.25, 100], [-0.62, 0.25, 105.5]], atol=1e-6)


def test_magnetic_headings_need_a_declination(path: Path) -> None:
    """From the option, from the sentence, from RMC, or none: then the note says what to do."""
    gga, hdm = "GPGGA,{t},{p},4,12,0.6,2.1,M,44.0,M,,", "HCHDM,{h},M"
    values, _, notes = read(path, log(gga, hdm), scans=SCAN)
    assert np.isnan(values[:, 2]).all()
    assert any("30 HDM (magnetic; give --magnetic-declination)" in note for note in notes)
    values, *_ = read(path, log(gga, hdm), NavigationSettings(declination=-3.0), scans=SCAN)
    np.testing.assert_allclose(values[:, 2], [97, 102.5], atol=0.6)
    values, *_ = read(path, log(gga, "GPRMC,{t},A,{p},0.1,0.0,010726,2.5,E,A", hdm), scans=SCAN)
    np.testing.assert_allclose(values[:, 2], [102.5, 108], atol=0.7)
    values, *_ = read(path, log(gga, "HEHDT,{h},T", "HCHDG,{h},,,9.0,E"), scans=SCAN)
    np.testing.assert_allclose(values[:, 2], [100, 105.5], atol=0.6)  # the gyrocompass
    refuses(
        "--magnetic-declination has no effect", read, path, log(gga), NavigationSettings(declination=1.0), scans=SCAN
    )


def test_depths_of_the_water_are_named_and_not_used(path: Path) -> None:
    text = log("GPGGA,{t},{p},4,12,0.6,2.1,M,44.0,M,,", "SDDBT,30.1,f,9.2,M,5.0,F", "SDDPT,9.2,0.5", "PXYZ,1")
    values, _, notes = read(path, text, scans=SCAN)
    assert np.isnan(values[:, 5]).all()
    assert any(
        "30 DBT (water below the transducer, not the sonar's depth), 30 DPT (water" in note and "30 PXYZ" in note
        for note in notes
    )


def test_unsettled_or_invalid_sentences_are_left_out(path: Path) -> None:
    gga = "GPGGA,{t},{p},4,12,0.6,2.1,M,44.0,M,,"
    for body in (":00FFFD 0004u-0012 0048", "GPTHS,{h},V", "PASHR,{t},,T,,,,,,,0,0", "GPGLL,{p},{t},V,N"):
        values, _, notes = read(path, log(gga, body), scans=SCAN)
        assert np.isnan(values[:, :3]).all()
        assert any("30 sentences are without a fix" in note for note in notes)


def test_two_receivers_of_one_talker_are_told_apart(path: Path) -> None:
    """A second antenna 5 m to the North, in turn or at the same time."""
    lines = []
    for k in range(30):
        lines += [sentence(f"GPGGA,{clock(k)},{place(k)},4,12,0.6,2.1,M,44.0,M,,")]
        other = k if k % 2 else k + 0.5
        lines += [sentence(f"GPGGA,{clock(other)},{place(other + 0.27)},4,12,0.6,2.1,M,44.0,M,,")]
    refuses(
        "alternate between two places .* m apart, as those of two receivers", read, path, "\n".join(lines), scans=SCAN
    )


def test_two_talkers_some_meters_apart_are_told_apart(path: Path) -> None:
    """Nearer than the errors of both, but steadily: 1 m is that of a receiver, 5 m that of two."""
    for apart, refused in ((0.0006, False), (0.0027, True)):  # minutes of latitude
        lines = []
        for k in range(30):
            for talker, north in (("GP", 0.0), ("GN", apart)):
                place = f"60{23.478 + 0.0006 * k + north:07.4f},N,00519.3260,E"
                lines.append(sentence(f"{talker}GGA,{clock(k)},{place},1,12,0.6,2.1,M,44.0,M,,"))
        path.write_text("\n".join(lines))
        if refused:
            refuses("two places 5.0 m apart.*--nmea-talker", navigate, SCAN, path, NavigationSettings())
        else:
            assert all(scan.prior is not None for scan in navigate(SCAN, path, NavigationSettings()).scans)


def test_inspect_reads_times_without_a_date(path: Path) -> None:
    path.write_text(log(*POSITIONS["GLL alone"]))
    notes = list[str]()
    found = read_navigation(path, NavigationSettings(), None, np.zeros(0), notes)
    assert found.times[0] == START % 86400
    assert any("the scans will tell it" in note for note in notes)
