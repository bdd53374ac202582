"""Nearest neighbors on all cores: the same as SciPy's, and an interrupt is an interrupt."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from spectral.nearest import query_on_all_cores

ROOT = Path(__file__).parents[2]
INTERRUPTED = """
import os, signal, threading
import numpy as np
from scipy.spatial import KDTree
from spectral.nearest import query_on_all_cores

points = np.random.default_rng(1).random((200_000, 3))
tree = KDTree(points)
threading.Timer(0.05, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
try:
    for _ in range(100):
        query_on_all_cores(tree, points + 0.001, 8)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize(("k", "reach"), [(1, np.inf), (4, 0.2), ([3], np.inf)])
def test_it_is_scipys(k: Any, reach: float) -> None:
    rng = np.random.default_rng(2)
    tree, points = KDTree(rng.random((300, 3))), rng.random((50, 3))
    distance, index = query_on_all_cores(tree, points, k, reach)
    wanted = tree.query(points, k, distance_upper_bound=reach)
    np.testing.assert_array_equal(distance, wanted[0])
    np.testing.assert_array_equal(index, wanted[1])


def test_an_interrupt_is_raised_and_crashes_nothing() -> None:
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stdout.strip()) == (0, "interrupted"), ended.stderr
