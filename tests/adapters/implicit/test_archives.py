"""Archives of torch.export: pickles of more than tensors and machine code within them are refused."""

from __future__ import annotations

import io
import os
import pickle
from pathlib import Path

import pytest
import torch
from intact_files import export_members
from splat_writers import zip_members

from topokit.adapters.implicit.files import read_network
from topokit.errors import ReadError


class RunsCode:
    """Unpickling it makes a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> object:
        return os.mkdir, (str(self.folder),)


def member(members: dict[str, bytes], ending: str) -> str:
    return next(name for name in members if name.endswith(ending))


@pytest.fixture(scope="module")
def members() -> dict[str, bytes]:
    return export_members()


def read(members: dict[str, bytes], folder: Path) -> object:
    (folder / "net.pt2").write_bytes(zip_members(members))
    return read_network(folder / "net.pt2")


def test_an_intact_archive_is_read(members: dict[str, bytes], tmp_path: Path) -> None:
    network = read(members, tmp_path)
    assert network(torch.ones(7, 3)).shape == (7, 1)  # type: ignore[operator]
    assert "TORCH_FORCE_WEIGHTS_ONLY_LOAD" not in os.environ


def test_a_nested_pickle_is_not_run(members: dict[str, bytes], tmp_path: Path) -> None:
    harm, saved = RunsCode(tmp_path / "harm"), io.BytesIO()
    torch.save(harm, saved)
    inputs = member(members, "sample_inputs/model.pt")
    for content in (saved.getvalue(), pickle.dumps(harm)):
        with pytest.raises(ReadError, match="holds a pickle of more than tensors"):
            read({**members, inputs: content}, tmp_path)
    root = inputs.partition("data/")[0]
    for name in ("data/constants/opaque_obj_0", "data/constants/custom_obj_0"):
        with pytest.raises(ReadError, match="holds a pickled object"):
            read({**members, root + name: pickle.dumps(harm)}, tmp_path)
    assert not (tmp_path / "harm").exists()


def test_machine_code_and_doubled_members_are_refused(members: dict[str, bytes], tmp_path: Path) -> None:
    import zipfile

    root = member(members, "archive_version").rpartition("archive_version")[0]
    with pytest.raises(ReadError, match="holds machine code"):
        read({**members, f"{root}data/aotinductor/model/model.so": b"\x7fELF"}, tmp_path)
    (tmp_path / "net.pt2").write_bytes(zip_members(members))
    with zipfile.ZipFile(tmp_path / "net.pt2", "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr(member(members, "model.json"), b"{}")
    with pytest.raises(ReadError, match="two members of one name"):
        read_network(tmp_path / "net.pt2")
