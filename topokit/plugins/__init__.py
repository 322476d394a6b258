"""The adapter interface, the registry, and the choice of an adapter for a source.

Plug-ins need `reading`, which turns what damaged data raises into a `ReadError`, and `head`, the first bytes of a file.
"""

from topokit.inputs.files import head
from topokit.inputs.reading import reading

__all__ = ["head", "reading"]
