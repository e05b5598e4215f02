"""``python -m gvp_lib``: the same as ``gvp``."""

import sys

from gvp_lib.cli import main

if __name__ == "__main__":
    sys.exit(main())
