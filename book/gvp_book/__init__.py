"""The reproduction: the thesis's tables, figures, and claims, computed with `gvp_lib`, and the chapters' plots."""
