"""The commands that show a scene: ``mode`` and ``animate`` draw a mode; ``page`` and ``export``
write for a browser.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from granphon.base.errors import InputError
from granphon.cli.app import PICTURES, Force, SceneFile, command
from granphon.cli.terminal import write_of_scene

if TYPE_CHECKING:
    from granphon.scene.scene import Scene

#: the programs for which ``export`` writes
_FORMATS = ("phononwebsite",)
#: most cells along a lattice vector in a picture: of more no ball could be told from others
_MOST_CELLS = 100

Point = Annotated[
    str,
    typer.Option(
        "--at",
        metavar="Q",
        help="Wave vector: a special point, such as K, or fractions of the reciprocal cell, such"
        " as '1/3 1/3'.",
    ),
]
Branch = Annotated[
    int,
    typer.Option(
        "--branch", min=0, metavar="N", help="The branch, counted from 0 in ascending frequency."
    ),
]
Cells = Annotated[
    str | None,
    typer.Option(
        "--cells",
        metavar="'N N'",
        help="Cells to draw along each lattice vector; by default 8, 4 4, or a cube.",
    ),
]
Approach = Annotated[
    str | None,
    typer.Option(
        "--direction",
        metavar="'X Y'",
        help="Direction from which a point where branches touch is approached; by default the"
        " scene's direction, else x.",
    ),
]


def _make_out(words: str) -> Any:
    """Return the option --out, which names the file that a command writes. Its help ends with
    ``words`` on the ending of the name.
    """
    return typer.Option("--out", "-o", metavar="FILE", help=f"The file to write; {words}.")


@command("mode", rich_help_panel=PICTURES)
def draw_mode(
    scene_file: SceneFile,
    point: Point,
    out: Annotated[str, _make_out("its ending is the format (.png, .pdf, .svg)")],
    branch: Branch = 0,
    cells: Cells = None,
    direction: Approach = None,
    force: Force = False,
) -> None:
    """Draw how the balls of a scene move and rotate in one mode.

    Arrows are displacements. In a plane the angle of a ball is the sector from the upright to its
    mark, vermilion anticlockwise and blue clockwise; balls that leave the plane, and those of
    crystals, are spheres, with a vermilion arrow along the axis of rotation. The title has the wave
    vector, the frequency, and the fraction of the energy in rotation. The scene must have one
    state: one load, one medium, and no block 'sweep'.

    \b
    Examples:
      granphon mode scene.yaml --at K --branch 1 -o mode.png
      granphon mode scene.yaml --at "1/4 0" --branch 2 --cells "8 2" -o mode.pdf
    """

    def draw(file: Path, *mode: Any, **options: Any) -> None:
        """Draw a mode into a ``file``; :func:`_write_picture` says what the arguments are."""
        from granphon.figures.modes import mode_figure
        from granphon.figures.style import save_figure

        save_figure(mode_figure(*mode, **options), file)

    choice = ModeChoice(point, branch, cells, direction)
    _write_picture(scene_file, out, (".png", ".pdf", ".svg"), draw, choice, force=force)


@command("animate", rich_help_panel=PICTURES)
def animate_scene(
    scene_file: SceneFile,
    point: Point,
    out: Annotated[str, _make_out("its name ends in .gif")],
    branch: Branch = 0,
    cells: Cells = None,
    direction: Approach = None,
    frames: Annotated[
        int,
        typer.Option(
            min=2,
            max=240,
            metavar="N",
            help="Number of pictures in one period, which takes two seconds.",
        ),
    ] = 24,
    force: Force = False,
) -> None:
    """Draw a mode as an animation of one period that repeats.

    The animation shows the same as 'granphon mode', and takes the same scenes.

    \b
    Examples:
      granphon animate scene.yaml --at K --branch 1 -o mode.gif
      granphon animate fcc.yaml --at "1/2 1/2 0" --frames 48 -o mode.gif
    """

    def draw(file: Path, *mode: Any, **options: Any) -> None:
        """Write the animation of a mode into a ``file``; :func:`_write_picture` says what the
        arguments are.
        """
        from granphon.figures.modes import animate_mode
        from granphon.figures.style import save_animation

        save_animation(animate_mode(*mode, **options, frames=frames), file)

    choice = ModeChoice(point, branch, cells, direction)
    _write_picture(scene_file, out, (".gif",), draw, choice, force=force)


class ModeChoice(NamedTuple):
    """The mode that a picture shows, in the words of the command line.

    Attributes
    ----------
    point : the wave vector, the option --at.
    branch : number of the branch, from 0, in ascending frequency.
    cells : numbers of cells to draw along the lattice vectors, between spaces; None for those of
        the figure.
    direction : the direction from which a point where branches touch is approached, components
        between spaces; None for that of the scene.
    """

    point: str
    branch: int
    cells: str | None
    direction: str | None

    def read(self, scene: Scene) -> tuple[Any, dict[str, Any]]:
        """Return the wave vector (3,) in fractions of the reciprocal cell, and keywords of the
        functions that draw modes: ``direction``, by default the first of the ``scene``, else x; and
        ``cells``, if they are given.

        Raises :class:`~granphon.base.errors.InputError` for an option that the lattice of the
        ``scene`` does not allow.
        """
        from granphon.base.validation import lengths, require
        from granphon.phonons.paths import read_point
        from granphon.scene.file_keys import read_directions

        lattice = scene.packing.structure
        q = require("--at", partial(read_point, structure=lattice), self.point)
        x_axis = (1.0, 0.0, 0.0)[: lattice.periods]
        options: dict[str, Any] = {"direction": next(iter(scene.directions), x_axis)}
        if self.direction is not None:
            read_direction = partial(read_directions, lattice=lattice)
            options["direction"] = require("--direction", read_direction, self.direction)
        if self.cells is not None:
            read_cells = partial(lengths, low=1, high=_MOST_CELLS, periods=lattice.periods)
            options["cells"] = require("--cells", read_cells, self.cells)
        n_branches = scene.plan.n_branches
        if self.branch >= n_branches:
            # the figure would refuse the branch too, but only after the state is solved
            mend = f"Count from 0 to {n_branches - 1}"
            raise InputError(f"there is no branch {self.branch}", mend=mend)
        return q, options


def _write_picture(
    scene_file: str,
    out: str,
    endings: Sequence[str],
    draw: Callable[..., None],
    choice: ModeChoice,
    *,
    force: bool,
) -> None:
    """Read the scene in the file ``scene_file``, and draw the mode of the ``choice`` into the file
    ``out``, as :func:`~granphon.cli.terminal.write_of_scene` writes: the name has one of the
    ``endings``, and with ``force`` a file of that name is replaced.

    The function ``draw`` draws. It takes the path of a file, the phonons, the wave vector (3,) in
    fractions of the reciprocal cell, the branch, and the keywords of :meth:`ModeChoice.read`.
    """
    why = "A mode is drawn of one state"
    with write_of_scene(scene_file, out, endings, force, why) as (scene, staged_file):
        q, options = choice.read(scene)
        # imported after all that can be refused, as phonopy takes long to load
        from granphon.phonons.phonons import Phonons

        with scene.origin.where_it_buckles():
            draw(staged_file, Phonons(scene.state()), q, choice.branch, **options)


@command("page", rich_help_panel=PICTURES)
def make_scene_page(
    scene_file: SceneFile,
    out: Annotated[str, _make_out("its name ends in .html")],
    force: Force = False,
) -> None:
    """Make an interactive page of a scene for a browser.

    The page is one file, which works without a network. Sliders change the load, the width of the
    spread, friction, torsion and bending; a switch changes finite overlap. The page shows bands,
    density of states, the balls as they move in a mode, sound velocities and moduli. The browser
    computes all of this, except for the stiffness of contacts of balls that differ. That stiffness
    is computed when the page is made, and interpolated; the page names the error of the
    interpolation. The page of a crystal made of kinds of balls, or of a network, shows the first
    state, and has sliders of the mode only. A scene of several loads or media makes one page, which
    begins at the first. From a block 'sweep' the page takes the first value of each parameter. With
    an effective medium in space this command takes up to half a minute.

    \b
    Examples:
      granphon page scene.yaml -o page.html
    """
    with write_of_scene(scene_file, out, (".html", ".htm"), force) as (scene, staged_file):
        packing = scene.plan.cases[0].case.packing
        options: dict[str, Any] = {
            "direction": next(iter(scene.directions), None),
            "title": f"{packing.structure.name} lattice, {Path(scene_file).name}",
            "losses": scene.bands,
        }
        with scene.origin.at():
            if packing.kind_names:
                text = _make_crystal_page(scene, options)
            else:
                text = _make_packing_page(scene, options)
        staged_file.write_text(text, encoding="utf-8")


def _make_crystal_page(scene: Scene, options: dict[str, Any]) -> str:
    """Return the HTML text of the page of a crystal, in the first state of its scene; ``options``
    are keywords of :func:`granphon.page.page.make_page`.
    """
    from granphon.page.page import make_page

    remarks: list[str] = []
    if scene.swept:
        remarks.append("The scene has several states; this page is that of the first.")
    case = scene.plan.cases[0].case
    medium = case.medium.of(case.packing)
    state: Any = medium.at(case.load[0], finite_overlap=scene.finite_overlap)
    return make_page(state.source, **options, remarks=remarks)


def _make_packing_page(scene: Scene, options: dict[str, Any]) -> str:
    """Return the HTML text of the page of the first packing of a scene, with all its media and
    loads; ``options`` are keywords of :func:`granphon.page.page.make_page`.
    """
    from granphon.page.page import make_page

    case = scene.plan.cases[0].case
    has_finite_overlap = bool(case.finite_overlaps[0])
    remarks: list[str] = []
    if case.where:
        remarks.append(
            f"The scene sweeps parameters; this page is that of the first values: {case.where}."
        )
    return make_page(
        case.packing,
        scene.media,
        scene.load,
        **options,
        finite_overlap=has_finite_overlap,
        path=scene.band,
        remarks=remarks,
    )


@command("export", rich_help_panel=PICTURES)
def export_scene(
    scene_file: SceneFile,
    out: Annotated[str, _make_out("its name ends in .json")],
    format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help=f"The program that reads the file: {', '.join(_FORMATS)}.",
        ),
    ] = "phononwebsite",
    force: Force = False,
) -> None:
    """Write the bands and modes of a scene for another program.

    The file is the JSON of phononwebsite, a viewer in the browser. A ball is an iron atom, and
    balls of other kinds are of other elements; a ball that turns carries two hydrogen atoms as
    marks, which show its rotation. The name in the file says the unit of the frequencies. The path
    and the number of its points are those of the scene. The scene must have one state: one load,
    one medium, and no block 'sweep'.

    \b
    Examples:
      granphon export scene.yaml -o modes.json
    """
    if format not in _FORMATS:
        raise InputError(f"--format is {format}", mend=f"Use {' or '.join(_FORMATS)}")

    why = "Modes are those of one state"
    with write_of_scene(scene_file, out, (".json",), force, why) as (scene, staged_file):
        from granphon.page.phononwebsite import write_phononwebsite
        from granphon.phonons.phonons import Phonons

        path = scene.path
        with scene.origin.where_it_buckles():
            phonons = Phonons(scene.state())
            bands = phonons.bands(path.arrays, npoints=scene.band_points, labels=path.labels)
        text = write_phononwebsite(bands, scene.packing.structure.name)
        staged_file.write_text(text, encoding="utf-8")
