# pyright: strict
"""What a browser still lacks: of everything that is replaced only the latest is kept, so that a slow browser costs no
memory, and one that comes late gets the whole map."""

import json
from dataclasses import dataclass
from struct import unpack_from
from threading import Lock
from typing import Any

import numpy as np

from sonarmap.tools.products.live.messages import CLOUD, CLOUD_HEADER, COVERAGE, COVERAGE_HEADER, LAST, POINT

MOST_POINTS = 1_500_000  # in clouds; beyond it every cloud loses every second point
MOST_TRACK = 50_000  # points of the track; likewise
AT_ONCE = 16  # binary messages between two looks at the texts


@dataclass(slots=True)
class Reached:
    """What a browser has: numbers of changes in texts and in bytes, points of the track as they were thinned."""

    text: int = 0
    binary: int = 0
    track: int = 0
    thinned: int = 0


class Kept:
    """Messages as a browser needs them. Every method may be called from any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._changes = 0
        self._forget()

    def _forget(self) -> None:
        self._texts: dict[str, tuple[int, str]] = {}  # the latest of a kind, and the number of its change
        self._poses: list[tuple[int, Any]] = []  # likewise of each key scan
        self._binaries: dict[tuple[int, int], tuple[int, bytes]] = {}  # (kind, key scan or part), oldest change first
        self._track: list[Any] = []
        self._thinned = self._changes  # the change that last thinned the track
        self._points, self._step = 0, 1  # in all clouds; of the points of a cloud, every how many are kept

    def add(self, message: str | bytes) -> None:
        """Keep a message in place of those that it replaces."""
        with self._lock:
            self._changes += 1
            if isinstance(message, str):
                self._add_text(message)
            else:
                self._add_binary(message)

    def _add_text(self, message: str) -> None:
        content = json.loads(message)
        kind = content["kind"]
        if kind == "track":
            self._track += content["points"]
            if len(self._track) > MOST_TRACK:
                self._track, self._thinned = self._track[::2], self._changes
        elif kind == "poses":
            first = content["first"]
            if first > len(self._poses):
                raise ValueError(f"poses from {first} on, but there are only {len(self._poses)} before")
            rows = [(self._changes, row) for row in content["poses"]]
            self._poses[first : first + len(rows)] = rows
        elif kind in ("state", "loops", "reset"):
            if kind == "reset":
                self._forget()
            self._texts[kind] = (self._changes, message)
        else:
            raise ValueError(f"a message of the kind {kind!r}, which the page does not know")

    def _add_binary(self, message: bytes) -> None:
        kind = message[0]
        if kind not in (CLOUD, LAST, COVERAGE):
            raise ValueError(f"a binary message of the kind {kind}, which the page does not know")
        if kind == CLOUD:
            message = _thinned(message, self._step)
        at = 0 if kind == LAST else unpack_from("<I", message, COVERAGE_HEADER - 4 if kind == COVERAGE else 4)[0]
        before = self._binaries.pop((kind, at), None)
        self._binaries[kind, at] = (self._changes, message)
        if kind == CLOUD:
            self._points += (len(message) - (len(before[1]) if before else CLOUD_HEADER)) // POINT
            while self._points > MOST_POINTS:
                self._thin_clouds()

    def _thin_clouds(self) -> None:
        self._step *= 2
        clouds = {at: _thinned(message, 2) for at, (_, message) in self._binaries.items() if at[0] == CLOUD}
        for at, message in clouds.items():
            self._changes += 1
            del self._binaries[at]
            self._binaries[at] = (self._changes, message)
        self._points = sum((len(message) - CLOUD_HEADER) // POINT for message in clouds.values())

    def after(self, reached: Reached) -> list[str | bytes]:
        """The next messages for a browser, texts first, and none if it has everything; moves on what it reached."""
        with self._lock:
            new: list[str | bytes] = [text for at, text in sorted(self._texts.values()) if at > reached.text]
            first = next((k for k, (at, _) in enumerate(self._poses) if at > reached.text), None)
            if first is not None:
                new.append(_text(kind="poses", first=first, poses=[row for _, row in self._poses[first:]]))
            if reached.thinned != self._thinned:
                reached.track, reached.thinned = 0, self._thinned
            if reached.track < len(self._track):
                new.append(_text(kind="track", first=reached.track, points=self._track[reached.track :]))
            reached.text, reached.track = self._changes, len(self._track)
            return new + self._binaries_after(reached)

    def _binaries_after(self, reached: Reached) -> list[bytes]:
        waiting: list[tuple[int, bytes]] = []
        for at, message in reversed(self._binaries.values()):
            if at <= reached.binary:
                break
            waiting.append((at, message))
        sent = waiting[: -AT_ONCE - 1 : -1]  # the oldest
        reached.binary = sent[-1][0] if sent else reached.binary
        return [message for _, message in sent]


def _thinned(message: bytes, step: int) -> bytes:
    """A cloud with every `step`-th of its points."""
    if step == 1:
        return message
    points = np.frombuffer(message, "<i2", offset=CLOUD_HEADER).reshape(-1, 3)
    return message[:CLOUD_HEADER] + points[::step].tobytes()


def _text(**content: Any) -> str:
    return json.dumps(content, separators=(",", ":"))
