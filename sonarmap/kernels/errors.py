"""The errors that a user can fix; the command line shows them without a traceback and exits with 2."""

import errno
import os
from reprlib import repr as shortened


class SonarmapError(Exception):
    """Its message says what was given, what was expected and what to do.

    Every error that a user's input, files, options or machine can cause derives from this class; any
    other exception is a defect of the program. Arguments are named in backticks.
    """


class InputError(SonarmapError, ValueError):
    """A value, a scan or a file that cannot be used."""


def path_error(error: OSError) -> InputError | None:
    """What the user can fix where the system refuses a path, whoever asked for it; None for another fault."""
    if error.filename is not None:
        given = shortened(os.fsdecode(error.filename)) if not isinstance(error.filename, int) else "a file"
        return InputError(f"{given} cannot be used: {error.strerror}. Give another path")
    if error.errno == errno.ENOENT:
        return InputError("the current folder is gone; change to one that exists, and start again from there")
    return None


class DeviceError(SonarmapError, RuntimeError):
    """No OpenCL device, one that does not work, or one that is too small for the task."""
