"""A published topology corrector on one volume, beside `enforce`: that of nighres, by fast marching.

    pip download --no-deps --no-binary :all: nighres==1.2.0 && tar xzf nighres-1.2.0.tar.gz
    python -m benchmarks.corrector FILE.npz nighres-1.2.0

It needs Java 11 or newer. The Java class of the source archive is called as `nighres.shape.topology_correction` does:
the Python package itself needs NumPy 1.16.

Reference:
    P.-L. Bazin, D. L. Pham, "Topology correction of segmented medical images using a fast marching algorithm",
    Computer Methods and Programs in Biomedicine 88, 2007, doi:10.1016/j.cmpb.2007.08.006.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import topokit as tk
from topokit.core.grid.betti import betti_numbers

_MARGIN = 2  # layers of background around the volume
_WAYS = {
    "object->background": "26/6",
    "background->object": "6/26",
}  # and the connectivity of what grows, and of the rest


def corrected(
    solid: NDArray[np.bool_], spacing: list[float], way: str, nighres: Path
) -> tuple[NDArray[np.bool_], float]:
    """What nighres makes of a 26-connected solid, and its CPU seconds, the start of Java among them."""
    jars = os.pathsep.join(map(str, sorted((nighres / "nighresjava").glob("*.jar"))))
    tables = str(nighres / "nighres" / "atlases" / "topology_lut") + os.sep
    padded = np.pad(solid, _MARGIN)
    with tempfile.TemporaryDirectory() as name:
        source, result = Path(name) / "source.raw", Path(name) / "result.raw"
        padded.astype("<f4").ravel(order="F").tofile(source)
        program = ["java", "-XX:+UseSerialGC", "-cp", jars, str(Path(__file__).with_name("TopologyCorrection.java"))]
        given = [source, result, *padded.shape, *spacing, _WAYS[way], way, tables]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([*program, *map(str, given)], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = np.fromfile(result, "<i4").reshape(padded.shape, order="F") > 0
    inner = (slice(_MARGIN, -_MARGIN),) * 3
    return found[inner], after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def told(name: str, solid: NDArray[np.bool_], before: NDArray[np.bool_], seconds: float) -> str:
    betti = tuple(betti_numbers(solid).tolist())
    return f"{name}: {betti}, {(solid != before).sum()} voxels changed, {seconds:.1f} CPU s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", help='volume, an .npz with "vol" and "spacing"')
    parser.add_argument("nighres", type=Path, help="folder of its source archive")
    given = parser.parse_args()
    with np.load(given.path) as archive:
        solid, spacing = archive["vol"] > 0, np.broadcast_to(archive["spacing"], 3).astype(float).tolist()
    print(told("before", solid, solid, 0.0))
    for way in _WAYS:
        found, seconds = corrected(solid, spacing, way, given.nighres)
        print(told(f"nighres, {way}", found, solid, seconds))
    for change in ("any", "remove", "add"):
        begin = time.process_time()
        try:
            made = tk.enforce(solid, spacing=spacing, change=change)
        except tk.InputError as error:
            print(f"enforce, {change}: {error}")
        else:
            print(told(f"enforce, {change}", made, solid, time.process_time() - begin))


if __name__ == "__main__":
    main()
