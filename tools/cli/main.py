"""The `sonarmap` command: its verbs, and how their errors become messages and exit codes."""

import errno
import functools
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module, metadata
from pathlib import Path
from typing import Annotated, Any

import typer

from kernels.errors import InputError, SonarmapError
from tools.cli.arguments import as_options
from tools.cli.terminal import say, show_messages

# A verb is the function `command` in tools/cli/verbs/<verb>.py; its docstring is the help.
# A new verb is a new line here; the help lists them in this order.
VERBS = [
    "register",
    "map",
    "record",
    "inspect",
    "template",
    "view",
    "export",
    "optimize",
    "simulate",
    "evaluate",
    "reproduce",
    "bench",
    "devices",
]

MISUSE = 2  # as typer's own for options that it refuses
DEFECT = 1
INTERRUPTED = 128 + 2  # as a shell reports SIGINT
PIPE_CLOSED = 128 + 13  # as a shell reports SIGPIPE
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # a disk that takes no more

app = typer.Typer(
    name="sonarmap",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def run() -> None:
    """The entry point.

    Exit codes: 0 done, 1 a defect of the program, 2 something that the user can fix, 3 a result that is incomplete or
    not to be trusted, 130 interrupted, 141 nobody reads the output any more.
    """
    _open_missing_streams()
    show_messages()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()  # here, where a closed pipe can still be told apart from a defect
    except KeyboardInterrupt:
        sys.exit(_stopped())
    except BrokenPipeError:
        sys.exit(_pipe_closed())
    except OSError as error:
        sys.exit(_output_lost(error))


def guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command, with what it raises turned into a message on stderr and an exit code."""

    @functools.wraps(command)
    def guard(*args: Any, **options: Any) -> Any:
        try:
            return command(*args, **options)
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except SonarmapError as error:
            code = _misuse(error)
        except KeyboardInterrupt:
            code = _stopped()
        except BrokenPipeError:
            code = _pipe_closed()
        except OSError as error:
            code = _output_lost(error) if error.errno in FULL else _defect(error)
        except MemoryError as error:
            code = _misuse(
                InputError(f"this machine's memory is used up ({error}); give less at a time, or thin it out")
            )
        except Exception as error:  # noqa: BLE001 - the last place where a defect can be reported
            code = _defect(error)
        raise typer.Exit(code)

    return guard


def _misuse(error: SonarmapError) -> int:
    if _debugging():
        traceback.print_exception(error)
    say(as_options(str(error)), "error: ", "bold red")
    return MISUSE


def _defect(error: Exception) -> int:
    if _debugging():
        traceback.print_exception(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    description = " ".join(f"{type(error).__name__}: {error}".split())
    say(
        f"this is a defect of sonarmap {metadata.version('sonarmap')}: {description} "
        f"({Path(frame.filename).name}, line {frame.lineno}). Please report it in the project's issues, "
        "with what the same command prints under SONARMAP_DEBUG=1.",
        "error: ",
        "bold red",
    )
    return DEFECT


def _stopped() -> int:
    say("stopped; no file is half written")
    return INTERRUPTED


def _pipe_closed() -> int:
    """The reader has left, as `head` does: no error to report."""
    _discard_output()
    return PIPE_CLOSED


def _output_lost(error: OSError) -> int:
    """stdout or stderr goes to a file on a full disk."""
    _discard_output()
    reason = error.strerror or error
    message = f"cannot write the output: {reason}. Make room, or redirect it elsewhere, and run the command again."
    with suppress(OSError):  # stderr itself may be what is full
        say(message, "error: ", "bold red")
    return MISUSE


def _discard_output() -> None:
    """Send what is still buffered nowhere, or the interpreter reports it as an error when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_missing_streams() -> None:
    """Open /dev/null for each of stdin, stdout and stderr that the caller closed: otherwise the next opened file
    would take its number, and what is printed would land in that file."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _debugging() -> bool:
    return os.environ.get("SONARMAP_DEBUG", "0").lower() not in ("", "0", "false", "no", "off")


def _version(print_it: bool) -> None:
    if print_it:
        typer.echo(f"sonarmap {metadata.version('sonarmap')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks, as with SONARMAP_DEBUG=1.")] = False,
) -> None:
    """Noisy 3D sonar scans in, a consistent map out."""
    if debug:
        os.environ["SONARMAP_DEBUG"] = "1"


def _flowing(docstring: str) -> str:
    """The docstring without line breaks within its paragraphs, which the help would keep."""
    return re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(docstring))


for _verb in VERBS:
    _command = import_module(f"tools.cli.verbs.{_verb}").command
    app.command(_verb, help=_flowing(_command.__doc__))(guarded(_command))
