"""Which OpenCL devices a selector means, and which of several comes first."""

import re
from collections.abc import Iterable

import pyopencl as cl

from kernels.errors import DeviceError

Entry = tuple[str, cl.Device]  # the label "platform:device", by number, and the device

_KINDS = ("gpu", "cpu", "other")


def kind(device: cl.Device) -> str:
    """ "gpu", "cpu" or "other"."""
    if device.type & cl.device_type.GPU:
        return "gpu"
    return "cpu" if device.type & cl.device_type.CPU else "other"


def matching(wanted: str, entries: list[Entry]) -> list[Entry]:
    """The devices that a selector means; it is read as `kernels.device.device.choose_device` says.

    Raises:
        DeviceError: it means none, or several at once; the message lists what there is.
    """
    text = wanted.strip().lower()
    if re.fullmatch(r"[^:]+:\s*\d+(\s*,\s*\d+)+", text):  # PyOpenCL takes this for a context of several
        first = wanted.partition(",")[0].strip()
        raise DeviceError(f"'{wanted}' names several OpenCL devices; choose one, as in '{first}'. {_listed(entries)}")
    if not text:
        return entries
    if text in _KINDS:
        matches = [entry for entry in entries if kind(entry[1]) == text]
    else:
        matches = _at_place(text, entries) or [entry for entry in entries if _is_named(text, entry[1])]
    if not matches:
        raise DeviceError(f"no OpenCL device matches '{wanted}'. {_listed(entries)}")
    return matches


def by_preference(entries: Iterable[Entry]) -> list[Entry]:
    """GPUs, then CPUs, then others.

    Of GPUs, those with their own memory come first, then those with more compute units times clock. That counts
    a maker's GPUs well and compares those of two makers roughly: what one calls a unit is several of another's.
    Of CPUs, the drivers of one vendor come newest first, since an old PoCL does not know a new processor. Versions of
    different vendors do not compare: their order, and that of all else, is the one in which the system lists them.
    """
    entries = list(entries)
    vendors = list(dict.fromkeys(_vendor(device) for _, device in entries))
    cpus = [entry for entry in entries if kind(entry[1]) == "cpu"]
    cpus.sort(key=lambda entry: _driver_age(entry[1]), reverse=True)
    cpus.sort(key=lambda entry: vendors.index(_vendor(entry[1])))
    gpus = sorted((entry for entry in entries if kind(entry[1]) == "gpu"), key=lambda entry: _gpu_rank(entry[1]))
    return gpus + cpus + [entry for entry in entries if kind(entry[1]) == "other"]


def _listed(entries: list[Entry]) -> str:
    known = (f"{label} {device.name.strip()} ({device.platform.name.strip()})" for label, device in entries)
    return f"There are: {'; '.join(known)}"


def _at_place(text: str, entries: list[Entry]) -> list[Entry]:
    """The devices of "platform:device", each a number or a part of a name, or of a platform's number alone."""
    platform, colon, device = (part.strip() for part in text.partition(":"))
    if not platform or not (colon or platform.isdecimal()):
        return []
    device = device or "0"  # as PyOpenCL takes it
    matches: list[Entry] = []
    for label, candidate in entries:
        p, _, d = label.partition(":")
        there = platform == p if platform.isdecimal() else platform in _platform_words(candidate)
        if there and (device == d if device.isdecimal() else device in candidate.name.lower()):
            matches.append((label, candidate))
    return matches


def _is_named(text: str, device: cl.Device) -> bool:
    """Whether a text is part of the device's or its platform's name or version; digits count as a whole number."""
    if text.isdecimal():
        return re.search(rf"(?<!\d){text}(?!\d)", device.name) is not None
    return text in f"{device.name} {device.version}".lower() or text in _platform_words(device)


def _platform_words(device: cl.Device) -> str:
    return f"{device.platform.name} {device.platform.version}".lower()


def _vendor(device: cl.Device) -> str:
    return device.platform.vendor.strip()


def _driver_age(device: cl.Device) -> tuple[list[int], bool]:
    """Sorts old drivers before new ones, and a release candidate before the release."""
    version = device.driver_version
    digits = re.search(r"\d+(\.\d+)*", version)
    return [int(part) for part in digits[0].split(".")] if digits else [], "rc" not in version.lower()


def _gpu_rank(device: cl.Device) -> tuple[bool, int]:
    return bool(device.host_unified_memory), -device.max_compute_units * device.max_clock_frequency
