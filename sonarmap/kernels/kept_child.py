"""A process that reads one file after another, so that a library that crashes, hangs or takes all memory does not
end this one."""

import atexit
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Lock
from time import process_time
from typing import IO, TypeVar, cast

from sonarmap.kernels.child import command_of, end_in_words, environment
from sonarmap.kernels.errors import InputError

_SECONDS, _BYTES_PER_SECOND = 30, 100_000  # processor time: 30 s + 1 s per 100 kB, ten times what slow computers need
_MEMORY, _MEMORY_PER_BYTE = 512 << 20, 200  # memory for a file, and per byte of it [bytes]
_END_TIMEOUT = 10.0  # time that a process may take to end after it closed its output [s]
_T = TypeVar("_T")

_lock = Lock()
_reader: tuple[int, subprocess.Popen[bytes]] | None = None  # id of the parent process (forks differ), and the reader


def run_apart(read: Callable[[bytes], _T], content: bytes) -> _T:
    """Run `read(content)`, a module-level function, in a separate process, so that a crash cannot end this one."""
    with _lock:
        process = _process()
        seconds, room = _SECONDS + len(content) // _BYTES_PER_SECOND, _MEMORY + _MEMORY_PER_BYTE * len(content)
        try:
            _send(process.stdin, (read.__module__, read.__name__, seconds, room, content))
            answer = pickle.load(cast(IO[bytes], process.stdout))
        except (OSError, EOFError, pickle.UnpicklingError):
            end = _end(_END_TIMEOUT)
            raise InputError(f"its library ended with {end}: the file is cut or damaged; copy it again") from None
        except BaseException:  # after Ctrl-C an answer may remain in the pipe
            _end()
            raise
    if isinstance(answer, str):
        raise InputError(answer)
    return answer


def main(_: Sequence[str]) -> None:
    """Main function of the separate process: read one file after another until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep what libraries print out of the answers
    with suppress(EOFError):
        while True:
            module, name, seconds, room, content = pickle.load(sys.stdin.buffer)
            _bound(seconds, room)
            _send(answers, _answer(getattr(import_module(module), name), content))


def _answer(read: Callable[[bytes], object], content: bytes) -> object:
    """What the function returns, or in words why it cannot read the content."""
    try:
        return read(content)
    except InputError as error:
        return str(error)
    except MemoryError:
        return "it takes more memory than is available; thin its points out first"


def _bound(seconds: int, room: int) -> None:
    """Limit the processor time [s] and the additional memory [bytes] for the next file, and disable core dumps."""
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


def _send(stream: IO[bytes] | None, message: object) -> None:
    out = cast(IO[bytes], stream)
    pickle.dump(message, out, pickle.HIGHEST_PROTOCOL)
    out.flush()


def _process() -> subprocess.Popen[bytes]:
    """The running reader process; a new one if there is none or it has ended."""
    global _reader
    if _reader is None or _reader[0] != os.getpid() or _reader[1].poll() is not None:
        try:
            process = subprocess.Popen(
                command_of(__name__),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**environment(), "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            raise InputError(f"cannot start a process to read it ({error.strerror or error}); end others") from error
        _reader = os.getpid(), process
    return _reader[1]


def _end(patience: float = 0.0) -> str:
    """End the reader process, by force after `patience` seconds; return in words how it ended."""
    global _reader
    if _reader is None or _reader[0] != os.getpid():
        return "nothing"
    process, _reader = _reader[1], None
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # data that can no longer be sent
            cast(IO[bytes], stream).close()
    try:
        return end_in_words(process.wait(patience))
    except subprocess.TimeoutExpired:
        process.kill()
        return end_in_words(process.wait())


atexit.register(_end)
