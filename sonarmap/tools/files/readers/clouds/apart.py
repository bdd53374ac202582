"""Reads clouds in a process of its own, which is kept: a native library that a damaged file crashes ends it alone.

What goes to and fro are lengths, JSON and plain numbers. Nothing is unpickled, as whoever made the file may have taken
that process over.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Lock
from time import process_time
from typing import IO, Any, cast

import numpy as np

from sonarmap.kernels.child import command_of, end_in_words, environment
from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud

Read = Callable[[bytes], list[Cloud]]

_ARRAYS = ("points", "strength", "viewpoints", "times")  # of a cloud
_SECONDS, _BYTES_PER_SECOND = 30, 100_000  # of processor time that a file may take: a tenth of a slow computer's speed
_ROOM, _ROOM_PER_BYTE = 512 << 20, 200  # bytes of memory that it may take
_DYING = 10.0  # seconds that a process which has closed its output may take to end

_lock = Lock()
_kept: tuple[int, subprocess.Popen[bytes]] | None = None  # the process that started it, as forks have another, and it


def read_apart(read: Read, content: bytes) -> list[Cloud]:
    """What `read` makes of a file, in a process of its own. `read`: a function of a module; its clouds have no prior.
    Raises InputError: as `read` does; or that process crashed, or took too long or too much memory."""
    with _lock:
        process = _process()
        seconds, room = _SECONDS + len(content) // _BYTES_PER_SECOND, _ROOM + _ROOM_PER_BYTE * len(content)
        try:
            _send(process.stdin, [json.dumps([read.__module__, read.__name__, seconds, room]).encode(), content])
            head = json.loads(_receive(process.stdout))
            if "refused" not in head:
                return [_cloud_of(cloud, process.stdout) for cloud in head["clouds"]]
        except (OSError, EOFError):
            end = _end(_DYING)
            raise InputError(f"its library ended with {end}: the file is cut or damaged; copy it again") from None
        except BaseException:  # of Ctrl-C, an answer may be left in the pipe
            _end()
            raise
    raise InputError(head["refused"])


def main(_: Sequence[str]) -> None:
    """Of that process: read one file after another, until its input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that started it
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints
    with suppress(EOFError):
        while True:
            module, name, seconds, room = json.loads(_receive(sys.stdin.buffer))
            content = _receive(sys.stdin.buffer)
            _bound(seconds, room)
            _send(answers, _answer(getattr(import_module(module), name), content))


def _answer(read: Read, content: bytes) -> Iterable[bytes | memoryview]:
    try:
        clouds = read(content)
    except InputError as error:
        return [json.dumps({"refused": str(error)}).encode()]
    except MemoryError:
        return [json.dumps({"refused": "it takes more memory than there is; thin its points out first"}).encode()]
    heads: list[dict[str, Any]] = []
    arrays: list[np.ndarray] = []
    for cloud in clouds:
        held = {name: np.ascontiguousarray(array) for name in _ARRAYS if (array := getattr(cloud, name)) is not None}
        forms = {name: (array.dtype.str, array.shape) for name, array in held.items()}
        heads.append({"arrays": forms, "stamp": cloud.stamp, "notes": cloud.notes, "sound_speed": cloud.sound_speed})
        arrays += held.values()
    return [json.dumps({"clouds": heads}).encode(), *(array.data.cast("B") for array in arrays if array.size)]


def _cloud_of(head: dict[str, Any], stream: IO[bytes] | None) -> Cloud:
    arrays: dict[str, np.ndarray] = {}
    for name, (dtype, shape) in head["arrays"].items():
        content = _receive(stream) if np.prod(shape) else b""
        arrays[name] = np.frombuffer(content, dtype).reshape(shape)
    cloud = Cloud(arrays["points"], stamp=head["stamp"], notes=tuple(head["notes"]), sound_speed=head["sound_speed"])
    # pyrefly: ignore[bad-argument-type]
    return replace(cloud, **arrays)


def _bound(seconds: int, room: int) -> None:
    """Let the next file take so much more of a processor's time, and so many more bytes of memory; dump no core."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError):  # not Linux
        return
    bounds = {resource.RLIMIT_CPU: int(process_time()) + seconds, resource.RLIMIT_AS: used + room}
    for kind, wanted in bounds.items():
        most = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (wanted if most == resource.RLIM_INFINITY else min(wanted, most), most))


def _send(stream: IO[bytes] | None, parts: Iterable[bytes | memoryview]) -> None:
    out = cast(IO[bytes], stream)
    for part in parts:
        out.write(len(part).to_bytes(8, "little"))
        out.write(part)
    out.flush()


def _receive(stream: IO[bytes] | None) -> bytes:
    source = cast(IO[bytes], stream)
    length = source.read(8)
    content = source.read(int.from_bytes(length, "little"))
    if len(length) < 8 or len(content) < int.from_bytes(length, "little"):
        raise EOFError
    return content


def _process() -> subprocess.Popen[bytes]:
    """The one that is kept, or another where there is none, or it has ended."""
    global _kept
    if _kept is None or _kept[0] != os.getpid() or _kept[1].poll() is not None:
        try:
            process = subprocess.Popen(
                command_of(__name__),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**environment(), "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            raise InputError(f"no process can be started to read it ({error.strerror or error}); end others") from error
        _kept = os.getpid(), process
    return _kept[1]


def _end(patience: float = 0.0) -> str:
    """End the process that is kept; with what it ended, in words, where it does so by itself within some seconds."""
    global _kept
    if _kept is None or _kept[0] != os.getpid():
        return "nothing"
    process, _kept = _kept[1], None
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # what was not sent yet, and cannot be
            cast(IO[bytes], stream).close()
    try:
        return end_in_words(process.wait(patience))
    except subprocess.TimeoutExpired:
        process.kill()
        return end_in_words(process.wait())


atexit.register(_end)
