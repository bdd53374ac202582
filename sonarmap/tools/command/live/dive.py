# pyright: strict
"""A dive from its first scan to its last: who records, who maps, and what is shown of it."""

import os
import signal
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from threading import Event, Thread
from typing import Any

from sonarmap.kernels.errors import DeviceError, InputError
from sonarmap.tools.command.live.mapping import MappingSettings, run_mapping
from sonarmap.tools.command.live.recording import RecordingProcess
from sonarmap.tools.products.live.server import LivePage
from sonarmap.tools.products.live.state import State

_TICK = 0.2  # seconds after which an end that was asked for is noticed, at the latest
_MOST_BEGUN, _WITHIN = 5, 60.0  # so often the mapping is begun again within so long [s]
_MOST_ALERTS = 5
_PATIENCE = 5.0  # until a process has ended [s]


@dataclass(slots=True)
class Dive:
    """What goes on.

    Attributes:
        settings: of the mapping.
        recording: who records; None of an input that somebody else writes.
        page: where it is shown.
        tell: called with what to say on the terminal: the state, and what is new and wrong.
    """

    settings: MappingSettings
    recording: RecordingProcess | None
    page: LivePage
    tell: Callable[[State, list[str]], None]
    _alerts: list[str] = field(default_factory=list[str])
    _new: list[str] = field(default_factory=list[str])
    _begun: list[float] = field(default_factory=list[float])

    def follow(self, stop: Event) -> None:
        """Until the input has ended, or `stop` is set; a recording goes on until then, mapped or not.

        Raises:
            InputError, DeviceError: nothing can be mapped, and nothing is recorded.
        """
        try:
            while not stop.is_set() and self._map_until(stop):
                self._alert("the mapping was killed, and goes on from the last key scan")
        except (InputError, DeviceError) as error:
            if self.recording is None:
                raise
            self._alert(f"nothing more is mapped until the dive ends: {error}")
            self._only_record(stop)
        finally:
            if self.recording is not None:
                self.recording.end()

    def _only_record(self, stop: Event) -> None:
        while not stop.is_set() and self.recording is not None:
            self._look_at_recording()
            if self._new:
                self._show(State("recording"))
            stop.wait(_TICK)

    def _show(self, state: State) -> None:
        """On the terminal and the page, with what is wrong."""
        for alert in state.alerts:
            self._alert(alert)
        self.tell(state, self._new)
        self._new = []
        self.page.publish(("state", replace(state, alerts=tuple(self._alerts)).message))

    def _map_until(self, stop: Event) -> bool:
        """Map in a process of its own; whether this was killed, and can be begun again."""
        context = get_context("spawn")
        pipe, other = context.Pipe()
        process = context.Process(target=_map, args=(self.settings, other), daemon=True)
        with _without_interrupts():
            process.start()
        other.close()
        self._begun = [begun for begun in self._begun if time.monotonic() - begun < _WITHIN] + [time.monotonic()]
        try:
            while not stop.is_set():
                self._look_at_recording()
                if pipe.poll(_TICK) and self._took(pipe):
                    return False
        except EOFError:
            if len(self._begun) > _MOST_BEGUN:
                raise InputError(
                    f"the process that maps ended {_MOST_BEGUN} times within a minute, as where memory is short; "
                    "'sonarmap doctor' says what fits"
                ) from None
            return True
        finally:
            pipe.close()
            process.join(_PATIENCE)
            process.kill()  # what it has kept is whole whenever it ends
            process.join()
        return False

    def _took(self, pipe: Connection) -> bool:
        """Take a message; whether it is the last one. Raises EOFError: the mapping has gone."""
        try:
            message: Any = pipe.recv()
        except OSError as error:  # in the middle of a message
            raise EOFError from error
        if message is None:
            return True
        if isinstance(message, InputError | DeviceError):
            raise message
        if isinstance(message, State):
            self._show(message)
        else:
            self.page.publish(message)
        return False

    def _look_at_recording(self) -> None:
        if self.recording is None:
            return
        try:
            for line in self.recording.look():
                self._alert(line.removeprefix("warning: "))
        except InputError as error:
            self._alert(str(error))
            self.recording.end()
            self.recording = None

    def _alert(self, words: str) -> None:
        if words and words not in self._alerts:
            self._alerts = [*self._alerts, words][-_MOST_ALERTS:]
            self._new.append(words)


@contextmanager
def _without_interrupts() -> Generator[None]:
    """A process that is started within the block does not hear Ctrl-C, which is for this one."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _map(settings: MappingSettings, pipe: Connection) -> None:
    """As `run_mapping`, in a process that ends with the one that began it: another one may want the journal."""
    parent = parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=end_with_parent, daemon=True).start()
    run_mapping(settings, pipe)
