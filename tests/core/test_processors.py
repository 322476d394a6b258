"""Cores: those of the affinity, and no more than a container's quota."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest

from topokit.core import processors
from topokit.core.processors import cpu_quota, n_cores


def system(root: Path, groups: str, files: dict[str, str]) -> Path:
    for name, text in {"proc/self/cgroup": groups, **files}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


V1 = "4:cpu,cpuacct:/docker/abc\n3:cpuset:/docker/abc\n1:name=systemd:/docker/abc\n"


@pytest.mark.parametrize(
    ("groups", "files", "quota"),
    [
        ("0::/\n", {"sys/fs/cgroup/cpu.max": "200000 100000\n"}, 2.0),
        ("0::/\n", {"sys/fs/cgroup/cpu.max": "max 100000\n"}, math.inf),
        ("0::/a.slice/b\n", {"sys/fs/cgroup/a.slice/cpu.max": "50000 100000\n"}, 0.5),  # the group above limits, too
        (
            "0::/a/b\n",
            {"sys/fs/cgroup/a/b/cpu.max": "400000 100000", "sys/fs/cgroup/a/cpu.max": "150000 100000"},
            1.5,
        ),
        (
            V1,  # in a container its group is mounted as the root
            {
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us": "300000\n",
                "sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us": "100000\n",
                "sys/fs/cgroup/cpuset/cpu.cfs_quota_us": "1\n",
            },
            3.0,
        ),
        (
            V1,
            {
                "sys/fs/cgroup/cpu,cpuacct/docker/abc/cpu.cfs_quota_us": "-1\n",
                "sys/fs/cgroup/cpu,cpuacct/docker/abc/cpu.cfs_period_us": "100000\n",
            },
            math.inf,
        ),
    ],
)
def test_quotas_of_control_groups(tmp_path: Path, groups: str, files: dict[str, str], quota: float) -> None:
    assert cpu_quota(system(tmp_path, groups, files)) == quota


def test_without_control_groups_there_is_no_quota(tmp_path: Path) -> None:
    assert cpu_quota(tmp_path) == math.inf


def test_cores_are_whole_and_at_least_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(96)), raising=False)
    for quota, cores in ((math.inf, 96), (2.0, 2), (1.5, 2), (0.1, 1), (200.0, 96)):
        monkeypatch.setattr(processors, "cpu_quota", lambda quota=quota: quota)
        assert n_cores() == cores
