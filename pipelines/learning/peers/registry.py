"""The compared methods that are trained, by name."""

from pipelines.errors import UnknownNameError
from pipelines.learning.peers.ggcnn_training import GG_CNN
from pipelines.learning.peers.graspnet_training import GRASPNET_BASELINE
from pipelines.learning.peers.multi_grasp_training import MULTI_GRASP
from pipelines.learning.peers.peer import Peer
from pipelines.learning.peers.pointnetgpd_training import POINTNETGPD
from pipelines.learning.peers.symmetrynet_training import SYMMETRYNET

TRAINED_PEERS: dict[str, Peer] = {
    "gg-cnn": GG_CNN,
    "multi-grasp": MULTI_GRASP,
    "pointnetgpd": POINTNETGPD,
    "graspnet": GRASPNET_BASELINE,
    "symmetrynet": SYMMETRYNET,
}


def trained_peer(name: str) -> Peer:
    """Return the compared method called `name`.

    Raises:
        UnknownNameError: there is none that is trained.
    """
    if name not in TRAINED_PEERS:
        raise UnknownNameError("compared method", name, TRAINED_PEERS)
    return TRAINED_PEERS[name]
