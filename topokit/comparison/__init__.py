"""Two solids compared: what matches, what is missing, what is spurious, and where."""
