"""A busy machine fails no chapter under nbval: `notebooks/conftest.py`."""

import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

CONFTEST = Path(__file__).resolve().parents[1] / "notebooks" / "conftest.py"
# The kernel has replied that the cell has ended, and is held up before it says that it is idle.
HELD_UP = """
import time
kernel = get_ipython().kernel
say_idle = kernel.post_handler_hook
kernel.post_handler_hook = lambda: (time.sleep(6), say_idle())
"""


@pytest.mark.full  # twice what nbval's limit takes
def test_a_kernel_that_is_held_up_after_a_cell_fails_no_chapter(tmp_path: Path) -> None:
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(HELD_UP)])
    for folder in ("bare", "chapters"):
        (tmp_path / folder).mkdir()
        nbformat.write(notebook, tmp_path / folder / "held_up.ipynb")
    shutil.copy(CONFTEST, tmp_path / "chapters")
    command = [sys.executable, "-m", "pytest", "-rA", "--nbval-lax", "--nbval-current-env", "bare", "chapters"]
    told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=150).stdout
    assert "PASSED chapters/held_up.ipynb::Cell 0" in told
    # The day that nbval's own limit can be set, this fails, and the file above can go.
    assert "FAILED bare/held_up.ipynb::Cell 0" in told
    assert "Timeout of 5 seconds exceeded waiting for output." in told
