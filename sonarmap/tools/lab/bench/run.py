"""A whole benchmark: the copy rate, the kernels, the pairs."""

from collections.abc import Sequence
from dataclasses import dataclass

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.bench.kernels import CASES, measure_kernels
from sonarmap.tools.lab.bench.machine import describe_machine, load_average
from sonarmap.tools.lab.bench.pairs import measure_pairs, simulate_pairs
from sonarmap.tools.lab.bench.rates import measure_rates, summarize_rates
from sonarmap.tools.lab.bench.result import BenchResult, KernelResult, PairResult
from sonarmap.tools.lab.bench.survey import Command, measure_survey
from sonarmap.tools.lab.progress import Follow

_RATE_REPEATS = 5


@dataclass(frozen=True, slots=True)
class Workload:
    """What a benchmark measures.

    Attributes:
        edges: voxels per edge, each.
        repeats: timed runs of each kernel.
        pairs: how many simulated pairs to register on each edge; 0 for none.
        kernels: whether to time the kernels.
        survey: how many scans of a simulated survey to map; 0 for none.
        seed: of all input.
    """

    edges: Sequence[int]
    repeats: int
    pairs: int
    kernels: bool
    survey: int
    seed: int


def run_bench(selector: str | None, work: Workload, follow: Follow, command: Command) -> BenchResult:
    """Measure on one device.

    Args:
        selector: of the device, as `choose_device` takes it.
        follow: reports the progress.
        command: as `measure_survey` takes it.

    Raises:
        InputError: an edge is not a grid's, or nothing is left to measure.
        DeviceError: there is no such device, or it is too small.
    """
    for edge in work.edges:
        Grid(edge, 1.0)
    if not (work.kernels or work.pairs or work.survey):
        raise InputError("--no-kernels and --pairs 0 leave nothing to measure; leave one of them out")
    if work.survey == 1:
        raise InputError("--survey 1: a survey needs 2 scans or more; 0 maps none")
    chosen = choose_device(selector)
    device = Device(chosen.cl_device, chosen.selector, chosen.notes, profiling=True)
    machine, before = describe_machine(device), load_average()
    rates = [measure_rates(device, _RATE_REPEATS)]
    measured = _kernels(device, work, machine.cores, follow) if work.kernels else ()
    # again, as the machine's other work may have changed meanwhile
    rates.append(measure_rates(device, _RATE_REPEATS))
    return BenchResult(
        machine=machine,
        seed=work.seed,
        repeats=work.repeats,
        rates=summarize_rates(device, rates),
        kernels=measured,
        pairs=_pairs(selector, work, follow) if work.pairs else (),
        survey=measure_survey(work.survey, work.seed, selector, follow, command) if work.survey else None,
        load=(before, load_average()),
    )


def _kernels(device: Device, work: Workload, cores: int, follow: Follow) -> tuple[KernelResult, ...]:
    with follow("timing kernels", len(work.edges) * len(CASES)) as step:
        return tuple(measure_kernels(device, work.edges, work.repeats, work.seed, cores, step))


def _pairs(selector: str | None, work: Workload, follow: Follow) -> tuple[PairResult, ...]:
    with follow("simulating pairs", work.pairs) as step:
        simulated = simulate_pairs(work.pairs, work.seed, step)
    with follow("registering pairs", len(work.edges) * work.pairs) as step:
        return tuple(measure_pairs(simulated, edge, selector, step) for edge in work.edges)
