"""Where a survey's pairs are registered, by the options of `sonarmap map`, and how that ends when it is stopped."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.failures import when_stopped
from sonarmap.tools.command.method import ConfiguredMethod
from sonarmap.tools.command.options.option import MOST_WORKERS, RUNNING, flag, option
from sonarmap.tools.command.terminal import say, warn
from sonarmap.tools.files.writers.atomic import LEFTOVER_PREFIX

if TYPE_CHECKING:
    from sonarmap.slam.execute.executor import Executor
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import PairWorker

# Beside the journal: whoever holds the folder's lock may delete what a killed run left.
SPOOL = f"{LEFTOVER_PREFIX}scans."
_running = partial(option, RUNNING)


@dataclass(frozen=True, slots=True)
class ExecutionOptions:
    """Where pairs are registered: in this process, or in several."""

    workers: int | None = _running(
        "N",
        "Processes that register pairs; the results are the same.",
        shown="1",
        min=1,
        max=MOST_WORKERS,
    )
    fresh: bool = flag(RUNNING, "--fresh", "Discard the pairs of earlier runs in OUT/journal.sqlite.")

    @property
    def processes(self) -> int:
        """How many register pairs; 1 is this one."""
        return self.workers or 1


@contextmanager
def open_execution(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions, journal: Path, quiet: bool
) -> Iterator["Execution"]:
    """Workers, where the options have them, and a journal, for as long as the block lasts.

    A worker keeps as many scans prepared as `prepared` says. If not `quiet`, it is said how many pairs the journal
    held. Raises InputError: the journal cannot be used, or the workers fail.
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
    from sonarmap.slam.execute.executor import processes, this_process
    from sonarmap.slam.execute.worker import Worker
    from sonarmap.tools.methods.fingerprint import worker_spec

    if options.processes > 1:
        spec = worker_spec(method.name, method.setup, method.registrar, prepared)
        with processes(options.processes, spool=spool) as executor:
            yield spec, executor
    else:
        yield Worker(method.registrar, prepared), this_process()
