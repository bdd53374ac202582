"""Point-to-plane refinement of several poses on the device: pairs of nearest points, normal equations, their solution.

The poses stay on the device between the steps. The host reads the records of the last step.
"""

from dataclasses import astuple, dataclass
from functools import partial

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.arrays import Pending, Readback, recycled
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch, table
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.surface.cells import GROUP, Elements, padded

# A record, in the layout of real.cl: a pose, p_target = turn p_source + shift about the grid centers [voxels], the sums
# over its pairs of points, and the pose after the step that these lead to.
RECORD = np.dtype(
    [
        ("turn", "f8", (3, 3)),
        ("shift", "f8", (3,)),
        ("width", "f8", ()),  # median gap between the surfaces [voxels]
        ("stretch", "f8", (2,)),  # of the ranges of the source and of the target
        ("unused", "f8", ()),
        # Weighted sums of J^T J, with J the derivatives of a pair's gap by turn, shift and both stretches.
        ("moving", "f8", (8, 8)),  # of the pairs that move the pose
        ("whole", "f8", (8, 8)),  # of all pairs
        ("shared", "f8", (8, 8)),  # of all pairs, with one J by the other scan's normal (not symmetric)
        ("gradient", "f8", (8,)),  # weighted sum of J times the gap, of the pairs that move the pose
        ("total", "f8", ()),  # sum of the weights
        ("squares", "f8", ()),  # weighted sum of the squared gaps
        ("unused_sums", "f8", (6,)),
        ("axes", "f8", (6, 8)),  # principal axes of `shared`; last its share of a pair, and that of the rest of `whole`
        ("doubts", "f8", (8,)),  # 6 sums of the squares of each pair's share of `shared` along the principal axes
        ("next_turn", "f8", (3, 3)),
        ("next_shift", "f8", (3,)),
        ("next_width", "f8", ()),
        ("next_stretch", "f8", (2,)),
        ("unused_next", "f8", ()),
        ("off", "f8", (6,)),  # residuals of instruments before the step, as in TERM
        ("alone", "f8", (6,)),  # the step by the pairs alone, rotation first [rad, voxels]
    ]
)
# What instruments measured, linearized about a pose: at most 6 uncorrelated residuals of variance 1.
TERM = np.dtype(
    [
        ("off", "f8", (6,)),  # the residuals about the first pose
        ("jacobian", "f8", (6, 6)),  # derivatives of the residuals, in rows, by turn and shift [1/rad, 1/voxels]
        ("systematic", "f8", (6, 6)),  # covariance of errors that all points of a scan share
        ("shortest", "f8", (6, 6)),  # in columns, the shortest step that makes each residual 1
        ("limits", "f8", (2,)),  # chi-squared values from which and up to which scans get less weight
    ]
)
_SUMS = 208  # from `moving` to `unused_sums`
_PART = 128  # pairs of a work-item on a CPU, of a group on a GPU


@dataclass(frozen=True, slots=True)
class Weighting:
    # The weight falls with the gap, as a bell whose width is the larger of two.
    bell: float  # share of the reach
    wide_bell: float  # share of the surfaces' median gap
    bells: float  # pairs count up to this many widths of the bell, or up to the reach if that is more
    measured: float  # least reach at which the median gap is measured; below it, rims do not move the pose
    scale: float = 1.0  # weight of each pair


@dataclass(frozen=True, slots=True)
class Noise:
    """The variance of the gaps is scale * width^power [voxels^2]."""

    scale: float
    power: float
    narrowest: float  # least width in the formula [voxels]
    stretched: float  # variance of a stretch of the ranges
    usual: float  # share of the variance without rare large errors


class Refinement:
    def __init__(
        self,
        device: Device,
        target: Elements,
        source: Elements,
        most: int,
        weighting: Weighting,
        noise: Noise,
        stretches: bool = False,
    ) -> None:
        """Prepare steps with at most `most` points of each surface, evenly thinned; unless a scan `stretches`, it is
        rigid."""
        self.device, self._weighting = device, weighting
        self._real = np.float64 if "cl_khr_fp64" in device.cl_device.extensions else np.float32
        macros = {"PART": _PART, "FP64": int(self._real is np.float64)}
        macros |= {"BELL": weighting.bell, "WIDE_BELL": weighting.wide_bell, "BELLS": weighting.bells}
        self._launch = partial(launch, device, "surface/refinement", **macros)
        self._noise = [self._real(value) for value in astuple(noise)]
        self._stretches = np.int32(stretches)
        self._surfaces: list[cla.Array | np.generic] = []
        for surface in (target, source):
            count, step = surface.thinned(most)
            self._surfaces += [*surface.cells.arguments, surface.rows, np.int32(count), np.int32(step)]
        self._count = target.thinned(most)[0] + source.thinned(most)[0]
        self._parts = -(-self._count // _PART)

    def begin(
        self,
        turn: np.ndarray,
        shift: np.ndarray,
        width: np.ndarray,
        stretch: np.ndarray | None = None,
        terms: np.ndarray | None = None,
    ) -> None:
        """Set the state of k poses before the first step, and what instruments measured about them, (k,) TERM;
        arguments as in RECORD."""
        records = np.zeros(len(shift), RECORD)
        records["turn"], records["shift"], records["width"] = turn, shift, width
        records["stretch"] = 0 if stretch is None else stretch
        records["off"] = 0 if terms is None else terms["off"]
        known = np.zeros(1, TERM) if terms is None else terms
        rows, known = (each.view(np.float64).reshape(len(each), -1) for each in (records, known))
        if not np.isfinite(rows).all():
            raise InputError(f"a pose to refine is not finite: rotations {turn.tolist()}, shifts {shift.tolist()}")
        self._measured = np.int32(terms is not None)
        upload = table if terms is None else Device.to_device
        self._take(self.device.to_device(rows.astype(self._real)), upload(self.device, known.astype(self._real)))

    def begin_after(self, other: "Refinement") -> None:
        """Take over the poses of another refinement, on the device; the other one must not be used any more."""
        self._measured = other._measured
        self._take(other._records, other._terms)

    def _take(self, records: cla.Array, terms: cla.Array) -> None:
        poses = len(records)
        if not hasattr(self, "_rows") or self._rows.shape[0] != poses:
            self._rows = recycled(self.device, (poses, self._count, 16))
            self._sums = recycled(self.device, (poses, self._parts, _SUMS), self._real)
            self._poses = self.device.empty((poses, 16))
        self._records, self._terms = records, terms

    def step(self, reach: float, moves: bool = True) -> None:
        """Queue a step by the pairs within reach [voxels], and by the instruments. Unless it `moves` the poses, they
        stay, and `end` returns the sums and the step."""
        self._pair(reach)
        cpu, poses = self.device.is_cpu, self._rows.shape[0]
        group = (1 if cpu else 256, 1)
        size, arguments = (self._parts * group[0], poses), self._pairs()
        self._launch("add_up", size, *arguments, group=group, LANES=group[0])
        lanes = 1 if cpu else 64
        arguments = self._sums, self._records, self._terms, self._poses, np.int32(self._parts), np.int32(moves)
        numbers = self._measured, self._stretches, *self._noise
        self._launch("solve", (lanes, poses), *arguments, *numbers, group=(lanes, 1), LANES=lanes)

    def read(self) -> Pending[np.ndarray]:
        """Queue a read of the records, (k,) RECORD; axes and doubts are those of `end`."""
        rows = Readback(self.device, self._records)
        return Pending(lambda: rows.read().astype(np.float64).view(RECORD)[:, 0])

    def end(self) -> tuple[cla.Array, Pending[np.ndarray]]:
        """Poses (k, 16) after the last step, which must not have moved them, as from `upload_poses`, and the records of
        this step."""
        # the sums are added up by now: the doubts may overwrite them
        lanes, size = 1 if self.device.is_cpu else 256, (8 * self._parts, self._rows.shape[0])
        self._launch("add_doubts", size, *self._pairs(), LANES=lanes)
        lanes, size = 1 if self.device.is_cpu else 64, (8, self._rows.shape[0])
        arguments = self._sums, self._records, np.int32(self._parts)
        self._launch("add_parts", size, *arguments, LANES=lanes)
        return self._poses, self.read()

    def _pairs(self) -> tuple[cla.Array | np.generic, ...]:
        """The arguments of the kernels that sum over pairs."""
        numbers = np.int32(self._count), np.float32(self._weighting.scale), self._stretches
        return self._rows, self._records, self._sums, *numbers

    def _pair(self, reach: float) -> None:
        """Queue the pairs within reach, and their median gap if the reach is large enough to measure it."""
        weighting, poses = self._weighting, self._rows.shape[0]
        near = reach < weighting.measured
        lanes = 1 if self.device.is_cpu else 64
        arguments = *self._surfaces, self._records, self._rows, np.float32(reach), np.int32(near)
        self._launch("pairs", (padded(self._count), poses), *arguments, group=(GROUP, 1), LANES=lanes)
        if not near:
            arguments = self._rows, self._records, np.int32(self._count)
            self._launch("widths", (lanes, poses), *arguments, group=(lanes, 1), LANES=lanes)
