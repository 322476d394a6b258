"""The experiments behind docs/paper-tables.md, one subcommand of `benchmarks/paper_tables.py` per file."""
