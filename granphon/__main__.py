"""The entry of the command line, ``granphon`` or ``python -m granphon``, which can be interrupted from the start."""

import signal
import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line and return its exit code; an interruption is reported even before the command has begun."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from granphon.cli.commands import main as command  # takes a moment

        code = command()
    except KeyboardInterrupt:
        print("granphon: error: interrupted.", file=sys.stderr)
        code = 130
    # an interruption within exec() of a text, as dataclasses use it, stays marked as not caught, and the interpreter would
    # end by the signal; the next exec() removes the mark
    exec("")
    # the work is done: a signal from now on would only disturb the end of the interpreter
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    return code


if __name__ == "__main__":
    sys.exit(main())
