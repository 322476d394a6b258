"""Archives of networks: pickles of more than tensors, machine code and tensors larger than their member are refused."""

from __future__ import annotations

import io
import json
import logging
import os
import pickle
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch
from intact_files import export_members, script_members
from splat_writers import zip_members

import topokit
from topokit.adapters.implicit.files import read_network
from topokit.errors import InputError, ReadError


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


def test_members_that_are_declared_pickles_are_refused_whatever_their_names(
    members: dict[str, bytes], tmp_path: Path
) -> None:
    """torch opens such a member without restriction; it finds members whatever the case of their names."""
    config, saved = member(members, "model_weights_config.json"), io.BytesIO()
    torch.save(RunsCode(tmp_path / "harm"), saved)
    entry = {"path_name": "weight_0", "is_param": True, "use_pickle": True, "tensor_meta": None}
    weight = config.replace("model_weights_config.json", "weight_0")
    changed = {config: json.dumps({"config": {"w": entry}}).encode(), weight: saved.getvalue()}
    with pytest.raises(ReadError, match=r"holds a pickled object .*model_weights_config"):
        read({**members, **changed}, tmp_path)
    upper = {weight.replace("weight_0", "MODEL.PT"): saved.getvalue()}
    with pytest.raises(ReadError, match="holds a pickle of more than tensors"):
        read({**members, **upper}, tmp_path)
    same = {weight.replace("weight_0", "A"): b"1", weight.replace("weight_0", "a"): b"2"}
    with pytest.raises(ReadError, match="two members of one name"):
        read({**members, **same}, tmp_path)
    assert not (tmp_path / "harm").exists()


def test_two_threads_that_open_networks_change_nothing_of_the_process(
    members: dict[str, bytes], tmp_path: Path
) -> None:
    (tmp_path / "net.pt2").write_bytes(zip_members(members))
    seen, done = set[str | None](), threading.Event()

    def watch() -> None:
        while not done.is_set():
            seen.add(os.environ.get("TORCH_FORCE_WEIGHTS_ONLY_LOAD"))

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        with ThreadPoolExecutor(2) as pool:
            opened = list(pool.map(lambda _: read_network(tmp_path / "net.pt2"), range(6)))
    finally:
        done.set()
        watcher.join()
    assert seen == {None}
    assert not logging.getLogger("torch.export").disabled
    assert not logging.getLogger("torch.export").filters
    assert all(network(torch.ones(7, 3)).shape == (7, 1) for network in opened)


def test_machine_code_and_doubled_members_are_refused(members: dict[str, bytes], tmp_path: Path) -> None:
    root = member(members, "archive_version").rpartition("archive_version")[0]
    with pytest.raises(ReadError, match="holds machine code"):
        read({**members, f"{root}data/aotinductor/model/model.so": b"\x7fELF"}, tmp_path)
    (tmp_path / "net.pt2").write_bytes(zip_members(members))
    with zipfile.ZipFile(tmp_path / "net.pt2", "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr(member(members, "model.json"), b"{}")
    with pytest.raises(ReadError, match="two members of one name"):
        read_network(tmp_path / "net.pt2")


@pytest.mark.parametrize("kept", [0, 20, 47])
def test_a_tensor_longer_than_its_member_is_refused(kept: int, tmp_path: Path) -> None:
    """torch.jit.load reads past the end of it; with no bytes at all it ends the process."""
    script = script_members()
    weights = member(script, "data/0")
    with pytest.raises(ReadError, match=f"should hold 48 bytes and holds {kept}"):
        read({**script, weights: script[weights][:kept]}, tmp_path)
    saved = io.BytesIO()
    torch.save((torch.ones(4, 3),), saved)
    with zipfile.ZipFile(saved) as inner:
        inputs = {name: inner.read(name) for name in inner.namelist()}
    inputs[member(inputs, "data/0")] = bytes(kept)
    exported = export_members()
    with pytest.raises(ReadError, match=f"sample_inputs.*should hold 48 bytes and holds {kept}"):
        read({**exported, member(exported, "sample_inputs/model.pt"): zip_members(inputs)}, tmp_path)


def test_a_tensor_beyond_its_storage_and_a_huge_memo_are_refused(tmp_path: Path) -> None:
    script = script_members()
    pickled = member(script, "data.pkl")
    long = script[pickled].replace(b"K\x00(K\x04K\x03t", b"K\x01(K\x04K\x03t")  # starts at element 1 of 12
    with pytest.raises(ReadError, match=r"a tensor of size \(4, 3\).*in 12 elements"):
        read({**script, pickled: long}, tmp_path)
    memo = script[pickled].replace(b"q\x00", b"r\xff\xff\xff\xff", 1)
    with pytest.raises(ReadError, match="a memo of 4294967295 objects"):
        read({**script, pickled: memo}, tmp_path)


def test_pickles_of_scripts_are_looked_at_without_being_run(tmp_path: Path) -> None:
    script = script_members()
    with pytest.raises(ReadError):
        read({**script, member(script, "data.pkl"): pickle.dumps(RunsCode(tmp_path / "harm"))}, tmp_path)
    assert not (tmp_path / "harm").exists()


def test_scripts_of_all_types_are_read(tmp_path: Path) -> None:
    class Holds(torch.nn.Module):
        """Buffers of many types, views of one storage, an empty one, lists and dictionaries."""

        def __init__(self) -> None:
            super().__init__()
            whole = torch.arange(24.0).reshape(4, 6)
            self.rows, self.columns, self.turned = whole[1:3], whole[:, 2::3], whole.t()
            self.several = [torch.ones(2, dtype=kind) for kind in (torch.bool, torch.int64, torch.float16)]
            self.named = {"double": torch.zeros(3, dtype=torch.complex128), "none": torch.empty(0, 3)}
            self.register_buffer("constant", torch.ones((), dtype=torch.bfloat16))

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            kept = self.rows.sum() + self.columns.sum() + self.turned[0, 0] + self.several[1].sum()
            return x.norm(2, 1) - 0.5 + 0 * (kept + self.named["none"].sum() + self.constant)

    torch.jit.save(torch.jit.script(Holds()), tmp_path / "net.pt")
    assert read_network(tmp_path / "net.pt")(torch.ones(7, 3)).shape == (7,)


def test_a_program_of_few_points_is_told_so(tmp_path: Path) -> None:
    class Ball(torch.nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return x.square().sum(1) - 0.25

    count = torch.export.Dim("count", min=2, max=100)
    for name, shapes in (("few.pt2", ({0: count},)), ("one.pt2", None)):
        torch.export.save(torch.export.export(Ball(), (torch.ones(7, 3),), dynamic_shapes=shapes), tmp_path / name)
        with pytest.raises(InputError, match=r"dynamic_shapes|cannot be called"):
            topokit.load(tmp_path / name, adapter="sdf").report()
