"""A dive in `sonarmap live`: runs the mapping in a process, restarts it if it fails, and shows its state."""

import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import Any

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.tools.command.live.chosen import changes_scans, keep_chosen
from sonarmap.tools.command.live.kept_keys import forget_dive
from sonarmap.tools.command.live.mapping import MappingSettings, run_mapping
from sonarmap.tools.command.live.recording import Again, in_words
from sonarmap.tools.files.finding import Remedy
from sonarmap.tools.products.live.messages import State
from sonarmap.tools.products.live.server import LivePage

_TICK = 0.2  # longest delay until a requested end is noticed [s]
_MOST_FAILURES = 5  # in a row; then a dive ends that is not recorded here
_MOST_ALERTS = 5  # on the page
_PATIENCE = 5.0  # for a process to end [s]


class KilledError(Exception):
    """The mapping process ended without a message."""


@dataclass(slots=True)
class Dive:
    """Runs the mapping of a dive and shows its state and alerts."""

    settings: Callable[[Sequence[Remedy]], MappingSettings]  # of the mapping, with the chosen remedies
    out: Path  # the map's folder
    page: LivePage
    tell: Callable[[State, list[str]], None]  # shows the state and the new alerts on the terminal
    is_recorded: bool  # whether a recording runs as well, so that only the user ends the dive
    said: Sequence[deque[str]] = ()  # alerts of the recording and the navigation, removed when shown
    chosen: list[Remedy] = field(default_factory=list[Remedy])  # on the page, in their order
    _state: State = field(default_factory=State)
    _alerts: list[str] = field(default_factory=list[str])
    _of_mapping: set[str] = field(default_factory=set[str])  # alerts of the mapping, which repeats them
    _new: list[str] = field(default_factory=list[str])  # alerts that are not on the terminal yet

    def follow(self, stop: Event) -> None:
        """Map until `stop` is set or the input has ended; restart the mapping if it fails. At the end say so."""
        again = Again()
        while not stop.is_set():
            again.begins()
            try:
                self._choose()
                if not self._map_until(stop):
                    continue
                if not self.is_recorded:
                    break
                error: Exception = InputError("no more scans came")
            except Exception as failure:  # noqa: BLE001 - whatever it is, a recording may go on
                error = failure
            if not stop.is_set():
                self._pause(again, error, stop)
        self._state = replace(self._state, status="ended")
        self._show()

    def _pause(self, again: Again, error: Exception, stop: Event) -> None:
        """Report why the mapping ended, and wait until it is restarted. Raises the error if it is not."""
        pause, was_killed = again.pause(), isinstance(error, KilledError)
        if not self.is_recorded and (isinstance(error, InputError | DeviceError) or again.failures > _MOST_FAILURES):
            raise InputError(f"{error}; 'sonarmap doctor' says what fits") if was_killed else error
        reason = next(iter(str(error).splitlines()), "")
        why = reason if was_killed else f"the mapping ended ({reason})"
        self._alert(f"{why}, and goes on from the last key scan{in_words(pause)}")
        self._state = State("recording" if self.is_recorded else "waiting")
        for _ in range(int(pause / _TICK) + 1):
            self._look()
            if stop.wait(_TICK):
                return

    def _map_until(self, stop: Event) -> bool:
        """Map in a process of its own; True if all scans are mapped, False if `stop` is set or a remedy was chosen.
        Raises what ended it."""
        context = get_context("spawn")
        pipe, other = context.Pipe()
        process = context.Process(target=_map, args=(self.settings(self.chosen), other), daemon=True)
        with _without_interrupts():
            process.start()
        other.close()
        try:
            while not stop.is_set() and not self.page.chosen:
                self._look()
                if pipe.poll(_TICK) and self._took(pipe):
                    return True
        finally:
            pipe.close()
            process.join(_PATIENCE)
            process.kill()  # its files are complete whenever it ends
            process.join()
        return False

    def _choose(self) -> None:
        """Apply the buttons that were pressed on the page. The mapping then restarts, without its earlier alerts."""
        while self.page.chosen:
            label = self.page.chosen.popleft()
            if (remedy := self._choices.get(label)) is not None:
                self.chosen.append(remedy)
            elif label in self._choices:
                remedy = self.chosen.pop()
            else:  # two browsers chose the same
                continue
            try:
                keep_chosen(self.out, self.chosen)
            except InputError as error:
                self._alert(f"the options chosen on the page are lost if the program is killed: {error}")
            if changes_scans(remedy):
                forget_dive(self.out)
            self._alerts = [words for words in self._alerts if words not in self._of_mapping]
            self._of_mapping.clear()
            used = "is used from here on" if remedy in self.chosen else "is not used any more"
            self._new.append(f"{remedy} {used}, as chosen on the page")
            self._state = State("waiting")
            self._show()

    @property
    def _choices(self) -> dict[str, Remedy | None]:
        """Buttons of the page by label: a remedy to use, or None to stop using the last. None after a dive."""
        if self._state.status == "ended":
            return {}
        choices: dict[str, Remedy | None] = {
            f"Use {each}": each for each in self._state.remedies if each not in self.chosen
        }
        return choices | ({f"Do not use {self.chosen[-1]} any more": None} if self.chosen else {})

    def _took(self, pipe: Connection) -> bool:
        """Receive a message; whether it is the last one. Raises what ended the mapping."""
        try:
            message: Any = pipe.recv()
        except (EOFError, OSError) as error:  # OSError within a message
            raise KilledError("the mapping was killed, perhaps for lack of memory") from error
        if message is None:
            return True
        if isinstance(message, Exception):
            raise message
        if isinstance(message, State):
            for alert in message.alerts:
                if alert not in self._of_mapping:
                    self._of_mapping.add(alert)
                    self._alert(alert)
            self._state = message
            self._show()
        else:
            self.page.publish(message)
        return False

    def _look(self) -> None:
        """Show new alerts of the recording and the navigation."""
        for lines in self.said:
            while lines:
                self._alert(lines.popleft().removeprefix("warning: "))
        if self._new:
            self._show()

    def _show(self) -> None:
        """Show the state and the alerts on the terminal and the page. A closed terminal does not end the dive."""
        with suppress(Exception):
            self.tell(self._state, self._new)
        self._new = []
        state = replace(self._state, alerts=tuple(self._alerts), choices=tuple(self._choices))
        self.page.choices = frozenset(state.choices)
        self.page.publish(("state", state.message))

    def _alert(self, words: str) -> None:
        self._alerts = [*(other for other in self._alerts if other != words), words][-_MOST_ALERTS:]
        self._new.append(words)


@contextmanager
def _without_interrupts() -> Generator[None]:
    """Within the block, started processes ignore Ctrl-C, which is for this process."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _map(settings: MappingSettings, pipe: Connection) -> None:
    """`run_mapping` in a process that ends with its parent, so that the next one can open the journal."""
    parent = parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=end_with_parent, daemon=True).start()
    run_mapping(settings, pipe)
