"""A pretended second device: its tensors compute on the processor, and refuse to mix with those of others.

It shows, without a GPU, that all tensors of a computation are where they were asked for, and that it
gives the same numbers; neither how fast a GPU is nor how it rounds.
"""

from __future__ import annotations

from typing import Any
from unittest import mock

import torch
from torch.utils._python_dispatch import TorchDispatchMode, return_and_correct_aliasing
from torch.utils._pytree import tree_leaves, tree_map_only

OTHER = "meta"  # of torch's devices the one that needs neither a library nor memory
MIXING = {"copy_", "_to_copy", "index", "index_put", "index_put_"}  # torch allows these


class There(torch.Tensor):
    """A tensor on the other device; `here` has its values."""

    here: torch.Tensor

    @staticmethod
    def __new__(cls, here: torch.Tensor) -> There:
        """Like a tensor of the processor, but for its device."""
        return torch.Tensor._make_wrapper_subclass(  # type: ignore[attr-defined, no-any-return]
            cls,
            here.size(),
            strides=here.stride(),
            storage_offset=here.storage_offset(),
            dtype=here.dtype,
            device=OTHER,
        )

    def __init__(self, here: torch.Tensor) -> None:
        self.here = here

    def __repr__(self) -> str:  # type: ignore[override]
        return f"There({self.here})"

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """See `computed`."""
        return computed(func, args, kwargs or {})

    def __getitem__(self, index: Any) -> torch.Tensor:
        """Of lists, torch would make tensors there without asking."""
        parts = index if isinstance(index, tuple) else (index,)
        made = (torch.as_tensor(part) if isinstance(part, list) else part for part in parts)
        return super().__getitem__(tuple(made))

    def tolist(self) -> Any:
        """See `torch.Tensor`."""
        return self.here.tolist()

    def new_tensor(self, data: Any, **how: Any) -> torch.Tensor:  # type: ignore[override]
        """See `torch.Tensor`."""
        return There(self.here.new_tensor(data, **how))


class OtherDevice(TorchDispatchMode):
    """A block in which there is that device."""

    def __enter__(self) -> Any:
        """Let functions that ask no mode make their tensors there, too."""

        def placing(make: Any) -> Any:
            return lambda data, device=None, **how: make(data, **how).to(device or "cpu")

        made = {"tensor": placing(torch.tensor), "as_tensor": placing(torch.as_tensor)}
        self._patch = mock.patch.multiple(torch, **made)
        self._patch.start()
        return super().__enter__()

    def __exit__(self, *error: Any) -> None:
        """Leave nothing changed."""
        self._patch.stop()
        super().__exit__(*error)

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """See `computed`."""
        return computed(func, args, kwargs or {})


def computed(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """The result of an operation, on the device of its tensors unless it names another.

    Raises:
      RuntimeError: its tensors are on two devices.
    """
    tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)]
    inside = any(isinstance(tensor, There) for tensor in tensors)
    strangers = any(tensor.dim() for tensor in tensors if not isinstance(tensor, There))
    if any(tensor.is_meta for tensor in tensors if not isinstance(tensor, There)):
        raise RuntimeError(f"{func} has a tensor without values")
    if inside and strangers and func.overloadpacket.__name__ not in MIXING:
        raise RuntimeError(f"{func} has tensors on two devices")
    device = kwargs.get("device")
    outside = not inside if device is None else torch.device(device).type != OTHER
    plain, named = tree_map_only(There, lambda tensor: tensor.here, (args, kwargs))
    result = func(*plain, **(named if device is None else {**named, "device": "cpu"}))
    if outside:
        return result
    result = tree_map_only(torch.Tensor, There, result)
    return return_and_correct_aliasing(func, args, kwargs, result) if inside else result
