"""Help in groups, as plain text: commands and options stand under the ``rich_help_panel`` that they name.

Typer itself has groups only in the boxes that rich draws, which a screen reader and a file do not need, and rich would be
loaded for every help.
"""

from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand, TyperGroup


def _write_groups(formatter: Any, entries: list[tuple[str, tuple[str, str]]]) -> None:
    """Write lists of a name and a text each, one for each group, in the order in which groups come first."""
    for group in dict.fromkeys(name for name, _ in entries):
        with formatter.section(group):
            formatter.write_dl([record for name, record in entries if name == group])


def _list_parameters(command: Any, ctx: Any) -> list[tuple[str, tuple[str, str]]]:
    """Return the group and the texts of each argument and option: arguments first, then options without a group."""
    entries = []
    for one in command.get_params(ctx):
        record = one.get_help_record(ctx)
        if record is not None:
            plain = "Arguments" if one.param_type_name == "argument" else "Options"
            # the type of a value, as "<str>", says nothing beside its name
            entries.append(
                (getattr(one, "rich_help_panel", None) or plain, (re.sub(r" <[\w\[\]]+>", "", record[0]), record[1]))
            )
    first = ("Arguments", "Options")
    return sorted(entries, key=lambda entry: first.index(entry[0]) if entry[0] in first else len(first))


class GroupedCommand(TyperCommand):
    """A command whose options are listed in groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments and options, group by group."""
        _write_groups(formatter, _list_parameters(self, ctx))


class GroupedGroup(TyperGroup):
    """A command with subcommands, which are listed in groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options, and then the subcommands group by group."""
        _write_groups(formatter, _list_parameters(self, ctx))
        found = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        shown: list[tuple[str, Any]] = [(name, one) for name, one in found if one is not None and not one.hidden]
        room = formatter.width - 6 - max(len(name) for name, _ in shown)
        _write_groups(
            formatter,
            [
                (getattr(one, "rich_help_panel", None) or "Commands", (name, one.get_short_help_str(room)))
                for name, one in shown
            ],
        )
