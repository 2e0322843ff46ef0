"""The commands that make something to play with: ``page``, and ``export`` for other viewers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from granphon.base.errors import InputError, message
from granphon.cli.app import PICTURES, Force, SceneFile, command
from granphon.cli.terminal import require_name, say

if TYPE_CHECKING:
    from granphon.scene.scene import Scene


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

    def make(read: Scene) -> str:
        from granphon.page.page import make_page

        first = read.plan.cases[0].case
        begins = f"The scene sweeps parameters; this page is that of the first values: {first.where}."
        direction = read.directions[0] if read.directions else None
        title = f"{first.packing.structure.name} lattice, {Path(scene).name}"
        with read.plan.origin.at():
            return make_page(
                first.packing, read.media, read.load, finite_overlap=read.finite_overlap, path=read.band,
                direction=direction, title=title, remarks=[begins] * bool(first.where),
            )  # fmt: skip

    _write(scene, out, (".html", ".htm"), force, make)


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

    def make(read: Scene) -> str:
        if read.is_sweep:
            why = "Modes are those of one state"
            raise InputError(message(f"{scene} has many states", why, "Keep one load, one medium, and no block 'sweep'"))
        from granphon.page.phononwebsite import write_phononwebsite
        from granphon.phonons.phonons import Phonons

        with read.plan.origin.where_it_buckles():
            path = read.path
            bands = Phonons(read.state()).bands(path.arrays, npoints=read.band_points, labels=path.labels)
        return write_phononwebsite(bands, read.packing.structure.name)

    _write(scene, out, (".json",), force, make)


def _write(scene: str, out: str, endings: tuple[str, ...], force: bool, make: Callable[[Scene], str]) -> None:
    """Write the text that ``make`` makes of the scene into the file ``out``, which arrives whole or not at all."""
    from granphon.base.staging import ResultFiles, write_text
    from granphon.scene.scene import Scene

    require_name("--out", out)
    target = Path(out)
    if target.suffix not in endings:
        what = f"--out is {out}, whose ending is not {' or '.join(endings)}"
        raise InputError(message(what, mend=f"Give a name that ends in {endings[0]}"))
    read = Scene.from_yaml(scene)
    with ResultFiles(target.parent, [target.name], force, inputs=read.inputs).open() as locked:
        text = make(read)
        with locked.staging() as place:
            write_text(place / target.name, text)
    say(f"Wrote {out}")
