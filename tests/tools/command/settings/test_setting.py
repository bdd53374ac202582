"""Every option as a setting, and a TOML file of them: it sets what the command line would, and errors are named."""

import random
import re
import time
from pathlib import Path
from typing import Any

import pytest
import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.main import app
from sonarmap.tools.command.settings.file import read_settings
from sonarmap.tools.command.settings.setting import Setting, common_settings, settings_of
from sonarmap.tools.command.verbs.config import _literal
from tests.samples.refusals import refuses

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
        ("map", "export", "", "none"),
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
    assert common["max-tilt"] == ["register", "map", "live", "locate", "compare"]
    assert {"method", "voxel", "device", "mount", "quiet", "json", "seed", "origin"} <= set(common)
    assert common["out"] == ["map", "live", "compare"]
    assert not {"overwrite", "trajectory", "method-of-its-own"} & set(common)


OF_KIND: dict[type, Any] = {bool: True, int: 2, float: 0.25, str: "a", Path: "a.csv"}
OF_KEY: dict[str, Any] = {
    "grid": 96,
    "method": "planes",
    "write": "moved.ply",
    "refine": "spectral",
    "prior-sigmas": "0.5,3,0.1,2",
    "export": ["laz", "kmz"],
    "format": ["laz"],
    "duration": "10m",
    "sonar": "10.0.0.7",
    "align": "first",
    "objective": "isotropic",
    "start": "given",
    "picture": "a.png",
    "scene": "harbor",
    "max-tilt": 12.5,
    "track": "a.tum",
    "height": "top",
    "export-height": "mean",
    "export-points": "all",
    "export-scans": "3,7-12",
}
EXAMPLE = """
[common]
grid = 96
max_tilt = 12.5  # degrees
method = "spectral"
mount = "0,0,180"
[map]
grid = 64
max-speed = 2
export = ["pcd", "kitti"]
report = false
[simulate]
seed = 5
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "survey.toml"
    path.write_text(text)
    return path


def sample(setting: Setting) -> Any:
    value = OF_KEY.get(f"{setting.verb}-{setting.key}", OF_KEY.get(setting.key, OF_KIND[setting.kind]))
    if setting.kind is bool:
        return not setting.parameter.default
    if setting.many and not isinstance(value, list):
        return [value]
    return value


def on_the_command_line(setting: Setting, value: Any) -> list[str]:
    flag = max(setting.parameter.opts, key=len)
    if setting.kind is bool:
        return [flag if value else max(setting.parameter.secondary_opts, key=len)]
    return [word for entry in (value if setting.many else [value]) for word in (flag, str(entry))]


def parsed(setting: Setting, words: list[str], **defaults: Any) -> Any:
    """What the verb would get."""
    command = GROUP.commands[setting.verb]
    for entry in command.params:
        if entry.required and entry.name != setting.name:
            flag = [max(entry.opts, key=len)] if entry.param_type_name == "option" else []
            words = [*words, *flag, "laz" if "--format" in entry.opts else "all"]
    with command.make_context(setting.verb, words, default_map=defaults or None) as context:
        return context.params[setting.name]


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda entry: f"{entry.verb}-{entry.key}")
def test_a_file_sets_what_the_command_line_would(setting: Setting, tmp_path: Path) -> None:
    value = sample(setting)
    path = written(tmp_path, f"[{setting.verb}]\n{setting.key} = {_literal(value)}\n")
    file = read_settings(path, GROUP.commands, setting.verb)
    assert file.sections[setting.verb] == {setting.name: setting.verb}
    by_file = parsed(setting, [], **file.values[setting.verb])
    by_words = parsed(setting, on_the_command_line(setting, value))
    assert by_file == by_words
    assert by_file != setting.parameter.default


def test_sections(tmp_path: Path) -> None:
    file = read_settings(written(tmp_path, EXAMPLE), GROUP.commands, None)
    assert file.values["map"] == {
        "grid": 64,
        "max_tilt": 12.5,
        "method": "spectral",
        "mount": "0,0,180",
        "max_speed": 2,
        "export": ["pcd", "kitti"],
        "report": False,
    }
    assert file.values["register"]["grid"] == 96
    assert file.values["simulate"] == {"seed": 5}  # its seed is not that of [common]
    assert (file.sections["map"]["grid"], file.sections["map"]["mount"]) == ("map", "common")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[map]\ngrdi = 96", "[map] grdi is not a setting; perhaps grid?"),
        ("[map]\nzzzz = 96", "[map] zzzz is not a setting; 'sonarmap config' lists all"),
        ("[mpa]\ngrid = 96", "[mpa] is not a section; perhaps map?"),
        ("grid = 96", "grid stands outside of a section; put it under [common]"),
        ("map = 5", "map is 5; wanted a section, [map]"),
        (
            "[common]\npatch-test = true",
            "[common] patch-test does not mean the same for several verbs; put it under [map]",
        ),
        (
            "[common]\nfresh = true",
            "[common] fresh does not mean the same for several verbs; put it under [map] or [reproduce]",
        ),
        ("[map]\ngrid = 96.0", "[map] grid is 96.0; wanted a whole number"),
        ("[map]\ngrid = '96'", "[map] grid is '96'; wanted a whole number"),
        ("[map]\ngrid = true", "[map] grid is True; wanted a whole number"),
        ("[map]\nvoxel = '1'", "[map] voxel is '1'; wanted a number [m]"),
        ("[map]\nvoxel = [1]", "[map] voxel is [1]; wanted a number [m]"),
        ("[map]\nreport = 1", "[map] report is 1; wanted true or false"),
        ("[map]\nnav-offset = 2.5", "[map] nav-offset is 2.5; wanted a text in quotes [s]"),
        ("[map]\nexport = ['pcd', 3]", "[map] export is ['pcd', 3]; wanted a text in quotes, or a list of such"),
        ("[map.grid]\na = 1", "[map] grid is {'a': 1}; wanted a whole number"),
        ("[map]\ngrid = 97", "[map] grid is 97: --grid 97 is not an even product of 2, 3 and 5"),
        ("[common]\ngrid = 97", "[common] grid is 97: --grid 97 is not"),
        ("[map]\nvoxel = nan", "[map] voxel is nan: nan m; give a length above 0"),
        ("[map]\nmax-speed = -1", "[map] max-speed is -1: -1.0; give a number above 0"),
        ("[map]\nloops = -1", "[map] loops is -1: "),
        ("[map]\nmethod = 'magic'", "[map] method is 'magic': no method is called 'magic'"),
        ("[map]\ngrid = 96\ngrid = 64", "is no TOML file: Cannot overwrite a value"),
        ("[map\ngrid = 96", "is no TOML file: "),
        ("\x00", "is no TOML file: "),
    ],
)
def test_what_cannot_be_is_named(text: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as refused:
        read_settings(path, GROUP.commands, None)
    assert str(refused.value).startswith(str(path))
    assert words in str(refused.value)


def test_the_values_of_another_verb_wait_until_it_runs(tmp_path: Path) -> None:
    path = written(tmp_path, "[map]\ngrid = 97\n")
    assert read_settings(path, GROUP.commands, "export").values["map"] == {"grid": 97}


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "large.toml").write_bytes(b"#\n" * ((1 << 15) + 1))
    none = r"cannot read the settings .*none\.toml: No such file"
    for name, words in {"none.toml": none, "": "Is a directory", "large.toml": "has more than 64 KiB"}.items():
        refuses(words, read_settings, tmp_path / name, GROUP.commands, None)
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbf[map]\r\ngrid = 96\r\n")
    assert read_settings(tmp_path / "bom.toml", GROUP.commands, None).values["map"] == {"grid": 96}


@pytest.mark.parametrize("text", ["{}=1", "[{}]\na=1", "[map]\nexport={{{}=1}}", "[map]\nloops = 0x{:f<40000.0}"])
def test_a_long_line_is_refused_before_it_is_read(text: str, tmp_path: Path) -> None:
    """A key of 80 KB took a minute and 6 GB, and a number of 40,000 digits was a defect."""
    path = written(tmp_path, "# settings\n" + text.format(".".join("a" * 20_000)))
    refuses(r"survey.toml: line [23] has more than 1000 characters", read_settings, path, GROUP.commands, None)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("{}=1\n" * 480, 980),
        ("[{}]\n" * 480, 980),
        ("[map.grid.{}]\n" + "{}=1\n" * 16, 490),
        ("[map.grid.{}]\n{}=1\n", 490),
        ("map=[{{{}=1}}]", 490),
    ],
)
def test_keys_of_many_parts_are_refused_soon(text: str, parts: int, tmp_path: Path) -> None:
    """A file of 1 MB, all lines shorter than 2,000 characters, took 15 s and 2 GB; a value so deep was a defect."""
    keys = [".".join([f"b{k}", *"a" * parts]) for k in range(480)]
    path = written(tmp_path, text.format(*keys))
    begun = time.process_time()
    with pytest.raises(InputError) as refused:
        read_settings(path, GROUP.commands, None)
    assert time.process_time() - begun < 2
    assert len(str(refused.value)) < 1000


@pytest.mark.parametrize("count", [60, pytest.param(3000, marks=pytest.mark.slow)])
def test_damaged_files_are_refused_by_their_name_or_read(count: int, tmp_path: Path) -> None:
    rng, path = random.Random(7), tmp_path / "damaged.toml"
    for _ in range(count):
        content = bytearray(EXAMPLE.encode())
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(content))
            if rng.random() < 0.5:
                content[at] = rng.randrange(256)
            else:
                del content[at : at + rng.randint(1, 9)]
        path.write_bytes(content)
        try:
            read_settings(path, GROUP.commands, None)
        except InputError as error:
            assert str(path) in str(error)  # noqa: PT017 - most are refused, some are not
