"""Who registers a survey's pairs, as the options of `sonarmap map` say it, and their end when it is stopped."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from tools.cli.method import Chosen
from tools.cli.terminal import say

if TYPE_CHECKING:
    from slam.execute.executor import Crew


@dataclass(frozen=True, slots=True)
class Way:
    """How pairs are to be registered.

    Attributes:
        workers: number of processes; with 1 it is this one.
        scheduler: address of a Dask cluster's scheduler, in place of them; None for none.
        fresh: whether to forget what the journal holds.
    """

    workers: int = 1
    scheduler: str | None = None
    fresh: bool = False

    @property
    def place(self) -> int | str:
        """What a file of times says of it."""
        return self.scheduler or self.workers


@contextmanager
def open_crew(chosen: Chosen, prepared: int, way: Way, journal: Path, quiet: bool) -> Iterator["Crew"]:
    """A crew that keeps a journal, for as long as the block lasts.

    Args:
        chosen: the method.
        prepared: how many prepared scans a worker keeps.
        way: who registers.
        journal: the file.
        quiet: whether not to tell what was found in it.

    Raises:
        InputError: the journal cannot be used, or the crew fails.
    """
    from slam.execute.journal import Journal
    from tools.methods.key import method_key

    key = method_key(chosen.name, chosen.setup, chosen.registrar)
    with _stoppable(), Journal(journal, key, way.fresh) as kept, _crew(chosen, prepared, way) as crew:
        held = kept.count()
        crew = replace(crew, journal=kept)
        yield crew
        found, tried = crew.account.found, len(crew.account.pairs)
    if found and not quiet:
        say(f"{found} of {tried} pairs found in {journal}")
    elif held and not quiet:
        say(f"{journal} holds {held} pairs of other scans, settings or code; none was of use")


@contextmanager
def _crew(chosen: Chosen, prepared: int, way: Way) -> Iterator["Crew"]:
    from slam.execute.executor import alone, cluster, processes
    from slam.execute.worker import Worker
    from tools.methods.key import checked_recipe, recipe

    method = (chosen.name, chosen.setup, chosen.registrar, prepared)
    if way.scheduler:
        with cluster(checked_recipe(*method), way.scheduler) as crew:
            yield crew
    elif way.workers > 1:
        with processes(recipe(*method), way.workers) as crew:
            yield crew
    else:
        yield alone(Worker(chosen.registrar, prepared))


@contextmanager
def _stoppable() -> Iterator[None]:
    """Being told to end is as being interrupted: what is open is closed, and workers end."""
    if threading.current_thread() is not threading.main_thread():  # only it can be told
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
