# pyright: strict
"""The command that makes a map again, from what its summary says of the settings."""

import math
import shlex
from collections.abc import Mapping
from typing import Any, cast

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.products.report.naming import inputs_of

# Settings of the mapper that an option sets: where they are, the option, its default, and how many of the option's
# units there are in one of the setting's.
_OF_MAPPER = (
    (("loops", "per_scan"), "--loops", 2, 1.0),
    (("keys", "step"), "--key-step", None, 1.0),
    (("limits", "speed"), "--max-speed", None, 1.0),
    (("limits", "turn_rate"), "--max-turn-rate", None, math.degrees(1.0)),
    (("limits", "step"), "--max-step", None, 1.0),
    (("min_seen",), "--min-seen", 2, 1.0),
)
_NOT_OPTIONS = ("inputs", "method", "ties")  # the page itself adds the ties that it saves
_EAST = 90.0  # the heading of a map's x axis, unless --origin-heading says otherwise [deg]


def map_command(settings: Mapping[str, Any], georeference: Georeference | None = None) -> dict[str, str]:
    """`sonarmap map` with the options that summary.json has settings of, and apart its inputs, all quoted for a POSIX
    shell; the map's place on the Earth is said where no navigation says it again.

    The page adds its own folder, so that its bytes do not depend on where it lies. The grid is as it was, so that pairs
    that are in the journal are not registered again.
    """
    words = ["sonarmap", "map"]
    if "method" in settings:
        words += ["--method", str(settings["method"])]
    grid = settings.get("grid")
    if isinstance(grid, Mapping):
        words += ["--grid", str(grid["edge"]), "--voxel", str(grid["voxel"])]  # pyright: ignore[reportUnknownArgumentType]
    for name, value in settings.items():
        for each in cast("list[Any]", value) if isinstance(value, list) else [value]:
            if name not in _NOT_OPTIONS and isinstance(each, str | int | float):
                words += _option(f"--{name.replace('_', '-')}", each)
    words += _mapper_words(settings.get("mapper"))
    if georeference is not None and "priors" not in settings:
        words += _origin_words(georeference)
    inputs = [f"./{path}" if path.startswith("-") else path for path in inputs_of(settings)]
    return {"options": shlex.join(words), "inputs": shlex.join(inputs)}


def _mapper_words(mapper: Any) -> list[str]:
    words: list[str] = []
    for path, option, default, factor in _OF_MAPPER:
        value = mapper
        for name in path:
            value = value.get(name) if isinstance(value, Mapping) else None  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        if isinstance(value, int | float) and value != default:
            words += _option(option, value if factor == 1.0 else float(f"{value * factor:.12g}"))
    return words


def _origin_words(here: Georeference) -> list[str]:
    words = _option("--origin", f"{here.latitude!r},{here.longitude!r},{here.height!r}")
    words += ["--vertical", here.vertical]
    return words if here.heading == _EAST else [*words, "--origin-heading", repr(here.heading)]


def _option(name: str, value: str | float) -> list[str]:
    if isinstance(value, bool):
        return [name] if value else []
    text = str(value)
    return [f"{name}={text}"] if text.startswith("-") else [name, text]
