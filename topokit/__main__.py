"""`python -m topokit` is the command `topokit`."""

from topokit.cli import app

app(prog_name="topokit")
