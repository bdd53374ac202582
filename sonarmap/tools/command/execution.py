"""Where a survey's pairs are registered, by the options of `sonarmap map`, and how that ends when it is stopped."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.method import ConfiguredMethod
from sonarmap.tools.command.stops import when_stopped
from sonarmap.tools.command.terminal import say, warn
from sonarmap.tools.files.writers.atomic import LEFTOVER_PREFIX

if TYPE_CHECKING:
    from sonarmap.slam.execute.executor import Executor
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import PairWorker

# Beside the journal: whoever holds the folder's lock may delete what a killed run left.
SPOOL = f"{LEFTOVER_PREFIX}scans."


@dataclass(frozen=True, slots=True)
class ExecutionOptions:
    """Where pairs are registered.

    Attributes:
        workers: number of processes; with 1 it is this one.
        scheduler: address of a Dask cluster's scheduler, in place of them; None for none.
        fresh: whether to delete what the journal holds.
    """

    workers: int = 1
    scheduler: str | None = None
    fresh: bool = False

    @classmethod
    def of(cls, workers: int | None, scheduler: str | None, fresh: bool) -> "ExecutionOptions":
        """As --workers, --scheduler and --fresh say; InputError for both of the first."""
        if workers is not None and scheduler is not None:
            raise InputError(
                "--workers starts processes on this machine, and --scheduler uses the workers of a cluster; leave one "
                "out"
            )
        return cls(workers or 1, scheduler, fresh)

    @property
    def place(self) -> int | str:
        """The number of processes, or the address of the cluster."""
        return self.scheduler or self.workers


@contextmanager
def open_execution(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions, journal: Path, quiet: bool
) -> Iterator["Execution"]:
    """Workers and a journal, for as long as the block lasts.

    Args:
        method: that registers them.
        prepared: how many prepared scans a worker keeps.
        options: where pairs are registered.
        journal: the file.
        quiet: whether to say nothing about the pairs that the journal held.

    Raises:
        InputError: the journal cannot be used, or the workers fail.
    """
    from sonarmap.slam.execute.journal import Journal
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.tools.methods.fingerprint import method_key

    key = method_key(method.name, method.setup, method.registrar)
    with (
        Journal(journal, options.fresh) as opened,
        _workers(method, prepared, options, journal.parent / SPOOL) as (worker, executor),
    ):
        held = opened.count()
        execution = Execution(worker, executor, opened, key)
        with when_stopped(lambda: _what_is_kept(len(execution.timings.pairs), journal, options.fresh)):
            yield execution
        from_journal, tried = execution.timings.from_journal, len(execution.timings.pairs)
        damaged = opened.damaged
    if damaged:
        warn(f"{damaged} results in {journal} were damaged, and have been computed again")
    if from_journal and held and not quiet:
        say(f"{from_journal} of {tried} pairs were in {journal}")
    elif held and not quiet:
        say(f"{journal} holds {held} results of other scans, settings or code; none could be used")


def _what_is_kept(pairs: int, journal: Path, fresh: bool) -> str:
    if not pairs:
        return "no pair was done yet, and nothing was written"
    done = "1 pair is done" if pairs == 1 else f"{pairs} pairs are done"
    without = " without --fresh" if fresh else ""
    return f"{done} and kept in {journal}; the same command{without} continues from there"


@contextmanager
def _workers(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions, spool: Path
) -> "Iterator[tuple[PairWorker, Executor]]":
    from sonarmap.slam.execute.cluster import cluster
    from sonarmap.slam.execute.executor import processes, this_process
    from sonarmap.slam.execute.worker import Worker
    from sonarmap.tools.methods.fingerprint import checked_worker_spec, worker_spec

    recipe = (method.name, method.setup, method.registrar, prepared)
    if options.scheduler:
        spec = checked_worker_spec(*recipe)
        with cluster(options.scheduler) as executor:
            yield spec, executor
    elif options.workers > 1:
        spec = worker_spec(*recipe)
        with processes(options.workers, spool=spool) as executor:
            yield spec, executor
    else:
        yield Worker(method.registrar, prepared), this_process()
