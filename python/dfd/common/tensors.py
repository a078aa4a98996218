"""Convert torch tensors to NumPy arrays that share their memory, and back. This module never imports torch."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import ArgumentError


def is_tensor(value: Any) -> bool:
    """Return whether `value` is a torch tensor."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def tracked(*values: Any) -> bool:
    """Return whether torch records gradients for at least one of `values`, or a transform of `torch.func` uses one."""
    torch = sys.modules.get("torch")
    if torch is None:
        return False
    records, wrapped = torch.is_grad_enabled(), torch._C._functorch.is_functorch_wrapped_tensor
    given = [value for value in values if isinstance(value, torch.Tensor)]
    return any((records and value.requires_grad) or wrapped(value) for value in given)


def shared(function: str | None, name: str, value: Any) -> Any:
    """Return `value`, or a NumPy array that shares its memory if `value` is a torch tensor on the CPU.

    NumPy has no bfloat16, so a tensor of this type gives a new array of float32.

    Raises ValueError if `value` is a masked array, a tensor on another device, or a tensor of a type that NumPy lacks.
    """
    if type(value) is np.ndarray:
        return value
    if isinstance(value, np.ma.MaskedArray):
        raise ArgumentError(name, "must not be a masked array: fill or remove the masked values", function)
    if not is_tensor(value):
        return value
    if value.device.type != "cpu":
        raise ArgumentError(name, f"must be on the CPU, got a tensor on {value.device}", function)
    if value.dtype is sys.modules["torch"].bfloat16:
        value = value.float()
    try:
        return value.detach().resolve_conj().resolve_neg().numpy()
    except (TypeError, RuntimeError, NotImplementedError):
        raise ArgumentError(name, f"must be a dense array of numbers, got {value.dtype}", function) from None


def output(
    function: str,
    out: Any,
    shape: tuple[int, ...],
    dtype: Any,
    inputs: dict[str, NDArray[Any] | None],
    *,
    columns: bool = False,
) -> NDArray[Any]:
    """Return `out` as a NumPy array that shares its memory, and to which a kernel can write.

    With `columns`, it is enough that either the rows or the columns are contiguous. Raises ValueError if `out` is no
    writable contiguous array of `shape` and `dtype`, requires a gradient, or shares memory with one of the `inputs`.
    """
    if is_tensor(out) and out.requires_grad:
        raise ArgumentError("out", "must not require a gradient", function)
    array = shared(function, "out", out)
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
        found = f"{array.shape} and {array.dtype.name}" if isinstance(array, np.ndarray) else type(out).__name__
        wanted = f"shape {shape} and type {np.dtype(dtype).name}"
        raise ArgumentError("out", f"must be an array of {wanted}, got {found}", function)
    flags = array.flags
    if columns and not lines_contiguous(array):
        raise ArgumentError("out", "must have contiguous rows or columns", function)
    if not (columns or flags.c_contiguous) or not flags.writeable or not flags.aligned:
        raise ArgumentError("out", f"must be {'' if columns else 'C-contiguous and '}writable", function)
    for name, other in inputs.items():
        if other is not None and np.may_share_memory(array, other):
            raise ArgumentError("out", f"must not overlap `{name}`: inputs are not changed", function)
    return array


def lines_contiguous(array: NDArray[Any]) -> bool:
    """Return whether a matrix is aligned, and either its rows or its columns are contiguous and do not overlap."""
    flags = array.flags
    if flags.c_contiguous or flags.f_contiguous:
        return flags.aligned
    rows, columns = array.shape
    if rows == 1:
        return False
    down, beside = (stride // array.itemsize for stride in array.strides)
    by_rows = (beside == 1 or columns <= 1) and (down >= columns or rows <= 1)
    by_columns = (down == 1 or rows <= 1) and (beside >= rows or columns <= 1)
    return flags.aligned and (by_rows or by_columns)


def like(value: Any, result: NDArray[Any]) -> Any:
    """Return `result`. If `value` is a torch tensor, return a torch tensor that shares the memory of `result`."""
    return sys.modules["torch"].from_numpy(result) if is_tensor(value) else result
