"""`python -m topokit` is the command `topokit`."""

from topokit.cli.app import app

if __name__ == "__main__":
    app(prog_name="topokit")
