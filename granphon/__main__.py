"""``python -m granphon``: the command line."""

import sys

from granphon.cli import main

if __name__ == "__main__":
    sys.exit(main())
