"""OpenCL: the loader, the drivers, the devices, the device that would be chosen, and its self-test."""

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sonarmap.kernels.child import Answers, answer, ask
from sonarmap.kernels.device.drivers import installed_drivers, vendor_folder
from sonarmap.tools.command.doctor.finding import Finding, Remedy
from sonarmap.tools.command.doctor.libraries import DRIVER_OF_PIP, pip_command, shared_object_remedy
from sonarmap.tools.command.doctor.machine import memory_is_short

_SECONDS = 900.0  # every driver is tried in a process of its own, which has a limit itself
_SHORT = 30.0  # a library that finds too little memory can try for ever, as OpenBLAS does
_METHODS = ("spectral", "hemisphere")  # that run on a device
_POCL = Remedy("install PoCL, an OpenCL driver for processors:", "sudo apt-get install pocl-opencl-icd")
_OF_PIP = Remedy("or, without root, Intel's, which AMD processors run too:", pip_command(*DRIVER_OF_PIP))


def opencl(test: bool) -> tuple[Finding, Answers]:
    """The drivers and devices, and what the other process said of them. Without `test` no device's self-test is run,
    and what the last ones said counts."""
    short = memory_is_short()
    answers = ask(
        "sonarmap.tools.command.doctor.opencl", *(["--test"] if test else []), seconds=_SHORT if short else _SECONDS
    )
    finding = _fault(answers) or _usable(answers)
    if finding.verdict == "wrong" and short:
        finding = replace(finding, seen=f"{finding.seen}; see memory", remedies=())
    return finding, answers


def main(arguments: Sequence[str]) -> None:
    """In the other process: list the devices, choose, and say what fits on it."""
    from dataclasses import asdict

    answer(begins="loading PyOpenCL")
    try:
        from sonarmap.kernels.device.device import choose_device, list_devices
    except ImportError as error:
        answer(unloadable=str(error))
        return
    from sonarmap.kernels.errors import DeviceError, SonarmapError

    try:
        answer(begins="testing the devices" if arguments else "trying the devices")
        answer(devices=[asdict(info) for info in list_devices(test=bool(arguments), again=False)])
        answer(begins="choosing a device")
        device = choose_device()
        answer(chosen=device.selector)
        from sonarmap.kernels.fft.edges import EDGES
        from sonarmap.spectral.memory import largest_edge, memory_plan  # loads SciPy: only once devices were tried

        pairs = [(edge, max(memory_plan(edge, method).pair for method in _METHODS)) for edge in EDGES]
        answer(largest=largest_edge(device), pairs=pairs, device_memory=device.memory, shared=device.is_cpu)
    except DeviceError as error:
        answer(unavailable=str(error))
    except SonarmapError as error:  # a variable of the environment
        answer(refused=str(error))


def _fault(answers: Answers) -> Finding | None:
    """Why there is no device; None where there is one."""
    if faults := answers.named("unloadable"):
        return _unloadable(str(faults[0]))
    if answers.end and not answers.named("largest"):  # a driver took the process with it, or hung
        seen = f"while {(answers.named('begins') or ['starting'])[-1]}: {answers.end}"
        newer = Remedy("update the driver, or use another device; this lists them:", "sonarmap devices")
        return Finding("wrong", seen, (newer, _POCL), {"error": seen})
    if refusals := answers.named("refused"):
        return Finding("wrong", str(refusals[0]), details={"error": refusals[0]})
    if errors := answers.named("unavailable"):
        return _unavailable(str(errors[0]), _devices(answers), _drivers(answers))
    return None


def _unloadable(fault: str) -> Finding:
    """PyOpenCL, or the loader that it needs, is not there."""
    system = shared_object_remedy(fault)
    anew = () if system or "No module named" in fault else ("--force-reinstall", "--no-deps")
    again = Remedy("install PyOpenCL with its own loader:", pip_command(*anew, "pyopencl"))
    remedies = (again,) if system is None else (system, again)
    return Finding("wrong", f"PyOpenCL cannot be loaded: {fault}", remedies, {"error": fault})


def _unavailable(error: str, devices: list[dict[str, Any]], drivers: dict[str, str]) -> Finding:
    """There is no driver, or no device that works."""
    details = {"error": error, "drivers": drivers, "devices": devices}
    if any(not device["fault"] for device in devices):  # PYOPENCL_CTX names another
        return Finding("wrong", error, (Remedy("have a device chosen that works:", "unset PYOPENCL_CTX"),), details)
    place, variable = vendor_folder()
    seen = [f"{device['selector']} {device['name']} does not work: {device['fault']}" for device in devices]
    if not devices:
        seen.insert(0, f"no driver: {_looked_in(place, variable)}")
    elif variable:
        seen.append(_looked_in(place, variable))
    remedies = [Remedy("look for drivers where the system has them:", f"unset {variable}")] if variable else []
    return Finding("wrong", "\n".join(seen), (*remedies, _POCL, _OF_PIP), details)


def _usable(answers: Answers) -> Finding:
    devices, chosen = _devices(answers), answers.named("chosen")[0]
    used = next(device for device in devices if device["selector"] == chosen)
    driver = used["version"].rpartition(", driver ")[2]
    tested = {"passed": "self-test passed", "not tested": "not tested (--quick)"}.get(used["self_test"], "")
    words = f"{chosen} {used['name']} ({used['kind']}, {used['compute_units']} units), {used['platform']} {driver}"
    seen = [f"{words}: {tested}"]
    seen += [
        f"not used: {device['selector']} {device['name']}: {device['fault']}" for device in devices if device["fault"]
    ]
    drivers = _drivers(answers)
    seen.append(f"drivers: {', '.join(map(_short, drivers))}; a process loads one")
    details = {"chosen": chosen, "devices": devices, "drivers": drivers, "PYOPENCL_CTX": os.environ.get("PYOPENCL_CTX")}
    return Finding("ok", "\n".join(seen), details=details)


def _devices(answers: Answers) -> list[dict[str, Any]]:
    return (answers.named("devices") or [[]])[0]


def _drivers(answers: Answers) -> dict[str, str]:
    """What is wrong with each driver, by its file."""
    faults = {device["driver_file"]: device["fault"] for device in _devices(answers) if not device["compute_units"]}
    return {driver.file: faults.get(driver.file, "") for driver in installed_drivers() if driver.file}


def _short(file: str) -> str:
    path = Path(file)
    return f"{path.name} of pip" if path.is_relative_to(sys.prefix) else file


def _looked_in(place: Path, variable: str) -> str:
    where = f"{place}, where {variable} points," if variable else str(place)
    if not place.exists():
        return f"{where} is not there"
    files = [path.name for path in sorted(place.glob("*.icd"))]
    return f"{where} holds {', '.join(files)}" if files else f"{where} holds no .icd file"
