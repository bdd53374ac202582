"""Installed drivers, by the .icd files that name them."""

import sys
from pathlib import Path

import pytest

from sonarmap.kernels.device import drivers
from sonarmap.kernels.device.drivers import Driver, driver_fault, installed_drivers


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two drivers of the system, one of them with two .icd files, and one installed by pip."""
    folder = tmp_path / "etc"
    folder.mkdir()
    (folder / "b.icd").write_text("libb.so.1\n")
    (folder / "a.icd").write_text("/opt/liba.so")
    (folder / "c.icd").write_text("libb.so.1")
    own = tmp_path / "environment"
    (own / "etc" / "OpenCL" / "vendors").mkdir(parents=True)
    (own / "lib").mkdir()
    (own / "lib" / "libpip.so").touch()
    (own / "etc" / "OpenCL" / "vendors" / "pip.icd").write_text("/where/it/was/built/lib/libpip.so\n")
    (own / "etc" / "OpenCL" / "vendors" / "absent.icd").write_text("/where/it/was/built/lib/libabsent.so\n")
    monkeypatch.setattr(drivers, "SYSTEM_FOLDER", folder)
    monkeypatch.setattr(sys, "prefix", str(own))
    monkeypatch.setattr(drivers.sysconfig, "get_path", lambda _: str(own / "site"))
    return folder


def test_drivers_of_the_system_come_before_those_of_pip(system: Path) -> None:
    own = Path(sys.prefix)
    assert installed_drivers({}) == [
        Driver(str(system / "a.icd"), "/opt/liba.so"),
        Driver(str(system / "b.icd"), "libb.so.1"),
        Driver(str(own / "etc" / "OpenCL" / "vendors" / "pip.icd"), str(own / "lib" / "libpip.so")),
    ]


@pytest.mark.parametrize("variable", ["OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"])
def test_variable_replaces_the_folders(system: Path, tmp_path: Path, variable: str) -> None:
    (tmp_path / "one").mkdir()
    file = tmp_path / "one" / "x.icd"
    file.write_text("libx.so")
    for place in (tmp_path / "one", file):
        assert installed_drivers({variable: str(place)}) == [Driver(str(file), "libx.so")]
    assert installed_drivers({variable: "b.icd"}) == [Driver(str(system / "b.icd"), "libb.so.1")]
    library = tmp_path / "one" / "libx.so"
    library.touch()
    assert installed_drivers({variable: str(library)}) == [Driver(str(library), str(library))]
    assert installed_drivers({variable: str(file)}) == [Driver(str(file), str(library))]  # it lies beside the file


def test_without_files_the_loader_is_asked(system: Path, tmp_path: Path) -> None:
    assert installed_drivers({"OCL_ICD_VENDORS": str(tmp_path / "nothing")}) == [Driver()]


def test_why_a_driver_cannot_be_loaded() -> None:
    assert driver_fault(Driver()) == ""
    assert driver_fault(Driver("empty.icd")) == "empty.icd names no library"
    assert "libnowhere.so" in driver_fault(Driver("x.icd", "libnowhere.so"))
