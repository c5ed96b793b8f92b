"""Types of arrays, named by their elements."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.floating]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

# For compiled loops, which take coordinates one by one.
Vector = tuple[float, float, float]
SingleVector = tuple[np.float32, np.float32, np.float32]
