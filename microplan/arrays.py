"""Types of arrays and points, as every package writes them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
ComplexArray = npt.NDArray[np.complex128]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]  # indices and counts
Point = tuple[float, float]  # (x, y)
Box = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max
