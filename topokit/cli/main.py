"""The command as it is installed: signals are taken care of before anything else is imported."""

from __future__ import annotations

from topokit.ending import end_on_signals


def main() -> None:
    """Run the command line."""
    end_on_signals()
    from topokit.cli.app import app

    app(prog_name="topokit")
