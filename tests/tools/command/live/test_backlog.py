"""Scans that wait: how many at most, in what order, and how it ends."""

import time
from collections.abc import Iterator

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.live.mapping import Backlog
from sonarmap.tools.files.readers.incoming import Incoming, Mark
from tests.samples.clutter_scans import scan
from tests.tools.command.live.waiting import until

MOST = 256


def scans(count: int, pulled: list[int] | None = None) -> Iterator[Incoming]:
    points = scan(0)[:50]
    for number in range(count):
        if pulled is not None:
            pulled.append(number)
        yield Incoming(Scan(points, stamp=float(number)), Mark("dive", number + 1), missing=number // 3)


def test_no_more_scans_wait_than_memory_is_for() -> None:
    pulled: list[int] = []
    backlog = Backlog(scans(300, pulled))
    assert backlog.wait(30, least=MOST) == MOST
    time.sleep(0.05)
    assert len(pulled) == MOST + 1  # the last one is held by who brings it
    backlog.drop(7)
    until(lambda: len(pulled) == MOST + 8 and backlog.wait(0) == MOST)
    assert (backlog[0].behind, backlog[MOST - 1].behind) == (Mark("dive", 8), Mark("dive", MOST + 7))
    assert not backlog.ended
    backlog.drop(MOST)
    until(lambda: backlog.ended)
    assert (backlog.wait(0), backlog.missing, backlog.error) == (300 - MOST - 7, 99, None)


def test_who_waits_for_more_than_come_hears_of_the_end() -> None:
    backlog = Backlog(scans(4))
    assert backlog.wait(30, least=9) == 4
    assert [backlog[k].scan.stamp for k in range(3)] == [0.0, 1.0, 2.0]
    backlog.drop(9)
    assert backlog.wait(30) == 0


def test_nothing_comes_while_nothing_is_there() -> None:
    def silent() -> Iterator[Incoming]:
        time.sleep(0.4)
        yield from scans(2)

    backlog = Backlog(silent())
    assert (backlog.wait(0.01), backlog.ended) == (0, False)
    assert backlog.wait(30) >= 1


@pytest.mark.parametrize(("error", "words"), [(InputError("no disk 7"), "no disk 7"), (OSError(5, "gone"), "gone")])
def test_an_error_is_handed_on_after_what_came_before_it(error: Exception, words: str) -> None:
    def failing() -> Iterator[Incoming]:
        yield from scans(3)
        raise error

    backlog = Backlog(failing())
    assert backlog.wait(30, least=9) == 3
    assert isinstance(backlog.error, InputError)
    assert words in str(backlog.error)
