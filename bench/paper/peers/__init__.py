"""Methods that DFD is compared with, each in three steps: for the shape, for its handles, and for a pose.

ARAP and bounded biharmonic weights are libigl's. Biharmonic coordinates, OptCtrlPoints and NeuralMLS are written here
from their papers. All but ARAP and NeuralMLS work within tetrahedra. The networks of APAP and DeepMetaHandles cannot
be had.
"""

from __future__ import annotations

from collections.abc import Callable

from bench.paper.peers.biharmonic import Coordinates, OptCtrlPoints
from bench.paper.peers.libigl_peers import Arap, Bounded
from bench.paper.peers.neural_mls import NeuralMLS
from bench.paper.peers.peer import Peer

PEERS: dict[str, Callable[[], Peer]] = {
    "ARAP": Arap,
    "biharmonic": Coordinates,
    "BBW": Bounded,
    "NeuralMLS": NeuralMLS,
    "OptCtrlPoints": OptCtrlPoints,
}
