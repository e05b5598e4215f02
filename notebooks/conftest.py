"""For the chapters under nbval: time for a cell's outputs on a busy machine."""

import pytest
from nbval.plugin import IPyNbCell

# s. A kernel replies that a cell has ended, and only then sends, from another
# thread, its last outputs and that it is idle. nbval gives each of these
# messages 5 s, which no option changes (its issues 136 and 231): too little
# where other processes have the cores, or the machine is suspended meanwhile.
OUTPUT_TIMEOUT = 120


def pytest_itemcollected(item: pytest.Item) -> None:
    """Give a cell's outputs their time."""
    if isinstance(item, IPyNbCell):
        item.output_timeout = OUTPUT_TIMEOUT
