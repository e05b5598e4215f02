"""For the chapters under nbval: time enough for what a kernel says after a cell, also on a busy machine."""

import pytest
from nbval.plugin import IPyNbCell

# s. A kernel replies that a cell has ended, and only then, from another thread, sends its last outputs and that it is
# idle. nbval gives each of these messages 5 s, whatever its options say (its issues 136 and 231): too little where
# other processes have the processor, or where the machine is suspended meanwhile.
OUTPUT_TIMEOUT = 120


def pytest_itemcollected(item: pytest.Item) -> None:
    """Give a cell's outputs their time."""
    if isinstance(item, IPyNbCell):
        item.output_timeout = OUTPUT_TIMEOUT
