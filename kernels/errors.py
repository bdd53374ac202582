"""The errors that a user can mend; the command line shows them without a traceback and exits with 2."""


class SonarmapError(Exception):
    """What was given, what was wanted and what to do about it, in one message.

    Every error that a user's input, files, options or machine can cause derives from this class. Anything
    else that escapes is a defect of the program.
    """


class InputError(SonarmapError, ValueError):
    """A value, a scan or a file that cannot be used."""


class DeviceError(SonarmapError, RuntimeError):
    """No OpenCL device, one that does not work, or one too small for what was asked."""
