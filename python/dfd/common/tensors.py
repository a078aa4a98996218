"""Convert torch tensors to NumPy arrays that share their memory, and back. This module never imports torch."""

import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import ArgumentError


def is_tensor(value: Any) -> bool:
    """Return whether `value` is a torch tensor."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def tracked(*values: Any) -> bool:
    """Return whether torch records gradients for one of `values`, or a transform of `torch.func` uses one.

    This includes the tensors in lists and tuples.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        return False
    records, wrapped = torch.is_grad_enabled(), torch._C._functorch.is_functorch_wrapped_tensor

    def is_tracked(value: Any) -> bool:
        if isinstance(value, torch.Tensor):
            return (records and value.requires_grad) or wrapped(value)
        return isinstance(value, list | tuple) and any(map(is_tracked, value))

    return any(map(is_tracked, values))


def as_tensor(function: str, name: str, value: Any) -> Any:
    """Return `value` as a tensor that torch can differentiate; None stays None.

    Tensors in lists and tuples are stacked. Floats of 16 bits become float32, in which the kernels compute. The tensor
    of a read-only array is a copy, because torch has no read-only tensors.

    Raises ValueError as `shared` does, or if the tensors in a list have different shapes.
    """
    torch = sys.modules["torch"]
    if value is None:
        return None
    if isinstance(value, list | tuple) and tracked(value):
        items = [as_tensor(function, f"{name}[{k}]", each) for k, each in enumerate(value)]
        if len({each.shape for each in items}) != 1:
            raise ArgumentError(name, "must have items of one shape to have gradients", function)
        return torch.stack([each.to(items[0].dtype) if each.is_floating_point() else each for each in items])
    if isinstance(value, torch.Tensor):
        if value.device.type != "cpu" or value.is_complex() or value.layout != torch.strided:
            shared(function, name, value.detach())
            raise ArgumentError(name, f"must be a dense array of numbers, got {value.dtype}", function)
        return value.to(torch.float32) if value.dtype in (torch.float16, torch.bfloat16) else value
    array = np.asarray(shared(function, name, value))
    if array.dtype.kind not in "fiub":
        raise ArgumentError(name, f"must be a numeric array, got {array.dtype}", function)
    return torch.from_numpy(np.array(array, array.dtype.newbyteorder("=")))


def unbatched(size: int, dimensions: Sequence[int | None], inputs: Sequence[Any]) -> list[list[Any]]:
    """Return the inputs of each of the `size` calls in a batch of `torch.func.vmap`."""
    pairs = list(zip(inputs, dimensions, strict=True))
    return [[value if axis is None else value.select(axis, k) for value, axis in pairs] for k in range(size)]


def shared(function: str | None, name: str, value: Any) -> Any:
    """Return `value`, or a NumPy array that shares its memory if `value` is a torch tensor on the CPU.

    NumPy has no bfloat16, so a tensor of this type gives a new array of float32.

    Raises ValueError if `value` is a masked array, a tensor on another device, or a tensor of a type that NumPy lacks.
    """
    if type(value) is np.ndarray:
        return value
    if isinstance(value, np.ma.MaskedArray):
        masked = int(np.count_nonzero(np.ma.getmaskarray(value)))
        what = (
            f"fill or remove its {masked} masked values" if masked else "it has no masked values, so pass its `.data`"
        )
        raise ArgumentError(name, f"must not be a masked array: {what}", function)
    if not is_tensor(value):
        return _plain(function, name, value)
    if value.layout is not sys.modules["torch"].strided:
        raise ArgumentError(name, "must be dense, got a sparse tensor: pass `.to_dense()`", function)
    if value.device.type != "cpu":
        raise ArgumentError(name, f"must be on the CPU, got a tensor on {value.device}", function)
    if value.dtype is sys.modules["torch"].bfloat16:
        value = value.float()
    try:
        return value.detach().resolve_conj().resolve_neg().numpy()
    except (TypeError, RuntimeError, NotImplementedError):
        raise ArgumentError(
            name, f"must have a type that NumPy has, got {value.dtype}: pass `.float()` or `.long()`", function
        ) from None


def _plain(function: str | None, name: str, value: Any) -> Any:
    """Return `value`. Raises ValueError if it is a sparse matrix, or a table whose columns NumPy cannot read."""
    kind = type(value)
    if hasattr(value, "nnz") and hasattr(value, "toarray"):
        raise ArgumentError(name, f"must be dense, got a sparse {kind.__name__}: pass `.toarray()`", function)
    if kind.__module__.startswith("pandas") and hasattr(value, "to_numpy") and np.asarray(value).dtype == object:
        what = "missing values, or columns that are not numbers: fill or remove them, then pass `.to_numpy(float)`"
        with suppress(TypeError, ValueError):
            if not np.isnan(value.to_numpy("float64", na_value=np.nan)).any():
                what = "a nullable type: pass `.to_numpy(float)` or `.to_numpy(int)`"
        raise ArgumentError(name, f"must be a numeric array, got a {kind.__name__} with {what}", function)
    return value


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
