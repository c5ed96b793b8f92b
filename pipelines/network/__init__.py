"""The networks, in torch: PointNet++ with PIFT, and the region detector."""

from pipelines.network.cpu.torchvision_start import import_torchvision

import_torchvision()  # before a module of this package does, which would take seconds longer
