"""`python -m topokit` is the command `topokit`."""

from topokit.cli.main import main

if __name__ == "__main__":
    main()
