"""How often the depths of simulated surveys are within their stated TVU.

`python -m tests.tools.products.accept.measured FOLDER [DRAWS]` simulates and maps the surveys in FOLDER (those that are
there already are kept) and prints a table.

The error of a cell's depth is that from the true surface below its center. Its part by the poses is the difference of
the depths with every scan's points at its estimated and at its true pose; the rest is noise and shape. "Other
navigation" is the same survey with new errors of its navigation, DRAWS times: the graph is optimized again, and the
points follow their scans.
"""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.files.map_folder.folder import Map, read_map_folder
from sonarmap.tools.files.readers.trajectory import read_graph_json, read_tum
from sonarmap.tools.lab.simulate.folder import read_settings
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.navigation import instruments_for, measure_poses
from sonarmap.tools.products.accept.cells import VERTICAL, DepthCells, depth_cells

SCENES = (
    *("shallow", "sandflat", "rubble", "shallow", "rubble", "sandflat", "shallow", "rubble", "shallow", "sandflat"),
    *("shallow", "rubble", "shallow", "sandflat", "rubble", "shallow", "rubble", "sandflat", "shallow", "rubble"),
)
SURVEYS = list(zip(SCENES, range(2401, 2421), strict=True))
KINDS, FIX = ("attitude", "heading", "depth", "position"), 0.5
DRAWS = 10
_MEDIAN = 0.67449  # of |x| / sigma of a normal distribution


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of K cells' depths and of M points' positions, each with its stated 95 % uncertainty [m]."""

    total: np.ndarray
    tvu: np.ndarray
    poses: np.ndarray
    by_poses: np.ndarray
    rest: np.ndarray
    noise: np.ndarray
    shift: np.ndarray
    thu: np.ndarray

    @property
    def row(self) -> list[str]:
        pairs = ((self.total, self.tvu), (self.poses, self.by_poses), (self.rest, self.noise), (self.shift, self.thu))
        shares = [f"{100 * (np.abs(error) <= stated).mean():.1f} %" for error, stated in pairs]
        ratio = np.median(np.abs(self.poses) / self.by_poses) * VERTICAL / _MEDIAN
        return [f"{len(self.tvu)}", f"{np.median(self.tvu):.3f}", *shares, f"{ratio:.2f}"]


def made(folder: Path, scene: str, seed: int) -> tuple[Path, Path]:
    """The folders of a survey and of its map."""
    scans, mapped = folder / f"s_{scene}_{seed}", folder / f"m_{scene}_{seed}"
    if not (mapped / "summary.json").exists():
        call = [sys.executable, "-m", "sonarmap"]
        route = ["--scene", scene, "--trajectory", "lawnmower", "--scans", "16", "--seed", str(seed)]
        priors = ["--priors", ",".join(KINDS), "--fix-sigma", str(FIX)]
        subprocess.run([*call, "simulate", "-q", *route, *priors, "-o", str(scans)], check=True)
        grid = ["--priors", str(scans / "priors.csv"), "--grid", "64", "--no-report"]
        subprocess.run([*call, "map", "-q", str(scans), *grid, "-o", str(mapped)], check=False)
    return scans, mapped


def at_poses(folder: Map, T_world_sensor: RigidTransform) -> Map:
    """The map with every point moved with its main scan to these poses."""
    part = folder.parts[0]
    k = np.searchsorted(part.scans, part.columns["scan"])
    points = (T_world_sensor * part.trajectory.T_world_sensor.inv())[k].apply(part.points)
    trajectory = replace(part.trajectory, T_world_sensor=T_world_sensor)
    return replace(folder, parts=(replace(part, points=points, trajectory=trajectory),))


def errors_of(map_: Map, truth: RigidTransform, scans: Path) -> Errors:
    """Errors of a map whose scans are truly at `truth`; cells that the scene or the map there lacks are left out."""
    found, there = depth_cells(map_, 1.0), depth_cells(at_poses(map_, truth), 1.0)
    settings, places, points = read_settings(scans / "description.json"), place_of(found), map_.parts[0].points
    rays = np.column_stack([places + 0.5, np.zeros(len(places))])
    depth, _ = build_scene(settings.scene, settings.seed).intersect(rays, np.tile([0.0, 0.0, -1.0], (len(rays), 1)))
    moved = looked_up(places, place_of(there), there.depth)
    usable = np.isfinite(depth) & np.isfinite(moved)
    by_poses = np.hypot(found.terms["poses"], found.terms["slope"])
    columns = (found.depth - depth, found.tvu, found.depth - moved, by_poses, moved - depth, found.terms["noise"])
    shift = np.linalg.norm((at_poses(map_, truth).parts[0].points - points)[:, :2], axis=1)
    thu = looked_up(np.floor(points[:, :2]), places, found.thu)
    inside = np.isfinite(thu)
    return Errors(*(column[usable] for column in columns), shift=shift[inside], thu=thu[inside])


def place_of(cells: DepthCells) -> np.ndarray:
    """(K, 2) lower left corners [m] of cells of 1 m."""
    return (np.column_stack([cells.column, cells.row]) + cells.low).astype(np.float64)


def looked_up(places: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(N,) values of the cells at places (N, 2), from the values (K,) of the cells at places (K, 2); NaN without."""
    table = dict(zip(map(tuple, known.tolist()), values.tolist(), strict=True))
    return np.array([table.get(tuple(place), np.nan) for place in places.tolist()])


def measured(folder: Path, draws: int) -> Iterator[tuple[str, Errors, list[Errors]]]:
    """Name, errors, and errors with newly drawn navigation, of each survey."""
    for scene, seed in SURVEYS:
        scans, mapped = made(folder, scene, seed)
        map_ = read_map_folder(mapped)
        every = read_tum(scans / "truth.tum").T_world_sensor
        truth = every[list(map_.parts[0].scans)]
        graph = read_graph_json(mapped / "graph.json")
        drawn = []
        for draw in range(draws):
            priors = tuple(enumerate(measure_poses(every, instruments_for(KINDS, FIX), 1000 * seed + draw)))
            T = replace(graph, priors=priors).optimize(covariances=False).trajectory.T_world_sensor
            drawn.append(errors_of(at_poses(map_, T[list(map_.parts[0].scans)]), truth, scans))
        yield f"{scene} {seed}", errors_of(map_, truth, scans), drawn


def joined(errors: list[Errors]) -> Errors:
    names = Errors.__dataclass_fields__
    return Errors(*(np.concatenate([getattr(each, name) for each in errors]) for name in names))


def main(folder: Path, draws: int = DRAWS) -> None:
    within = ("depths within", "poses' part", "noise", "positions")
    names = ("survey", "cells", "TVU [m]", *within, "error of poses / stated", "other navigation")
    print("|", " | ".join(names), "|")
    print("| --- " * len(names) + "|")
    once: list[Errors] = []
    again: list[Errors] = []
    for name, errors, drawn in measured(folder, draws):
        once.append(errors)
        again += drawn
        print("|", " | ".join([name, *errors.row, joined(drawn).row[2] if drawn else ""]), "|", flush=True)
    for kind in ("beds", "rubble", "all"):
        pick = [k for k, (scene, _) in enumerate(SURVEYS) if kind == "all" or (kind == "rubble") == (scene == "rubble")]
        more = [each for k in pick for each in again[draws * k : draws * (k + 1)]]
        print("|", " | ".join([kind, *joined([once[k] for k in pick]).row, joined(more).row[2] if more else ""]), "|")
        if more:
            print("|", " | ".join([f"{kind}, other navigation", *joined(more).row, ""]), "|")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
