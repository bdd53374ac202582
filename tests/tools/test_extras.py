"""Optional libraries: each is declared in an extra, and a missing one is named before any work."""

import re
import tomllib
from importlib.metadata import packages_distributions

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools import extras
from sonarmap.tools.products.export.formats import FORMATS, known_formats
from tests.samples.places import ROOT


def test_every_optional_module_is_declared_in_its_extra() -> None:
    optional = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    declared = {extra: {re.split(r"[\[>=]", text)[0] for text in texts} for extra, texts in optional.items()}
    distributions = packages_distributions()
    for module, extra in extras.EXTRA_OF.items():
        assert declared[extra] & set(distributions[module]), module
    assert {entry.library for entry in FORMATS.values()} - {None} <= set(extras.EXTRA_OF)


@pytest.mark.parametrize(("name", "extra"), [("geotiff", "gis"), ("e57", "e57"), ("mcap", "ros")])
def test_a_format_without_its_library_is_refused_at_once(
    name: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda module: None)
    with pytest.raises(InputError, match=rf"{FORMATS[name].library}, which is not installed.*sonarmap\[{extra}\]"):
        known_formats(["xyz", name])
    assert known_formats(["xyz", "kmz"]) == ["xyz", "kmz"]
