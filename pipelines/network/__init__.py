"""The networks, in torch: PointNet++ with PIFT, and the region detector."""
