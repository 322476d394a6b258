"""From measurements to a report. `topokit.report(source)` calls the function of this name in `topokit.questions`.

Python binds this package to the name `topokit.report`, so the package itself can be called.
"""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    def __call__(self, source: Any, **options: Any) -> Any:
        from topokit import questions

        return questions.report(source, **options)


sys.modules[__name__].__class__ = _Callable
