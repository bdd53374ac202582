"""Nearest neighbors on all cores: the same as SciPy's, and an interrupt is an interrupt."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.tools.lab.baselines.result import query_on_all_cores
from tests.samples.places import ROOT

INTERRUPTED = """
import os, signal, threading
import numpy as np
from scipy.spatial import KDTree
from sonarmap.tools.lab.baselines.result import query_on_all_cores

# a shell that starts the tests in the background has them ignore interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)
rng = np.random.default_rng(1)
points = rng.random((POINTS, 3))
tree = KDTree(points)
interrupts = 0
for delay in rng.uniform(0, MOST, TIMES):
    try:
        threading.Timer(delay, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        while True:
            query_on_all_cores(tree, points + 0.001, 8)
    except KeyboardInterrupt:
        interrupts += 1
print(interrupts)
"""


@pytest.mark.parametrize(("k", "reach"), [(1, np.inf), (4, 0.2), ([3], np.inf)])
def test_it_is_scipys(k: Any, reach: float) -> None:
    rng = np.random.default_rng(2)
    tree, points = KDTree(rng.random((300, 3))), rng.random((50, 3))
    distance, index = query_on_all_cores(tree, points, k, reach)
    wanted = tree.query(points, k, distance_upper_bound=reach)
    np.testing.assert_array_equal(distance, wanted[0])
    np.testing.assert_array_equal(index, wanted[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "most", "times"),
    [
        pytest.param(200_000, 0.2, 5, id="in SciPy's threads"),
        pytest.param(20, 0.002, 200, id="as a thread starts"),
    ],
)
def test_an_interrupt_is_raised_and_neither_crashes_nor_hangs(points: int, most: float, times: int) -> None:
    values = {"POINTS": points, "MOST": most, "TIMES": times}
    program = "".join(f"{name} = {value}\n" for name, value in values.items()) + INTERRUPTED
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert (ended.returncode, ended.stdout.strip()) == (0, str(times)), ended.stderr
