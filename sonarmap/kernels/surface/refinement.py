"""Point-to-plane steps of several poses on the device: pairs of nearest points, normal equations, and their solution.

Nothing comes back between the steps, unless the caller takes them: a `Record` is read when it is wanted, and where the
poses are is known on the device before.
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

# A row of numbers as real.cl has it.
STATE = 15  # numbers of a state
SUMS = 16  # where the sums begin
SUMS_COUNT = 208
DOUBTS = 272  # where they begin
NEXT = 280  # where the next state begins
LENGTH = 296


@dataclass(frozen=True, slots=True)
class Record:
    """Where k poses are, the sums of the last step there, and where it leads; float64."""

    turn: np.ndarray  # (k, 3, 3) and
    shift: np.ndarray  # (k, 3), p_target = R p_source + shift about the grid centers [voxels]
    width: np.ndarray  # (k,) how far the surfaces usually are apart [voxels]
    stretch: np.ndarray  # (k, 2) of the source and of the target
    # moving, whole, shared: (k, 8, 8) sums of the weights times the gaps' derivatives, by turn, shift and stretches: of
    # the pairs that move the pose, of all, and with one scan's normals times the other's (not symmetric)
    moving: np.ndarray
    whole: np.ndarray
    shared: np.ndarray
    gradient: np.ndarray  # (k, 8) of the pairs that move the pose, times the gaps
    # total, squares: (k,) of the weights, and times the squared gaps
    total: np.ndarray
    squares: np.ndarray
    doubts: np.ndarray  # (k, 6) sums of the squares of what each pair adds to `shared` along the principal axes
    # next_turn, next_shift, next_stretch: where the step leads, if the pairs alone decide
    next_turn: np.ndarray
    next_shift: np.ndarray
    next_stretch: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray) -> "Record":
        """From rows (k, LENGTH) as real.cl has them."""
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
    """Rows (k, LENGTH) float64 to begin with, of rotations (k, 3, 3), shifts (k, 3), widths (k,), stretches (k, 2)."""
    rows = np.zeros((len(shift), LENGTH))
    rows[:, :9], rows[:, 9:12], rows[:, 12] = turn.reshape(-1, 9), shift, width
    rows[:, 13:STATE] = 0 if stretch is None else stretch
    if not np.isfinite(rows).all():
        raise InputError(f"a pose to refine is not finite: rotations {turn.tolist()}, shifts {shift.tolist()}")
    return rows


_PART = 128  # pairs of a work-item of a processor, or of a group elsewhere


@dataclass(frozen=True, slots=True)
class Weighting:
    # The width of the weights' bell is the larger of two.
    bell: float  # share of how far apart points may be
    wide_bell: float  # share of how far the surfaces usually are apart
    bells: float  # points as many widths of the bell apart as this no longer count
    # least reach at which how far the surfaces usually are apart is measured; below it rims do not move the pose
    measured: float
    scale: float = 1.0  # weight of each pair


@dataclass(frozen=True, slots=True)
class Stretching:
    """What is known of the stretches before: their inverse variance by that of the gaps is known * width^power."""

    # known, power: as above
    known: float
    power: float
    narrowest: float  # no width is less


@dataclass(frozen=True, slots=True)
class LastStep:
    """What the last step of a refinement says."""

    poses: cla.Array  # device (k, 16) float32, where it leads if the pairs alone decide, as `upload_poses` has them
    rows: Readback  # a `Record` of the poses, on its way to the host

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
        """What all steps share: at most `most` points of each surface, evenly; no stretching where scans are taken as
        they are."""
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
        """Put the k poses where the next step begins; as `Record` has them."""
        rows = state_rows(turn, shift, width, stretch)
        self._take(self.device.to_device(rows.astype(self._real)))

    def begin_after(self, other: "Refinement") -> None:
        """Go on where the poses of another refinement are, which ends; nothing comes back between the two."""
        self._take(other._records)

    def _take(self, records: cla.Array) -> None:
        poses = len(records)
        if not hasattr(self, "_rows") or self._rows.shape[0] != poses:
            self._rows = self.device.empty((poses, self._count, 16))
            self._sums = self.device.empty((poses, self._parts, SUMS_COUNT), self._real)
            self._poses = self.device.empty((poses, 16))
        self._records = records

    def step(self, reach: float, alone: bool) -> None:
        """A step: the pairs within reach [voxels], and what they say. `alone`: the poses move on as the pairs say; else
        they stay, for `end` and whoever knows more."""
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

    def end(self) -> "LastStep":
        """What the last step says, which did not move the poses; nothing is read yet."""
        poses, stretches = self._rows.shape[0], np.int32(self._stretching is not None)
        count, parts = np.int32(self._count), np.int32(self._parts)
        # the sums are folded by now: their memory is free for the doubts
        arguments = self._rows, self._records, self._sums, count, np.float32(self._weighting.scale), stretches
        lanes = 1 if self.device.is_cpu else 256
        self._launch("surface/equations", "add_doubts", (8 * self._parts, poses), *arguments, LANES=lanes, PART=_PART)
        lanes = 1 if self.device.is_cpu else 64
        self._launch("surface/solve", "add_parts", (8, poses), self._sums, self._records, parts, LANES=lanes)
        return LastStep(self._poses, Readback(self.device, self._records))

    def _pair(self, reach: float) -> None:
        """The pairs within reach; and how far apart they usually are, where that can be measured."""
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
