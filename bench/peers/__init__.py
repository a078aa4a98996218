"""Peers: the deformation methods that DFD is compared with.

ARAP and bounded biharmonic weights (BBW) come from libigl. The other methods are implemented here from their papers.
"""

from bench.peers.biharmonic import coordinates, opt_ctrl_points
from bench.peers.libigl_peers import arap, bounded
from bench.peers.neural_mls import neural_mls
from bench.peers.peer import Peer

PEERS = {
    "ARAP": Peer(arap),
    "biharmonic": Peer(coordinates, volume=True),
    "BBW": Peer(bounded, volume=True),
    "NeuralMLS": Peer(neural_mls),
    "OptCtrlPoints": Peer(opt_ctrl_points, volume=True),
}
