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
class BenchPlan:
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


def run_bench(selector: str | None, plan: BenchPlan, follow: Follow, command: Command) -> BenchResult:
    """Measure on one device.

    Args:
        selector: of the device, as `choose_device` takes it.
        follow: reports the progress.
        command: as `measure_survey` takes it.

    Raises:
        InputError: an edge is not a grid's, or nothing is left to measure.
        DeviceError: there is no such device, or it is too small.
    """
    for edge in plan.edges:
        Grid(edge, 1.0)
    if not (plan.kernels or plan.pairs or plan.survey):
        raise InputError("--no-kernels and --pairs 0 leave nothing to measure; leave one of them out")
    if plan.survey == 1:
        raise InputError("--survey 1: a survey needs 2 scans or more; 0 maps none")
    chosen = choose_device(selector)
    device = Device(chosen.cl_device, chosen.selector, chosen.notes, profiling=True)
    machine, before = describe_machine(device), load_average()
    rates = [measure_rates(device, _RATE_REPEATS)]
    measured = _kernels(device, plan, machine.cores, follow) if plan.kernels else ()
    # again, as the machine's other work may have changed meanwhile
    rates.append(measure_rates(device, _RATE_REPEATS))
    return BenchResult(
        machine=machine,
        seed=plan.seed,
        repeats=plan.repeats,
        rates=summarize_rates(device, rates),
        kernels=measured,
        pairs=_pairs(selector, plan, follow) if plan.pairs else (),
        survey=measure_survey(plan.survey, plan.seed, selector, follow, command) if plan.survey else None,
        load=(before, load_average()),
    )


def _kernels(device: Device, plan: BenchPlan, cores: int, follow: Follow) -> tuple[KernelResult, ...]:
    with follow("timing kernels", len(plan.edges) * len(CASES)) as step:
        return tuple(measure_kernels(device, plan.edges, plan.repeats, plan.seed, cores, step))


def _pairs(selector: str | None, plan: BenchPlan, follow: Follow) -> tuple[PairResult, ...]:
    with follow("simulating pairs", plan.pairs) as step:
        simulated = simulate_pairs(plan.pairs, plan.seed, step)
    with follow("registering pairs", len(plan.edges) * plan.pairs) as step:
        return tuple(measure_pairs(simulated, edge, selector, step) for edge in plan.edges)
