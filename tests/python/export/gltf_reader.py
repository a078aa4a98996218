"""Read a GLB file with pygltflib, and pose it with NumPy in float64, without code of the exporter."""

import numpy as np
import pygltflib

COMPONENTS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    def __init__(self, path):
        self.file = pygltflib.GLTF2().load_binary(str(path))
        self.blob = self.file.binary_blob()

    def read(self, index):
        accessor = self.file.accessors[index]
        dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[accessor.type]
        if accessor.bufferView is None:
            return np.zeros((accessor.count, width), dtype)
        view = self.file.bufferViews[accessor.bufferView]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        stride = view.byteStride or dtype.itemsize * width
        return np.ndarray((accessor.count, width), dtype, self.blob, start, (stride, dtype.itemsize)).copy()

    def channels(self, name, seconds, interpolation="LINEAR"):
        """Return the values that the animation `name` sets at one of its keys, by node and path.

        With `interpolation` "CUBICSPLINE", `seconds` may also lie between keys.
        """
        found = {}
        for animation in self.file.animations:
            for channel in animation.channels if animation.name == name else ():
                sampler = animation.samplers[channel.sampler]
                assert sampler.interpolation == interpolation
                times = self.read(sampler.input)[:, 0]
                values = self.read(sampler.output).astype(float)
                if interpolation == "CUBICSPLINE":
                    found[channel.target.node, channel.target.path] = spline(times, values, seconds)
                    continue
                (key,) = np.flatnonzero(times == np.float32(seconds))
                found[channel.target.node, channel.target.path] = values.reshape(len(times), -1)[key]
        return found

    def world(self, animated=None):
        """Return the transforms (nodes, 4, 4) of the nodes to the scene's coordinates."""
        nodes = self.file.nodes
        matrices = [self._local(node, index, animated or {}) for index, node in enumerate(nodes)]
        waiting = [(np.eye(4), root) for root in self.file.scenes[self.file.scene or 0].nodes]
        world = np.full((len(nodes), 4, 4), np.nan)
        while waiting:
            parent, index = waiting.pop()
            world[index] = parent @ matrices[index]
            waiting += [(world[index], child) for child in nodes[index].children or []]
        return world

    def _local(self, node, index, animated):
        if node.matrix is not None:
            return np.array(node.matrix, float).reshape(4, 4).T
        x, y, z, w = animated.get((index, "rotation"), node.rotation or (0, 0, 0, 1))
        local = np.eye(4)
        local[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        local[:3, :3] *= np.array(animated.get((index, "scale"), node.scale or (1, 1, 1)))
        local[:3, 3] = animated.get((index, "translation"), node.translation or (0, 0, 0))
        return local

    def triangles(self, animated=None):
        """Return the corners (F, 3, 3) of all triangles, in the order of nodes, as a viewer shows them."""
        world = self.world(animated)
        return np.concatenate([
            self.shown(node, primitive, world, animated or {})[self.read(primitive.indices).reshape(-1, 3)]
            for node, primitive in self.primitives()
        ])  # fmt: skip

    def primitives(self):
        for index, node in enumerate(self.file.nodes):
            for primitive in () if node.mesh is None else self.file.meshes[node.mesh].primitives:
                yield index, primitive

    def shown(self, index, primitive, world, animated):
        """Return the shown vertices (rows, 3) of a primitive of a node."""
        node = self.file.nodes[index]
        points = self.read(primitive.attributes.POSITION).astype(float)
        weights = animated.get(
            (index, "weights"), getattr(node, "weights", None) or self.file.meshes[node.mesh].weights or []
        )
        for weight, target in zip(weights, primitive.targets or [], strict=True):
            points = points + weight * self.read(target["POSITION"])
        if node.skin is None:
            return points @ world[index][:3, :3].T + world[index][:3, 3]
        skin = self.file.skins[node.skin]
        binds = self.read(skin.inverseBindMatrices).astype(float).reshape(-1, 4, 4).transpose(0, 2, 1)
        matrices = world[skin.joints] @ binds
        joints, weights = self.influences(primitive)
        moved = np.einsum("jab,vb->vja", matrices[:, :3, :3], points) + matrices[:, :3, 3]
        return np.einsum("vk,vka->va", weights, np.take_along_axis(moved, joints[:, :, None].astype(int), axis=1))

    def influences(self, primitive):
        """Return the joints and weights (rows, K) of all sets of a primitive."""
        names = primitive.attributes.__dict__
        sets = sum(name.startswith("WEIGHTS_") and names[name] is not None for name in names)
        joints, weights = ([self.read(names[f"{kind}_{n}"]) for n in range(sets)] for kind in ("JOINTS", "WEIGHTS"))
        return np.concatenate(joints, axis=1), np.concatenate(weights, axis=1).astype(float)


def spline(times, values, seconds):
    """Return the value at a time by glTF's cubic Hermite spline: each key has a tangent, a value and a tangent."""
    before, at, after = values.reshape(len(times), 3, -1).transpose(1, 0, 2)
    key = min(int(np.searchsorted(times, np.float32(seconds), side="right")) - 1, len(times) - 2)
    span = float(times[key + 1] - times[key])
    t = (seconds - float(times[key])) / span
    found = (2 * t**3 - 3 * t**2 + 1) * at[key] + span * (t**3 - 2 * t**2 + t) * after[key]
    found += (-2 * t**3 + 3 * t**2) * at[key + 1] + span * (t**3 - t**2) * before[key + 1]
    return found / np.linalg.norm(found) if values.shape[-1] == 4 else found
