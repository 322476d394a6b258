"""One folder per representation; adapters never import each other."""
