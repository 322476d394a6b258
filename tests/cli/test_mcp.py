"""The server for agents, asked by the official client in a process of its own."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import topokit as tk
from topokit.testing import genus_mesh, icosphere, torus_mesh


async def conversation(calls: list[tuple[str, dict[str, Any]]]) -> tuple[list[str], list[Any]]:
    """The tools of the server, and its answers: what is in them, or the text of an error."""
    mcp = pytest.importorskip("mcp", reason="the server needs the extra mcp")
    started = mcp.StdioServerParameters(command=sys.executable, args=["-m", "topokit", "mcp"])
    answers = []
    async with mcp.Client(started) as client:
        tools = [tool.name for tool in (await client.list_tools()).tools]
        for name, arguments in calls:
            given = await client.call_tool(name, arguments)
            answers.append(given.content[0].text if given.is_error else given.structured_content)
    return tools, answers


def test_an_agent_asks_about_files_and_mends_one(tmp_path: Path) -> None:
    vertices, faces = icosphere(2)
    torn = (vertices, faces[2:])
    for name, mesh in (("two", genus_mesh(2)), ("thin", torus_mesh(major=1, minor=0.1)), ("torn", torn)):
        trimesh.Trimesh(*mesh, process=False).export(tmp_path / f"{name}.off")
    volume = np.zeros((12, 12, 12))
    volume[2:10, 2:10, 2:10], volume[5:7, 5:7] = 9, 0
    np.save(tmp_path / "volume.npy", volume)
    volume[5:7, 5:7, 5:7] = 9
    np.save(tmp_path / "plugged.npy", volume)
    two, thin, open_file, volume_file, plugged = (
        str(tmp_path / name) for name in ("two.off", "thin.off", "torn.off", "volume.npy", "plugged.npy")
    )
    mended, filled = str(tmp_path / "mended.stl"), str(tmp_path / "filled.ply")
    tools, answers = asyncio.run(
        conversation(
            [
                ("report", {"path": two, "locate": True}),
                ("report", {"path": volume_file, "level": 4.5}),
                ("handles", {"path": two}),
                ("compare", {"path": plugged, "truth": volume_file, "level": 4.5}),
                ("compare", {"path": two, "truth": two}),
                ("mend", {"path": thin, "output": mended, "below": 1.0}),
                ("mend", {"path": open_file, "output": filled}),
                ("mend", {"path": open_file, "output": filled}),
                ("handles", {"path": two, "most": 1}),
                ("report", {"path": str(tmp_path / "missing.stl")}),
            ]
        )
    )
    assert tools == ["report", "handles", "mend", "compare"]
    report, solid, handles, comparison, itself, simplified, closed, *refused = answers
    assert (report["genus"], report["verdict"], report["closed"]) == (2, "certain", True)
    assert report["text"].count("around the tunnel") == 2
    assert (solid["pieces"], solid["tunnels"], solid["cavities"]) == (1, 1, 0)
    assert [set(one) for one in handles["result"]] == [{"handle_length", "tunnel_length", "center", "bounds"}] * 2
    assert (comparison["same"], comparison["missing"], comparison["betti_b"]) == (False, [0, 1, 0], [1, 1, 0])
    [filled_tunnel] = comparison["features"]
    x, y, z = filled_tunnel["center"]
    assert (filled_tunnel["kind"], x, y, 2 <= z <= 9) == ("filled tunnel", 5.5, 5.5, True)
    assert (itself["same"], itself["matched"], itself["features"]) == (True, [1, 2, 0], [])
    assert (simplified["before"]["genus"], simplified["after"]["genus"], tk.genus(mended)) == (1, 0, 0)
    assert (closed["before"]["closed"], closed["after"]["closed"], tk.report(filled).closed) == (False, True, True)
    for text, expected in zip(refused, ("a new file", "more than 1", "does not exist"), strict=True):
        assert expected in text
    assert json.dumps(answers)
