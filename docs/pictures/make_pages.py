"""Make page-table.webp and page-shape.webp: a page of several shapes in a headless Chromium, its table and one shape.

python docs/pictures/make_pages.py [PAGE NAME]     PAGE: one that exists, and the name of the shape to open in it
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from PIL import Image

import topokit as tk
from topokit.pages import Entry, page_of, write_html
from topokit.testing import genus_mesh, linked_tori_mesh, shell_mesh, torus_mesh, torus_samples

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "support"))


def main() -> None:
    """Write a page, open it, and keep two pictures of it."""
    from browser import opened_browser, page_in

    with tempfile.TemporaryDirectory() as folder:
        path, name = Path(folder) / "parts.html", "bracket.ply"
        if len(sys.argv) > 2:
            path, name = Path(sys.argv[1]).resolve(), sys.argv[2]
        else:
            write_html(map(entry, shapes()), path, title="Parts of the week")
        with opened_browser() as browser, page_in(browser, 1280, 800) as (page, complaints):
            page.goto(path.as_uri())
            page.wait_for_timeout(1_000)
            keep(page.screenshot(), "page-table")
            page.click(f"text={name}")
            page.wait_for_selector("#canvas[data-target]")
            page.locator("tr.place[data-mark]").nth(2).click()
            page.wait_for_timeout(2_000)
            keep(page.screenshot(), "page-shape")
        assert complaints == [], complaints


def shapes() -> Iterator[tk.Shape]:
    """What a week brings."""
    vertices, faces = torus_mesh(80, 40)
    axis = torch.linspace(-1, 1, 40)
    x, y, z = torch.meshgrid(axis, axis, axis, indexing="ij")
    yield tk.from_mesh(genus_mesh(4, resolution=24)).replace(name="bracket.ply")
    yield tk.from_mesh(vertices, faces[~np.isin(faces, (5, 6, 45, 46)).any(axis=1)]).replace(name="ring, torn.stl")
    yield tk.from_mesh(linked_tori_mesh(80, 40)).replace(name="chain.obj")
    yield tk.from_mesh(shell_mesh(4)).replace(name="hollow ball.off")
    yield tk.from_points(torus_samples(3_000).points).replace(name="scan.xyz")
    solid = torch.minimum(0.8 - torch.sqrt(x * x + y * y + z * z), torch.hypot(x, y) - 0.25)
    yield tk.from_voxels(solid, level=0.0).replace(name="organ.nii.gz")


def entry(shape: tk.Shape) -> Entry:
    """A shape as a row."""
    return Entry(shape.name, page_of(shape, shape.report(locate=True)))


def keep(screenshot: bytes, name: str) -> None:
    """Write a screenshot beside this script."""
    Image.open(io.BytesIO(screenshot)).convert("RGB").save(HERE / f"{name}.webp", quality=85)


if __name__ == "__main__":
    main()
