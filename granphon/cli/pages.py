"""The commands that make something to play with: ``page``, and ``export`` for other viewers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from granphon.base.errors import InputError, message
from granphon.cli.app import PICTURES, Force, SceneFile, command
from granphon.cli.terminal import write_of_scene

#: the programs for which ``export`` writes
_FORMATS = ("phononwebsite",)


@command("page", rich_help_panel=PICTURES)
def make_scene_page(
    scene: SceneFile,
    out: Annotated[str, typer.Option("--out", "-o", metavar="FILE", help="The file to write; its name ends in .html.")],
    force: Force = False,
) -> None:
    """Make an interactive page of a scene for a browser.

    The page is one file, which works without a network. Sliders change the load, the width of the spread, friction, torsion
    and bending; a switch changes finite overlap. The page shows bands, density of states, the balls as they move in a mode,
    sound velocities and moduli. It computes all of this itself, except for the stiffness of contacts of balls that differ.
    That stiffness is computed when the page is made, and interpolated; the page names the error of the interpolation. A
    scene of several loads or media makes one page, which begins at the first. From a block 'sweep' the page takes the first
    value of each parameter. With an effective medium in space this command takes up to half a minute.

    \b
    Examples:
      granphon page scene.yaml -o page.html
    """

    with write_of_scene(scene, out, (".html", ".htm"), force) as (read, place):
        from granphon.page.page import make_page

        first = read.plan.cases[0].case
        begins = f"The scene sweeps parameters; this page is that of the first values: {first.where}."
        with read.plan.origin.at():
            text = make_page(
                first.packing, read.media, read.load, finite_overlap=read.finite_overlap, path=read.band,
                direction=read.directions[0] if read.directions else None,
                title=f"{first.packing.structure.name} lattice, {Path(scene).name}", remarks=[begins] * bool(first.where),
            )  # fmt: skip
        place.write_text(text, encoding="utf-8")


@command("export", rich_help_panel=PICTURES)
def export_scene(
    scene: SceneFile,
    out: Annotated[str, typer.Option("--out", "-o", metavar="FILE", help="The file to write; its name ends in .json.")],
    format: Annotated[
        str, typer.Option("--format", metavar="NAME", help=f"The program that reads the file: {', '.join(_FORMATS)}.")
    ] = "phononwebsite",
    force: Force = False,
) -> None:
    """Write the bands and modes of a scene for another program.

    The file is the JSON of phononwebsite, a viewer in the browser. A ball is an iron atom; a ball that turns carries two
    hydrogen atoms as marks, which show its rotation. The name in the file says the unit of the frequencies. The path and
    the number of its points are those of the scene. The scene must have one state: one load, one medium, and no block
    'sweep'.

    \b
    Examples:
      granphon export scene.yaml -o modes.json
    """
    if format not in _FORMATS:
        raise InputError(message(f"--format is {format}", mend=f"Use {' or '.join(_FORMATS)}"))

    with write_of_scene(scene, out, (".json",), force, "Modes are those of one state") as (read, place):
        from granphon.page.phononwebsite import write_phononwebsite
        from granphon.phonons.phonons import Phonons

        with read.plan.origin.where_it_buckles():
            path = read.path
            bands = Phonons(read.state()).bands(path.arrays, npoints=read.band_points, labels=path.labels)
        place.write_text(write_phononwebsite(bands, read.packing.structure.name), encoding="utf-8")
