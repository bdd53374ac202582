"""Spawned processes, which share the cores and end with this one. No library is imported here, as a new process sets
the number of their threads before it loads them."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, connection, get_context, parent_process
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import Any

from sonarmap.kernels.device.threads import share_cores
from sonarmap.kernels.errors import InputError


@contextmanager
def spawned(workers: int, begin: Callable[..., None] | None = None, *arguments: Any) -> Iterator[ProcessPoolExecutor]:
    """New Python processes for as long as the block lasts.

    They are spawned, as an OpenCL context must not be inherited. They ignore interrupts, which are for this process.
    If the block raises or is interrupted they are ended, and their unfinished work is lost; if this process is killed
    they end too. Each uses its share of the cores (`kernels.device.threads.share_cores`).
    """
    before = set(active_children())
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _begin, (workers, begin, arguments))
    try:
        yield pool
        pool.shutdown()
    except BaseException as error:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(active_children()) - before:
            child.terminate()
        if isinstance(error, BrokenProcessPool):
            raise InputError(
                "one of the `workers` processes ended early, as happens where memory is short; use fewer. What is done "
                "is kept, and the same command continues from there."
            ) from error
        raise


def _begin(workers: int, begin: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    signal(SIGINT, SIG_IGN)
    share_cores(workers)
    Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*arguments)


def _end_with_parent() -> None:
    """End this process when its parent is gone: a killed parent cannot end it."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
