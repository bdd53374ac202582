"""The groups in which `--help` lists options, in their order, the largest counts, and what a shell can complete."""

from collections.abc import Callable, Iterable

INPUT = "Input"
NAVIGATION = "Navigation"
SCENE = "Scene"
NOISE = "Noise"
REGISTRATION = "Registration"
EXPERIMENT = "Experiment"
OPTIMIZATION = "Optimization"
MEASUREMENT = "Measurement"
LOOPS = "Loops and motion"
EARTH = "Place on the Earth"
OUTPUT = "Output"
RUNNING = "Running"
GROUPS = (
    *(INPUT, NAVIGATION, SCENE, NOISE, REGISTRATION, EXPERIMENT, OPTIMIZATION, MEASUREMENT),
    *(LOOPS, EARTH, OUTPUT, RUNNING),
)

MOST_WORKERS = 1024  # more processes than any machine has use for
MOST = 1_000_000  # of whatever is counted, so that every file and library can hold the number

INSTRUMENTS = (
    "attitude",
    "heading",
    "depth",
    "position",
)  # as --priors of `simulate` and --known of `reproduce` name them


def completes(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A completion for an option that takes one of the names."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def completes_list(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A completion for an option that takes several of the names, separated by commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        given = before.split(",")
        return [f"{before}{comma}{name}" for name in names if name.startswith(last) and name not in given]

    return complete
