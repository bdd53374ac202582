"""Every option as a setting: all of them, with unit and default from the option itself."""

import re
from typing import Any

import pytest
import typer

from sonarmap.tools.command.main import app
from sonarmap.tools.command.settings.setting import Setting, common_settings, settings_of

GROUP: Any = typer.main.get_command(app)
SETTINGS = settings_of(GROUP.commands)
WITHOUT_UNIT = re.compile(r"\b(share|strength|factor|Multiply all ranges|in beams|linear)\b", re.IGNORECASE)


def setting(verb: str, key: str) -> Setting:
    (only,) = [entry for entry in SETTINGS if (entry.verb, entry.key) == (verb, key)]
    return only


def test_every_option_of_every_verb_is_a_setting() -> None:
    options = [
        (verb, parameter.name)
        for verb, command in GROUP.commands.items()
        for parameter in command.params
        if parameter.param_type_name == "option" and parameter.name not in ("help", "help_all")
    ]
    assert [(entry.verb, entry.name) for entry in SETTINGS] == options
    assert len({(entry.verb, entry.key) for entry in SETTINGS}) == len(options)
    assert all(entry.about and entry.type and entry.default for entry in SETTINGS)


@pytest.mark.parametrize("entry", SETTINGS, ids=lambda entry: f"{entry.verb}-{entry.key}")
def test_every_length_angle_and_time_has_its_unit(entry: Setting) -> None:
    """A number with a fraction is of a unit, or says that it is a share or the like."""
    if entry.kind is float and not entry.unit:
        assert WITHOUT_UNIT.search(entry.help), f"{entry.help!r} names no unit; write it as \\[m] or \\[deg]"
    assert "[" not in entry.default


@pytest.mark.parametrize(
    ("verb", "key", "unit", "default"),
    [
        ("map", "grid", "", "128"),
        ("map", "voxel", "m", "suits the scans"),
        ("map", "max-tilt", "deg", "35"),
        ("map", "max-turn-rate", "deg/s", "learned"),
        ("map", "units", "", "m"),
        ("map", "mount", "deg, m", "the navigation is of the sonar"),
        ("map", "nav-offset", "s", "0"),
        ("map", "odometry-drift", "%, deg/h", "1,10"),
        ("map", "prior-sigmas", "deg, m", "none"),
        ("map", "report", "", "true"),
        ("map", "out", "", "to be given"),
        ("map", "also", "", "none"),
        ("simulate", "sigma2", "m^2", "none"),
        ("evaluate", "max-error-m", "m", "none"),
        ("reproduce", "max-tilt", "deg", "35"),
        ("bench", "grid", "", "64, 128 and 256"),
        ("bench", "repeats", "", "15"),
    ],
)
def test_units_and_defaults(verb: str, key: str, unit: str, default: str) -> None:
    entry = setting(verb, key)
    assert (entry.unit, entry.default) == (unit, default)


def test_what_means_the_same_is_common() -> None:
    common = {key: [entry.verb for entry in group] for key, group in common_settings(SETTINGS).items()}
    assert set(common["grid"]) >= {"register", "map", "inspect"}
    assert "bench" not in common["grid"]  # which takes several
    assert common["max-tilt"] == ["register", "map"]
    assert {"method", "voxel", "device", "mount", "quiet", "json", "seed", "origin"} <= set(common)
    assert not {"out", "loops", "trajectory", "method-of-its-own"} & set(common)
