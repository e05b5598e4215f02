"""Figures and tables of the chapters."""

from gvp_lib.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, extra="notebooks")
