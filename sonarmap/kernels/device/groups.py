"""How many work-items share a group, by flavor: the only place that says so.

On a processor a group costs as much as a short row: an item is a row, or a group a few of them. On a graphics processor
a group holds a multiple of 64 items, which is whole warps and whole wavefronts, neighbors along the first dimension.
"""

from collections.abc import Mapping
from math import gcd, prod
from types import MappingProxyType

from sonarmap.kernels.device.device import Device

Shape = tuple[int, ...]

# What a kernel's items are -> the group (CPU, GPU). Kernels with such a group return beyond what they are given.
GROUPS: Mapping[str, tuple[Shape, Shape]] = MappingProxyType(
    {
        "numbers": ((32,), (256,)),  # 8 adjacent numbers or one, of an array without rows
        "columns": ((1, 1), (64, 4)),  # 8 adjacent numbers or one; second dimension: layers or rows
        "rows": ((1, 8, 1), (64, 4, 1)),  # a row or a number of it; then rows and planes
        "planes": ((1, 1, 1), (64, 4, 1)),  # the same where rows take long
        "sums": ((1,), (128,)),  # a group sums a row or an image
        # a point each, in both flavors: a processor's compiler makes vectors of the group's loop; second: poses
        "points": ((256, 1), (256, 1)),
    }
)
# of kernels that say nothing, along each dimension at most
_PLAIN: tuple[Shape, ...] = ((), (256,), (64, 4), (64, 4, 1))


def lanes(device: Device) -> int:
    """How many adjacent numbers a work-item takes (LANES of lanes.cl)."""
    return 8 if device.is_cpu else 1


def along(device: Device, count: int) -> int:
    """How many work-items a row of `count` numbers has: one that walks it, or one each (ALONG of lanes.cl)."""
    return 1 if device.is_cpu else count


def team(device: Device) -> int:
    """How many work-items a group of "sums" has, to multiply the number of groups with."""
    return GROUPS["sums"][0 if device.is_cpu else 1][0]


def arrange(device: Device, size: Shape, group: str | Shape | None, most: int) -> tuple[Shape, Shape]:
    """The size to launch, in whole groups, and the group.

    Args:
        size: work-items along each dimension.
        group: a key of GROUPS; a group to take as it is; None: single items on a processor, and elsewhere the largest
            power of two that divides the size.
        most: work-items that a group of this kernel can have.
    """
    if isinstance(group, str):
        fitting = _shrink(GROUPS[group][0 if device.is_cpu else 1], most)
        return tuple(-(-n // g) * g for n, g in zip(size, fitting, strict=True)), fitting
    if group is not None:
        return size, group
    if device.is_cpu:
        return size, (1,) * len(size)
    return size, tuple(gcd(n, g) for n, g in zip(size, _shrink(_PLAIN[len(size)], most), strict=True))


def _shrink(group: Shape, most: int) -> Shape:
    """The group with its longest dimension halved until the device can run it."""
    while prod(group) > most:
        longest = group.index(max(group))
        group = tuple(n // 2 if axis == longest else n for axis, n in enumerate(group))
    return group
