"""The option --device of the benchmarks: where torch works. What works on the CPU alone is skipped elsewhere."""

from __future__ import annotations

import pytest
import torch


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", type=torch.device, help="where torch works: cpu, cuda, cuda:1")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Function]) -> None:
    chosen = config.getoption("--device")
    if chosen.type == "cpu":
        return
    for item in items:
        if "device" not in item.fixturenames:
            item.add_marker(pytest.mark.skip(reason=f"works on the CPU alone, not on {chosen}"))


@pytest.fixture
def device(request: pytest.FixtureRequest) -> torch.device:
    """Where torch works."""
    chosen: torch.device = request.config.getoption("--device")
    torch.zeros(1, device=chosen)  # an error of torch's own where there is none
    return chosen
