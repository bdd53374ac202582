"""Files of navigation damaged anywhere: refused in words, or read as priors that can be used, without a warning."""

import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS, NavigationSettings, parse_mount
from tests.samples.damage.mutations import mutated
from tests.samples.processor_time import processor_time
from tests.tools.files.readers.navigation.logs import SCANS, SIGMAS, START
from tests.tools.files.readers.navigation.test_nmea import dive

MOST_SECONDS = 5.0


def _log(rows: range, separator: str = ";") -> bytes:
    lines = ["Date;Time (UTC);Lat;Lon;Depth (m);Depth SD;Heading;Roll;Pitch;Volt"]
    for k in rows:
        lines.append(
            f"01.07.2026;09:30:{k:02d}.25;60 23.{478 + k} N;5 19.{326 + k} E;12,{k:02d};0,2;{340 + k};1,5;-2,5;12,1"
        )
    return "\n".join([*lines, ""]).replace(";", separator).encode()


def _grid() -> bytes:
    rows = "".join(f"2425\t{293418 + k}\t{297000 + k}.5\t{6701000 - k}.25\t{k}.5\t{200 - k}\n" for k in range(12))
    return ("GPS Week\tTOW\tEasting\tNorthing\tz\tyaw\n" + rows).encode("utf-16")


TUM = "".join(f"{START + k} {k * 1.5} 2.25 -0.5 0.1 0.2 0.3 0.9\n" for k in range(12)).encode()
FILES = {
    "log": ("log.csv", _log(range(12)), AS_IT_SAYS),
    "mounted": ("log.csv", _log(range(12)), NavigationSettings(mount=parse_mount("0,-20,5,1,0,0.5"), offset=0.5)),
    "grid": ("log.csv", _grid(), NavigationSettings(crs="EPSG:32632", frame="ned", heading_reference="grid")),
    "nmea": ("log.nmea", dive(count=12, headings=1).encode(), AS_IT_SAYS),
    "tum": ("nav.tum", TUM, AS_IT_SAYS),
    "odometry": ("odometry.tum", TUM, AS_IT_SAYS),
}  # fmt: skip


def _read(kind: str, path: Path, settings: NavigationSettings) -> None:
    notes: list[str] = []
    if kind == "odometry":
        odometry = read_odometry(path, SCANS, 0.01, 0.001, notes, settings)
        assert np.isfinite(odometry.T_odom_sensor.as_matrix()).all()
        return
    navigated = navigate(SCANS, path, settings, SIGMAS, notes=notes)
    priors = [scan.prior for scan in navigated.scans if scan.prior is not None]
    assert all(np.isfinite(prior.T_world_sensor.as_matrix()).all() for prior in priors)
    assert all((prior.sigmas > 0).all() for prior in priors)


def damage(folder: Path, kind: str, each: int, read: Callable[[str, Path, NavigationSettings], None]) -> Counter[str]:
    """How many of so many damaged files were refused and read."""
    name, content, settings = FILES[kind]
    ends: Counter[str] = Counter()
    others = [other for _, other, _ in FILES.values()]
    for number in range(each):
        rng = np.random.default_rng([11, list(FILES).index(kind), number])
        path = folder / name
        path.write_bytes(mutated(content, others[rng.integers(len(others))], rng))
        start = processor_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read(kind, path, settings)
        except InputError:
            ends["refused"] += 1
        else:
            ends["read"] += 1
        assert processor_time() - start < MOST_SECONDS, f"{kind} {number}"
    return ends


@pytest.mark.parametrize("kind", list(FILES))
def test_a_few_are_refused_or_harmless(tmp_path: Path, kind: str) -> None:
    _read(kind, _whole(tmp_path, kind), FILES[kind][2])
    ends = damage(tmp_path, kind, 80, _read)
    assert ends["refused"] > 0
    assert ends["read"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(FILES))
def test_two_thousand_are_refused_or_harmless(tmp_path: Path, kind: str) -> None:
    print(kind, dict(damage(tmp_path, kind, 2000, _read)))


def _whole(folder: Path, kind: str) -> Path:
    path = folder / FILES[kind][0]
    path.write_bytes(FILES[kind][1])
    return path
