"""The result of a benchmark."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sonarmap.tools.lab.bench.machine import Machine
from sonarmap.tools.lab.bench.rates import Rates, Traffic
from sonarmap.tools.lab.bench.timing import Times

# Seconds per registration of the paper (Sect. 3: MATLAB, 2010), by voxels per edge.
PAPER_SECONDS = {128: 10.5, 256: 60.6}


@dataclass(frozen=True, slots=True)
class Launches:
    """What one run of a kernel's function asks of the device.

    Attributes:
        count: of kernels.
        reads: how often the host waits for the device within the run.
        kernels: the device's own time by kernel, the median of some runs [s]; nothing where it notes no times.
        passes: what some of them move.
    """

    count: int = 0
    reads: int = 0
    kernels: Mapping[str, float] = field(default_factory=dict[str, float])
    passes: Mapping[str, Traffic] = field(default_factory=dict[str, Traffic])

    @property
    def seconds(self) -> float | None:
        """The device's time of all [s]; None where it notes none."""
        return sum(self.kernels.values()) if self.kernels else None


@dataclass(frozen=True, slots=True)
class KernelResult:
    """One kernel beside its twin.

    Attributes:
        name, twin_name, edge: which kernel, what its twin is made of, N.
        device, twin: times of the two [s].
        traffic: what the algorithm must move.
        error: relative L2 difference of the two results.
        tolerance: the largest that is right.
        flops: operations of the algorithm; 0 where they do not matter.
        peers: times of other libraries, by their names [s].
        compile_seconds: building the programs, and what the first run took longer [s].
        launches: what one run asks of the device.
    """

    name: str
    twin_name: str
    edge: int
    device: Times
    twin: Times
    traffic: Traffic
    error: float
    tolerance: float
    flops: float = 0.0
    peers: Mapping[str, Times] = field(default_factory=dict[str, Times])
    compile_seconds: float = 0.0
    launches: Launches = field(default_factory=Launches)

    @property
    def ratio(self) -> float:
        """How many times as long the twin takes, by medians."""
        return self.twin.median / self.device.median

    @property
    def rate(self) -> float:
        """Bytes that must be moved over the median time [bytes/s]."""
        return self.traffic.moved / self.device.median

    @property
    def right(self) -> bool:
        """Whether the results agree; not where the error is NaN."""
        return self.error <= self.tolerance

    def share_of_limit(self, rates: Rates) -> float:
        """How much of its time the device's memory needs at its best."""
        return rates.least_seconds(self.traffic) / self.device.median


@dataclass(frozen=True, slots=True)
class StageResult:
    """One stage of a pair, per pair.

    Attributes:
        name: what it is called.
        calls: how often it runs.
        seconds: with the stages within it [s].
        own_seconds: without these, as all that follows [s].
        device_seconds: the device's own time [s].
        launches, reads, writes: kernels, how often the host waits for the device, transfers to it.
        array_bytes: of every array of every launch [bytes].
    """

    name: str
    calls: float
    seconds: float
    own_seconds: float
    device_seconds: float
    launches: float
    reads: float
    writes: float
    array_bytes: float


@dataclass(frozen=True, slots=True)
class PairResult:
    """Prepared pairs of simulated scans on one grid, in a process that did only this.

    Attributes:
        edge, voxel: the grid [voxels, m].
        prepare: times of preparing each scan [s].
        register: times of registering each pair of prepared scans [s].
        accepted: how many pairs the registration believed.
        right: how many are within 6 degrees and 3 voxels of the truth.
        peak_memory: of the whole process [bytes].
        first_seconds: opening the device, planning, and the first pair, with all that is compiled [s].
        device_memory: the most that all arrays on the device took together [bytes].
        planned_memory: what was reckoned with for these scans [bytes].
        stages: where the time of a pair goes, on a device that notes times.
    """

    edge: int
    voxel: float
    prepare: Times
    register: Times
    accepted: int
    right: int
    peak_memory: int
    first_seconds: float
    device_memory: int
    planned_memory: int
    stages: tuple[StageResult, ...]


@dataclass(frozen=True, slots=True)
class SurveyResult:
    """A simulated survey mapped by `sonarmap map`, in a process of its own.

    Attributes:
        scans, pairs: how many of each, the pairs that were tried.
        seconds: from reading the files to the last file written, without starting Python [s].
        prepared: how often a scan was prepared.
        stages: seconds of each on its own, by name [s].
        peak_memory: of the process [bytes].
    """

    scans: int
    pairs: int
    seconds: float
    prepared: int
    stages: Mapping[str, float]
    peak_memory: int


@dataclass(frozen=True, slots=True)
class BenchResult:
    """One run of the benchmark.

    Attributes:
        machine: where.
        seed, repeats: as asked for.
        rates: what the device's memory gives.
        load: load average before and after.
        kernels, pairs: the rows.
        survey: of a whole survey; None where none was asked for.
    """

    machine: Machine
    seed: int
    repeats: int
    rates: Rates
    load: tuple[float | None, float | None]
    kernels: tuple[KernelResult, ...]
    pairs: tuple[PairResult, ...]
    survey: SurveyResult | None = None

    @property
    def wrong(self) -> list[KernelResult]:
        """The kernels whose results are not their twins'."""
        return [kernel for kernel in self.kernels if not kernel.right]
