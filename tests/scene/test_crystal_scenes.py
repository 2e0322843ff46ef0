"""Scenes, sweeps, fits and the command line over lattices of one, two and three dimensions."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.base.errors import (
    InputError,
    InstabilityError,
    MechanismError,
    SceneError,
    UnverifiedFileWarning,
)
from granphon.base.text import parse_yaml
from granphon.cli.main import main
from granphon.cli.scenes import PRESETS
from granphon.cli.terminal import describe_result, describe_scene
from granphon.figures.curves import sweep_figure
from granphon.phonons.paths import BandPath
from granphon.runs import dataset
from granphon.scene.file import write_preset
from granphon.scene.scene import Scene, is_complete

MATERIAL = "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}"
#: lattices that hold their shape with the motions that they have by default
RIGID = ("chain", "triangular", "square", "kagome", "sc", "bcc", "fcc", "hcp")


def scene_text(packing: str, load: str = "force: 1 N", rest: str = "") -> str:
    return f"{MATERIAL}\npacking: {{diameter: 8 mm, {packing}}}\nload: {{{load}}}\n{rest}"


def read(packing: str, load: str = "force: 1 N", rest: str = "") -> Scene:
    return Scene.from_text(scene_text(packing, load, rest), "s.yaml")


def read_summary(folder: Path):
    return parse_yaml((folder / "summary.yaml").read_text(), "summary.yaml").data


# -- what a scene says -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", LATTICES)
def test_a_scene_names_every_lattice(name):
    scene = read(f"lattice: {name}", rest="observe: [bands]")
    assert scene.packing.structure == LATTICES[name]
    assert len(scene.mesh) == LATTICES[name].periods
    assert scene.path == BandPath.default(LATTICES[name])
    assert Scene.from_text(scene.to_yaml()) == scene


def test_motions_and_stiffnesses_are_read_and_written_where_they_differ_from_the_defaults():
    scene = read("lattice: chain, motions: all, torsion: mindlin, bending: 0.125")
    assert (scene.packing.motions, scene.packing.torsion, scene.packing.bending) == (
        "all",
        "mindlin",
        0.125,
    )
    written = scene.to_yaml()
    assert all(
        line in written for line in ('motions: "all"', 'torsion: "mindlin"', "bending: 0.125")
    )
    assert Scene.from_text(written) == scene
    plain = read("lattice: square").to_yaml()
    assert not any(word in plain for word in ("motions", "torsion", "bending"))


def test_a_lattice_of_ones_own_is_a_block():
    thirds = "[[1/3, 2/3], [2/3, 1/3]]"
    cell = f"[[{math.sqrt(3.0)!r}, 0], [{-math.sqrt(0.75)!r}, 1.5]]"
    scene = read(
        f"lattice: {{name: mine, cell: {cell}, sites: {thirds}}}, motions: out_of_plane,"
        f" bending: 0.1"
    )
    assert scene.packing.structure.contacts.normal == pytest.approx(
        LATTICES["honeycomb"].contacts.normal
    )
    assert Scene.from_text(scene.to_yaml()) == scene
    row = gp.Lattice("row in space", ((2.0, 0.0, 0.0),), ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)))
    ladder = Scene(
        gp.Packing(gp.Material(1e9, 0.3, 1e3), 1e-3, lattice=row),
        Load("force", 1.0),
        observe=("bands",),
    )
    assert Scene.from_text(ladder.to_yaml()) == ladder


@pytest.mark.parametrize(
    ("lattice", "load", "force"),
    [
        ("chain", "2 N", 2.0),
        ("triangular", "2 kN/m", 2e3 * 8e-3 / math.sqrt(3.0)),
        ("square", "2 N/mm", 16.0),
        ("sc", "10 kPa", 1e4 * 64e-6),
        ("fcc", "0.1 bar", 1e4 * 64e-6 / (2.0 * math.sqrt(2.0))),
    ],
)
def test_a_pressure_has_the_unit_of_the_dimension(lattice, load, force):
    scene = read(f"lattice: {lattice}", f"pressure: {load}")
    assert scene.state().force == pytest.approx(force, rel=1e-14)
    assert Scene.from_text(scene.to_yaml()) == scene


@pytest.mark.parametrize(
    ("lattice", "mesh", "dim", "found"),
    [
        ("chain", "32", "3", ((32,), (3,))),
        ("chain", "32 1 1", "4 1 1", ((32,), (4,))),
        ("square", "8 4", "3 4", ((8, 4), (3, 4))),
        ("fcc", "8 4 6", "[3, 3, 4]", ((8, 4, 6), (3, 3, 4))),
    ],
)
def test_meshes_and_supercells_have_the_numbers_of_the_dimension(lattice, mesh, dim, found):
    scene = read(f"lattice: {lattice}", rest=f"phonopy: {{mesh: {mesh}, dim: {dim}}}")
    assert (scene.mesh, scene.dim) == found
    assert Scene.from_text(scene.to_yaml()) == scene


@pytest.mark.parametrize(
    ("lattice", "band", "corners", "labels"),
    [
        ("chain", "XG", [(0.5, 0, 0), (0, 0, 0)], "X G"),
        ("kagome", "G K M G", [(0, 0, 0), (1 / 3, 1 / 3, 0), (0.5, 0, 0), (0, 0, 0)], "G K M G"),
        ("fcc", "XGL", [(0.5, 0, 0.5), (0, 0, 0), (0.5, 0.5, 0.5)], "X G L"),
        ("sc", "GX, RM", [(0, 0, 0), (0, 0.5, 0), (0.5, 0.5, 0.5), (0.5, 0.5, 0)], "G X R M"),
    ],
)
def test_a_path_may_be_given_in_letters(lattice, band, corners, labels):
    scene = read(f"lattice: {lattice}", rest=f"observe: [bands]\nphonopy: {{band: '{band}'}}")
    assert_allclose(np.concatenate(scene.path.arrays), corners, rtol=0, atol=1e-15)
    assert scene.path.labels == tuple(labels.split())
    assert len(scene.path.paths) == 1 + band.count(",")
    assert Scene.from_text(scene.to_yaml()) == scene
    named = read(
        f"lattice: {lattice}",
        rest=f"phonopy: {{band: '{band}', band_labels: {' '.join(labels.lower().split())}}}",
    )
    assert named.path == BandPath(scene.path.paths, tuple(labels.lower().split()))


@pytest.mark.parametrize("lattice", LATTICES)
def test_the_paths_that_an_error_names_are_taken(lattice):
    with pytest.raises(SceneError) as caught:
        read(f"lattice: {lattice}", rest="phonopy: {band: 0 0 0}")
    told = re.search(
        r"letters .*such as (.+), or points .* such as '(.*)'; a comma",
        str(caught.value),
    )
    for band in told.groups():
        path = read(
            f"lattice: {lattice}", rest=f"observe: [bands]\nphonopy: {{band: '{band}'}}"
        ).path
        assert path.labels == (None if " " in band else tuple(band.replace(",", "")))


def test_torsion_belongs_to_the_lattices_of_a_sweep():
    scene = read("torsion: 0.02", rest="sweep: {lattice: [fcc, hcp]}")
    assert [state.packing.torsion for _, state in scene.states()] == [0.02, 0.02]


# -- the direction of sound ------------------------------------------------------------------------

WAYS = ((1.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1 / 3, 1.0, -2.0))


def test_the_description_of_many_directions_counts_those_it_does_not_name():
    ways = "[1 0 0, 0 1 0, 0 0 1, 1 1 0, 1 0 1]"
    rows = describe_scene(read("lattice: fcc", "force: 5 N", f"direction: {ways}"))
    assert [name for name, _ in rows].count("direction") == 4
    assert dict(rows)["further directions"] == "1"


def test_the_direction_of_a_scene_is_that_of_its_velocities(tmp_path):
    scene = read("lattice: fcc", "force: 5 N", "direction: 1 1 0")
    assert (scene.direction, scene.directions) == (WAYS[0], WAYS[:1])
    assert Scene.from_text(scene.to_yaml()) == scene
    expected = gp.sound_velocities(scene.state(), WAYS[0])
    found = scene.run(tmp_path / "one", figures=False)
    for name in ("longitudinal", "transverse_slow", "transverse_fast"):
        assert (
            getattr(found.velocities, name)
            == getattr(expected, name)
            != getattr(gp.sound_velocities(scene.state(), WAYS[1]), name)
        )
    told = read_summary(tmp_path / "one")
    assert_allclose(told["direction"], [0.5**0.5, 0.5**0.5, 0], rtol=1e-15)
    assert told["transverse_slow"] == expected.transverse_slow
    assert dict(describe_scene(scene))["direction"] == "1, 1, 0"
    assert dict(describe_result(found))["slow transverse velocity"].endswith(
        "m/s along (0.707107, 0.707107, 0)"
    )
    # along x, as before, if none is given
    bare = read("lattice: fcc", "force: 5 N").run(tmp_path / "x", figures=False)
    assert read_summary(tmp_path / "x")["direction"] == [1.0, 0.0, 0.0]
    assert bare.velocities.longitudinal == gp.sound_velocities(scene.state(), WAYS[1]).longitudinal


def test_a_sweep_without_a_direction_says_that_sound_is_along_x(tmp_path):
    result = read("lattice: sc", "force: [1 N, 2 N]").run(tmp_path / "sc", figures=False)
    assert read_summary(tmp_path / "sc")["direction"] == [1.0, 0.0, 0.0]
    assert dict(describe_result(result))["longitudinal velocity"].endswith(" along (1, 0, 0)")
    read("lattice: triangular", "force: [1 N, 2 N]").run(tmp_path / "plane", figures=False)
    assert "direction" not in read_summary(tmp_path / "plane")


def test_lattices_of_one_name_cannot_be_swept(steel):
    one, other = (
        gp.Lattice("mine", cell=cell) for cell in (np.eye(3), math.sqrt(0.5) * (1.0 - np.eye(3)))
    )
    with pytest.raises(InputError, match="'mine'"):
        gp.sweep(gp.Packing(steel, 8e-3, lattice="fcc"), force=[1.0], lattice=[one, other])


def test_a_scene_simulates_the_torsion_of_hertz_contacts():
    packing = "lattice: fcc, torsion: mindlin, spread: {uniform: 1 um}"
    scene = read(packing, "force: 5 N", "medium: {simulation: {shape: 2 2 2}}")
    state = scene.state()
    assert state.packing.torsion == "mindlin"
    assert float(state.torsion) > 0.0
    # a simulation has no terms of finite overlap that could be asked for
    (told,) = [text for text in gp.validity(state).warnings if "torsion" in text]
    assert "finite_overlap" not in told
    (told,) = [
        text
        for text in gp.validity(read(packing, "force: 5 N").state()).warnings
        if "torsion" in text
    ]
    assert "finite_overlap=True keeps" in told


def test_counts_of_a_sweep_are_singular_where_they_are_one():
    for more, wanted in (
        ("sweep: {lattice: [fcc]}", "1 load x 1 medium x 1 value of lattice = 1 state"),
        ("sweep: {lattice: [fcc, hcp]}", "1 load x 1 medium x 2 values of lattice = 2 states"),
        (
            "medium: [ala, afa]\nsweep: {torsion: [0, 0.1]}",
            "1 load x 2 media x 2 values of torsion = 4 states",
        ),
    ):
        assert dict(describe_scene(read("lattice: fcc", "force: 5 N", more)))["sweep"] == wanted


def test_a_warning_of_many_cases_of_a_sweep_is_said_once(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc", torsion="mindlin")
    data = gp.sweep(packing, pressure=[1e5, 1e6], lattice=["fcc", "bcc"], media=("ala", "afa"))
    (told,) = json.loads(data.attrs["warnings"])
    assert re.search("all 8 states .* 414.4 % of the torsion", told)


def test_many_directions_of_a_scene(tmp_path):
    scene = read("lattice: fcc", "force: 5 N", "direction: [[1, 1, 0], 1 0 0, [1/3, 1, -2]]")
    assert scene.direction == scene.directions == WAYS
    assert Scene.from_text(scene.to_yaml()) == scene
    expected = gp.sound_velocities(scene.state(), WAYS)
    found = scene.run(tmp_path / "many", figures=False)
    told = read_summary(tmp_path / "many")
    assert told["direction"] == expected.direction.tolist()
    for name in ("longitudinal", "transverse_slow", "transverse_fast"):
        assert told[name] == getattr(expected, name).tolist()
    told = dict(describe_result(found))["longitudinal velocity"]
    assert re.fullmatch(r"719\.26 m/s to [0-9.]+ m/s along 3 directions", told)


@pytest.mark.parametrize(
    ("lattice", "ways"),
    [
        ("fcc", WAYS),
        pytest.param("square", ((1.0, 1.0), (0.0, 1.0)), marks=pytest.mark.slow),
        pytest.param("triangular", ((0.5, 1.0), (3.0, 4.0)), marks=pytest.mark.slow),
    ],
)
def test_a_sweep_has_its_directions_as_a_dimension(lattice, ways, tmp_path):
    text = scene_text(
        f"lattice: {lattice}",
        "force: [5 N, 9 N]",
        f"direction: {[list(one) for one in ways]}\nsweep: {{bending: [0, 0.1]}}",
    )
    scene = Scene.from_text(text)
    result = scene.run(tmp_path / "s", figures=False)
    data = gp.load_sweep(tmp_path / "s" / "sweep.nc")
    assert data.identical(result.dataset)
    names = [
        name
        for name in ("longitudinal", "transverse", "transverse_slow", "transverse_fast")
        if name in data
    ]
    expected = gp.sound_velocities(
        gp.AveragedLattice(scene.packing).at_force(np.array([5.0, 9.0])), ways
    )
    for name in names:
        assert data[name].dims == ("load", "medium", "bending", "direction")
        for place in (0, 1):  # bending does not change the sound of one ball in a cell
            assert_allclose(data[name].values[:, 0, place], getattr(expected, name), rtol=1e-14)
    assert data["valid"].dims == data["exponent"].dims == ("load", "medium", "bending")
    assert data["direction"].values.tolist() == [
        f"({', '.join(f'{x:g}' for x in one)})" for one in ways
    ]
    assert data.attrs["direction"] == f"{', '.join(data['direction'].values)}, Cartesian"
    told = read_summary(tmp_path / "s")
    assert told["direction"] == [list(one) for one in ways]
    assert told["sizes"] == {"load": 2, "medium": 1, "bending": 2, "direction": len(ways)}
    with (tmp_path / "s" / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * len(ways)
    last = rows[-1]
    assert (last["direction"], float(last["longitudinal (m/s)"])) == (
        data["direction"].values[-1],
        data["longitudinal"].values[-1, 0, -1, -1],
    )
    assert [row["direction"] for row in rows[: len(ways)]] == data["direction"].values.tolist()
    # the same sweep goes on from its file; another direction is another sweep
    assert is_complete(scene, tmp_path / "s")
    assert not is_complete(
        Scene.from_text(text.replace("direction: [[", "direction: [[-")), tmp_path / "s"
    )


def test_one_direction_of_a_sweep_is_told_in_its_files(tmp_path):
    result = read("lattice: fcc", "force: [5 N, 9 N]", "direction: [1, 1, 0]").run(
        tmp_path / "s", figures=False
    )
    data = gp.load_sweep(tmp_path / "s" / "sweep.nc")
    assert data["longitudinal"].dims == ("load", "medium")
    assert (str(data["direction"].values), data.attrs["direction"]) == (
        "(1, 1, 0)",
        "(1, 1, 0), Cartesian",
    )
    state = gp.AveragedLattice(
        gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice="fcc")
    ).at_force(9.0)
    assert data["transverse_slow"].values[1, 0] == pytest.approx(
        gp.sound_velocities(state, (1, 1, 0)).transverse_slow, rel=1e-14
    )
    assert read_summary(tmp_path / "s")["direction"] == [1.0, 1.0, 0.0]
    with (tmp_path / "s" / "sweep.csv").open() as file:
        assert {row["direction"] for row in csv.DictReader(file)} == {"(1, 1, 0)"}
    assert dict(describe_result(result))["longitudinal velocity"].endswith(" m/s along (1, 1, 0)")


def test_directions_in_a_sweep_with_a_simulation_and_its_figure(tmp_path):
    scene = read(
        "lattice: triangular, spread: {uniform: 2 um}",
        "force: [5 N, 9 N]",
        "direction: [[0, 1], [1, 0]]\nmedium: [ema, {simulation: {shape: 4 4, samples: 2}}]",
    )
    result = scene.run(tmp_path / "s", figures=False)
    data = result.dataset
    for name in ("longitudinal", "longitudinal_error"):
        assert data[name].dims == ("load", "medium", "direction")
        # the triangular lattice is isotropic
        assert_allclose(data[name][..., 0], data[name][..., 1], rtol=1e-12)
    assert np.all(data["longitudinal_error"].values[:, 0] == 0.0)
    assert np.all(data["longitudinal_error"].values[:, 1] > 0.0)
    lines = {line.get_gid() for ax in result.figure("sweep.png").axes for line in ax.lines}
    assert {"longitudinal-valid", "exponent-valid"} <= lines


def test_a_sweep_in_python_takes_directions():
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice="hcp")
    near = gp.sweep(packing, force=[5.0], direction=[(0.0, 0.0, 1.0), (0.0, 1e-9, 1.0)])
    assert near["direction"].values.tolist() == ["(0, 0, 1)", "(0, 1e-09, 1)"]
    for bad, text in (
        ((1, 0), "three finite numbers"),
        ((0, 0, 0), "not all zero"),
        ([(1, 0, 0), (2, 0, 0)], "twice"),
    ):
        with pytest.raises(InputError, match=text):
            gp.sweep(packing, force=[5.0], direction=bad)


# -- mistakes --------------------------------------------------------------------------------------


def test_mistakes_in_python(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc")
    with pytest.raises(InputError, match="three whole numbers"):
        Scene(packing, Load("force", 1.0), mesh=(8, 8))
    with pytest.raises(InputError, match="third number"):
        Scene(gp.Packing(steel, 8e-3), Load("force", 1.0), band=BandPath.parse("0 0 0 1/2 1/2 1/2"))
    with pytest.raises(
        InputError,
        match=r"dimension.*square.*fcc",
    ):
        gp.sweep(packing, force=1.0, lattice=["fcc", "square"])
    with pytest.raises(InputError, match=r"bands .*motions"):
        gp.sweep(gp.Packing(steel, 8e-3), force=1.0, bands="GK", motions=["in_plane", "all"])


# -- running ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param("chain", marks=pytest.mark.slow),
        "membrane",
        pytest.param("fcc", marks=pytest.mark.slow),
        pytest.param("hcp", marks=pytest.mark.exhaustive),
    ],
)
def test_presets_of_each_dimension_run(tmp_path, monkeypatch, capsys, preset):
    monkeypatch.chdir(tmp_path)
    assert preset in PRESETS
    assert main(["init", "--preset", preset]) == 0
    assert main(["check", "scene.yaml"]) == 0
    out, err = capsys.readouterr()
    assert "can be run" in out
    assert err == ""
    text = Path("scene.yaml").read_text()
    scene = Scene.from_text(text)
    # as it is, but on fewer points
    points = f"band_points: {scene.band_points}"
    mesh = " ".join(map(str, scene.mesh))
    assert f"mesh: {mesh}" in text
    coarse = " ".join(["6"] * len(scene.mesh))
    Path("small.yaml").write_text(
        text.replace(points, "band_points: 3").replace(f"mesh: {mesh}", f"mesh: {coarse}")
    )
    assert main(["run", "small.yaml", "-o", "out", "--no-figures"]) == 0
    assert {"band.yaml", "phonopy_params.yaml", "dos.csv"} <= {
        path.name for path in Path("out").iterdir()
    }
    out = capsys.readouterr().out
    summary = read_summary(Path("out"))
    assert summary["units"]["pressure"] == {"chain": "N", "membrane": "N/m"}.get(preset, "Pa")
    assert ("Longitudinal".lower() in out) == (preset != "membrane")
    if preset == "fcc":
        assert "654.11 m/s along (1, 0, 0)" in out


@pytest.mark.parametrize("preset", ["chain", "membrane", "fcc", "hcp"])
def test_what_is_commented_out_in_a_preset_is_right_too(preset):
    text = write_preset(preset)
    lines = text.splitlines()
    own, *others = [
        at for at, line in enumerate(lines) if re.match(r" +(# )?(force|pressure|overlap):", line)
    ]
    force = Scene.from_text(text).state().force
    assert others
    for other in others:
        changed = [*lines[:own], lines[other].replace("# ", "", 1), *lines[own + 1 :]]
        assert Scene.from_text("\n".join(changed)).state().force == pytest.approx(force, rel=0.2)
    for key in ("yield_strength", "dim", "torsion", "bending", "band"):
        plain = text.replace(f"# {key}:", f"{key}:").replace(
            "# band_labels:", "band_labels:" if key == "band" else "#"
        )
        assert (
            Scene.from_text(plain).packing.structure.name
            == Scene.from_text(text).packing.structure.name
        )


@pytest.mark.parametrize("preset", ["membrane", "fcc", "hcp"])
def test_the_lattices_that_a_preset_names_can_take_the_place_of_its_own(preset):
    text = write_preset(preset)
    own, *others = re.findall(r"^  (?:# )?lattice: (\w+)", text, re.M)
    assert others
    for name in others:
        Scene.from_text(text.replace(f"lattice: {own} ", f"lattice: {name} "))


def test_the_motions_that_the_preset_of_a_chain_names_can_take_the_place_of_its_own():
    text = (Path(gp.__file__).parent / "data" / "chain.yaml").read_text()
    for motions in ("in_plane", "out_of_plane", "longitudinal"):
        changed = text.replace("motions: all", f"motions: {motions}")
        if motions != "out_of_plane":
            changed = changed.replace("torsion: 0.02", "torsion: 0")
        if motions == "longitudinal":
            changed = changed.replace("bending: 0.02", "bending: 0")
        assert Scene.from_text(changed).packing.ball_motions.name == motions


def test_a_mechanism_has_bands_and_says_why_it_has_no_velocities(tmp_path):
    scene = read(
        "lattice: square, friction: false", rest="observe: [bands]\nphonopy: {band_points: 3}"
    )
    result = scene.run(tmp_path / "out", figures=False)
    assert result.velocities is None
    assert result.bands.frequencies.shape == (3, 3, 2)
    assert any(text.startswith("velocities and moduli ") for text in result.warnings)
    summary = read_summary(tmp_path / "out")
    assert "longitudinal" not in summary
    assert summary["warnings"] == list(result.warnings)
    with pytest.raises(SceneError, match=r"found 'square'.*rigid"):
        read("lattice: square, friction: false")


def test_a_sweep_of_a_mechanism_has_bands_only(steel, tmp_path):
    packing = gp.Packing(steel, 8e-3, lattice="square", friction=False)
    with pytest.raises(MechanismError):
        gp.sweep(packing, force=[1.0, 2.0])
    data = gp.sweep(packing, force=[1.0, 2.0], bands="GX", npoints=3, path=tmp_path / "sweep.nc")
    assert "longitudinal" not in data
    assert data["frequencies"].shape == (2, 1, 1, 3, 2)
    assert "left out" in data.attrs["warnings"]
    assert gp.sweep(
        packing, force=[1.0, 2.0], bands="GX", npoints=3, path=tmp_path / "sweep.nc", resume=True
    ).equals(data)
    scene = read(
        "lattice: square, friction: false",
        "force: [1 N, 2 N]",
        "observe: [bands]\nphonopy: {band_points: 3}",
    )
    result = scene.run(tmp_path / "out", figures=False)
    assert result.figure("sweep.png").axes
    assert any("mechanism" in text for text in result.warnings)


# -- sweeps ----------------------------------------------------------------------------------------


def test_a_sweep_over_lattices_of_space(steel, tmp_path):
    names = ["sc", "bcc", "fcc", "hcp"]
    data = gp.sweep(
        gp.Packing(steel, 8e-3),
        pressure=[1e4, 1e5],
        lattice=names,
        torsion=[0.0, 0.05],
        path=tmp_path / "s.nc",
    )
    assert data["longitudinal"].dims == ("load", "medium", "lattice", "torsion")
    assert data["pressure"].attrs["units"] == "Pa"
    assert data["effective_density"].attrs["units"] == "kg/m^3"
    assert data["tensor"].shape == (2, 1, 4, 2, 6, 6)
    assert list(data["voigt_row"].values) == ["xx", "yy", "zz", "yz", "xz", "xy"]
    assert data.attrs["direction"].startswith("(1, 0, 0)")
    assert "transverse" not in data
    for name in names:
        for torsion in (0.0, 0.05):
            packing = gp.Packing(steel, 8e-3, lattice=name, torsion=torsion)
            v = gp.sound_velocities(gp.AveragedLattice(packing).at_pressure([1e4, 1e5]), (1, 0, 0))
            here = data.sel(lattice=name, torsion=torsion, medium="ala")
            assert np.array_equal(here["longitudinal"], v.longitudinal)
            assert np.array_equal(
                np.stack([here["transverse_slow"], here["transverse_fast"]], axis=-1), v.transverse
            )
    # Duffy and Mindlin's constants: C11 = sqrt 2 (k + kappa)/d = 2 C44 along the cube's edge
    here = data.sel(lattice="fcc", torsion=0.0, medium="ala")
    stiffness = (here["normal_stiffness"] + here["shear_stiffness"]).values
    longitudinal = np.sqrt(math.sqrt(2.0) * stiffness / 8e-3 / here["effective_density"].values)
    assert here["longitudinal"].values == pytest.approx(longitudinal, rel=1e-13)
    assert here["transverse_slow"].values == pytest.approx(longitudinal / math.sqrt(2.0), rel=1e-13)
    with (tmp_path / "s.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0][0] == "pressure (Pa)"
    assert len(rows) == 1 + 2 * 4 * 2
    assert {"transverse_slow (m/s)", "transverse_fast (m/s)"} <= set(rows[0])


def test_a_sweep_over_motions_of_a_chain(steel):
    packing = gp.Packing(steel, 8e-3, lattice="chain")
    data = gp.sweep(packing, pressure=[1.0, 2.0], motions=["longitudinal", "in_plane", "all"])
    assert (data["pressure"].attrs["units"], data["bulk"].attrs["units"]) == ("N", "N")
    assert data["effective_density"].attrs["units"] == "kg/m"
    assert list(data["motions"].values) == ["longitudinal", "in_plane", "all"]
    # v = d (k/M)^1/2, and the modulus k d
    state = gp.AveragedLattice(packing).at_pressure([1.0, 2.0])
    exact = 8e-3 * np.sqrt(state.normal_stiffness / packing.mass)
    for motions in data["motions"].values:
        here = data.sel(motions=motions, medium="ala")
        assert here["longitudinal"].values == pytest.approx(exact, rel=1e-14)
        assert here["bulk"].values == pytest.approx(state.normal_stiffness * 8e-3, rel=1e-14)


def test_a_sweep_over_motions_says_which_quantities_some_of_them_lack(steel):
    packing = gp.Packing(steel, 8e-3)
    data = gp.sweep(
        packing,
        force=[1.0, 2.0],
        motions=["in_plane", "out_of_plane", "all"],
    )
    plane = gp.sweep(packing, force=[1.0, 2.0])
    for name in ("longitudinal", "transverse", "bulk", "shear"):
        for motions in ("in_plane", "all"):
            np.testing.assert_allclose(data[name].sel(motions=motions), plane[name], rtol=1e-14)
        assert np.all(np.isnan(data[name].sel(motions="out_of_plane")))
    assert np.all(np.isnan(data["out_of_plane"].sel(motions="in_plane")))
    assert np.all(data["out_of_plane"].sel(motions=["out_of_plane", "all"]) == 0.0)
    warnings = json.loads(data.attrs["warnings"])
    assert [text.partition(" nan")[0] for text in warnings] == [
        "motions in_plane: out_of_plane is",
        "motions out_of_plane: longitudinal, transverse, bulk, shear are",
    ]


def test_a_file_whose_numbers_are_nan_is_not_damaged(steel, tmp_path, monkeypatch):
    """Also if another program has rewritten it: a sound file, which needs no trial elsewhere."""
    monkeypatch.setattr(dataset, "_require_openable", lambda *_: None)
    path = tmp_path / "sweep.nc"
    packing = gp.Packing(steel, 8e-3)
    data = gp.sweep(packing, force=1.0, motions=["in_plane", "out_of_plane"], path=path)
    assert np.isnan(data["longitudinal"]).any()
    assert data.equals(gp.load_sweep(path))
    path.write_bytes(dataset.netcdf_bytes(data))
    with pytest.warns(UnverifiedFileWarning):
        assert data.equals(gp.load_sweep(path))


def test_crystals_whose_balls_adhere_or_bear_gravity_alone_are_not_damaged(steel):
    """The forces of a packing alone are above zero."""
    crystal = gp.Crystal.on("triangular", [gp.Ball(steel, 8e-3)], law=gp.DMT(5.0))
    adhering = gp.sweep(crystal, overlap=[1e-9, 1e-7])
    assert adhering["force"].values[0, 0] < 0.0
    heap = gp.Crystal.on("triangular", [gp.Ball(steel, 8e-3)]).cut(1, 4, ("floor", "free"))
    heavy = gp.sweep(heap, load=Load("pressure", [0.0, 1.0], gravity=9.81))
    for data in (adhering, heavy):
        dataset._require_plausible("x.nc", data)
    packing = gp.sweep(gp.Packing(steel, 8e-3), force=1.0)
    with pytest.raises(InputError, match="force"):
        dataset._require_plausible("x.nc", packing.assign_coords(force=("load", [-1.0])))


def test_a_figure_leaves_out_what_is_nan(steel):
    packing = gp.Packing(steel, 8e-3)
    data = gp.sweep(packing, force=[1.0, 2.0], motions=["in_plane", "out_of_plane"])
    figure = sweep_figure(data)
    assert {text.get_text() for text in figure.axes[0].texts} == {"$v_L$", "$v_T$"}
    assert all(np.all(np.isfinite(text.xy)) for text in figure.axes[0].texts)


def test_a_tensor_stands_for_the_shear_modulus_where_one_lattice_is_not_isotropic(steel):
    packing = gp.Packing(steel, 8e-3)
    mixed = gp.sweep(packing, force=1.0, lattice=["square", "triangular"])
    assert "tensor" in mixed
    assert "bulk" in mixed
    assert "shear" not in mixed
    assert json.loads(mixed.attrs["warnings"]) == []


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"friction": False, "lattice": ["fcc", "diamond"]},
            r"^ala, lattice = diamond: .*mechanism",
        ),
        (
            {"lattice": ["triangular"], "motions": ["in_plane", "all"], "finite_overlap": True},
            "^ala, lattice = triangular, motions = all: .*buckles",
        ),
    ],
)
def test_a_sweep_without_sound_leaves_nothing_behind(steel, tmp_path, given, told):
    packing = gp.Packing(
        steel, 8e-3, lattice=given["lattice"][0], friction=given.pop("friction", True)
    )
    with pytest.raises((MechanismError, InstabilityError), match=told):
        gp.sweep(packing, force=[1.0, 2.0], path=tmp_path / "sweep.nc", **given)
    assert not list(tmp_path.iterdir())


def test_a_sweep_over_torsion_may_have_a_word_among_its_values(steel, tmp_path):
    packing = gp.Packing(steel, 8e-3, lattice="hcp")
    data = gp.sweep(
        packing,
        force=[1.0, 8.0],
        torsion=[0.0, "mindlin"],
        bands="GA",
        npoints=3,
        path=tmp_path / "t.nc",
    )
    assert list(data["torsion"].values) == ["0.0", "mindlin"]
    assert "units" not in data["torsion"].attrs
    frequencies = data["frequencies"].values[:, 0]
    scaled = frequencies / np.sqrt(data["normal_stiffness"].values[:, 0])[..., None, None, None]
    # torsion of a Hertz contact changes with the load, and so do the branches in reduced units
    assert scaled[0, 0] == pytest.approx(scaled[1, 0], rel=1e-12, abs=1e-9 * scaled.max())
    assert np.max(np.abs(scaled[0, 1] - scaled[1, 1])) > 1e-6 * scaled.max()
    for n, force in enumerate((1.0, 8.0)):
        state = gp.AveragedLattice(
            gp.Packing(steel, 8e-3, lattice="hcp", torsion="mindlin")
        ).at_force(force)
        exact = gp.Phonons(state).frequencies(data["qpoints"].values[0])
        assert frequencies[n, 1, 0] == pytest.approx(exact, rel=1e-12, abs=1e-9 * exact.max())
    again = gp.sweep(
        packing,
        force=[1.0, 8.0],
        torsion=[0.0, "mindlin"],
        bands="GA",
        npoints=3,
        path=tmp_path / "t.nc",
        resume=True,
    )
    assert again.equals(data)


def test_motions_are_judged_by_the_lattices_of_a_sweep_and_not_by_the_packings_own():
    # its balls may have all motions only
    flat = "lattice: {name: flat, cell: [[1, 0, 0], [0, 1, 0]], sites: [[0, 0, 0]]}"
    scene = read(flat, rest="sweep: {lattice: [triangular, square], motions: [in_plane, all]}")
    assert dict(scene.parameters)["motions"] == ("in_plane", "all")


def test_a_scene_sweeps_lattices_of_another_dimension_than_its_packing(tmp_path):
    scene = read(
        "friction: true",
        "pressure: [10 kPa, 20 kPa]",
        "sweep: {lattice: [fcc, hcp], bending: [0, 0.1]}",
    )
    assert scene.packing.lattice == "fcc"
    assert Scene.from_text(scene.to_yaml()) == scene
    result = scene.run(tmp_path / "out", figures=False)
    assert result.summary()["sizes"] == {"load": 2, "medium": 1, "lattice": 2, "bending": 2}
    assert read_summary(tmp_path / "out")["units"]["transverse_slow"] == "m/s"


@pytest.mark.parametrize("lattice", RIGID)
def test_equal_balls_are_the_same_in_every_medium(steel, lattice):
    packing = gp.Packing(steel, 8e-3, lattice=lattice)
    data = gp.sweep(packing, pressure=[1.0, 1e3], media=("ala", "afa", "ema", "auto"))
    for name, values in data.data_vars.items():
        if name not in ("choice", "expected_error"):
            first = values.isel(medium=[0] * 4)
            assert np.array_equal(values.values, first.values), name


# -- fits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "branch"),
    [
        ("chain", "longitudinal"),
        ("kagome", "transverse"),
        ("fcc", "transverse_slow"),
        ("hcp", "transverse_fast"),
    ],
)
def test_the_young_modulus_of_equal_balls_is_fitted_on_every_lattice(steel, lattice, branch):
    true = gp.Packing(steel, 8e-3, lattice=lattice)
    force = np.geomspace(1.0, 30.0, 5)
    direction = np.arange(1.0, true.structure.periods + 1.0)
    measured = getattr(
        gp.sound_velocities(gp.AveragedLattice(true).at_force(force), direction), branch
    )
    start = gp.Packing(gp.Material(150e9, 0.276, 7840.0), 8e-3, lattice=lattice)
    fit = gp.fit_width(
        start,
        force,
        measured,
        1.0,
        parameters=("young_modulus",),
        branch=branch,
        direction=direction,
        medium="ema",
    )
    assert fit.values[0] == pytest.approx(steel.young_modulus, rel=1e-10)
    assert (fit.width, fit.stderr, fit.medium) == (0.0, 0.0, "ala")
    # v goes as E^(1/3): the standard error of n velocities of sigma 1 m/s
    assert fit.stderrs[0] / fit.values[0] == pytest.approx(
        3.0 / math.sqrt(float(np.sum(measured**2))), rel=1e-9
    )
    assert type(fit).from_dict(fit.to_dict()).to_dict() == fit.to_dict()


def test_fits_that_a_lattice_does_not_have(steel):
    def fit(**more):
        return gp.fit_width(
            gp.Packing(steel, 8e-3, lattice="fcc"), [1.0, 2.0, 4.0], [500.0, 560.0, 630.0], **more
        )

    with pytest.raises(InputError, match=r"fcc .*transverse"):
        fit(branch="transverse", parameters=("young_modulus",))
    with pytest.raises(InputError, match="three finite numbers"):
        fit(direction=(0, 1), parameters=("young_modulus",))
    with pytest.raises(MechanismError, match="sc is a mechanism"):
        gp.fit_width(
            gp.Packing(steel, 8e-3, lattice="sc", friction=False),
            [1.0, 2.0],
            [500.0, 560.0],
            direction=(1, 0, 0),
        )
    with pytest.raises(InputError, match="young_modulus and diameter"):
        fit(parameters=("young_modulus", "diameter"))


def test_the_command_line_fits_a_crystal(tmp_path, monkeypatch, capsys, steel):
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(scene_text("lattice: fcc", "pressure: 1 MPa"))
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="fcc")).at_pressure([1e5, 1e6, 4e6])
    v = gp.sound_velocities(state, (1, 1, 0)).transverse_slow
    rows = "\n".join(f"{p},{x!r}" for p, x in zip((100, 1000, 4000), v.tolist(), strict=True))
    Path("data.csv").write_text(f"pressure (kPa),velocity (m/s)\n{rows}\n")
    asked = [
        "--no-width",
        "--parameter",
        "young_modulus",
        "--sigma",
        "1 m/s",
        "--branch",
        "transverse_slow",
    ]
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "1 1 0", "-o", "out"]) == 0
    out = capsys.readouterr().out
    assert "Young modulus         211.65 +/- 0.57 GPa" in out
    assert "width" not in out
    assert {"fit.yaml", "fit.csv", "fit.png"} <= {path.name for path in Path("out").iterdir()}
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "up"]) == 2
    assert "--direction: found 'up'" in capsys.readouterr().err
    Path("data.csv").write_text("pressure (N/m),velocity (m/s)\n1000,500\n2000,560\n")
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "1 1 0"]) == 2
    assert "force per area" in capsys.readouterr().err


def test_a_fit_takes_the_direction_of_its_scene(tmp_path, monkeypatch, capsys, steel):
    monkeypatch.chdir(tmp_path)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="hcp")).at_force([1.0, 10.0, 100.0])
    v = gp.sound_velocities(state, (1, 0, 0)).longitudinal.tolist()
    rows = "".join(f"{f},{x!r}\n" for f, x in zip((1, 10, 100), v, strict=True))
    Path("data.csv").write_text(f"force (N),velocity (m/s)\n{rows}")
    asked = ["data.csv", "--no-width", "--parameter", "young_modulus"]

    def fit(rest, *more):
        Path("s.yaml").write_text(scene_text("lattice: hcp", "force: 1 N", rest=rest))
        code, told = main(["fit", "s.yaml", *asked, *more]), capsys.readouterr()
        return code, told.out, told.err

    code, out, err = fit("direction: [2, 0, 0]")
    assert code == 0
    assert "depends on the direction" not in err
    assert "Young modulus         211.65 GPa" in out
    assert "direction             (1, 0, 0)" in out
    code, out, err = fit("")
    assert code == 0
    assert "direction             (0, 0, 1)" in out
    assert re.search(r"hcp .*direction.* \(0, 0, 1\)", err)
    code, _, err = fit("direction: [[1, 0, 0], [0, 0, 1]]")
    assert code == 2
    assert "s.yaml has 2 directions" in err
    Path("s.yaml").write_text(scene_text("lattice: hcp"))
    assert main(["fit", "s.yaml", "data.csv", "--no-width"]) == 2
    assert "--no-width" in capsys.readouterr().err
    code, out, err = fit("direction: [[1, 0, 0], [0, 0, 1]]", "--direction", "1 0 0")
    assert (code, "direction" in err) == (0, False)
    assert "211.65 GPa" in out


def test_a_sweep_says_which_branches_cost_nothing(steel):
    chain = gp.sweep(
        gp.Packing(steel, 8e-3, lattice="chain", motions="all"),
        force=[1.0, 2.0],
        bands="GX",
        npoints=3,
    )
    assert "3 of 6 branches" in chain.attrs["warnings"]
    square = gp.sweep(
        gp.Packing(steel, 8e-3, lattice="square"), force=[1.0, 2.0], bands="GXM", npoints=3
    )
    assert "the first at q = (0.5, 0.5)" in square.attrs["warnings"]
    still = gp.sweep(gp.Packing(steel, 8e-3, lattice="chain", motions="all"), force=[1.0, 2.0])
    assert still.attrs["warnings"].count("3 of 6 branches vanish") == 1
    held = gp.sweep(
        gp.Packing(steel, 8e-3, lattice="chain", motions="all", torsion=0.1, bending=0.1),
        force=[1.0, 2.0],
    )
    assert held.attrs["warnings"] == "[]"


def test_a_scene_of_velocities_says_which_branches_cost_nothing(tmp_path):
    result = read("lattice: chain, motions: all", rest="observe: [velocities]").run(
        tmp_path / "out"
    )
    (text,) = result.warnings
    assert text.startswith("3 of 6 branches")
    assert read_summary(tmp_path / "out")["warnings"] == [text]
