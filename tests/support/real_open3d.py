"""open3d itself, for tests that compare with it."""

from __future__ import annotations

from typing import Any

import pytest


def open3d_or_skip() -> Any:
    """The module; skips where it is not installed, or the system libraries that it loads are missing."""
    try:
        import open3d
    except (ImportError, OSError) as error:
        pytest.skip(f"open3d cannot be loaded ({error}); make test installs it", allow_module_level=True)
    return open3d
