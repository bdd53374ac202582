"""Point-to-plane refinement of several poses on the device: pairs of nearest points, normal equations, their solution.

The poses stay on the device between the steps. The host reads a `Record` of the last step, when it needs one.
"""

from dataclasses import dataclass
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
LENGTH = 296


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
    # the state after a step by the pairs alone
    next_turn: np.ndarray
    next_shift: np.ndarray
    next_stretch: np.ndarray

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
        )


def state_rows(turn: np.ndarray, shift: np.ndarray, width: np.ndarray, stretch: np.ndarray | None) -> np.ndarray:
    """First rows (k, LENGTH) float64, of rotations (k, 3, 3), shifts (k, 3), widths (k,), stretches (k, 2)."""
    rows = np.zeros((len(shift), LENGTH))
    rows[:, :9], rows[:, 9:12], rows[:, 12] = turn.reshape(-1, 9), shift, width
    rows[:, 13:STATE] = 0 if stretch is None else stretch
    if not np.isfinite(rows).all():
        raise InputError(f"a pose to refine is not finite: rotations {turn.tolist()}, shifts {shift.tolist()}")
    return rows


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
class Stretching:
    """Prior of the stretches: the variance of the gaps over that of a stretch is known * width^power."""

    known: float
    power: float
    narrowest: float  # least width in the formula


@dataclass(frozen=True, slots=True)
class LastStep:
    """Result of the last step of a refinement."""

    poses: cla.Array  # device (k, 16) float32, the poses after a step by the pairs alone, as from `upload_poses`
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
        stretching: Stretching | None,
    ) -> None:
        """Prepare steps with at most `most` points of each surface, evenly thinned; without `stretching` scans are
        rigid."""
        self.device, self._weighting, self._stretching = device, weighting, stretching
        self._real = np.float64 if "cl_khr_fp64" in device.cl_device.extensions else np.float32
        self._launch = partial(launch, device, FP64=int(self._real is np.float64))
        self._surfaces: list[cla.Array | np.generic] = []
        for surface in (target, source):
            count, step = surface.thinned(most)
            self._surfaces += [*surface.cells.arguments, surface.rows, np.int32(count), np.int32(step)]
        self._count = target.thinned(most)[0] + source.thinned(most)[0]
        self._parts = -(-self._count // _PART)

    def begin(self, turn: np.ndarray, shift: np.ndarray, width: np.ndarray, stretch: np.ndarray | None) -> None:
        """Set the state of k poses before the first step; arguments as in `Record`."""
        rows = state_rows(turn, shift, width, stretch)
        self._take(self.device.to_device(rows.astype(self._real)))

    def begin_after(self, other: "Refinement") -> None:
        """Take over the poses of another refinement, on the device; the other one must not be used any more."""
        self._take(other._records)

    def _take(self, records: cla.Array) -> None:
        poses = len(records)
        if not hasattr(self, "_rows") or self._rows.shape[0] != poses:
            self._rows = self.device.empty((poses, self._count, 16))
            self._sums = self.device.empty((poses, self._parts, SUMS_COUNT), self._real)
            self._poses = self.device.empty((poses, 16))
        self._records = records

    def step(self, reach: float, alone: bool) -> None:
        """Queue a step by the pairs within reach [voxels]. With `alone` the poses move by the pairs' solution; else
        they stay, and `end` returns the sums and the solution, for a caller with further information."""
        self._pair(reach)
        count, stretches = np.int32(self._count), np.int32(self._stretching is not None)
        cpu, poses = self.device.is_cpu, self._rows.shape[0]
        group = (1 if cpu else 256, 1)
        size = (self._parts * group[0], poses)
        arguments = self._rows, self._records, self._sums, count, np.float32(self._weighting.scale), stretches
        self._launch("surface/equations", "add_up", size, *arguments, group=group, LANES=group[0], PART=_PART)
        known = self._stretching or Stretching(0.0, 0.0, 1.0)
        numbers = [self._real(value) for value in (known.known, known.power, known.narrowest)]
        lanes = 1 if cpu else 64
        arguments = self._sums, self._records, self._poses, np.int32(self._parts), np.int32(alone), stretches, *numbers
        self._launch("surface/solve", "solve", (lanes, poses), *arguments, group=(lanes, 1), LANES=lanes)

    def record(self) -> Record:
        """The record of the last step, without the doubts; waits for the device."""
        return Record.of(Readback(self.device, self._records).read())

    def end(self) -> "LastStep":
        """The result of the last step, which must not have moved the poses; its read is queued."""
        poses, stretches = self._rows.shape[0], np.int32(self._stretching is not None)
        count, parts = np.int32(self._count), np.int32(self._parts)
        # the sums are added up by now: the doubts may overwrite them
        arguments = self._rows, self._records, self._sums, count, np.float32(self._weighting.scale), stretches
        lanes = 1 if self.device.is_cpu else 256
        self._launch("surface/equations", "add_doubts", (8 * self._parts, poses), *arguments, LANES=lanes, PART=_PART)
        lanes = 1 if self.device.is_cpu else 64
        self._launch("surface/solve", "add_parts", (8, poses), self._sums, self._records, parts, LANES=lanes)
        return LastStep(self._poses, Readback(self.device, self._records))

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
