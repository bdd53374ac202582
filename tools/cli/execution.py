"""Where a survey's pairs are registered, by the options of `sonarmap map`, and how that ends when it is stopped."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from tools.cli.method import ConfiguredMethod
from tools.cli.terminal import say
from tools.cli.text.survey import warn
from tools.writers.atomic import LEFTOVER_PREFIX

if TYPE_CHECKING:
    from slam.execute.executor import Executor
    from slam.execute.runner import Execution
    from slam.execute.worker import PairWorker

# Beside the journal: whoever holds the journal's lock may delete what a killed run left.
SPOOL = f"{LEFTOVER_PREFIX}scans"


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
    from slam.execute.journal import Journal
    from slam.execute.runner import Execution
    from tools.methods.fingerprint import method_key

    key = method_key(method.name, method.setup, method.registrar)
    with (
        _terminated_as_interrupted(),
        Journal(journal, options.fresh) as opened,
        _workers(method, prepared, options, journal.parent / SPOOL) as (worker, executor),
    ):
        held = opened.count()
        execution = Execution(worker, executor, opened, key)
        yield execution
        from_journal, tried = execution.timings.from_journal, len(execution.timings.pairs)
        damaged = opened.damaged
    if damaged:
        warn(f"{damaged} results in {journal} were damaged, and have been computed again")
    if from_journal and not quiet:
        say(f"{from_journal} of {tried} pairs were in {journal}")
    elif held and not quiet:
        say(f"{journal} holds {held} results of other scans, settings or code; none could be used")


@contextmanager
def _workers(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions, spool: Path
) -> "Iterator[tuple[PairWorker, Executor]]":
    from slam.execute.cluster import cluster
    from slam.execute.executor import processes, this_process
    from slam.execute.worker import Worker
    from tools.methods.worker_spec import checked_worker_spec, worker_spec

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


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM ends the block as Ctrl-C does: files are closed, and workers end."""
    if threading.current_thread() is not threading.main_thread():  # only it receives signals
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
