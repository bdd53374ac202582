"""A port that passes on what it gets to another one, and counts the bytes."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Thread


@dataclass(slots=True)
class CountingProxy:
    """Attributes: its port on this machine; the bytes that went through, both ways."""

    port: int
    passed: int = 0

    def pump(self, here: socket.socket, there: socket.socket) -> None:
        with suppress(OSError):
            while chunk := here.recv(1 << 16):
                self.passed += len(chunk)
                there.sendall(chunk)
        with suppress(OSError):
            there.shutdown(socket.SHUT_WR)


@contextmanager
def counting_proxy(port: int) -> Iterator[CountingProxy]:
    """A proxy of a port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        proxy = CountingProxy(server.getsockname()[1])

        def accept() -> None:
            with suppress(OSError):
                while True:
                    here, _ = server.accept()
                    there = socket.create_connection(("127.0.0.1", port))
                    for pair in ((here, there), (there, here)):
                        Thread(target=proxy.pump, args=pair, daemon=True).start()

        Thread(target=accept, daemon=True).start()
        yield proxy
