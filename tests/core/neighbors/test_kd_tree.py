"""The KD-tree: the same neighbors as SciPy's own threads, and no crash after an interrupt."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from topokit.core.neighbors.kd_tree import nearest_in_tree

INTERRUPTED = """
import os, signal, threading
import numpy as np
from scipy.spatial import cKDTree
from topokit.core.neighbors.kd_tree import nearest_in_tree
signal.signal(signal.SIGINT, signal.default_int_handler)
points = np.random.default_rng(0).random((120_000, 3))
tree = cKDTree(points)
for delay in (0.02, 0.05, 0.1):
    threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        while True:
            nearest_in_tree(tree, points, 20)
    except KeyboardInterrupt:
        junk = [np.ones((120_000, 20), dtype=np.int64) for _ in range(3)]  # takes the memory that was freed
        assert all((part == 1).all() for part in junk)
        assert all(thread is threading.main_thread() or "Timer" in thread.name for thread in threading.enumerate())
print("alive")
"""


@pytest.mark.parametrize(("n_points", "n_nearest"), [(1, 1), (100, 1), (100, 7), (20_000, 1), (20_000, 9)])
def test_the_same_neighbors_as_scipy(n_points: int, n_nearest: int) -> None:
    rng = np.random.default_rng(0)
    tree, positions = cKDTree(rng.random((500, 3))), rng.random((n_points, 3))
    found = nearest_in_tree(tree, positions, n_nearest)
    np.testing.assert_array_equal(found, tree.query(positions, n_nearest, workers=-1)[1])
    assert nearest_in_tree(tree, positions[:0], 3).shape == (0, 3)


@pytest.mark.skipif(sys.platform == "win32", reason="processes cannot be sent this signal")
def test_an_interrupt_leaves_no_thread_behind() -> None:
    ran = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stdout) == (0, "alive\n"), ran.stderr
