# pyright: strict
"""A method that stays ready from one registration to the next: to make its tables takes longer than a pair."""

import os
from collections import deque
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from sonarmap.tools.methods.registry import Setup, find_method

if TYPE_CHECKING:
    from sonarmap.spectral.result import Registrar

# What is kept takes no more than this part of the device's memory: on larger grids a pair takes far longer.
_PART = 32
_CHOOSE = ("PYOPENCL_CTX", "SONARMAP_FLAVOR")  # what else decides about the device
# The last method and what it was made from; taking it out and putting it back are one step each for all threads.
_KEPT: deque[tuple[object, Any]] = deque(maxlen=1)


@contextmanager
def reused(name: str, setup: Setup) -> "Generator[Registrar]":
    """A method as the registry makes it: that of the last block, if nothing but the voxel is another.

    It is the block's alone, also where several threads register at once, and what the block raised leaves none.

    Args:
        name: a key of METHODS.
        setup: what it is made from.

    Raises:
        InputError, DeviceError: it cannot be made, as the registry says.
    """
    key = name, setup.grid.edge, setup.device, setup.seed, *setup.changes.items(), *map(os.environ.get, _CHOOSE)
    try:
        last, kept = _KEPT.pop()
    except IndexError:
        last = kept = None
    if kept is not None and last == key:
        registrar = kept.with_voxel(setup.grid.voxel)
    else:
        kept = None  # its memory is free before the next one takes some
        registrar = find_method(name).make(setup)
    yield registrar
    if _is_worth_keeping(registrar, setup.grid.edge):
        _KEPT.append((key, registrar))


def _is_worth_keeping(registrar: Any, edge: int) -> bool:
    if not hasattr(registrar, "with_voxel"):  # made at once
        return False
    from sonarmap.spectral.memory import memory_plan

    plans = (memory_plan(edge, method) for method in ("spectral", "hemisphere"))
    return _PART * max(plan.pair for plan in plans) <= registrar.device.memory
