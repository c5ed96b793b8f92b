"""The networks, in torch: PointNet++ with PIFT, and the region detector."""

from pipelines.network.cpu.torchvision_start import import_torchvision

import_torchvision()  # first of all: a module of this package would import it seconds slower
