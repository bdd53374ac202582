"""Errors of the command line: a message on stderr, with --json also an object on stdout, and an exit code."""

import errno
import functools
import json
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

import typer

from sonarmap.kernels.errors import SonarmapError, path_error
from sonarmap.tools.command.terminal import quietly, say, shortened
from sonarmap.tools.extras import EXTRA_OF, how_to_install

MISUSE = 2  # typer's exit code for a wrong option
DEFECT = 1
INTERRUPTED = 128 + 2  # as a shell reports SIGINT
PIPE_CLOSED = 128 + 13  # as a shell reports SIGPIPE
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # errors of a full or broken disk
STOPPED = "stopped: "
_LESS = "give less at a time, or thin it out; 'sonarmap doctor' says what fits"
UsageError: Any = typer.BadParameter.__base__  # base of typer's errors about options; it has no public name


def guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command, with its exceptions turned into a message, for its `quiet` and `as_json`, and an exit code."""

    @functools.wraps(command)
    def guard(*args: Any, **options: Any) -> Any:
        as_json = bool(options.get("as_json", "--json" in sys.argv[1:]))  # for commands without this option
        with quietly(bool(options.get("quiet")), as_json), terminated_as_interrupted():
            try:
                return command(*args, **options)
            except (typer.Exit, typer.Abort, typer.BadParameter):
                raise
            except BaseException as error:  # noqa: BLE001 - the last place where a defect can be reported
                raise typer.Exit(failed(error, as_json)) from None

    return guard


def failed(error: BaseException, as_json: bool) -> int:
    """Report an error, and return the exit code."""
    match error:
        case KeyboardInterrupt():
            message = _note_of(error) or "no file is half written"
            say(message, STOPPED, "bold yellow")
            print_failure(STOPPED + message, INTERRUPTED, as_json)
            return INTERRUPTED
        case BrokenPipeError():
            discard(sys.stdout)  # the reader closed it, as `head` does: that is not an error
            return PIPE_CLOSED
        case OSError() if error.errno in FULL:
            return output_lost(error)
        case SonarmapError():
            message, code = str(error), MISUSE
        case OSError() if refused := path_error(error):
            message, code = str(refused), MISUSE
        case ImportError() if (module := (error.name or "").partition(".")[0]) != "sonarmap":  # ours are never missing
            message, code = _unloadable(error, module), MISUSE
        case MemoryError():
            reason = f" ({error})" if str(error) else ""
            message, code = f"this machine's memory is used up{reason}; {_LESS}", MISUSE
        case Exception():
            message, code = _defect(error), DEFECT
        case _:
            raise error
    if os.environ.get("SONARMAP_DEBUG", "0").lower() not in ("", "0", "false", "no", "off"):
        traceback.print_exception(error)
    message = as_options(message) if code == MISUSE else message
    say(message, "error: ", "bold red")
    print_failure(message, code, as_json)
    return code


def _unloadable(error: ImportError, module: str) -> str:
    """Message about a library that is missing or broken."""
    if (extra := EXTRA_OF.get(module)) and isinstance(error, ModuleNotFoundError):
        return f"this needs {module}, which is not installed. {how_to_install(extra)}."
    return f"a library cannot be loaded: {' '.join(str(error).split())}. 'sonarmap doctor' says what to do"


def _defect(error: Exception) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    description = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"this is a defect of sonarmap {metadata.version('sonarmap')}: {description} "
        f"({Path(frame.filename).name}, line {frame.lineno}). Please report it in the project's issues, "
        "with what the same command prints under SONARMAP_DEBUG=1."
    )


def print_failure(message: str, code: int, as_json: bool) -> None:
    """Print a failure as JSON on stdout, if that was asked for."""
    if as_json:
        typer.echo(json.dumps({"error": shortened(message), "exit_code": code}))


def output_lost(error: OSError) -> int:
    """Report that stdout or stderr cannot be written, and return the exit code."""
    discard(sys.stdout)
    reason = error.strerror or error
    message = f"cannot write the output: {reason}. Make room, or redirect it elsewhere, and run the command again."
    with suppress(OSError):  # stderr itself may be what is full
        say(message, "error: ", "bold red")
    return MISUSE


def discard(stream: TextIO) -> None:
    """Redirect a stream to /dev/null: flushing its buffer at exit would raise an error."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


_SAME = ("device", "fix_sigma", "frame", "fresh", "max_tilt", "method", "range_scale")
_SAME += ("seed", "sound_speed", "start", "ties", "units", "voxel", "workers")
OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _SAME} | {
    "alignment": "--align",
    "count": "--scans",
    "edge": "--grid",
}
FLAGS = {"--fresh"}  # options without a value

_ARGUMENT = re.compile(r"`(\w+)(?:=([^`]*))?`")


def as_options(message: str) -> str:
    """Replace library arguments in backticks, as `max_tilt=20`, by options; other words lose their backticks."""
    return _ARGUMENT.sub(_option, message)


def _option(argument: re.Match[str]) -> str:
    name, value = argument.groups()
    if name not in OPTIONS:
        return argument[0].strip("`")
    option = OPTIONS[name]
    return option if value is None or option in FLAGS else f"{option} {value}"


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Within the block SIGTERM raises KeyboardInterrupt, as Ctrl-C does, so that files are closed and workers end."""
    if threading.current_thread() is not threading.main_thread():  # only the main thread receives signals
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def when_stopped(words: Callable[[], str]) -> Iterator[None]:
    """If the block is interrupted, note `words()`: what is kept, and how to continue. The innermost block counts."""
    try:
        yield
    except KeyboardInterrupt as stop:
        if not _note_of(stop):
            stop.add_note(words())
        raise


def _note_of(stop: KeyboardInterrupt) -> str:
    """The note of `when_stopped`; "" without one."""
    return " ".join(getattr(stop, "__notes__", ()))
