"""Point-to-plane refinement of several poses on the device: pairs of nearest points, normal equations, their solution.

The poses stay on the device between the steps. The host reads a `Record` of the last step, when it needs one.
"""

from dataclasses import astuple, dataclass
from functools import partial

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.arrays import Readback
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import launch
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.surface.cells import GROUP, Elements, padded

# Layout of a record, as in real.cl.
STATE = 15  # numbers of a state
SUMS = 16  # first of the sums
SUMS_COUNT = 208
DOUBTS = 272  # first of the doubts
NEXT = 280  # first of the next state
OFF = 296  # first of the instruments' residuals
ALONE = 302  # first of the step by the pairs alone
LENGTH = 308
TERM = 110  # numbers of the instruments' measurements


@dataclass(frozen=True, slots=True)
class Record:
    """State of k poses, the sums over their pairs, and the state after the step that these lead to; float64."""

    turn: np.ndarray  # (k, 3, 3) rotations R, and
    shift: np.ndarray  # (k, 3), p_target = R p_source + shift about the grid centers [voxels]
    width: np.ndarray  # (k,) median gap between the surfaces [voxels]
    stretch: np.ndarray  # (k, 2) stretches of the ranges of the source and of the target
    # (k, 8, 8) weighted sums of J^T J, with J the derivatives of a pair's gap by turn, shift and both stretches
    moving: np.ndarray  # of the pairs that move the pose
    whole: np.ndarray  # of all pairs
    shared: np.ndarray  # of all pairs, with one J by the other scan's normal (not symmetric)
    gradient: np.ndarray  # (k, 8) weighted sum of J times the gap, of the pairs that move the pose
    total: np.ndarray  # (k,) sum of the weights
    squares: np.ndarray  # (k,) weighted sum of the squared gaps
    doubts: np.ndarray  # (k, 6) sums of the squares of each pair's share of `shared` along the principal axes
    # the state after the step, by the pairs and the instruments
    next_turn: np.ndarray
    next_shift: np.ndarray
    next_stretch: np.ndarray
    off: np.ndarray  # (k, 6) residuals of instruments before the step, as in `Measured`
    alone: np.ndarray  # (k, 6) the step by the pairs alone, rotation first [rad, voxels]

    @classmethod
    def of(cls, rows: np.ndarray) -> "Record":
        """Records from rows (k, LENGTH) in the layout of real.cl."""
        rows = rows.astype(np.float64)
        moving, whole, shared = rows[:, SUMS : SUMS + 192].reshape(-1, 3, 8, 8).transpose(1, 0, 2, 3)
        state, following = rows[:, :STATE], rows[:, NEXT : NEXT + STATE]
        return cls(
            turn=state[:, :9].reshape(-1, 3, 3),
            shift=state[:, 9:12],
            width=state[:, 12],
            stretch=state[:, 13:],
            moving=moving,
            whole=whole,
            shared=shared,
            gradient=rows[:, SUMS + 192 : SUMS + 200],
            total=rows[:, SUMS + 200],
            squares=rows[:, SUMS + 201],
            doubts=rows[:, DOUBTS : DOUBTS + 6],
            next_turn=following[:, :9].reshape(-1, 3, 3),
            next_shift=following[:, 9:12],
            next_stretch=following[:, 13:],
            off=rows[:, OFF : OFF + 6],
            alone=rows[:, ALONE : ALONE + 6],
        )


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


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurements by instruments, linearized about k poses: at most 6 uncorrelated residuals of variance 1."""

    off: np.ndarray  # (k, 6) residuals, 0 beyond their number
    jacobian: np.ndarray  # (k, 6, 6) derivatives of the residuals, in rows, by turn and shift [1/rad, 1/voxels]
    systematic: np.ndarray  # (k, 6, 6) covariance of errors that all points of a scan share
    shortest: np.ndarray  # (k, 6, 6) in columns, the shortest step that makes each residual 1
    limits: tuple[float, float]  # chi-squared values from which and up to which scans get less weight

    def rows(self) -> np.ndarray:
        """(k, TERM) in the layout of real.cl."""
        matrices = np.stack([self.jacobian, self.systematic, self.shortest], axis=1).reshape(len(self.off), -1)
        return np.hstack([matrices, np.tile(self.limits, (len(self.off), 1))])


@dataclass(frozen=True, slots=True)
class LastStep:
    """Result of the last step of a refinement."""

    poses: cla.Array  # device (k, 16) float32, the poses after the step, as from `upload_poses`
    rows: Readback  # of a `Record`, on their way to the host

    def read(self) -> Record:
        return Record.of(self.rows.read())


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
        self._launch = partial(launch, device, FP64=int(self._real is np.float64))
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
        measured: Measured | None = None,
    ) -> None:
        """Set the state of k poses before the first step, and what instruments measured; arguments as in `Record`."""
        rows = np.zeros((len(shift), LENGTH))
        rows[:, :9], rows[:, 9:12], rows[:, 12] = turn.reshape(-1, 9), shift, width
        rows[:, 13:STATE] = 0 if stretch is None else stretch
        if measured is not None:
            rows[:, OFF : OFF + 6] = measured.off
        if not np.isfinite(rows).all():
            raise InputError(f"a pose to refine is not finite: rotations {turn.tolist()}, shifts {shift.tolist()}")
        self._measured = np.int32(measured is not None)
        terms = np.zeros((1, TERM)) if measured is None else measured.rows()
        self._take(*(self.device.to_device(array.astype(self._real)) for array in (rows, terms)))

    def begin_after(self, other: "Refinement") -> None:
        """Take over the poses of another refinement, on the device; the other one must not be used any more."""
        self._measured = other._measured
        self._take(other._records, other._terms)

    def _take(self, records: cla.Array, terms: cla.Array) -> None:
        poses = len(records)
        if not hasattr(self, "_rows") or self._rows.shape[0] != poses:
            self._rows = self.device.empty((poses, self._count, 16))
            self._sums = self.device.empty((poses, self._parts, SUMS_COUNT), self._real)
            self._poses = self.device.empty((poses, 16))
        self._records, self._terms = records, terms

    def step(self, reach: float, moves: bool = True) -> None:
        """Queue a step by the pairs within reach [voxels], and by the instruments. Unless it `moves` the poses, they
        stay, and `end` returns the sums and the step."""
        self._pair(reach)
        cpu, poses = self.device.is_cpu, self._rows.shape[0]
        group = (1 if cpu else 256, 1)
        size, arguments = (self._parts * group[0], poses), self._pairs()
        self._launch("surface/equations", "add_up", size, *arguments, group=group, LANES=group[0], PART=_PART)
        lanes = 1 if cpu else 64
        arguments = self._sums, self._records, self._terms, self._poses, np.int32(self._parts), np.int32(moves)
        numbers = self._measured, self._stretches, *self._noise
        self._launch("surface/solve", "solve", (lanes, poses), *arguments, *numbers, group=(lanes, 1), LANES=lanes)

    def end(self) -> "LastStep":
        """The result of the last step, which must not have moved the poses; its read is queued."""
        # the sums are added up by now: the doubts may overwrite them
        lanes, size = 1 if self.device.is_cpu else 256, (8 * self._parts, self._rows.shape[0])
        self._launch("surface/equations", "add_doubts", size, *self._pairs(), LANES=lanes, PART=_PART)
        lanes, size = 1 if self.device.is_cpu else 64, (8, self._rows.shape[0])
        arguments = self._sums, self._records, np.int32(self._parts)
        self._launch("surface/solve", "add_parts", size, *arguments, LANES=lanes)
        return LastStep(self._poses, Readback(self.device, self._records))

    def _pairs(self) -> tuple[cla.Array | np.generic, ...]:
        """The arguments of the kernels that sum over pairs."""
        numbers = np.int32(self._count), np.float32(self._weighting.scale), self._stretches
        return self._rows, self._records, self._sums, *numbers

    def _pair(self, reach: float) -> None:
        """Queue the pairs within reach, and their median gap if the reach is large enough to measure it."""
        weighting, poses = self._weighting, self._rows.shape[0]
        near = reach < weighting.measured
        lanes = 1 if self.device.is_cpu else 64
        defines = {
            "LANES": lanes,
            "BELL": float(weighting.bell),
            "WIDE_BELL": float(weighting.wide_bell),
            "BELLS": float(weighting.bells),
        }
        arguments = *self._surfaces, self._records, self._rows, np.float32(reach), np.int32(near)
        self._launch("surface/pairs", "pairs", (padded(self._count), poses), *arguments, group=(GROUP, 1), **defines)
        if not near:
            arguments = self._rows, self._records, np.int32(self._count)
            self._launch("surface/pairs", "widths", (lanes, poses), *arguments, group=(lanes, 1), **defines)
