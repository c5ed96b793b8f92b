"""Types of pictures: RGB images and their colours."""

import numpy as np
from numpy.typing import NDArray

ColorImage = NDArray[np.uint8]  # (H, W, 3) RGB
Color = tuple[int, int, int]  # RGB, 0 to 255
