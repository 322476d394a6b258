"""Many files at once: finding them, examining each, in several processes if wanted, and what a set of them is like."""
