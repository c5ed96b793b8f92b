"""Sources of a candidate symmetry: the network, the region's shape, or both."""

from pipelines.configs.planning import SymmetrySource

NETWORK, SHAPE = 1, 2  # bits
SOURCE_NAMES = ("", "network", "shape", "both")  # by the bits of a candidate's sources
SOURCE_BITS: dict[SymmetrySource, int] = {
    "network": NETWORK,
    "shape": SHAPE,
    "network+shape": NETWORK | SHAPE,
}
