"""Shared fixtures: where the real data is, and a fixed seed for whoever draws."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

REAL_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def generator() -> torch.Generator:
    return torch.Generator().manual_seed(7)


@pytest.fixture(scope="session")
def real_data() -> Path:
    if not (REAL_DATA / "index.json").is_file():
        pytest.skip(f"the real shapes are not at {REAL_DATA}")
    return REAL_DATA
