"""Where other projects document a name: addresses worked out from the name, without asking a network."""

from __future__ import annotations

import sys

NUMPY = "https://numpy.org/doc/stable/reference/"
SCIPY = "https://docs.scipy.org/doc/scipy/reference/generated/"
TORCH = "https://docs.pytorch.org/docs/stable/"
MUJOCO = "https://mujoco.readthedocs.io/en/stable/"
GYMNASIUM = "https://gymnasium.farama.org/api/"
OPENCV = "https://docs.opencv.org/4.x/"
PYTHON = "https://docs.python.org/3/library/"
MATPLOTLIB = "https://matplotlib.org/stable/api/"

_SCALARS = {"bool_", "uint8", "int64", "float32", "float64", "floating", "integer"}
_TORCH_PAGES = {
    "torch.Tensor": "tensors.html",
    "torch.device": "tensor_attributes.html",
    "torch.dtype": "tensor_attributes.html",
    "torch.utils.data.Dataset": "data.html",
    "torch.utils.data.DataLoader": "data.html",
}
# OpenCV names its pages by a hash of the module, so the functions that the book mentions are listed.
_OPENCV_PAGES = {
    "cvtColor": "d8/d01/group__imgproc__color__conversions.html",
    "inRange": "d2/de8/group__core__array.html",
    "moments": "d3/dc0/group__imgproc__shape.html",
    "morphologyEx": "d4/d86/group__imgproc__filter.html",
    "findHomography": "d9/d0c/group__calib3d.html",
    "calibrateCamera": "d9/d0c/group__calib3d.html",
}


def external_url(name: str) -> str | None:
    """The address of a dotted name's documentation; None where its project is not known here."""
    top, _, rest = name.partition(".")
    if top == "numpy" and rest:
        return _numpy(name, rest)
    if top == "scipy" and rest:
        return f"{SCIPY}{name}.html"
    if top == "torch" and rest:
        page = _TORCH_PAGES.get(name)
        return f"{TORCH}{page}#{name}" if page else f"{TORCH}generated/{name}.html"
    if top == "mujoco" and rest:
        if rest.startswith("mj_"):
            return f"{MUJOCO}APIreference/APIfunctions.html#{rest.lower().replace('_', '-')}"
        return f"{MUJOCO}APIreference/APItypes.html#{rest.lower()}"
    if top == "gymnasium" and rest:
        page = "spaces/fundamental/" if rest.startswith("spaces.") else "env/"
        return f"{GYMNASIUM}{page}#{name}"
    if top == "cv2" and rest in _OPENCV_PAGES:
        return OPENCV + _OPENCV_PAGES[rest]
    if name in ("matplotlib.figure.Figure", "matplotlib.axes.Axes"):
        return f"{MATPLOTLIB}{name.split('.')[1]}_api.html#{name}"
    if top in sys.stdlib_module_names and rest:
        # The page is that of the module: collections.abc.Callable is on collections.abc's.
        module = name.rpartition(".")[0]
        return f"{PYTHON}{module}.html#{name}"
    return None


def _numpy(name: str, rest: str) -> str:
    if rest.startswith("typing."):
        return f"{NUMPY}typing.html#{name}"
    if rest in _SCALARS:
        return f"{NUMPY}arrays.scalars.html#{name}"
    if name == "numpy.random.Generator":
        return f"{NUMPY}random/generator.html#{name}"
    if name == "numpy.random.SeedSequence":
        return f"{NUMPY}random/bit_generators/generated/{name}.html"
    if rest.startswith("random."):
        return f"{NUMPY}random/generated/{name}.html"
    return f"{NUMPY}generated/{name}.html"
