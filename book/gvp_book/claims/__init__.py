"""What the thesis claims, sentence by sentence and cell by cell, held against the stored results."""

from gvp_lib.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, extra="learning")
