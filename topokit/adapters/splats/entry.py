"""How Gaussian splats are recognised, without importing what reads them."""

from __future__ import annotations

from pathlib import Path

from topokit.inputs.files import file_of_folder, head
from topokit.plugins.adapter import Adapter


class Splats(Adapter):
    """Gaussian splats; see `topokit.from_splats`."""

    name = "splats"
    description = "Gaussian splats; for .sog also its unzipped folder"
    suffixes = (".ply", ".splat", ".spz", ".sog", ".ksplat")
    types = ("topokit.adapters.splats.gaussians.GaussianSplats",)
    extra = "topokit[splats]"
    suffix_requires = ((".sog", "PIL"),)
    differentiable = True
    opener = "topokit.adapters.splats.adapter:from_splats"

    def can_open(self, source: Path) -> bool:
        from topokit.adapters.splats.formats.choose import reader_by_content

        path = file_of_folder(source)
        return path.is_file() and reader_by_content(path, head(path)) is not None
