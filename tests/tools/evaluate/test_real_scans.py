"""Real scans, where the folder of shared data lies beside the checkout: RGB-D fragments with truth, a real sonar."""

import json
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from typer.testing import CliRunner

from slam.map.crossing import crossing_error
from slam.mapper import Mapper, SurveyResult
from spectral.grid import Grid, choose_grid
from spectral.result import Registration
from spectral.scan import Scan
from tests.samples.structures import difference
from tools.cli.main import app
from tools.methods.registry import build
from tools.readers.poses.tum import read_tum
from tools.readers.scans import read_scans

SHARED = Path(__file__).parents[4] / "shared" / "data"
KITCHEN, SHIP = SHARED / "redkitchen", SHARED / "sonar3d15" / "ship_short.sonar"


def survey(out: Path, *inputs: Path) -> tuple[dict, list[RigidTransform]]:
    """The summary of `sonarmap map` and T_world_sensor of every scan."""
    result = CliRunner().invoke(app, ["map", *map(str, inputs), "-o", str(out), "--quiet"])
    assert result.exit_code == 0, result.output
    return json.loads((out / "summary.json").read_text()), list(read_tum(out / "trajectory.tum").T_world_sensor)


def registered(summary: dict) -> dict[tuple[int, int], RigidTransform]:
    """T_target_source of every pair, by its scans."""
    return {
        (row["target"], row["source"]): RigidTransform.from_matrix(np.array(row["T_target_source"]))
        for row in summary["pairs"]
    }


def true_transforms() -> dict[tuple[int, int], RigidTransform]:
    """gt.log: a line 'i j n' and the matrix that maps fragment j into fragment i."""
    rows = [line.split() for line in (KITCHEN / "gt.log").read_text().splitlines() if line.strip()]
    return {
        (int(head[0]), int(head[1])): RigidTransform.from_matrix(np.array(matrix, dtype=float))
        for head, *matrix in (rows[n : n + 5] for n in range(0, len(rows), 5))
    }


def registrations(*inputs: Path) -> tuple[tuple[Scan, ...], Grid, dict[tuple[int, int], Registration]]:
    """Every pair of the scans by the default method, with nothing but its defaults."""
    scans = read_scans(inputs).scans
    grid = choose_grid(scans)
    registrar = build("spectral", grid)
    prepared = [registrar.prepare(scan) for scan in scans]
    pairs = combinations(range(len(scans)), 2)
    return scans, grid, {(i, j): registrar.register(prepared[i], prepared[j]) for i, j in pairs}


def mapped(*inputs: Path) -> tuple[tuple[Scan, ...], float, SurveyResult]:
    """The scans as one survey with loops, by the default method, with nothing but its defaults; the voxel [m]."""
    scans = read_scans(inputs).scans
    grid = choose_grid(scans)
    return scans, grid.voxel, Mapper(build("spectral", grid), grid.voxel).run(scans)


def tell_pairs(result: SurveyResult) -> None:
    """Print what became of every pair."""
    for pair in result.pairs:
        print(f"{pair.i}, {pair.j} {pair.role}: {pair.residual:.2f} sigmas; {pair.reason}")


def crossings(scans: tuple[Scan, ...], voxel: float, result: SurveyResult) -> tuple[float, float]:
    """The median crossing error before the loops and after [m], every scan taken for a pass of its own; printed."""
    before, after = result.chained.T_world_sensor, result.trajectory.T_world_sensor
    error = crossing_error(scans, before, after, voxel, surveys=range(len(scans)))
    assert error.before is not None
    assert error.after is not None
    print(
        f"{len(error.crossings)} crossings: median {100 * error.before.median:.2f} cm before the loops, "
        f"{100 * error.after.median:.2f} after; 90 % within {100 * error.before.most:.2f} and "
        f"{100 * error.after.most:.2f}; the voxel is {100 * voxel:.2f}"
    )
    return error.before.median, error.after.median


@pytest.mark.skipif(not KITCHEN.is_dir(), reason="shared/data/redkitchen is not beside the checkout")
def test_kitchen_fragments_are_registered_as_the_truth_has_them() -> None:
    """All pairs within 3 degrees, and within a voxel at the middle of the source's points; all believed.

    The fragments lie 1 to 4 m before their origin, so that a degree moves the origin by a voxel or two.
    """
    scans, grid, found = registrations(*sorted(KITCHEN.glob("*.ply")))
    truth = true_transforms()
    for (i, j), registration in found.items():
        T = registration.T_target_source
        middle = scans[j].points.mean(axis=0)
        angle, origin = difference(T, truth[i, j])
        off = float(np.linalg.norm(T.apply(middle) - truth[i, j].apply(middle)))
        print(
            f"fragments {i}, {j}: {angle:.2f} degrees, {off / grid.voxel:.2f} voxels of {grid.voxel:.4f} m, "
            f"{origin / grid.voxel:.2f} at the origin; probability {registration.probability:.4f}"
        )
        assert registration.accepted
        assert angle < 3
        assert off < grid.voxel


@pytest.mark.skipif(not SHIP.is_file(), reason="shared/data/sonar3d15 is not beside the checkout")
def test_frames_of_a_sonar_agree_with_their_mean_chain(tmp_path: Path) -> None:
    """Each of the 15 pairs of six frames within 1 degree and 3 cm of what the optimized chain says; all believed."""
    _, _, found = registrations(SHIP)
    _, poses = survey(tmp_path, SHIP)
    differences = [difference(found[i, j].T_target_source, poses[i].inv() * poses[j]) for i, j in found]
    angle, distance = np.max(differences, axis=0)
    print(f"{len(differences)} pairs, at most {angle:.2f} degrees and {100 * distance:.1f} cm from the mean chain")
    assert all(registration.accepted for registration in found.values())
    assert len(differences) == 15
    assert angle < 1
    assert distance < 0.03


@pytest.mark.skipif(not KITCHEN.is_dir(), reason="shared/data/redkitchen is not beside the checkout")
def test_kitchen_fragments_come_out_as_the_truth_has_them(tmp_path: Path) -> None:
    """Within 6 degrees and 2 voxels, before the graph and after it."""
    summary, poses = survey(tmp_path, *sorted(KITCHEN.glob("*.ply")))
    voxel, truth = summary["settings"]["grid"]["voxel"], true_transforms()
    for i, j in pairwise(range(3)):
        for what, T in (("registered", registered(summary)[i, j]), ("optimized", poses[i].inv() * poses[j])):
            angle, distance = difference(T, truth[i, j])
            print(f"fragments {i}, {j} {what}: {angle:.2f} degrees, {distance / voxel:.2f} voxels of {voxel:.4f} m")
            assert angle < 6
            assert distance < 2 * voxel


@pytest.mark.skipif(not SHIP.is_file(), reason="shared/data/sonar3d15 is not beside the checkout")
def test_a_sonar_that_hardly_moves_is_told_to_hardly_move(tmp_path: Path) -> None:
    """Six frames within a second: steps under 3 degrees and 0.15 m, the whole way under 0.3 m."""
    summary, poses = survey(tmp_path, SHIP)
    assert len(poses) == 6
    steps = [registered(summary)[k, k + 1] for k in range(5)]
    chained = np.prod(np.array(steps, dtype=object))
    for k, step in enumerate(steps):
        angle, distance = difference(RigidTransform.identity(), step)
        print(f"frames {k}, {k + 1}: {angle:.2f} degrees, {distance:.3f} m")
        assert angle < 3
        assert distance < 0.15
    for what, whole in (("chained", chained), ("optimized", poses[0].inv() * poses[5])):
        angle, distance = difference(RigidTransform.identity(), whole)
        print(f"all six frames, {what}: {angle:.2f} degrees, {distance:.3f} m")
        assert distance < 0.3


@pytest.mark.skipif(not KITCHEN.is_dir(), reason="shared/data/redkitchen is not beside the checkout")
def test_the_kitchen_is_a_survey_whose_loop_is_found() -> None:
    """The loop of the first and last fragment is tried and kept; poses within 3 degrees, and a voxel at the points.

    The places are those of the middle of a fragment's points, in the frame of the first. The fragments are themselves
    put together from many images and bent, by more than covariances that were calibrated on single scans hold.
    """
    scans, voxel, result = mapped(*sorted(KITCHEN.glob("*.ply")))
    truth = true_transforms()
    tell_pairs(result)
    for what, poses in (("before the loop", result.chained), ("after it", result.trajectory)):
        for k in (1, 2):
            T, middle = poses.T_world_sensor[0].inv() * poses.T_world_sensor[k], scans[k].points.mean(axis=0)
            angle, _ = difference(T, truth[0, k])
            off = float(np.linalg.norm(T.apply(middle) - truth[0, k].apply(middle)))
            print(f"fragment {k}, {what}: {angle:.2f} degrees, {off / voxel:.2f} voxels of {voxel:.4f} m")
            assert angle < 3
            assert off < voxel
    loop = next(pair for pair in result.pairs if pair.role == "loop")
    assert (loop.i, loop.j) == (0, 2)
    assert loop.registration is not None
    assert loop.kept
    angle, _ = difference(loop.registration.T_target_source, truth[0, 2])
    print(f"the loop's own registration: {angle:.2f} degrees off")
    assert angle < 3
    assert all(pair.kept for pair in result.pairs if pair.role == "sequential")
    before, after = crossings(scans, voxel, result)
    assert after < max(1.1 * before, 0.5 * voxel)


@pytest.mark.skipif(not SHIP.is_file(), reason="shared/data/sonar3d15 is not beside the checkout")
def test_frames_of_a_sonar_are_a_survey_whose_loops_agree() -> None:
    """Six frames that show one place: every loop that is tried is kept, and no pass lies a voxel from another."""
    scans, voxel, result = mapped(SHIP)
    tell_pairs(result)
    loops = [pair for pair in result.pairs if pair.role == "loop"]
    assert len(result.components) == 1
    assert len(loops) >= 3
    assert all(pair.kept for pair in result.pairs)
    assert max(pair.residual for pair in result.pairs) < 4.74
    before, after = crossings(scans, voxel, result)
    assert after < max(1.1 * before, 0.5 * voxel)
