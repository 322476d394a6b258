"""Topology and curvature of 3D shapes, with a verdict on how far the answer may be believed.

Public names are imported when they are first used, so `import topokit` loads neither torch nor any reader. They are
listed in `__init__.pyi`, which type checkers read, too.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
