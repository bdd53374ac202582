"""The library's arguments as options: its errors say `edge=128`, the command line says --grid 128."""

import re

_SAME = ("device", "fix_sigma", "frame", "fresh", "max_tilt", "method", "objective", "range_scale")
_SAME += ("scheduler", "seed", "sound_speed", "start", "ties", "units", "voxel", "workers")
OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _SAME} | {
    "alignment": "--align",
    "count": "--scans",
    "edge": "--grid",
    "repairs": "--repair",
}
FLAGS = {"--fresh", "--repair"}  # without a value

_ARGUMENT = re.compile(r"`(\w+)(?:=([^`]*))?`")


def as_options(message: str) -> str:
    """The message with every argument in backticks as its option; one that is no option loses its backticks."""
    return _ARGUMENT.sub(_option, message)


def _option(argument: re.Match[str]) -> str:
    name, value = argument.groups()
    if name not in OPTIONS:
        return argument[0].strip("`")
    option = OPTIONS[name]
    return option if value is None or option in FLAGS else f"{option} {value}"
