"""Fixtures that several tests of commands share."""

from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.slam.mapper import Mapper
from sonarmap.spectral.scan import Scan
from tests.samples.clutter_scans import scan, write


@pytest.fixture
def pair(tmp_path: Path) -> list[str]:
    """Paths of two scans of one place."""
    return write(tmp_path, target=scan(0), source=scan(1))


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Paths of four scans of one place."""
    return write(tmp_path_factory.mktemp("scans"), a=scan(0), b=scan(1), c=scan(2), d=scan(3))


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Scan]:
    """The scans given to a mapper, whose run then ends with InputError."""
    scans: list[Scan] = []

    def run(_: Mapper, given: tuple[Scan, ...], *__: object) -> None:
        scans.extend(given)
        raise InputError("enough")

    monkeypatch.setattr(Mapper, "run", run)
    return scans
