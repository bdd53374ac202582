"""A benchmark's result in JSON; seconds, bytes and bytes per second throughout. Other programs read it: names stay."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.user_file import read_content
from sonarmap.tools.files.versions import package_versions
from sonarmap.tools.files.writers.json_text import to_json
from sonarmap.tools.lab.bench.output.compare import compare
from sonarmap.tools.lab.bench.peers import peer_versions
from sonarmap.tools.lab.bench.rates import Rates
from sonarmap.tools.lab.bench.result import PAPER_SECONDS, BenchResult, KernelResult, PairResult
from sonarmap.tools.lab.bench.timing import Times


def as_json(result: BenchResult) -> dict[str, Any]:
    """One object."""
    return to_json(
        {
            "device": {"name": result.machine.device, "platform": result.machine.platform},
            "processor": result.machine.processor,
            "cores": result.machine.cores,
            "versions": package_versions() | peer_versions(),
            "load_average": result.load,
            "seed": result.seed,
            "repeats": result.repeats,
            "copy_rate": result.rates.copy_rate,
            "rates": result.rates.best,
            "flops": result.rates.flops,
            "kernels": [_kernel_row(kernel, result.rates) for kernel in result.kernels],
            "pairs": [_pair_row(pair, result.rates) for pair in result.pairs],
            "survey": result.survey,
        }
    )


def read_result(path: Path) -> dict[str, Any]:
    """What an earlier run wrote.

    Raises:
        InputError: the file cannot be read, or is none of `sonarmap bench`.
    """
    with results_of(path):
        content = json.loads(read_content(path, pipe=True))
        compare(content, content)  # looks at all that another run is compared with
        return content


@contextmanager
def results_of(path: Path | None) -> Iterator[None]:
    """Whatever the block misses in a result refuses the file that it was read from; None: it was measured just now.

    Raises:
        InputError: the file is none of `sonarmap bench`.
    """
    try:
        yield
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
        if path is None:
            raise
        raise InputError(f"{path} is not a result of `sonarmap bench`; give a file that -o or --json wrote") from error


def _kernel_row(kernel: KernelResult, rates: Rates) -> dict[str, Any]:
    traffic, launches = kernel.traffic, kernel.launches
    touched = traffic.reads + traffic.writes + traffic.in_place / 2
    return {
        "kernel": kernel.name,
        "twin": kernel.twin_name,
        "grid": kernel.edge,
        "device_seconds": kernel.device,
        "twin_seconds": kernel.twin,
        "ratio": kernel.ratio,
        "bytes_moved": traffic.moved,
        "rate": kernel.rate,
        "rate_over_copy_rate": kernel.rate / rates.at("copy", touched),
        "error": kernel.error,
        "tolerance": kernel.tolerance,
        "right": kernel.right,
        "bytes": traffic,
        "limit_seconds": rates.least_seconds(traffic),
        "share_of_limit": kernel.share_of_limit(rates),
        "flops": kernel.flops,
        "flop_rate": kernel.flops / kernel.device.median,
        "compile_seconds": kernel.compile_seconds,
        "launches": launches.count,
        "blocking_reads": launches.reads,
        "event_seconds": launches.seconds,
        "passes": [
            {
                "kernel": name,
                "event_seconds": seconds,
                "bytes": launches.passes.get(name),
                "share_of_limit": rates.least_seconds(launches.passes[name]) / seconds
                if name in launches.passes
                else None,
            }
            for name, seconds in launches.kernels.items()
        ],
        "peers": [
            {"library": name, "seconds": times, "ratio": times.median / kernel.device.median}
            for name, times in kernel.peers.items()
        ],
    }


def _pair_row(pair: PairResult, rates: Rates) -> dict[str, Any]:
    touched = 8 * pair.edge**3
    return {
        "grid": pair.edge,
        "voxel": pair.voxel,
        "prepare_seconds": _with_spread(pair.prepare),
        "register_seconds": _with_spread(pair.register),
        "paper_seconds": PAPER_SECONDS.get(pair.edge),
        "accepted": pair.accepted,
        "right": pair.right,
        "peak_memory": pair.peak_memory,
        "first_seconds": pair.first_seconds,
        "device_memory": pair.device_memory,
        "planned_memory": pair.planned_memory,
        "stages": [
            to_json(stage) | {"limit_seconds": stage.array_bytes / rates.at("in_place", touched)}
            for stage in pair.stages
        ],
    }


def _with_spread(times: Times) -> dict[str, Any]:
    return {name: getattr(times, name) for name in times.__slots__} | {"most_over_median": times.most_over_median}
