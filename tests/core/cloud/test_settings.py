"""Every setting says its unit, its meaning and its source, and there are not too many."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest

from topokit.core.cloud.settings import CloudSettings

GROUPS = {group.name: getattr(CloudSettings(), group.name) for group in dataclasses.fields(CloudSettings)}


def numbers() -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    for name, group in GROUPS.items():
        for one in dataclasses.fields(group):
            yield f"{name}.{one.name}", one, getattr(group, one.name)


def test_each_has_a_unit_a_meaning_and_a_source() -> None:
    for name, one, _ in numbers():
        assert set(one.metadata) == {"unit", "meaning", "source"}, name
        assert all(isinstance(text, str) and text.strip() for text in one.metadata.values()), name


def test_there_are_not_too_many() -> None:
    assert len(list(numbers())) <= 80


@pytest.mark.parametrize("name", GROUPS)
def test_they_cannot_be_changed_for_all(name: str) -> None:
    group = GROUPS[name]
    hash(group)
    field = dataclasses.fields(group)[0].name
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(group, field, 1)


def test_numbers_are_positive_but_for_cosines() -> None:
    for name, one, value in numbers():
        if isinstance(value, int | float) and one.metadata["unit"] != "cosine":
            assert value > 0, name
        if one.metadata["unit"] == "cosine":
            assert -1 < value < 1, name
        if one.metadata["unit"].startswith("share"):
            assert 0 < value < 1, name
