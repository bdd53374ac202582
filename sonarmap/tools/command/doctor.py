"""`sonarmap doctor`: faults of the installation and of this machine, with remedies.

It must run where the rest does not: only the standard library is imported at the top, and checks that a driver or a
broken library could crash run in another process.
"""

import json
import os
import shlex
import shutil
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module, metadata
from itertools import chain
from pathlib import Path
from typing import Any, Literal

Verdict = Literal["ok", "warning", "wrong"]
VERDICTS: tuple[Verdict, ...] = ("ok", "warning", "wrong")  # the worst last
WRONG = 2  # exit code
_LOADING, _TESTING = 240.0, 900.0  # seconds; each driver has a limit of its own
_PLENTY, _LEAST = 1 << 30, 32 << 20  # free bytes: for a survey of thousands of scans, and for a small one
_TRIAL = 64 << 10  # bytes that are written to see whether a file can grow
_USUAL_EDGE = 128  # of --grid
# Modules whose names differ from their distributions'.
_MODULES = {"pillow": "PIL", "protobuf": "google.protobuf", "python-neo-lzf": "lzf"}
_INDENT = " " * 21  # columns of the verdict and of the name


@dataclass(frozen=True, slots=True)
class Remedy:
    """Advice on a finding."""

    words: str  # a sentence, or the words before the command
    command: str = ""  # to be pasted into a shell; "" where there is none


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was checked."""

    verdict: Verdict  # "wrong": something that is needed does not work; "warning": part of it may not
    seen: str  # what the check saw; lines
    remedies: tuple[Remedy, ...] = ()  # the best first
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # the same for programs, of JSON's types
    check: str = ""  # what was checked, in a word


def run(folder: Path, quick: bool, in_json: bool, known: Sequence[Finding] = ()) -> int:
    """Check everything, and print each finding at once, or all as JSON at the end; `known` are earlier findings. Return
    the exit code: 0 if all that is needed works, else 2."""
    findings: list[Finding] = []
    for finding in chain(known, examine(folder, quick)):
        findings.append(finding)
        if not in_json:
            _print("\n".join(lines_of(finding)))
    _print(json.dumps(as_json(findings), indent=2) if in_json else f"\n{summary(findings)}")
    return WRONG if any(finding.verdict == "wrong" for finding in findings) else 0


def run_from(arguments: Sequence[str], error: Exception) -> int:
    """`run` by the arguments of `sonarmap doctor`, if `error` prevents the command line from starting."""
    folders = [word for word in arguments if not word.startswith("-")]
    missing = (getattr(error, "name", None) or "").partition(".")[0]
    again = Remedy("reinstall the library:", _pip("--force-reinstall", missing))
    seen = f"the other verbs cannot start: {type(error).__name__}: {error}"
    start = Finding("wrong", seen, (again,) if missing else (), check="command")
    return run(Path(folders[0] if folders else "."), "--quick" in arguments, "--json" in arguments, [start])


def examine(folder: Path, quick: bool) -> Iterator[Finding]:
    """Yield the findings one by one. `folder` is the folder for results; `quick` loads no library and runs no
    self-test."""
    yield _checked("libraries", lambda: _required(load=not quick))
    yield (opencl := _checked("OpenCL", lambda: _opencl(test=not quick)))
    yield _checked("memory", lambda: _memory(opencl.details.get("plan")))
    yield _checked("disk", lambda: _disk(folder))


def _checked(name: str, check: Callable[[], Finding]) -> Finding:
    """The finding of a check; a check that raises is a finding too."""
    try:
        finding = check()
    except ImportError as error:
        install = (Remedy("install it:", _pip(error.name)),) if error.name else ()
        finding = Finding("wrong", f"cannot be checked: {error}", install)
    except Exception as error:  # noqa: BLE001 - a broken installation must not end the doctor
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        finding = Finding("wrong", f"cannot be checked: {type(error).__name__}: {error} ({place})")
    return replace(finding, check=name)


def _required(load: bool) -> Finding:
    """Check that all required libraries are installed in the right versions and, with `load`, can be loaded."""
    from packaging.requirements import Requirement

    lines = [Requirement(text) for text in metadata.requires("sonarmap") or []]
    required = {line.name: line for line in lines if not line.marker or line.marker.evaluate({"extra": ""})}
    installed = {name: _version(name) for name in required}
    bad = {
        str(line): installed[name]
        for name, line in required.items()
        if not line.specifier.contains(installed[name] or "0", prereleases=True)
    }
    modules = [_MODULES.get(name, name.replace("-", "_")) for name in required if installed[name]]
    faults = _load_faults(modules) if load else {}
    details = {"python": sys.version.split()[0], "installed": installed, "cannot be loaded": faults}
    if not bad and not faults:
        loaded = "can be loaded" if load else "are installed (not loaded: --quick)"
        return Finding("ok", f"Python {details['python']}; all {len(required)} {loaded}", details=details)
    seen = [f"{version or 'not installed'}, wanted {text}" for text, version in bad.items()]
    seen += [f"{name} cannot be loaded: {fault}" for name, fault in faults.items()]
    names = {module: name for name, module in _MODULES.items()}
    again = [names.get(module, module.replace("_", "-")) for module in faults]
    remedies = [Remedy("install what is missing:", _pip(*bad))] if bad else []
    if faults:
        remedies.append(Remedy("reinstall what cannot be loaded:", _pip("--force-reinstall", "--no-deps", *again)))
        remedies.append(Remedy("a missing system library (.so) is one of those that tools/setup.sh installs"))
    return Finding("wrong", "\n".join(seen), tuple(remedies), details)


def _load_faults(modules: list[str]) -> dict[str, str]:
    """Reasons of the modules that cannot be loaded. After one that ends the process the others are still tried."""
    from sonarmap.kernels.child import ask

    faults: dict[str, str] = {}
    while modules and not _memory_is_short():
        answers = ask(__name__, "load", *modules, seconds=_LOADING)
        faults |= dict(answers.named("fault"))
        if not answers.end:
            break
        culprit = [modules[0], *answers.named("begins")][-1]
        faults[culprit] = answers.end
        modules = modules[modules.index(culprit) + 1 :]
    return faults


def _opencl(test: bool) -> Finding:
    """List the devices, and find which would be used and what fits on it; without `test` the last self-tests count."""
    from sonarmap.kernels.child import ask

    if _memory_is_short():
        return Finding("wrong", "not tried; see memory")
    answers = ask(__name__, "devices", *(["--test"] if test else []), seconds=_TESTING)
    devices: list[dict[str, Any]] = (answers.named("devices") or [[]])[0]
    if answers.named("plan"):  # even if the driver ended the process afterwards
        plan = answers.named("plan")[0]
        lines = [device_line(device, plan["chosen"]) for device in devices]
        return Finding("ok", "\n".join(lines), details={"chosen": plan["chosen"], "devices": devices, "plan": plan})
    seen = [device_line(device, "") for device in devices]
    if faults := answers.named("unloadable"):
        fault = f"PyOpenCL cannot be loaded: {faults[0]}"
        remedies = [Remedy("install it with its own loader:", _pip("--force-reinstall", "--no-deps", "pyopencl"))]
    elif errors := answers.named("refused"):
        fault = str(errors[0])
        remedies = []
        if any(not device["fault"] for device in devices):
            remedies = [Remedy("let a working device be chosen:", "unset PYOPENCL_CTX")]
        elif not devices:
            fault += f"\n{_drivers_looked_for()}"
    else:  # a driver took the process with it, or hangs
        fault = f"while {(answers.named('begins') or ['starting'])[-1]}: {answers.end}"
        remedies = [Remedy("update the driver, or use another device; this lists them:", "sonarmap devices")]
    return Finding("wrong", "\n".join([fault, *seen]), tuple(remedies), {"error": fault, "devices": devices})


def device_line(device: Mapping[str, Any], chosen: str | None) -> str:
    """A device, an entry of `sonarmap devices --json`, as a line of text."""
    mark = "* " if device["selector"] == chosen else ""
    works = f"does not work: {device['fault']}" if device["fault"] else "works"
    if not device["compute_units"]:
        return f"{mark}{device['selector']} driver {device['driver_file'] or device['name']}; {works}"
    from sonarmap.kernels.counted import sized

    about = f"{device['kind']}, {device['compute_units']} units, {sized(device['memory'])}"
    driver = f"{device['platform']} ({device['version'].rpartition(', ')[2]})"
    return f"{mark}{device['selector']} {device['name']}: {about}, {driver}; self-test {device['self_test']}; {works}"


def _drivers_looked_for() -> str:
    from sonarmap.kernels.device.drivers import vendor_folder

    place, variable = vendor_folder()
    where = f"{place}, where {variable} points," if variable else str(place)
    files = [path.name for path in sorted(place.glob("*.icd"))] if place.exists() else []
    return f"{where} holds {', '.join(files) or 'no .icd file, which names a driver'}"


def main(arguments: Sequence[str]) -> None:
    """In the other process: load libraries; or list the devices, choose one, and report what fits on it."""
    from sonarmap.kernels.child import answer

    if arguments[0] == "devices":
        return _answer_devices(test="--test" in arguments)
    for module in arguments[1:]:
        answer(begins=module)
        try:
            import_module(module)
        except Exception as error:  # noqa: BLE001 - any error of a broken library is an answer
            answer(fault=[module, " ".join(f"{type(error).__name__}: {error}".split())[:300]])


def _answer_devices(test: bool) -> None:
    from sonarmap.kernels.child import answer
    from sonarmap.kernels.errors import SonarmapError

    answer(begins="loading PyOpenCL")
    try:
        from sonarmap.kernels.device.device import choose_device, list_devices
    except ImportError as error:
        return answer(unloadable=str(error))
    try:
        answer(begins="testing the devices" if test else "trying the devices")
        answer(devices=[asdict(info) for info in list_devices(test=test, again=False)])
        answer(begins="choosing a device")
        device = choose_device()
        from sonarmap.kernels.fft.edges import EDGES
        from sonarmap.spectral.memory import largest_edge, memory_plan  # loads SciPy, so after the devices

        pairs = [(edge, max(memory_plan(edge, method).pair for method in ("spectral", "hemisphere"))) for edge in EDGES]
        plan = {"pairs": pairs, "largest": largest_edge(device), "memory": device.memory, "shared": device.is_cpu}
        answer(plan={"chosen": device.selector, **plan})
    except SonarmapError as error:
        answer(refused=str(error))


def _memory_is_short() -> bool:
    """Whether too little memory is free for sonarmap itself, so that any check may fail."""
    from sonarmap.tools.files.memory import room_for_arrays

    return room_for_arrays() < 0


def _memory(plan: Mapping[str, Any] | None) -> Finding:
    """Check that the usual grid fits, and find the largest that does, by the device's `plan`; None without a device."""
    from sonarmap.kernels.counted import sized
    from sonarmap.tools.files.memory import available_memory, room_for_arrays

    room, seen = room_for_arrays(), f"{sized(available_memory())} to spare"
    less = Remedy("end other programs, or give this process more memory (ulimit -v, a container's limit)")
    if room < 0:
        return Finding("wrong", f"{seen}; too little for sonarmap with its libraries and a driver", (less,))
    if plan is None:
        return Finding("ok", seen)
    seen += "" if plan["shared"] else f"; {sized(plan['memory'])} on the device"
    pairs = {edge: pair for edge, pair in plan["pairs"] if edge <= (plan["largest"] or 0)}
    fits = max((edge for edge, pair in pairs.items() if not plan["shared"] or pair <= room), default=0)
    seen += f"; --grid up to {fits}, {sized(pairs[fits])} for a pair" if fits else "; no grid fits"
    verdict: Verdict = "ok" if fits >= _USUAL_EDGE else "warning" if fits else "wrong"
    return Finding(verdict, seen, () if verdict == "ok" else (less,), {"largest grid": fits or None})


def _disk(folder: Path) -> Finding:
    """Check that the folders for results and temporary files can be written, and have room."""
    from sonarmap.kernels.counted import sized

    verdicts = list[Verdict]()
    seen, remedies, details = list[str](), list[Remedy](), dict[str, Any]()
    choices = {"results": Remedy("make room there, or choose another folder with -o OUT")}
    choices["temporary files"] = Remedy("name a folder with room for temporary files:", "export TMPDIR=/var/tmp")
    for what, remedy in choices.items():
        place = folder.absolute() if what == "results" else Path(tempfile.gettempdir())
        free, fault = look_at(place)
        details[what] = {"folder": str(place), "free": free, "fault": fault}
        seen.append(f"{what} in {place}: {fault or f'{sized(free)} free'}")
        of_place: Verdict = "wrong" if fault or free < _LEAST else "ok" if free >= _PLENTY else "warning"
        remedies += [] if of_place == "ok" else [remedy]
        verdicts.append(of_place)
    return Finding(max(verdicts, key=VERDICTS.index), "\n".join(seen), tuple(remedies), details)


def look_at(folder: Path) -> tuple[int, str]:
    """Free bytes where a folder is, or would be made, and the reason why it cannot be written, or ""."""
    free = 0
    try:
        there = next((parent for parent in (folder, *folder.parents) if parent.exists()), folder)
        free = shutil.disk_usage(there).free
        if not there.is_dir():
            return free, f"{there} is a file, not a folder"
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(bytes(_TRIAL))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return free, (error.strerror or str(error)).lower()
    return free, ""


def summary(findings: Sequence[Finding]) -> str:
    """The verdict on all findings, in a line."""
    verdicts = [finding.verdict for finding in findings]
    name, warnings = f"sonarmap {_version('sonarmap') or '(not installed)'}", verdicts.count("warning")
    also = f"{warnings} {'warning' if warnings == 1 else 'warnings'}" if warnings else ""
    if wrong := verdicts.count("wrong"):
        more = f", and {also}" if also else ""
        return f"{name}: {wrong} of {len(findings)} wrong{more}; follow the advice after >"
    return f"{name}: all that is needed works" + (f"; {also}" if also else "")


def lines_of(finding: Finding) -> list[str]:
    """A finding as lines: the verdict, the name, what was seen, and below it the remedies. A command has a line of
    its own, so that it can be copied."""
    first, *others = finding.seen.splitlines() or [""]
    lines = [f"{finding.verdict:<9}{finding.check:<12}{first}", *(_INDENT + line for line in others)]
    for remedy in finding.remedies:
        lines += [f"{_INDENT}> {remedy.words}", *([f"{_INDENT}  {remedy.command}"] if remedy.command else [])]
    return lines


def as_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """The findings as an object of JSON's types."""
    worst = max((finding.verdict for finding in findings), key=VERDICTS.index)
    checks = [{"check": finding.check} | asdict(finding) for finding in findings]
    return {"sonarmap": _version("sonarmap") or None, "verdict": worst, "checks": checks}


def _pip(*wanted: str) -> str:
    """A command that installs distributions for this Python."""
    return shlex.join([sys.executable, "-m", "pip", "install", *wanted])


def _version(distribution: str) -> str:
    """Version of a distribution; "" if it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""


def _print(text: str) -> None:
    """Print a text; characters that stdout cannot encode are replaced."""
    coding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(coding, errors="replace").decode(coding), flush=True)
