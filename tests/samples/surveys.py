"""Small surveys with known poses, a registrar that knows them, and registrations and loops that are wrong."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.decide.measurements import Measurements
from sonarmap.slam.graph.edge import Edge, Kind
from sonarmap.slam.graph.pose_graph import PoseGraph
from sonarmap.slam.graph.trajectory import chain
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan


def random_transforms(rng: np.random.Generator, count: int, angle: float = 1.0, length: float = 5.0) -> RigidTransform:
    """`count` transforms with tangents of about `angle` [rad] and `length` [m]."""
    xi = rng.normal(size=(count, 6)) * np.repeat([angle, length], 3)
    return RigidTransform.from_exp_coords(xi)


def random_covariance(rng: np.random.Generator, rotation: float = 0.01, translation: float = 0.1) -> np.ndarray:
    """(6, 6), full, asymmetric in every direction, with about these standard deviations [rad, m]."""
    root = np.eye(6) + 0.4 * rng.normal(size=(6, 6))
    scale = np.repeat([rotation, translation], 3) * np.array([1.0, 0.7, 1.4, 1.2, 0.5, 0.9])
    return scale[:, None] * (root @ root.T) * scale


def registration(T: RigidTransform, covariance: np.ndarray, accepted: bool = True) -> Registration:
    return Registration(T, covariance, psr=30.0, overlap=0.6, accepted=accepted, seconds=0.01, reason="as told")


def edge(i: int, j: int, T: RigidTransform, covariance: np.ndarray, kind: Kind = "sequential") -> Edge:
    return Edge(i, j, registration(T, covariance), kind)


def drawn(rng: np.random.Generator, covariance: np.ndarray, count: int | None = None) -> RigidTransform:
    """A random error with this covariance, or `count` of them."""
    return RigidTransform.from_exp_coords(rng.multivariate_normal(np.zeros(6), covariance, count))


def measured_edge(rng: np.random.Generator, T: RigidTransform, i: int, j: int, covariance: np.ndarray) -> Edge:
    """An edge between two poses with a random error of this covariance."""
    kind: Kind = "sequential" if j == i + 1 else "loop"
    return edge(i, j, T[i].inv() * T[j] * drawn(rng, covariance), covariance, kind)


def chain_edges(T: RigidTransform, covariance: np.ndarray, errors: RigidTransform | None = None) -> list[Edge]:
    """Edges from each pose to the next, exact or with these errors."""
    steps = T[:-1].inv() * T[1:]
    return [edge(k, k + 1, step, covariance) for k, step in enumerate(steps if errors is None else steps * errors)]


def chained_graph(edges: Sequence[Edge], count: int) -> PoseGraph:
    """A graph whose poses are chained from its first edges, a second apart."""
    return PoseGraph(chain(edges, np.arange(float(count))), tuple(edges))


def position_error(T: RigidTransform, truth: RigidTransform) -> float:
    """Root mean square of the distances between positions [m]."""
    return float(np.sqrt(((T.translation - truth.translation) ** 2).sum(axis=1).mean()))


def from_the_first(T: RigidTransform) -> RigidTransform:
    return T[0].inv() * T


def distance(one: RigidTransform, other: RigidTransform) -> float:
    """Root mean square of the distances between positions, the first poses laid on each other [m]."""
    return position_error(from_the_first(one), from_the_first(other))


def step_pair(k: int, T: RigidTransform, covariance: np.ndarray, accepted: bool = True) -> RegisteredPair:
    """The registered pair of scans k and k + 1."""
    return RegisteredPair(k, k + 1, "sequential", registration=registration(T, covariance, accepted))


def ring_poses(count: int, radius: float = 10.0, turns: float = 1.0) -> RigidTransform:
    """Poses around a circle, looking along it, with a little roll and pitch; the first is the identity."""
    angle = np.linspace(0, 2 * np.pi * turns, count, endpoint=False)
    R = Rotation.from_euler("ZYX", np.stack([angle, 0.1 * np.sin(angle), 0.05 * np.cos(3 * angle)], axis=1))
    t = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.5 * np.sin(2 * angle)], axis=1)
    return from_the_first(RigidTransform.from_components(t, R))


def scans_of(T_world_sensor: RigidTransform, reach: float = 6.0, seed: int = 0) -> list[Scan]:
    """What a sensor with this reach [m] sees of a rough floor from these poses; named scan0, scan1, ..."""
    rng = np.random.default_rng(seed)
    spread = np.abs(T_world_sensor.translation).max() + reach
    world = rng.uniform(-spread, spread, (30_000, 3)) * [1, 1, 0]
    world[:, 2] = -2 + 0.3 * np.sin(world[:, 0]) * np.cos(0.7 * world[:, 1])
    scans: list[Scan] = []
    for k, T in enumerate(T_world_sensor):
        near = world[np.linalg.norm(world - T.translation, axis=1) < reach]
        scans.append(Scan(T.inv().apply(near).astype(np.float32), stamp=100.0 + k, name=f"scan{k}"))
    return scans


def measurements_of(count: int) -> Measurements:
    """Measurements of scans without priors, a second apart."""
    scans = tuple(Scan(np.zeros((1, 3), np.float32), stamp=float(k)) for k in range(count))
    return Measurements(scans, np.zeros(count, np.intp))


class KnowingRegistrar:
    """Returns the true transform between scan0, scan1, ... with noise of the covariance that it states; counts its
    calls. `spoil` gives another registration instead, or raises; `broken` scans cannot be prepared."""

    def __init__(
        self,
        T_world_sensor: RigidTransform,
        covariance: np.ndarray,
        spoil: Callable[[int, int, Registration], Registration] | None = None,
        broken: tuple[str, ...] = (),
        seed: int = 1,
    ) -> None:
        self.truth, self.covariance = T_world_sensor, covariance
        self.spoil, self.broken, self.seed = spoil, broken, seed
        self.prepared: Counter[str] = Counter()
        self.alive = self.most_alive = 0
        self.pairs: list[tuple[int, int]] = []

    def prepare(self, scan: Scan) -> "_Prepared":
        if scan.name in self.broken:
            raise InputError(f"{scan.name}: it is of no use; drop it")
        self.prepared[scan.name] += 1
        return _Prepared(self, int(scan.name.removeprefix("scan")))

    def register(self, target: "_Prepared", source: "_Prepared") -> Registration:
        i, j = target.index, source.index
        self.pairs.append((i, j))
        # Seeded per pair, so that a pair gives the same result in every run, whatever the order of calls.
        rng = np.random.default_rng([self.seed, i, j])
        noise = drawn(rng, self.covariance)
        given = registration(self.truth[i].inv() * self.truth[j] * noise.inv(), self.covariance)
        return self.spoil(i, j, given) if self.spoil else given


class _Prepared:
    def __init__(self, registrar: KnowingRegistrar, index: int) -> None:
        self.registrar, self.index = registrar, index
        registrar.alive += 1
        registrar.most_alive = max(registrar.most_alive, registrar.alive)

    def __del__(self) -> None:
        self.registrar.alive -= 1


FAR = 10.0  # least residual of a wrong loop [sigmas]
GROUP = 20  # consecutive poses with a loop to the same aliased place


def scattered(graph: PoseGraph, T: RigidTransform, count: int, seed: int) -> tuple[Edge, ...]:
    """Wrong loops between random poses, each with the transform and covariance of a loop of the graph; a pair whose
    transform happens to fit the true poses T is drawn again."""
    rng = np.random.default_rng(seed)
    loops, poses = [one for one in graph.edges if one.kind == "loop"], len(graph.trajectory)
    wrong: list[Edge] = []
    while len(wrong) < count:
        i, j = sorted(rng.choice(poses, 2, replace=False).tolist())
        model = loops[rng.integers(len(loops))].registration
        error = (model.T_target_source.inv() * T[i].inv() * T[j]).as_exp_coords()
        if j - i > 2 and error @ np.linalg.solve(model.covariance, error) > FAR**2:
            wrong.append(edge(i, j, model.T_target_source, model.covariance, "loop"))
    return tuple(wrong)


def aliased(graph: PoseGraph, T: RigidTransform, count: int, seed: int) -> tuple[Edge, ...]:
    """Wrong loops of consecutive poses that all mistake another place for theirs, at the same wrong offset. With the
    true poses T, the loops of a group agree up to the noise of their covariances, which are of loops of the graph."""
    rng = np.random.default_rng(seed)
    loops, poses = [one for one in graph.edges if one.kind == "loop"], len(graph.trajectory)
    wrong: list[Edge] = []
    while len(wrong) < count:
        a, b = sorted(rng.choice(poses - GROUP, 2, replace=False).tolist())
        if b - a <= GROUP:
            continue
        model = loops[rng.integers(len(loops))].registration
        offset = T[a] * model.T_target_source * T[b].inv()
        for k in range(min(GROUP, count - len(wrong))):
            measured = T[a + k].inv() * offset * T[b + k] * drawn(rng, model.covariance)
            wrong.append(edge(a + k, b + k, measured, model.covariance, "loop"))
    return tuple(wrong)
