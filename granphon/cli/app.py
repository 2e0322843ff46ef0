"""The command ``granphon`` itself: its help, its version, and the options that several subcommands
share.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from granphon.cli.terminal import say
from granphon.runs import MOST_WORKERS

#: groups of commands, in the order of the help
SCENES = "Scenes"
PICTURES = "Pictures"
COMPARISONS = "Comparisons"
ABOUT = "About granphon"
GROUPS = (SCENES, PICTURES, COMPARISONS, ABOUT)
#: group of the options that say who does the work
WORK = "Work"
#: help of the option --force
FORCE = "Replace files that granphon wrote and that were not changed since."

#: last paragraph of the help of ``granphon``; \b keeps its line breaks
_EXIT_CODES = """\b
Exit codes:
  0    done
  1    the computation failed, or its result could not be written
  2    the input or the command line is wrong
  130  interrupted"""


class _Grouped:
    """Help in groups, as plain text: commands and options stand under the ``rich_help_panel`` that
    they name. Errors of usage know the command at fault.

    Typer itself has groups only in the boxes that rich draws, which a screen reader and a file do
    not need, and rich would be loaded for every help.
    """

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        """Return what is left of the words ``args`` behind the command in ``ctx``, as the method of
        click's own commands does.

        An error of usage without a context, as that of an option that lacks its value, takes
        ``ctx``.
        """
        try:
            parsed: list[str] = super().parse_args(ctx, args)  # type: ignore[misc]
        except Exception as error:
            if getattr(error, "ctx", ctx) is None:
                error.ctx = ctx  # type: ignore[attr-defined]
            raise
        return parsed

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write into the ``formatter`` the arguments, the options without a group, and then the
        other options and the subcommands by groups.

        Click calls this method for the help of the command in ``ctx``; it takes the place of the
        method of click's own commands.
        """
        # rows of a name and its help, by group
        rows_of_groups: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if not record:
                continue
            typed_names, words = record
            # the type of a value, as "<str>", says nothing beside its name
            names = re.sub(r" <[\w\[\]]+>", "", typed_names)
            default_group = "Arguments" if parameter.param_type_name == "argument" else "Options"
            group = getattr(parameter, "rich_help_panel", None) or default_group
            rows_of_groups.setdefault(group, []).append((names, words))
        commands = {}
        if hasattr(self, "commands"):
            commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        # the width that click gives to the short helps of subcommands, beside margins of 6
        width = formatter.width - 6 - max(map(len, commands), default=0)
        for name, subcommand in commands.items():
            row = (name, subcommand.get_short_help_str(width))
            rows_of_groups.setdefault(subcommand.rich_help_panel, []).append(row)
        for group, rows in rows_of_groups.items():
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)


class _Command(_Grouped, TyperCommand):
    """A subcommand."""


class _Group(_Grouped, TyperGroup):
    """A command with subcommands."""


#: the command ``granphon``; the modules beside this one add their subcommands to it
app = typer.Typer(
    cls=_Group,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
#: decorator that adds a subcommand to :data:`app`; it takes a name and ``rich_help_panel``, the
#: group of the help in which the subcommand stands
command = partial(app.command, cls=_Command)


def _print_version(is_requested: bool) -> None:
    """If the option --version was given, print the version of granphon and end the command."""
    if is_requested:
        from granphon import __version__

        say(f"granphon {__version__}")
        raise typer.Exit


@app.callback(epilog=_EXIT_CODES, invoke_without_command=True)
def _granphon(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Vibrations and sound velocities of granular crystals: elastic balls in contact, rotations
    included.

    \b
    Examples:
      granphon init                       write scene.yaml, commented
      granphon check scene.yaml           check it, and list what a run will compute
      granphon run scene.yaml -o out      compute it, and write the folder out
      granphon plot out -o figure.pdf     draw the results again
      granphon mode scene.yaml --at K -o mode.png
                                          draw how balls move in a mode
      granphon page scene.yaml -o page.html
                                          make an interactive page for a browser
      granphon tradeoff scene.yaml        measure the error and time of each medium
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


Force = Annotated[bool, typer.Option("--force", help=FORCE)]
SceneFile = Annotated[str, typer.Argument(metavar="SCENE", help="The scene file.")]
Values = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="A value in place of the scene's, such as 'load.force=18.4 +- 0.2 N'. May be"
        " repeated.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=MOST_WORKERS,
        metavar="N",
        help="Processes that share the work; no more than it has tasks.",
        rich_help_panel=WORK,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="A dask scheduler whose workers share the work.",
        rich_help_panel=WORK,
    ),
]
