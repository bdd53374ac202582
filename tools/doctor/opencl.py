"""OpenCL: the loader, the drivers, the devices, the device that would be chosen, and its self-test."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tools.doctor.child import Answers, answer, ask
from tools.doctor.drivers import driver_fault, driver_files, vendor_folder
from tools.doctor.finding import Finding, Remedy
from tools.doctor.libraries import pip_command, shared_object_remedy
from tools.doctor.memory import memory_is_short

_SECONDS = 120.0  # kernels are compiled, and every device is tested
_POCL = Remedy("install PoCL, an OpenCL driver for processors:", "sudo apt-get install pocl-opencl-icd")
_POCL_OF_PIP = Remedy("or, without apt:", pip_command("pyopencl[pocl]"))


def opencl(test: bool) -> tuple[Finding, Answers]:
    """The drivers and devices, and what the other process said of them.

    Args:
        test: whether to run the devices' self-tests; otherwise what the last ones said counts.
    """
    answers = ask("tools.doctor.opencl", *(["--test"] if test else []), seconds=_SECONDS)
    finding = _unloadable(answers) or _ended(answers) or _unavailable(answers) or _usable(answers)
    if finding.verdict == "wrong" and memory_is_short():
        finding = replace(finding, seen=f"{finding.seen}; see memory", remedies=())
    return finding, answers


def main(arguments: Sequence[str]) -> None:
    """In the other process: list the devices, choose, and say what fits on it."""
    from dataclasses import asdict

    answer(begins="loading PyOpenCL")
    try:
        from kernels.device.device import choose_device, list_devices
    except ImportError as error:
        answer(unloadable=str(error))
        return
    from kernels.errors import DeviceError, SonarmapError

    try:
        answer(begins="testing the devices" if arguments else "trying the devices")
        answer(devices=[asdict(info) for info in list_devices(test=bool(arguments))])
        answer(begins="choosing a device")
        device = choose_device()
        answer(chosen=device.selector)
        _say_what_fits(device)
    except DeviceError as error:
        answer(unavailable=str(error))
    except SonarmapError as error:  # a variable of the environment
        answer(refused=str(error))
    for file in driver_files():
        answer(begins=f"loading the driver of {file}")
        answer(driver=[str(file), driver_fault(file)])


def _say_what_fits(device: Any) -> None:
    from kernels.fft.edges import EDGES
    from spectral.memory import largest_edge, memory_plan

    methods = ("spectral", "hemisphere")
    pairs = {edge: max(memory_plan(edge, method).pair for method in methods) for edge in EDGES}
    answer(largest=largest_edge(device), pairs=list(pairs.items()), device_memory=device.memory, shared=device.is_cpu)


def _unloadable(answers: Answers) -> Finding | None:
    """PyOpenCL, or the loader that it needs, is not there."""
    if not (faults := answers.named("unloadable")):
        return None
    fault = str(faults[0])
    system = shared_object_remedy(fault)
    again = Remedy("install PyOpenCL with its own loader and driver:", pip_command("pyopencl[pocl]"))
    if system is None and "No module named" not in fault:
        again = Remedy(again.words, pip_command("--force-reinstall", "--no-deps", "pyopencl"))
    remedies = (again,) if system is None else (system, again)
    return Finding("OpenCL", "wrong", f"PyOpenCL cannot be loaded: {fault}", remedies, {"error": fault})


def _ended(answers: Answers) -> Finding | None:
    """A driver took the process with it, or hung, before there was a device."""
    if not answers.end or answers.named("largest"):
        return None
    while_it = (answers.named("begins") or ["starting"])[-1]
    seen = f"while {while_it}: {answers.end}"
    newer = Remedy("update the driver, or use another device; this lists them:", "sonarmap devices")
    return Finding("OpenCL", "wrong", seen, (newer, _POCL), {"error": seen})


def _unavailable(answers: Answers) -> Finding | None:
    """There is no driver, or no device that works."""
    if refusals := answers.named("refused"):
        return Finding("OpenCL", "wrong", str(refusals[0]), details={"error": refusals[0]})
    if not (errors := answers.named("unavailable")):
        return None
    devices, drivers = _devices(answers), _drivers(answers)
    details = {"error": errors[0], "drivers": drivers, "devices": devices}
    working = [device for device in devices if not device["fault"]]
    if working:  # PYOPENCL_CTX names another
        unset = Remedy("have a device chosen that works:", "unset PYOPENCL_CTX")
        return Finding("OpenCL", "wrong", str(errors[0]), (unset,), details)
    place, variable = vendor_folder()
    seen = [f"{device['selector']} {device['name']} does not work: {device['fault']}" for device in devices]
    seen += [f"{file}: {fault}" for file, fault in drivers.items() if fault]
    if not devices:
        seen.insert(0, f"no driver: {_looked_in(place, variable)}")
    elif variable:
        seen.append(_looked_in(place, variable))
    remedies = [Remedy("look for drivers where the system has them:", f"unset {variable}")] if variable else []
    remedies += [_POCL] if devices else [_POCL, _POCL_OF_PIP]
    return Finding("OpenCL", "wrong", "\n".join(seen), tuple(remedies), details)


def _usable(answers: Answers) -> Finding:
    devices, chosen = _devices(answers), answers.named("chosen")[0]
    used = next(device for device in devices if device["selector"] == chosen)
    driver = used["version"].rpartition(", driver ")[2]
    tested = {"passed": "self-test passed", "not tested": "not tested (--quick)"}.get(used["self_test"], "")
    words = f"{chosen} {used['name']} ({used['kind']}, {used['compute_units']} units), {used['platform']} {driver}"
    seen = [f"{words}: {tested}"]
    others = [device for device in devices if device is not used]
    seen += [
        f"not used: {device['selector']} {device['name']}: {device['fault']}" for device in others if device["fault"]
    ]
    drivers = _drivers(answers)
    named = (f"{_short(file)} ({fault})" if fault else _short(file) for file, fault in drivers.items())
    seen.append(f"drivers: {', '.join(named)}")
    details = {"chosen": chosen, "devices": devices, "drivers": drivers, "PYOPENCL_CTX": os.environ.get("PYOPENCL_CTX")}
    return Finding("OpenCL", "ok", "\n".join(seen), details=details)


def _devices(answers: Answers) -> list[dict[str, Any]]:
    return (answers.named("devices") or [[]])[0]


def _drivers(answers: Answers) -> dict[str, str]:
    return dict(answers.named("driver"))


def _short(file: str) -> str:
    path = Path(file)
    return f"{path.name} of pip" if path.parent.name == ".libs" else file


def _looked_in(place: Path, variable: str) -> str:
    where = f"{place}, where {variable} points," if variable else str(place)
    if not place.exists():
        return f"{where} is not there"
    files = [file.name for file in driver_files() if file.parent == place]
    return f"{where} holds {', '.join(files)}" if files else f"{where} holds no .icd file"
