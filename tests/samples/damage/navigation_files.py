"""Small valid files of navigation of every kind, each with a check of the result of reading it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings, parse_mount
from tests.samples.bags.samples import navigation
from tests.samples.damage.pose_files import Readable
from tests.tools.files.readers.navigation.logs import SCANS, SIGMAS, START
from tests.tools.files.readers.navigation.test_nmea import dive

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
NAVIGATION_FILES = {
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
