"""The command ``granphon`` itself: its help, its version, and the options that several subcommands share."""

from __future__ import annotations

from typing import Annotated

import typer

from granphon.cli.terminal import say

__all__ = ["Force", "SceneFile", "app"]

#: last paragraph of the help of ``granphon``; \b keeps its line breaks
_EXIT_CODES = """\b
Exit codes:
  0    done
  1    the computation failed, or its result could not be written
  2    the input or the command line is wrong
  130  interrupted"""

#: the command ``granphon``; the modules :mod:`.scenes` and :mod:`.studies` add their subcommands to it
app = typer.Typer(
    add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)  # fmt: skip


def _print_version(wanted: bool) -> None:
    if wanted:
        from granphon import __version__

        say(f"granphon {__version__}")
        raise typer.Exit


@app.callback(epilog=_EXIT_CODES)
def _granphon(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Vibrations and sound velocities of granular crystals: elastic balls in contact, rotations included.

    \b
    Examples:
      granphon init                       write scene.yaml, commented
      granphon check scene.yaml           is it right, and what will be computed?
      granphon run scene.yaml -o out      compute, and write the folder out
      granphon plot out -o figure.pdf     draw the results again
      granphon tradeoff scene.yaml        what accuracy costs, measured
    """


Force = Annotated[bool, typer.Option("--force", help="Replace files that granphon wrote and that were not changed since.")]
SceneFile = Annotated[str, typer.Argument(metavar="SCENE", help="The scene file.")]
