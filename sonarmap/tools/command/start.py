"""Start of the `sonarmap` command: load its libraries, and report one that is missing or broken."""

import sys

_INTERRUPTED = 128 + 2  # as a shell reports SIGINT


def start() -> None:
    """Run the command line. While its libraries are loaded, Ctrl-C ends it without a message."""
    try:
        from sonarmap.tools.command.main import run
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    except Exception as error:  # noqa: BLE001 - a broken library can raise anything
        sys.exit(_without_a_library(error))
    run()


def _without_a_library(error: Exception) -> int:
    """Report a missing or broken library and return the exit code; `doctor` runs without the library."""
    if sys.argv[1:2] == ["doctor"]:
        from sonarmap.tools.command.doctor import run_from

        return run_from(sys.argv[2:], error)
    reason = f"{type(error).__name__}: {error}"
    print(f"error: the command cannot start: {reason}. 'sonarmap doctor' says what is missing.", file=sys.stderr)
    return 2
