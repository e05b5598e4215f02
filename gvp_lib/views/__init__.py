"""What a reader looks at: 3D scenes and figures. Nothing imports this room."""

from gvp_lib.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, extra="notebooks")
