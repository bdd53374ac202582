"""Which OpenCL devices a selector means, and which of several comes first."""

import re
from collections.abc import Iterable

from sonarmap.kernels.device.device_info import DeviceInfo
from sonarmap.kernels.errors import DeviceError

_KINDS = ("gpu", "cpu", "other")


def matching(wanted: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices that a selector means; it is read as `kernels.device.device.choose_device` says.

    Raises:
        DeviceError: it means none, or several at once; the message lists what there is.
    """
    text = wanted.strip().lower()
    if re.fullmatch(r"[^:]+:\s*\d+(\s*,\s*\d+)+", text):  # PyOpenCL takes this for a context of several
        first = wanted.partition(",")[0].strip()
        raise DeviceError(f"'{wanted}' names several OpenCL devices; choose one, as in '{first}'. {_listed(infos)}")
    if not text:
        return infos
    if text in _KINDS:
        matches = [info for info in infos if info.kind == text]
    else:
        matches = _at_place(text, infos) or [info for info in infos if _is_named(text, info)]
    if not matches:
        raise DeviceError(f"no OpenCL device matches '{wanted}'. {_listed(infos)}")
    return matches


def by_preference(infos: Iterable[DeviceInfo]) -> list[DeviceInfo]:
    """GPUs, then CPUs, then others.

    Of GPUs, those with their own memory come first, then those with more compute units times clock. That counts
    a maker's GPUs well and compares those of two makers roughly: what one calls a unit is several of another's.
    Of CPUs, the drivers of one vendor come newest first, since an old PoCL does not know a new processor. Versions of
    different vendors do not compare: their order, and that of all else, is the one in which the system lists them.
    """
    infos = list(infos)
    vendors = list(dict.fromkeys(info.vendor for info in infos))
    cpus = [info for info in infos if info.kind == "cpu"]
    cpus.sort(key=_driver_age, reverse=True)
    cpus.sort(key=lambda info: vendors.index(info.vendor))
    gpus = sorted((info for info in infos if info.kind == "gpu"), key=_gpu_rank)
    return gpus + cpus + [info for info in infos if info.kind == "other"]


def _listed(infos: list[DeviceInfo]) -> str:
    known = (f"{info.selector} {info.name}" + (f" ({info.platform})" if info.platform else "") for info in infos)
    return f"There are: {'; '.join(known)}"


def _at_place(text: str, infos: list[DeviceInfo]) -> list[DeviceInfo]:
    """The devices of "platform:device", each a number or a part of a name, or of a platform's number alone."""
    platform, colon, device = (part.strip() for part in text.partition(":"))
    if not platform or not (colon or platform.isdecimal()):
        return []
    device = device or "0"  # as PyOpenCL takes it
    matches: list[DeviceInfo] = []
    for info in infos:
        p, _, d = info.selector.partition(":")
        there = platform == p if platform.isdecimal() else platform in _platform_words(info)
        if there and (device == (d or "0") if device.isdecimal() else device in info.name.lower()):
            matches.append(info)
    return matches


def _is_named(text: str, info: DeviceInfo) -> bool:
    """Whether a text is part of the device's or its platform's name or version; digits count as a whole number."""
    if text.isdecimal():
        return re.search(rf"(?<!\d){text}(?!\d)", info.name) is not None
    return text in f"{info.name} {info.version}".lower() or text in _platform_words(info)


def _platform_words(info: DeviceInfo) -> str:
    return f"{info.platform} {info.platform_version}".lower()


def _driver_age(info: DeviceInfo) -> tuple[list[int], bool]:
    """Sorts old drivers before new ones, and a release candidate before the release."""
    version = info.driver_version
    digits = re.search(r"\d+(\.\d+)*", version)
    return [int(part) for part in digits[0].split(".")] if digits else [], "rc" not in version.lower()


def _gpu_rank(info: DeviceInfo) -> tuple[bool, int]:
    return info.shares_memory, -info.compute_units * info.clock
