"""Make the pictures of docs/concepts.md: shapes side by side, each above a line of its report.

python docs/pictures/make_concepts.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

import topokit as tk
from topokit.testing import genus_mesh, icosphere, torus_mesh, torus_samples
from topokit.testing.meshes import joined

FOLDER = Path(__file__).parent
SIDE, TEXT = 220, 50
Panel = tuple[str, tk.Shape]


def main() -> None:
    """Draw one picture for each concept."""
    ball, lid = icosphere(4), icosphere(4)[0][icosphere(4)[1]].mean(axis=1)[:, 2] < 0.3
    balls = joined(ball, (ball[0] * 0.6 + (2.2, 0, 0), ball[1]))
    surfaces = [ball, torus_mesh(), genus_mesh(2), balls, (ball[0], ball[1][lid])]
    draw(
        "concept-euler",
        [(f"Euler characteristic {tk.euler(tk.from_mesh(one))}", tk.from_mesh(one)) for one in surfaces],
    )
    clouds = [tk.from_points(torus_samples(n).points) for n in (100, 400, 4_000)]
    draw("concept-scale", [(f"{one.samples.n_points} points: {answer(one)}", one) for one in clouds])
    shapes = [tk.from_mesh(torus_mesh()), *(tk.from_points(torus_samples(n).points) for n in (6_000, 200))]
    kinds = ("mesh", "6000 points", "200 points")
    draw("concept-verdict", [(f"{kind}: {answer(one)}", one) for kind, one in zip(kinds, shapes, strict=True)])


def answer(shape: tk.Shape) -> str:
    """The integer and the verdict."""
    report = shape.report()
    return f"{report.euler} ({report.verdict})"


def draw(name: str, panels: Sequence[Panel]) -> None:
    """The shapes side by side with their lines below."""
    picture = Image.new("RGB", (SIDE * len(panels), SIDE + TEXT), "white")
    pen = ImageDraw.Draw(picture)
    for number, (line, shape) in enumerate(panels):
        print(f"{name}: {line}")
        picture.paste(shape.picture(SIDE, eye=(0.4, -1.0, 1.1)), (SIDE * number, 0))
        place = SIDE * number + SIDE // 2, SIDE + 10
        pen.text(place, line, fill="#21334f", font=ImageFont.load_default(16), anchor="ma")
    picture.save(FOLDER / f"{name}.webp", quality=80)


if __name__ == "__main__":
    main()
