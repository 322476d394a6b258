"""Topology and curvature of 3D shapes, with a verdict on how far the answer may be believed.

Public names are imported when they are first used, so `import topokit` loads neither torch nor any reader. They are
listed in `__init__.pyi`, which type checkers read, too.
"""

from typing import Any

import lazy_loader

__version__ = "0.2.0"
_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


_OTHER_WORDS = {
    "BettiError": "compare(a, b).betti_error, or metrics.TopologyMetric",
    "curve": "load(path).euler_curve()",
    "fill_boundaries": "load(path).fill_boundaries()",
    "simplify_topology": "load(path).simplify(below=...)",
}


def __getattr__(name: str) -> Any:
    if name in __all__:
        return _attribute(name)
    from topokit.text import no_attribute

    message = no_attribute("topokit", name, __all__, _OTHER_WORDS)
    raise AttributeError(message, name=name, obj=None)  # Python would hint once more
