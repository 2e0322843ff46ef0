"""Entry point of the commands ``granphon`` and ``python -m granphon``; it handles interruptions
from the start.
"""

import gc
import os
import signal
import sys

#: new objects of Python after which a command looks for reference cycles. Nearly all that a command
#: imports and makes lives to its end: at the default of Python, 700 or 2000, the search takes
#: longer, by two to five hundredths of the time of a short run (tests/benchmarks/bench_commands.py)
_COLLECTION_THRESHOLD = 10_000
#: settings of mimalloc, with which rslab allocates, in the environment: the pages that rslab frees
#: are left to the system, which takes them when memory is short, instead of given back at once.
#: Otherwise all factors have their pages mapped anew, which takes four hundredths of the time of
#: README's beads (tests/benchmarks/bench_commands.py)
_ALLOCATION = {"MIMALLOC_PURGE_DECOMMITS": "0"}


def main() -> int:
    """Run the command line and return its exit code; report an interruption even while the command
    is being imported.

    From here on, Python looks for reference cycles less often in this process, and rslab keeps the
    pages that it frees; variables of the environment that the user has set stay. When a command has
    ended, SIGINT and SIGTERM are ignored, so that the process is to end too.
    """
    gc.set_threshold(_COLLECTION_THRESHOLD)
    for name, value in _ALLOCATION.items():
        os.environ.setdefault(name, value)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from granphon.base.errors import MissingPackageError, needing

        try:
            with needing("The command granphon"):
                # a slow import, which may be interrupted
                from granphon.cli.main import (
                    main as command,
                )
        except MissingPackageError as error:
            print(f"granphon: error: {error}", file=sys.stderr)
            return 2
        code = command()
    except KeyboardInterrupt:
        print("granphon: error: interrupted.", file=sys.stderr)
        code = 130
    # Python marks an interruption that leaves exec() of a text, which dataclasses use, as not
    # caught, even if it is caught later; it would then end by the signal instead of with our exit
    # code. Another exec() removes the mark.
    exec("")
    # the work is done: ignore signals while the interpreter shuts down
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    return code


if __name__ == "__main__":
    sys.exit(main())
