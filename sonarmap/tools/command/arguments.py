"""The library's arguments as options: its errors say `edge=128`, the command line says --grid 128."""

import re

OPTIONS = {
    "alignment": "--align",
    "count": "--scans",
    "device": "--device",
    "edge": "--grid",
    "fix_sigma": "--fix-sigma",
    "frame": "--frame",
    "fresh": "--fresh",
    "hypotheses": "--hypotheses",
    "max_tilt": "--max-tilt",
    "method": "--method",
    "objective": "--objective",
    "range_scale": "--range-scale",
    "refinement": "--refine",
    "repairs": "--repair",
    "scheduler": "--scheduler",
    "seed": "--seed",
    "sound_speed": "--sound-speed",
    "start": "--start",
    "ties": "--ties",
    "units": "--units",
    "use_strength": "--strength",
    "voxel": "--voxel",
    "workers": "--workers",
    "yaw_peaks": "--yaw-peaks",
}
FLAGS = {"--fresh", "--repair", "--strength"}  # without a value

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
