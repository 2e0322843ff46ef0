"""The commands ``mode`` and ``animate``, and how they read a wave vector."""

import numpy as np
import pytest
from PIL import Image

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import Refused
from granphon.base.staging import LIST
from granphon.cli.main import main
from granphon.figures.modes import mode_figure
from granphon.figures.style import save_figure
from granphon.phonons.paths import read_point, special_points
from tests.conftest import one_error, only

SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {lattice: triangular, diameter: 8 mm}
load: {force: 18.446 N}
"""


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != LIST}


def test_a_mode_is_that_of_the_library(work, capsys):
    assert (
        main(
            ["mode", "scene.yaml", "--at", "K", "--branch", "1", "--cells", "2 2", "-o", "mode.png"]
        )
        == 0
    )
    assert capsys.readouterr() == ("Wrote mode.png\n", "")
    phonons = gp.Phonons(gp.Scene.from_yaml("scene.yaml").state())
    save_figure(
        mode_figure(phonons, (1 / 3, 1 / 3), 1, cells=(2, 2), direction=(1.0, 0.0)),
        work / "same.png",
    )
    found = files(work)
    assert found["mode.png"] == found["same.png"]


@pytest.mark.parametrize(
    ("direction", "is_default"), [("0 1", False), pytest.param("1 0", True, marks=pytest.mark.slow)]
)
def test_a_mode_is_seen_from_the_side_that_is_given(work, direction, is_default):
    """At Gamma all directions have their own longitudinal wave: by default the one along x."""
    arguments = ["mode", "scene.yaml", "--at", "0 0", "--branch", "1", "--cells", "1 1"]
    assert main([*arguments, "-o", "default.png"]) == 0
    assert main([*arguments, "--direction", direction, "-o", "given.png"]) == 0
    found = files(work)
    assert (found["default.png"] == found["given.png"]) == is_default


def test_a_mode_is_seen_from_the_direction_of_its_scene(work):
    arguments = ["mode", "scene.yaml", "--at", "0 0", "--branch", "1", "--cells", "1 1"]
    assert main([*arguments, "--direction", "0 1", "-o", "y.png"]) == 0
    (work / "scene.yaml").write_text(SCENE + "direction: 0 1\n", encoding="utf-8")
    assert main([*arguments, "-o", "scene.png"]) == 0
    assert files(work)["scene.png"] == files(work)["y.png"]


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_an_animation_has_a_picture_for_each_moment(work, capsys, count):
    arguments = [
        "animate",
        "scene.yaml",
        "--at",
        "1/3,1/3",
        "--frames",
        str(count),
        "--cells",
        "2 1",
        "-o",
        "films/mode.gif",
    ]
    assert main(arguments) == 0
    assert capsys.readouterr() == ("Wrote films/mode.gif\n", "")
    with Image.open(work / "films" / "mode.gif") as film:
        assert film.n_frames == count
        assert film.info["loop"] == 0
        pictures = []
        for number in range(count):
            film.seek(number)
            assert film.info["duration"] == 2000 // count
            pictures.append(np.asarray(film.convert("RGB")))
    assert all(
        np.any(pictures[one] != pictures[other]) for one in range(count) for other in range(one)
    )


#: what is wrong with the words of both commands
WRONG = [
    ({"--at": "Q"}, "--at: found 'Q'; allowed: G, M, K, or two numbers"),
    ({"--at": "k"}, "Did you mean 'K'?"),
    ({"--at": "1/3"}, "--at: found '1/3', with 1 number"),
    ({"--at": "1/3 1/3 1/3"}, "leaves the plane"),
    ({"--at": "1/3 nan"}, "--at: found"),
    ({"--at": ""}, "--at: found ''"),
    ({"--branch": "3"}, "no branch 3. Count from 0 to 2"),
    ({"--branch": "-1"}, "--branch"),
    ({"--cells": "2 2 2"}, "--cells: found '2 2 2'"),
    ({"--cells": "0 2"}, "--cells"),
    ({"--direction": "0 0"}, "--direction: found '0 0'"),
    ({"--direction": "up"}, "--direction: found 'up'"),
    ({"-o": "mode.doc"}, "--out is mode.doc"),
    ({"-o": "mode"}, "--out is mode,"),
    ({"-o": ""}, "--out is empty"),
    ({"scene": "none.yaml"}, "none.yaml"),
    ({"scene": "sweep.yaml"}, "sweep.yaml has many states"),
    ({"scene": "media.yaml"}, "media.yaml has many states"),
]


@pytest.mark.parametrize(
    ("command", "change", "said"),
    only(
        [
            *(("mode", *case) for case in WRONG),
            *(("animate", *case) for case in WRONG if {"-o", "--at"} & {*case[0]}),
        ],
        [(command, *case) for command in ("mode", "animate") for case in WRONG],
    ),
    ids=str,
)
def test_bad_input_is_one_error_and_nothing_is_written(command, change, said, work, capsys):
    (work / "sweep.yaml").write_text(SCENE.replace("18.446 N", "[1 N, 2 N]"), encoding="utf-8")
    (work / "media.yaml").write_text(SCENE + "medium: [ala, afa]\n", encoding="utf-8")
    before = files(work)
    given = {"--at": "K", "-o": "mode.png" if command == "mode" else "mode.gif"} | change
    scene = given.pop("scene", "scene.yaml")
    assert main([command, scene, *(word for pair in given.items() for word in pair)]) == 2
    assert said in one_error(capsys)
    assert files(work) == before


def test_a_picture_is_not_overwritten_unless_asked_for(work, capsys):
    arguments = ["mode", "scene.yaml", "--at", "K", "--cells", "1 1", "-o", "mode.png"]
    assert main(arguments) == 0
    before = files(work)
    capsys.readouterr()
    assert main([*arguments, "--branch", "1"]) == 1
    assert "already holds mode.png" in one_error(capsys)
    assert files(work) == before
    assert main([*arguments, "--branch", "1", "--force"]) == 0
    assert files(work)["mode.png"] != before["mode.png"]
    # what the user has drawn is never replaced
    (work / "mode.png").write_bytes(b"mine")
    capsys.readouterr()
    assert main([*arguments, "--force"]) == 1
    one_error(capsys)
    assert files(work)["mode.png"] == b"mine"


@pytest.mark.parametrize("command", ["mode", "animate"])
def test_a_picture_that_fails_half_way_leaves_nothing(command, work, capsys, monkeypatch):
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

    def fail(self, path, **options):
        self._draw_was_started = True  # else matplotlib warns of an animation that was never drawn
        path.write_bytes(b"half")
        raise ValueError("the ink is out")

    monkeypatch.setattr(
        *((Figure, "savefig") if command == "mode" else (FuncAnimation, "save")), fail
    )
    before = files(work)
    name = "mode.png" if command == "mode" else "mode.gif"
    assert main([command, "scene.yaml", "--at", "K", "--cells", "1 1", "-o", name]) == 1
    error = one_error(capsys)
    assert error.startswith(name)
    assert "the ink is out" in error
    assert files(work) == before


@pytest.mark.parametrize(
    ("lattice", "at"),
    [("chain", "X"), ("kagome", "M"), pytest.param("fcc", "W", marks=pytest.mark.slow)],
)
def test_modes_of_other_lattices_are_drawn(lattice, at, work):
    (work / "scene.yaml").write_text(SCENE.replace("triangular", lattice), encoding="utf-8")
    assert main(["mode", "scene.yaml", "--at", at, "-o", "mode.svg"]) == 0
    assert files(work)["mode.svg"].rstrip().endswith(b"</svg>")


@pytest.mark.parametrize(
    "name",
    ["chain", "triangular", "square", "honeycomb", "kagome", "sc", "bcc", "fcc", "hcp", "diamond"],
)
def test_a_point_is_read_by_its_letter_and_in_numbers(name):
    structure = LATTICES[name]
    p = structure.periods
    for letter, point in special_points(structure.vectors).items():
        np.testing.assert_array_equal(read_point(letter, structure), point)
        np.testing.assert_allclose(
            read_point(" ".join(map(repr, point.tolist())), structure), point, rtol=0, atol=1e-15
        )
        np.testing.assert_allclose(
            read_point(",".join(map(repr, point[:p].tolist())), structure),
            point,
            rtol=0,
            atol=1e-15,
        )
    for gamma in ("G", "Gamma", "Γ"):
        np.testing.assert_array_equal(read_point(gamma, structure), np.zeros(3))
    for bad in ("Q9", "1/0", "", 3, None, "1 2 3 4", "1e9 0 0"):
        with pytest.raises(Refused):
            read_point(bad, structure)
