"""The episodes behind each table and figure, and what is made of their rows."""

from gvp_lib.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, extra="learning")
