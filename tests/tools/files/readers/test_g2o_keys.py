"""Graphs of other programs: 64-bit keys, priors of single poses, byte-order marks, decimal commas."""

from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.readers.g2o import read_g2o, require_connected
from sonarmap.tools.files.writers.poses import rewrite_g2o
from tests.samples.clutter_scans import printed, sonarmap
from tests.samples.damage.pose_files import GTSAM, SYMBOL
from tests.samples.refusals import refuses

LETTERS = {letter: ord(letter) << 56 for letter in "ab"}


def put(folder: Path, text: str) -> Path:
    path = folder / "graph.g2o"
    path.write_text(text, encoding="utf-8")
    return path


def test_symbols_are_kept_exactly(tmp_path: Path) -> None:
    path = put(tmp_path, GTSAM)
    graph = read_g2o(path)
    assert [(edge.i, edge.j, edge.kind) for edge in graph.edges] == [(0, 1, "sequential"), (1, 2, "sequential")]
    np.testing.assert_array_equal(graph.trajectory.stamps, [0.0, 1, 2])
    np.testing.assert_allclose(graph.trajectory.T_world_sensor.translation[:, 0], [0, 1.5, 3])
    (known,) = graph.known
    assert (known.pose, known.T_world_pose.translation[0]) == (1, 1.5)
    rewrite_g2o(tmp_path / "out.g2o", path, graph.trajectory, left_out={0})
    lines = (tmp_path / "out.g2o").read_text().splitlines()
    assert [line.split()[1] for line in lines[:3]] == [str(SYMBOL + k) for k in range(3)]
    assert [line.split()[:3] for line in lines[3:4]] == [["EDGE_SE3:QUAT", str(SYMBOL + 1), str(SYMBOL + 2)]]


def test_symbols_of_several_letters_are_counted(tmp_path: Path) -> None:
    text = GTSAM
    for k, key in enumerate((LETTERS["b"] + 7, LETTERS["a"] + 7, LETTERS["b"] + 8)):
        text = text.replace(str(SYMBOL + k), str(key))
    graph = read_g2o(put(tmp_path, text))
    np.testing.assert_array_equal(graph.trajectory.stamps, [0.0, 1, 2])
    np.testing.assert_allclose(graph.trajectory.T_world_sensor.translation[:, 0], [1.5, 0, 3])  # a7, b7, b8


def test_a_prior_of_a_single_pose_moves_the_graph(tmp_path: Path) -> None:
    put(tmp_path, GTSAM.replace(f"PRIOR:QUAT {SYMBOL + 1} 1.5 2 ", f"PRIOR:QUAT {SYMBOL + 1} 11.5 2 "))
    printed(sonarmap("optimize", tmp_path / "graph.g2o", "-o", tmp_path / "out.g2o", "--json"))
    assert read_g2o(tmp_path / "out.g2o").trajectory.T_world_sensor.translation[1, 0] == pytest.approx(11.5, abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (f"QUAT {SYMBOL + 2} ", f"QUAT {SYMBOL + 1} ", "line 3 gives vertex x1 again, after 2"),
        (f"QUAT {SYMBOL} {SYMBOL + 1} ", f"QUAT {SYMBOL} {SYMBOL + 9} ", "names vertex x9, which the file does not"),
        (f"QUAT {SYMBOL} {SYMBOL + 1} ", f"QUAT {10**20} {SYMBOL + 1} ", "wanted id within 1e"),
        (f"QUAT {SYMBOL} {SYMBOL + 1} ", f"QUAT 0.5 {SYMBOL + 1} ", "vertex ids are whole numbers"),
        (f"QUAT {SYMBOL} 0.0", f"QUAT {SYMBOL} 0,0", "'0,0' is not a number; write its decimal comma as a point"),
    ],
)
def test_faults_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GTSAM
    refuses(words, read_g2o, put(tmp_path, GTSAM.replace(old, new)))


def test_parts_are_named_by_their_symbols(tmp_path: Path) -> None:
    lines = [line for line in GTSAM.splitlines(keepends=True) if not line.startswith(f"EDGE_SE3:QUAT {SYMBOL} ")]
    path = put(tmp_path, "".join(lines))
    refuses("line 2: no edges join vertex x1 to vertex x0", require_connected, path, read_g2o(path))
