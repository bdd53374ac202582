"""Small valid files of navigation of every kind, each with a check of the result of reading it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings, parse_mount
from tests.samples.bags.samples import navigation
from tests.samples.damage.pose_files import Readable
from tests.tools.files.readers.navigation.logs import SCANS, SIGMAS, START
from tests.tools.files.readers.navigation.test_dvl import json_lines, serial_lines
from tests.tools.files.readers.navigation.test_nmea import dive
from tests.tools.files.readers.navigation.test_nmea_others import log
from tests.tools.files.readers.navigation.test_sbet import sbet
from tests.tools.files.readers.navigation.test_tables_of_others import STAMPS, TRUTH, euroc, mavlink

_LOG = "Date;Time (UTC);Lat;Lon;Depth (m);Depth SD;Heading;Roll;Pitch;Volt\n" + "".join(
    f"01.07.2026;09:30:{k:02d}.25;60 23.{478 + k} N;5 19.{326 + k} E;12,{k:02d};0,2;{340 + k};1,5;-2,5;12,1\n"
    for k in range(12)
)
_GRID = "GPS Week\tTOW\tEasting\tNorthing\tz\tyaw\n" + "".join(
    f"2425\t{293418 + k}\t{297000 + k}.5\t{6701000 - k}.25\t{k}.5\t{200 - k}\n" for k in range(12)
)
_TUM = "".join(f"{START + k} {k * 1.5} 2.25 -0.5 0.1 0.2 0.3 0.9\n" for k in range(12)).encode()


def _check_priors(settings: NavigationSettings, path: Path) -> None:
    navigated = navigate(SCANS, path, replace(settings, sigmas=SIGMAS))
    priors = [scan.prior for scan in navigated.scans if scan.prior is not None]
    assert all(np.isfinite(prior.T_world_sensor.as_matrix()).all() for prior in priors)
    assert all((prior.sigmas > 0).all() for prior in priors)


_AS_IT_SAYS = partial(_check_priors, AS_IT_SAYS)
_MOUNTED = partial(_check_priors, NavigationSettings(mount=parse_mount("0,-20,5,1,0,0.5"), offset=0.5))
_ON_GRID = partial(_check_priors, NavigationSettings(crs="EPSG:32632", frame="ned", heading_reference="grid"))


def _check_odometry(path: Path) -> None:
    found = read_odometry(path, SCANS, 0.01, 0.001)
    assert np.isfinite(found.T_odom_sensor.as_matrix()).all()
    assert found.drift >= 0.01


_OTHERS = log(
    "GNGNS,{t},{p},AANN,06,5.88,56.0,48.5,,,V", "GPGLL,{p},{t},A,A", "PASHR,{t},{h},T,-0.62,0.25,,0.029,0.03,0.502,2,3",
    "PRDID,-1.50,2.50,{h}", "HCHDG,{h},1.5,W,4.0,E", ":00FFFD 0004F-0012 0048", "SDDPT,9.2,0.5", count=12,
)  # fmt: skip
_ROSTOPIC = "%time,field.header.seq,field.header.stamp,field.depth\n" + "".join(
    f"{round((START + k + 0.4) * 1e9)},{k},{round((START + k) * 1e9)},{-9999 if k % 5 == 2 else 5 + 0.1 * k:.3f}\n"
    for k in range(20)
)
# kinds that came with the logs of other instruments
OF_INSTRUMENTS = {
    "dvl json": Readable("dvl.json", json_lines().encode(), _check_odometry),
    "dvl serial": Readable("dvl.log", serial_lines().encode(), _check_odometry),
    "sbet": Readable("sbet_1.out", sbet(30).tobytes(), _AS_IT_SAYS),
    "sbet as odometry": Readable("sbet_1.out", sbet(120).tobytes(), _check_odometry),
    "rostopic": Readable("depth.csv", _ROSTOPIC.encode(), _AS_IT_SAYS),
    "euroc": Readable("euroc.csv", euroc(STAMPS, TRUTH).encode(), _AS_IT_SAYS),
    "mavlink": Readable("mavlink.csv", mavlink().encode(), _AS_IT_SAYS),
    "nmea of others": Readable("others.nmea", _OTHERS.encode(), _AS_IT_SAYS),
    "nmea without checksums": Readable("bare.nmea", _OTHERS.replace("*", "").encode(), _AS_IT_SAYS),
}
NAVIGATION_FILES = OF_INSTRUMENTS | {
    "log": Readable("log.csv", _LOG.encode(), _AS_IT_SAYS),
    "log of a mounted sonar": Readable("log.csv", _LOG.encode(), _MOUNTED),
    "log of a grid": Readable("log.csv", _GRID.encode("utf-16"), _ON_GRID),
    "nmea": Readable("log.nmea", dive(count=12, headings=1).encode(), _AS_IT_SAYS),
    **{
        f"{kind} of navigation": Readable(f"nav{suffix}", content, _AS_IT_SAYS)
        for kind, (suffix, content) in navigation(START).items()
    },
    "tum as navigation": Readable("nav.tum", _TUM, _AS_IT_SAYS),
}
