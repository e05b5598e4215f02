"""The names of the room, one a line: for type checkers, editors, and ``gvp_lib.lazy``."""

from gvp_book.plots import datasets as datasets
from gvp_book.plots import diagrams as diagrams
from gvp_book.plots import grasping as grasping
from gvp_book.plots import learned as learned
from gvp_book.plots import reach as reach
from gvp_book.plots import tables as tables
from gvp_book.plots import training as training
from gvp_book.plots import traversal as traversal
from gvp_book.plots import viewpoints as viewpoints
from gvp_book.plots.reach import reach_map as reach_map
from gvp_book.plots.reach import reach_table as reach_table
from gvp_book.plots.tables import Table as Table
from gvp_book.plots.tables import alignment_table as alignment_table
from gvp_book.plots.tables import first_arc_effect as first_arc_effect
from gvp_book.plots.tables import outlines_table as outlines_table
from gvp_book.plots.tables import packages_table as packages_table
from gvp_book.plots.tables import pooled_table as pooled_table
from gvp_book.plots.tables import segmenters_table as segmenters_table
from gvp_book.plots.tables import sweep_table as sweep_table
from gvp_book.plots.viewpoints import grouped_bars as grouped_bars
