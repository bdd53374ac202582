# pyright: strict, reportUnknownVariableType=false, reportUnknownMemberType=false, reportUnknownArgumentType=false
"""A surface on the device: its points in cells, and what is known of each."""

from dataclasses import dataclass

import pyopencl.array as cla

from sonarmap.kernels.surface.cells import Cells


@dataclass(frozen=True, slots=True)
class Elements:
    """The points of a surface on the device that they were prepared on.

    Attributes:
        rows: device (m, 12) float32, point, normal and ray of each as `element.cl` has them.
        cells: the same points, to search among.
    """

    rows: cla.Array
    cells: Cells

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def thinned(self, most: int) -> tuple[int, int]:
        """At most so many of the points, evenly: their number, and how many points further the next one is."""
        step = max(1, -(-len(self) // most))
        return -(-len(self) // step), step
