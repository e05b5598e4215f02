"""The reproduction: the thesis's tables, figures and claims, by way of `gvp_lib`, and the chapters' plots."""
