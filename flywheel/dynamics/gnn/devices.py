"""The devices that a network can be computed on."""

from __future__ import annotations

import torch

from flywheel.errors import ConfigError


def check_device(device: str, setting: str = "device") -> None:
    """Reject a GPU where there is none.

    Args:
      device: asked for.
      setting: its name, for the message.

    Raises:
      ConfigError: torch finds no CUDA device here.
    """
    if device == "cuda" and not torch.cuda.is_available():
        why = "finds no GPU here" if torch.version.cuda else "is a build without CUDA"
        raise ConfigError(
            f"{setting}=cuda needs a CUDA GPU and a build of torch for it, but torch "
            f"{torch.__version__} {why}. Allowed on this machine: {setting}=cpu."
        )
