"""Third floor: what is learned, and from what. Thesis 2.4, 3.2. Torch lives only here, and only where it must."""

from gvp_lib.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, extra="learning")
