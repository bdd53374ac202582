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
SURVEYS = list(zip(SCENES, range(11, 31), strict=True))
KINDS, FIX = ("attitude", "heading", "depth", "position"), 0.5
DRAWS = 10
_MEDIAN = 0.67449  # of |x| / sigma of a normal distribution


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of K cells' depths and their stated 95 % uncertainties [m]."""

    total: np.ndarray
    tvu: np.ndarray
    poses: np.ndarray
    by_poses: np.ndarray
    rest: np.ndarray
    noise: np.ndarray

    @property
    def row(self) -> list[str]:
        pairs = ((self.total, self.tvu), (self.poses, self.by_poses), (self.rest, self.noise))
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


def errors_of(found: DepthCells, at_truth: DepthCells, scans: Path) -> Errors:
    """Errors of cells' depths; cells that the scene or the map at the true poses lacks are left out."""
    settings = read_settings(scans / "description.json")
    place = np.column_stack([found.column, found.row]) + found.low
    rays = np.column_stack([(place + 0.5) * found.cell, np.zeros(len(place))])
    depth, _ = build_scene(settings.scene, settings.seed).intersect(rays, np.tile([0.0, 0.0, -1.0], (len(rays), 1)))
    keys = (np.column_stack([at_truth.column, at_truth.row]) + at_truth.low).tolist()
    there = dict(zip(map(tuple, keys), at_truth.depth.tolist(), strict=True))
    moved = np.array([there.get(tuple(each), np.nan) for each in place.tolist()])
    usable = np.isfinite(depth) & np.isfinite(moved)
    by_poses = np.hypot(found.terms["poses"], found.terms["slope"])
    columns = (found.depth - depth, found.tvu, found.depth - moved, by_poses, moved - depth, found.terms["noise"])
    return Errors(*(column[usable] for column in columns))


def measured(folder: Path, draws: int) -> Iterator[tuple[str, Errors, list[Errors]]]:
    """Name, errors, and errors with newly drawn navigation, of each survey."""
    for scene, seed in SURVEYS:
        scans, mapped = made(folder, scene, seed)
        map_ = read_map_folder(mapped)
        every = read_tum(scans / "truth.tum").T_world_sensor
        members = list(map_.parts[0].scans)
        at_truth = depth_cells(at_poses(map_, every[members]), 1.0)
        graph = read_graph_json(mapped / "graph.json")
        drawn = []
        for draw in range(draws):
            priors = tuple(enumerate(measure_poses(every, instruments_for(KINDS, FIX), 1000 * seed + draw)))
            T = replace(graph, priors=priors).optimize(covariances=False).trajectory.T_world_sensor
            drawn.append(errors_of(depth_cells(at_poses(map_, T[members]), 1.0), at_truth, scans))
        yield f"{scene} {seed}", errors_of(depth_cells(map_, 1.0), at_truth, scans), drawn


def joined(errors: list[Errors]) -> Errors:
    names = Errors.__dataclass_fields__
    return Errors(*(np.concatenate([getattr(each, name) for each in errors]) for name in names))


def main(folder: Path, draws: int = DRAWS) -> None:
    names = ("survey", "cells", "TVU [m]", "depths within", "poses' part", "noise", "poses", "other navigation")
    print("|", " | ".join(names), "|")
    print("| --- " * 8 + "|")
    once: list[Errors] = []
    again: list[Errors] = []
    for name, errors, drawn in measured(folder, draws):
        once.append(errors)
        again += drawn
        print("|", " | ".join([name, *errors.row, joined(drawn).row[2] if drawn else ""]), "|", flush=True)
    for kind in ("beds", "all"):
        pick = [k for k, (scene, _) in enumerate(SURVEYS) if kind == "all" or scene != "rubble"]
        more = [each for k in pick for each in again[draws * k : draws * (k + 1)]]
        print("|", " | ".join([kind, *joined([once[k] for k in pick]).row, joined(more).row[2] if more else ""]), "|")
        if more:
            print("|", " | ".join([f"{kind}, other navigation", *joined(more).row, ""]), "|")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
