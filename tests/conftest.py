"""Shared fixtures: where the real data is, and a fixed seed for whoever draws."""

from __future__ import annotations

import locale
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

REAL_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(autouse=True)
def own_locale() -> Iterator[None]:
    """The locale is as it was, also after a test that has written a file by SimpleITK, which sets it to "C"."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(7)


@pytest.fixture(scope="module")
def dask_client() -> Iterator[Any]:
    """A client of two worker processes, for the tests of one file: idle ones take a tenth of a core."""
    pytest.importorskip("distributed")
    from topokit.batch.files_on_dask import connected

    with connected("local", 2) as client:
        yield client


@pytest.fixture(scope="session")
def real_data() -> Path:
    if not (REAL_DATA / "index.json").is_file():
        pytest.skip(f"the real shapes are not at {REAL_DATA}")
    return REAL_DATA
