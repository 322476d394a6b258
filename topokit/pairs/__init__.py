"""Two sources compared, label by label, and folders whose files are matched by name."""
