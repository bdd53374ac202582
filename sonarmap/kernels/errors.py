"""The errors that a user can fix; the command line shows them without a traceback and exits with 2."""

import errno
import os
from reprlib import repr as shortened


class SonarmapError(Exception):
    """Base class of the errors that a user's input, files, options or machine can cause; others are bugs.

    The message says what was given, what was expected and what to do, with the names of arguments in backticks.
    """


class InputError(SonarmapError, ValueError):
    """A value, a scan or a file that cannot be used."""


def path_error(error: OSError) -> InputError | None:
    """An InputError for a path that the operating system refuses; None for other errors of the system."""
    if error.filename is not None:
        given = shortened(os.fsdecode(error.filename)) if not isinstance(error.filename, int) else "a file"
        return InputError(f"{given} cannot be used: {error.strerror}. Give another path")
    if error.errno == errno.ENOENT:
        return InputError("the current folder was deleted; change to an existing one, and start again")
    return None


class DeviceError(SonarmapError, RuntimeError):
    """No OpenCL device, one that does not work, or one that is too small for the task."""
