"""The compared methods that are trained, by name."""

from pipelines.errors import UnknownNameError
from pipelines.learning.peers.ggcnn_training import GGCNNTraining
from pipelines.learning.peers.graspnet_training import GraspNetTraining
from pipelines.learning.peers.multi_grasp_training import MultiGraspTraining
from pipelines.learning.peers.peer import PeerTraining
from pipelines.learning.peers.pointnetgpd_training import PointNetGPDTraining
from pipelines.learning.peers.symmetrynet_training import SymmetryNetTraining

TRAINED_PEERS: dict[str, type[PeerTraining]] = {
    "gg-cnn": GGCNNTraining,
    "multi-grasp": MultiGraspTraining,
    "pointnetgpd": PointNetGPDTraining,
    "graspnet": GraspNetTraining,
    "symmetrynet": SymmetryNetTraining,
}


def trained_peer(name: str) -> type[PeerTraining]:
    """Return the compared method called `name`.

    Raises:
        UnknownNameError: no trained method has this name.
    """
    if name not in TRAINED_PEERS:
        raise UnknownNameError("compared method", name, TRAINED_PEERS)
    return TRAINED_PEERS[name]
