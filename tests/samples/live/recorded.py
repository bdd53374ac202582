"""Recording in this process while a test sends, and reading of the file."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ipaddress import IPv4Address
from pathlib import Path
from threading import Event
from typing import Any

from google.protobuf.message import Message
from wlsonar import range_image_protocol as rip

from sonarmap.tools.command.record.receiver import Source
from sonarmap.tools.command.record.recorder import RecordSettings, Status, record
from sonarmap.tools.command.record.words import Watch
from tests.samples.live.sender import LOOPBACK, free_port


def record_while(
    out: Path, sends: Callable[[tuple[str, int]], object], address: str = LOOPBACK, **settings: Any
) -> tuple[Status, list[str]]:
    """Record what `sends` sends to the given address until it returns; the final status and the warnings."""
    source = Source(IPv4Address(address), free_port(), settings.pop("interface", None))
    listens, stop, watch, warnings = Event(), Event(), Watch(), list[str]()

    def follow(status: Status) -> None:
        warnings.extend(watch.warnings(status))
        listens.set()

    with ThreadPoolExecutor(1) as pool:
        recording = pool.submit(record, RecordSettings(source, out, **settings), follow, stop)
        recording.add_done_callback(lambda _: listens.set())
        listens.wait()
        try:
            sends((address, source.port))
        finally:
            stop.set()
        return recording.result(), warnings


def messages_by_wlsonar(path: Path) -> list[Message]:
    """Every message of a recording, as wlsonar reads it; an unknown one raises its error."""
    messages = []
    with path.open("rb") as file:
        while True:
            try:
                messages.append(rip.unpack(file))
            except EOFError:
                return messages
