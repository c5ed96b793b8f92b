"""Sources of a candidate symmetry: the network, the region's shape, or both, as bits."""

from pipelines.configs.planning import SymmetrySource

NETWORK, SHAPE = 1, 2
SOURCE_NAMES = ("", "network", "shape", "both")
BY_CANDIDATES: dict[SymmetrySource, int] = {
    "network": NETWORK,
    "shape": SHAPE,
    "network+shape": NETWORK | SHAPE,
}
