"""`python -m topokit` is the command `topokit`."""

from topokit.cli.app import app

app(prog_name="topokit")
