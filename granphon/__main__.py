"""The process of the command line, ``granphon`` or ``python -m granphon``, which can be interrupted from its start on."""

import signal
import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line; returns the exit code. An interruption before it has begun is told as any other."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from granphon.cli.commands import main as command  # takes a moment

        code = command()
    except KeyboardInterrupt:
        print("granphon: error: interrupted.", file=sys.stderr)
        code = 130
    # an interruption that has passed through exec() of a text, as in dataclasses, is remembered as one that nobody has
    # caught, and the interpreter would end by the signal; each exec() forgets what was before
    exec("")
    # all is said and done: what comes now would only disturb the end of the interpreter
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    return code


if __name__ == "__main__":
    sys.exit(main())
