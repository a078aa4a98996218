"""Benchmarks for asv: pose a shape, and drag one handle."""

import numpy as np
import torch

import dfd

from .made_input import MOTIONS, MadeInput, make_input


def setup_cache() -> MadeInput:
    """Make the input once for all benchmarks."""
    return make_input()


class Pose:
    """Pose with 1 and 100 handles: without and with a mirror plane, and in a drag that moves one handle."""

    params = (MOTIONS, (1, 100), ("float32", "float64"))
    param_names = ("motion", "handles", "type")

    def setup(self, made: MadeInput, motion: str, handles: int, dtype: str) -> None:
        """Bind, and allocate the moved vertices."""
        self.call = made.pose(motion, handles, dtype)

    def time_pose(self, made: MadeInput, motion: str, handles: int, dtype: str) -> None:
        """Pose once."""
        self.call()


class PoseGradients:
    """Pose with gradients for the transforms, or also for the weights, with 1 and 100 handles."""

    params = ((False, True), (1, 100))
    param_names = ("weights", "handles")

    def setup(self, made: MadeInput, weights: bool, handles: int) -> None:
        """Make tensors that require gradients."""
        self.vertices = torch.from_numpy(made.vertices)
        bound = dfd.bind(made.compact, made.handles(handles)) / np.float32(handles)
        self.weights = torch.from_numpy(bound).requires_grad_(weights)
        self.transforms = torch.from_numpy(made.transforms[:handles].copy()).requires_grad_()

    def time_gradients(self, made: MadeInput, weights: bool, handles: int) -> None:
        """Pose once, and differentiate."""
        dfd.pose(self.vertices, self.weights, self.transforms).sum().backward()
