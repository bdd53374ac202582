# pyright: strict
"""What a browser still lacks: of everything that is replaced only the latest is kept, so that a slow browser costs no
memory, and one that comes late gets the whole map."""

from threading import Lock

from sonarmap.tools.products.live.messages import RESET, Message

AT_ONCE = 16  # binary messages between two looks at the texts


class Kept:
    """Messages by their names. Every method may be called from any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._changes = 0
        self._latest: dict[str, tuple[int, str | bytes]] = {}  # with the number of its change, which ascends

    def add(self, message: Message) -> None:
        """Keep a message in place of the one that has its name; one that is the same is no news."""
        name, content = message
        with self._lock:
            if message == RESET:
                self._latest.clear()
            elif self._latest.get(name, (0, None))[1] == content:
                return
            self._latest.pop(name, None)
            self._changes += 1
            self._latest[name] = self._changes, content

    def after(self, reached: dict[type, int]) -> list[str | bytes]:
        """The next messages for a browser, texts first, and none if it has everything.

        `reached` is what it has, the last change among its texts and among its bytes; it is moved on.
        """
        with self._lock:
            new = [(at, content) for at, content in self._latest.values() if at > reached.get(type(content), 0)]
        texts = [each for each in new if isinstance(each[1], str)]
        sent = texts + [each for each in new if isinstance(each[1], bytes)][:AT_ONCE]
        reached.update({type(content): at for at, content in sent})
        return [content for _, content in sent]
