"""One representation per file: each turns its input into a Shape."""
