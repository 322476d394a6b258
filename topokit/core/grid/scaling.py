"""Fields in single precision, whatever their size."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_RANGE = 1e30  # squares of its ends do not leave double precision, sums and differences not single precision


def in_single_precision(values: NDArray[Any]) -> NDArray[np.float32]:
    """Finite values times the power of two that brings their median size to about 1; each keeps its sign.

    Sizes beyond 10³⁰ or below 10⁻³⁰ become that. The level set of zero stays where it is.
    """
    sizes = np.abs(values, dtype=np.result_type(values, np.float32))
    exponent = int(np.frexp(np.median(sizes[sizes > 0]))[1]) if sizes.any() else 0
    np.clip(np.ldexp(sizes, -exponent, out=sizes), 1 / _RANGE, _RANGE, out=sizes)
    return (np.sign(values) * sizes).astype(np.float32)
