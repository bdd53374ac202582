# pyright: strict
"""The errors that a user can fix; the command line shows them without a traceback and exits with 2."""


class SonarmapError(Exception):
    """Its message says what was given, what was expected and what to do.

    Every error that a user's input, files, options or machine can cause derives from this class; any
    other exception is a defect of the program. Arguments are named in backticks.
    """


class InputError(SonarmapError, ValueError):
    """A value, a scan or a file that cannot be used."""


class DeviceError(SonarmapError, RuntimeError):
    """No OpenCL device, one that does not work, or one that is too small for the task."""
