"""Where a network computes, by name."""

from __future__ import annotations

import torch

from gvp_lib.errors import InvalidParameterError

__all__ = ["device_named", "name_of"]


def device_named(name: str) -> str:
    """A device that is at hand; ``"auto"``: a GPU where there is one, else the processor.

    Raises
    ------
    InvalidParameterError
        There is none of that name here.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.zeros(1, device=name).item()
    except (RuntimeError, AssertionError, TypeError) as error:
        raise InvalidParameterError(
            f"device {name!r} is not at hand here ({str(error).splitlines()[0]}); 'cpu' is, and 'auto' takes what is"
        ) from error
    return name


def name_of(device: str) -> str:
    """What a device is: the model of a GPU, for whoever asks where a network was trained; else the name itself."""
    return torch.cuda.get_device_name(device) if device.startswith("cuda") else device
