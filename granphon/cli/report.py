"""The command ``report``: one page about a folder of results."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from granphon.base.errors import InputError
from granphon.cli.app import PICTURES, Force, command
from granphon.cli.terminal import require_name, say


@command("report", rich_help_panel=PICTURES)
def write_report(
    folder: Annotated[
        str, typer.Argument(metavar="DIR", help="A folder of 'granphon run' or 'granphon fit'.")
    ],
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The file to write; its ending is the format (.html, .md). By default report.html"
            " and report.md in the folder.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Write one page about a folder of results.

    The page has the main numbers with their units, the warnings, all figures that are in the
    folder, a table of the states of a sweep, the scene, the versions of packages, and how to cite.
    The HTML needs no other file and no network. The Markdown is for the supplement of a paper; it
    names the files of the figures. Nothing is computed or drawn again.

    \b
    Examples:
      granphon report out
      granphon report out -o supplement.md
    """
    from granphon.base.staging import ResultFiles
    from granphon.page.document import write_html, write_markdown
    from granphon.scene.outputs import OUTPUTS
    from granphon.scene.report import read_report

    require_name("--out", out)
    targets = (
        [Path(folder) / name for name in OUTPUTS["report"].files] if out is None else [Path(out)]
    )
    for target in targets:
        if target.suffix not in (".html", ".md"):
            problem = f"--out is {target}, whose ending names no format of a report"
            raise InputError(problem, mend="Use .html or .md")
    # read before the folder of the report is made: if the reading fails, no empty folder is left
    title, sections = read_report(folder)
    # the report links to tables, and in Markdown to pictures, by their paths from its own folder
    path_of_results = os.path.relpath(folder, targets[0].parent)
    link_folder = "" if path_of_results == os.curdir else Path(path_of_results).as_posix()
    writers: dict[str, Any] = {
        ".html": partial(write_html, folder=link_folder),
        ".md": partial(write_markdown, folder=link_folder),
    }
    names = [target.name for target in targets]
    with (
        ResultFiles(targets[0].parent, names, force).open() as locked,
        locked.staging() as stage,
    ):
        for name in names:
            text = writers[Path(name).suffix](title, sections)
            (stage / name).write_text(text, encoding="utf-8")
    say(f"Wrote {', '.join(map(str, targets))}")
