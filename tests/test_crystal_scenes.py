"""Scenes, sweeps, fits and the command line over lattices of one, two and three dimensions."""

from __future__ import annotations

import csv
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import InputError, MechanismError, SceneError
from granphon.base.text import parse_yaml
from granphon.cli.commands import main
from granphon.cli.scenes import PRESETS
from granphon.phonons.paths import BandPath
from granphon.scene.scene import Load, Scene

MATERIAL = "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}"
#: lattices that hold their shape with the motions that they have by default
RIGID = ("chain", "triangular", "square", "kagome", "sc", "bcc", "fcc", "hcp")


def scene_text(packing: str, load: str = "force: 1 N", rest: str = "") -> str:
    return f"{MATERIAL}\npacking: {{diameter: 8 mm, {packing}}}\nload: {{{load}}}\n{rest}"


def read(packing: str, load: str = "force: 1 N", rest: str = "") -> Scene:
    return Scene.from_text(scene_text(packing, load, rest), "s.yaml")


def read_summary(folder: Path):
    return parse_yaml((folder / "summary.yaml").read_text(), "summary.yaml").data


# -- what a scene says ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LATTICES)
def test_a_scene_names_every_lattice(name):
    scene = read(f"lattice: {name}", rest="observe: [bands]")
    assert scene.packing.structure == LATTICES[name]
    assert len(scene.grid) == LATTICES[name].periods
    assert scene.path == BandPath.default(LATTICES[name])
    assert Scene.from_text(scene.to_yaml()) == scene


def test_motions_and_stiffnesses_are_read_and_written_where_they_differ_from_the_defaults():
    scene = read("lattice: chain, motions: all, torsion: mindlin, bending: 0.125")
    assert (scene.packing.motions, scene.packing.torsion, scene.packing.bending) == ("all", "mindlin", 0.125)
    written = scene.to_yaml()
    assert all(line in written for line in ('motions: "all"', 'torsion: "mindlin"', "bending: 0.125"))
    assert Scene.from_text(written) == scene
    plain = read("lattice: square").to_yaml()
    assert not any(word in plain for word in ("motions", "torsion", "bending"))


def test_a_lattice_of_ones_own_is_a_block():
    thirds = "[[1/3, 2/3], [2/3, 1/3]]"
    cell = f"[[{math.sqrt(3.0)!r}, 0], [{-math.sqrt(0.75)!r}, 1.5]]"
    scene = read(f"lattice: {{name: mine, cell: {cell}, sites: {thirds}}}, motions: out_of_plane, bending: 0.1")
    assert scene.packing.structure.contacts.normal == pytest.approx(LATTICES["honeycomb"].contacts.normal)
    assert Scene.from_text(scene.to_yaml()) == scene
    row = gp.Lattice("row in space", ((2.0, 0.0, 0.0),), ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)))
    ladder = Scene(gp.Packing(gp.Material(1e9, 0.3, 1e3), 1e-3, lattice=row), Load("force", 1.0), observe=("bands",))
    assert Scene.from_text(ladder.to_yaml()) == ladder


@pytest.mark.parametrize(
    ("lattice", "load", "force"),
    [
        ("chain", "2 N", 2.0), ("triangular", "2 kN/m", 2e3 * 8e-3 / math.sqrt(3.0)), ("square", "2 N/mm", 16.0),
        ("sc", "10 kPa", 1e4 * 64e-6), ("fcc", "0.1 bar", 1e4 * 64e-6 / (2.0 * math.sqrt(2.0))),
    ],
)  # fmt: skip
def test_a_pressure_has_the_unit_of_the_dimension(lattice, load, force):
    scene = read(f"lattice: {lattice}", f"pressure: {load}")
    assert scene.state().force == pytest.approx(force, rel=1e-14)
    assert Scene.from_text(scene.to_yaml()) == scene


@pytest.mark.parametrize(
    ("lattice", "mesh", "dim", "found"),
    [
        ("chain", "32", "3", ((32,), (3,))), ("chain", "32 1 1", "4 1 1", ((32,), (4,))),
        ("square", "8 4", "3 4", ((8, 4), (3, 4))), ("fcc", "8 4 6", "[3, 3, 4]", ((8, 4, 6), (3, 3, 4))),
    ],
)  # fmt: skip
def test_meshes_and_supercells_have_the_numbers_of_the_dimension(lattice, mesh, dim, found):
    scene = read(f"lattice: {lattice}", rest=f"phonopy: {{mesh: {mesh}, dim: {dim}}}")
    assert (scene.grid, scene.dim) == found
    assert Scene.from_text(scene.to_yaml()) == scene


# -- mistakes -------------------------------------------------------------------------------------------------------

#: packing, load, rest; then line and key, what was found, what is allowed, and what is meant
MISTAKES = {
    "unknown lattice": ("lattice: fccc", "", "", "2: packing.lattice", "'fccc'", "sc, bcc, fcc, hcp", "'fcc'?"),
    "balls overlap": (
        "lattice: {name: box, cell: [[0.5, 0], [0, 1]]}", "", "", "2: packing.lattice", "'box'", "do not overlap",
        "0.5 apart",
    ),
    "lattice without a cell": (
        "lattice: {name: box}", "", "", "2: packing.lattice.cell", "nothing", "a list of one or more", "",
    ),
    "motions in space": (
        "lattice: fcc, motions: in_plane", "", "", "2: packing.motions", "'in_plane'", "all; the fcc", "space",
    ),
    "motions in the plane": (
        "lattice: square, motions: longitudinal", "", "", "2: packing.motions", "'longitudinal'",
        "in_plane, out_of_plane, all", "in a plane",
    ),
    "motions misspelt": (
        "lattice: chain, motions: out of plane", "", "", "2: packing.motions", "plane'", "all", "'out_of_plane'?",
    ),
    "torsion without rotations": (
        "lattice: chain, torsion: 0.1", "", "", "2: packing.torsion", "0.1", "0 where balls do not rotate", "in_plane",
    ),
    "bending without rotations": (
        "lattice: chain, bending: 1", "", "", "2: packing.bending", "1", "0 where balls do not rotate", "in_plane",
    ),
    "negative torsion": (
        "lattice: fcc, torsion: -1", "", "", "2: packing.torsion", "-1", "zero or above, or mindlin", "",
    ),
    "torsion not a number": ("lattice: fcc, torsion: .nan", "", "", "2: packing.torsion", "nan", "a finite number", ""),
    "torsion misspelt": (
        "lattice: fcc, torsion: mindlim", "", "", "2: packing.torsion", "'mindlim'", "mindlin", "'mindlin'?",
    ),
    "negative bending": ("lattice: fcc, bending: -0.1", "", "", "2: packing.bending", "-0.1", "zero or above", ""),
    "infinite bending": ("lattice: fcc, bending: .inf", "", "", "2: packing.bending", "inf", "a finite number", ""),
    "bending with a unit": (
        "lattice: fcc, bending: 1 N m", "", "", "2: packing.bending", "'1 N m'", "a finite", "unit",
    ),
    "pressure of a plane in space": (
        "lattice: fcc", "pressure: 4 kN/m", "", "3: load.pressure", "'4 kN/m'", "a force per area", "is in Pa",
    ),
    "pressure of space in a plane": (
        "lattice: square", "pressure: 4 kPa", "", "3: load.pressure", "'4 kPa'", "a force per length", "is in N/m",
    ),
    "pressure of a plane on a chain": (
        "lattice: chain", "pressure: 4 N/m", "", "3: load.pressure", "'4 N/m'", "a force above zero", "is in N",
    ),
    "side force in space": (
        "lattice: fcc", "side_force: 1 N, balls_per_side: 3", "", "3: load.side_force", "a side_force", "triangular",
        "",
    ),
    "mesh of a plane in space": (
        "lattice: fcc", "", "phonopy: {mesh: 8 8}", "4: phonopy.mesh", "'8 8'", "three whole", "32 32 32",
    ),
    "mesh of a layer in space": (
        "lattice: fcc", "", "phonopy: {mesh: 8 8 1}", "4: phonopy.mesh", "'8 8 1'", "from 2 to", "",
    ),
    "mesh of space on a chain": (
        "lattice: chain", "", "phonopy: {mesh: 8 8 8}", "4: phonopy.mesh", "second number is 8", "one whole",
        "one row",
    ),
    "small supercell": ("lattice: fcc", "", "phonopy: {dim: 2 2 2}", "4: phonopy.dim", "2 2 2", "3 3 3 or more", ""),
    "path in space for a plane": (
        "lattice: square", "", "phonopy: {band: 0 0 0 0 0 1/2}", "4: phonopy.band", "a third number", "points",
        "one layer",
    ),
    "path of a plane for a chain": (
        "lattice: chain", "", "phonopy: {band: 0 0 0 0 1/2 0}", "4: phonopy.band", "a second number", "points",
        "one row",
    ),
    "lattices of two dimensions": (
        "lattice: fcc", "", "sweep: {lattice: [fcc, chain]}", "4: sweep.lattice", "['fcc', 'chain']", "one dimension",
        "sweep of each",
    ),
    "motions of a sweep": (
        "lattice: fcc", "", "sweep: {motions: [all, in_plane]}", "4: sweep.motions.1", "'in_plane'", "all", "in space",
    ),
    "negative torsion of a sweep": (
        "lattice: fcc", "", "sweep: {torsion: [0, -1]}", "4: sweep.torsion.1", "-1", "zero or above", "",
    ),
    "torsion of a chain of a sweep": (
        "lattice: chain", "", "sweep: {torsion: [0, 1]}", "4: sweep.torsion.1", "1",
        "a value that the packing can have", "rotation",
    ),
    "mechanism": (
        "lattice: diamond", "", "", "2: packing.lattice", "'diamond'", "a lattice that is rigid", "without a cost",
    ),
    "effective medium of a mechanism": (
        "lattice: sc, friction: false, spread: {uniform: 1 um}", "", "observe: [bands]\nmedium: ema", "5: medium", "'ema'",
        "a medium for this lattice", "Use friction",
    ),
    "simulation in space": (
        "lattice: fcc, spread: {uniform: 1 um}", "", "medium: simulation", "4: medium", "'simulation'",
        "a medium for this lattice", "not simulated",
    ),
    "choice of medium in space": (
        "lattice: hcp, spread: {uniform: 1 um}", "", "medium: auto", "4: medium", "'auto'", "a tolerance",
        "Name a medium",
    ),
    "bands of different motions": (
        "lattice: fcc, friction: false", "", "observe: [bands]\nsweep: {torsion: [0, 0.1]}", "4: observe", "torsion",
        "velocities", "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_error_and_nothing_is_written(tmp_path, monkeypatch, capsys, name):
    packing, load, rest, place, found, allowed, meant = MISTAKES[name]
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(scene_text(packing, load or "force: 1 N", rest))
    assert main(["run", "s.yaml", "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"granphon: error: s.yaml:{place}")
    assert error.count("\n") == 1
    head, _, tail = error.partition("; allowed: ")
    assert found in head
    assert allowed in tail
    assert meant in tail
    assert not Path("out").exists()


def test_the_lattice_is_read_before_what_depends_on_it():
    text = f"load: {{pressure: 10 kPa}}\n{MATERIAL}\npacking: {{diameter: 8 mm, lattice: fc}}\n"
    with pytest.raises(SceneError, match=r"s.yaml:3: packing.lattice: found 'fc'"):
        Scene.from_text(text, "s.yaml")


def test_mistakes_in_python(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc")
    with pytest.raises(InputError, match="three whole numbers"):
        Scene(packing, Load("force", 1.0), mesh=(8, 8))
    with pytest.raises(InputError, match="a third number that is not 0"):
        Scene(gp.Packing(steel, 8e-3), Load("force", 1.0), band=BandPath.parse("0 0 0 1/2 1/2 1/2"))
    with pytest.raises(
        InputError, match="lattices of different dimension in one sweep: square, in a plane, and fcc, in space"
    ):
        gp.sweep(packing, force=1.0, lattice=["fcc", "square"])
    with pytest.raises(InputError, match="bands cannot be swept over friction, motions or lattices"):
        gp.sweep(gp.Packing(steel, 8e-3), force=1.0, bands="GK", motions=["in_plane", "all"])


# -- running --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["chain", "membrane", "fcc", "hcp"])
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
    points, mesh = f"band_points: {scene.band_points}", " ".join(map(str, scene.grid))
    assert f"mesh: {mesh}" in text
    coarse = " ".join(["6"] * len(scene.grid))
    Path("small.yaml").write_text(text.replace(points, "band_points: 3").replace(f"mesh: {mesh}", f"mesh: {coarse}"))
    assert main(["run", "small.yaml", "-o", "out"]) == 0
    assert {"band.yaml", "phonopy_params.yaml", "dos.csv", "bands.png"} <= {path.name for path in Path("out").iterdir()}
    out = capsys.readouterr().out
    summary = read_summary(Path("out"))
    assert summary["units"]["pressure"] == {"chain": "N", "membrane": "N/m"}.get(preset, "Pa")
    assert ("Longitudinal".lower() in out) == (preset != "membrane")
    if preset == "fcc":
        assert "slow transverse velocity 654.11 m/s along (1, 0, 0)" in out
    again = main(["run", "small.yaml", "-o", "out", "--resume"])
    assert (again, "is complete" in capsys.readouterr().out) == (0, True)


@pytest.mark.parametrize("preset", ["chain", "membrane", "fcc", "hcp"])
def test_what_is_commented_out_in_a_preset_is_right_too(preset):
    text = (Path(gp.__file__).parent / "data" / f"{preset}.yaml").read_text()
    lines = text.splitlines()
    load = lines.index(next(line for line in lines if line.startswith("load:")))
    force = Scene.from_text(text).state().force
    for other in lines[load + 2 : load + 4]:
        changed = [*lines[: load + 1], other.replace("# ", "", 1), *lines[load + 2 :]]
        assert Scene.from_text("\n".join(changed)).state().force == pytest.approx(force, rel=0.2)
    for key in ("yield_strength", "dim", "torsion", "bending", "band"):
        plain = text.replace(f"# {key}:", f"{key}:").replace("# band_labels:", "band_labels:" if key == "band" else "#")
        assert Scene.from_text(plain).packing.structure.name == Scene.from_text(text).packing.structure.name


def test_a_mechanism_has_bands_and_says_why_it_has_no_velocities(tmp_path):
    scene = read("lattice: square, friction: false", rest="observe: [bands]\nphonopy: {band_points: 3}")
    result = scene.run(tmp_path / "out", figures=False)
    assert result.velocities is None
    assert result.bands.frequencies.shape == (3, 3, 2)
    assert any(
        text.startswith("velocities and moduli are left out: the lattice square is a mechanism") for text in result.warnings
    )
    summary = read_summary(tmp_path / "out")
    assert "longitudinal" not in summary
    assert summary["warnings"] == list(result.warnings)
    with pytest.raises(SceneError, match="found 'square'; allowed: a lattice that is rigid"):
        read("lattice: square, friction: false")


def test_a_sweep_of_a_mechanism_has_bands_only(steel, tmp_path):
    packing = gp.Packing(steel, 8e-3, lattice="square", friction=False)
    with pytest.raises(MechanismError):
        gp.sweep(packing, force=[1.0, 2.0])
    data = gp.sweep(packing, force=[1.0, 2.0], bands="GX", npoints=3, path=tmp_path / "sweep.nc")
    assert "longitudinal" not in data
    assert data["frequencies"].shape == (2, 1, 1, 3, 2)
    assert "velocities and moduli are left out" in data.attrs["warnings"]
    assert gp.sweep(packing, force=[1.0, 2.0], bands="GX", npoints=3, path=tmp_path / "sweep.nc", resume=True).equals(data)
    scene = read("lattice: square, friction: false", "force: [1 N, 2 N]", "observe: [bands]\nphonopy: {band_points: 3}")
    result = scene.run(tmp_path / "out")
    assert "sweep.png" in {path.name for path in result.files}
    assert any("mechanism" in text for text in result.warnings)


def test_velocities_in_space_need_neither_ase_nor_phonopy():
    code = (
        "import sys; from granphon.scene.scene import Scene;"
        f"scene = Scene.from_text({scene_text('lattice: fcc')!r}); scene.to_yaml();"
        "import granphon as gp; gp.sound_velocities(scene.state(), (1, 0, 0));"
        "print([name for name in ('ase', 'phonopy', 'spglib', 'matplotlib', 'xarray') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"


# -- sweeps ---------------------------------------------------------------------------------------------------------


def test_a_sweep_over_lattices_of_space(steel, tmp_path):
    names = ["sc", "bcc", "fcc", "hcp"]
    data = gp.sweep(gp.Packing(steel, 8e-3), pressure=[1e4, 1e5], lattice=names, torsion=[0.0, 0.05], path=tmp_path / "s.nc")
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
            assert np.array_equal(np.stack([here["transverse_slow"], here["transverse_fast"]], axis=-1), v.transverse)
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


def test_a_sweep_over_torsion_may_have_a_word_among_its_values(steel, tmp_path):
    packing = gp.Packing(steel, 8e-3, lattice="hcp")
    data = gp.sweep(packing, force=[1.0, 8.0], torsion=[0.0, "mindlin"], bands="GA", npoints=3, path=tmp_path / "t.nc")
    assert list(data["torsion"].values) == ["0.0", "mindlin"]
    assert "units" not in data["torsion"].attrs
    frequencies = data["frequencies"].values[:, 0]
    scaled = frequencies / np.sqrt(data["normal_stiffness"].values[:, 0])[..., None, None, None]
    # torsion of a Hertz contact changes with the load, and so do the branches in reduced units
    assert scaled[0, 0] == pytest.approx(scaled[1, 0], rel=1e-12, abs=1e-9 * scaled.max())
    assert np.max(np.abs(scaled[0, 1] - scaled[1, 1])) > 1e-6 * scaled.max()
    for n, force in enumerate((1.0, 8.0)):
        state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="hcp", torsion="mindlin")).at_force(force)
        exact = gp.Phonons(state).frequencies(data["qpoints"].values[0])
        assert frequencies[n, 1, 0] == pytest.approx(exact, rel=1e-12, abs=1e-9 * exact.max())
    again = gp.sweep(
        packing, force=[1.0, 8.0], torsion=[0.0, "mindlin"], bands="GA", npoints=3, path=tmp_path / "t.nc", resume=True
    )
    assert again.equals(data)


def test_a_scene_sweeps_lattices_of_another_dimension_than_its_packing(tmp_path):
    scene = read("friction: true", "pressure: [10 kPa, 20 kPa]", "sweep: {lattice: [fcc, hcp], bending: [0, 0.1]}")
    assert scene.packing.lattice == "fcc"
    assert Scene.from_text(scene.to_yaml()) == scene
    result = scene.run(tmp_path / "out")
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


def test_balls_that_differ_have_the_averaged_force_and_the_effective_medium_in_space(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc", spread=gp.Uniform(2e-6))
    data = gp.sweep(packing, force=[0.1, 100.0], media=("ala", "afa", "ema"))
    for medium in ("afa", "ema"):
        ratio = (data["longitudinal"].sel(medium=medium) / data["longitudinal"].sel(medium="ala")).values
        assert ratio[0] < ratio[1] < 1.0
    exponent = data["exponent"].sel(medium="ema").values
    assert exponent[0] > 0.3
    assert exponent[1] == pytest.approx(1.0 / 6.0, abs=1e-3)
    with pytest.raises(InputError, match="the fcc lattice is not simulated"):
        gp.sweep(packing, force=1.0, media="simulation")
    with pytest.raises(InputError, match="no errors for the fcc lattice"):
        gp.sweep(packing, force=1.0, media="auto")


# -- fits -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "branch"),
    [
        ("chain", "longitudinal"), ("kagome", "transverse"), ("square", "transverse"), ("bcc", "longitudinal"),
        ("fcc", "transverse_slow"), ("hcp", "transverse_fast"),
    ],
)  # fmt: skip
def test_the_young_modulus_of_equal_balls_is_fitted_on_every_lattice(steel, lattice, branch):
    true = gp.Packing(steel, 8e-3, lattice=lattice)
    force, direction = np.geomspace(1.0, 30.0, 5), np.arange(1.0, true.structure.periods + 1.0)
    measured = getattr(gp.sound_velocities(gp.AveragedLattice(true).at_force(force), direction), branch)
    start = gp.Packing(gp.Material(150e9, 0.276, 7840.0), 8e-3, lattice=lattice)
    fit = gp.fit_width(
        start, force, measured, 1.0, parameters=("young_modulus",), branch=branch, direction=direction, medium="ema"
    )
    assert fit.values[0] == pytest.approx(steel.young_modulus, rel=1e-10)
    assert (fit.width, fit.stderr, fit.medium) == (0.0, 0.0, "ala")
    # v goes as E^(1/3): the standard error of n velocities of sigma 1 m/s
    assert fit.stderrs[0] / fit.values[0] == pytest.approx(3.0 / math.sqrt(float(np.sum(measured**2))), rel=1e-9)
    assert type(fit).from_dict(fit.to_dict()).to_dict() == fit.to_dict()


def test_the_width_is_fitted_in_space_with_the_averaged_force(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc", spread=gp.Uniform(2e-6))
    force = np.geomspace(0.5, 30.0, 6)
    measured = gp.sound_velocities(gp.AveragedForce(packing).at_force(force), (1, 1, 0)).longitudinal
    fit = gp.fit_width(gp.Packing(steel, 8e-3, lattice="fcc"), force, measured, 1.0, medium="afa", direction=(1, 1, 0))
    assert fit.width == pytest.approx(2e-6, rel=1e-9)


def test_fits_that_a_lattice_does_not_have(steel):
    def fit(**more):
        return gp.fit_width(gp.Packing(steel, 8e-3, lattice="fcc"), [1.0, 2.0, 4.0], [500.0, 560.0, 630.0], **more)

    with pytest.raises(InputError, match="the fcc lattice has no transverse wave"):
        fit(branch="transverse", parameters=("young_modulus",))
    with pytest.raises(InputError, match="three finite numbers"):
        fit(direction=(0, 1), parameters=("young_modulus",))
    with pytest.raises(MechanismError, match="the lattice sc is a mechanism"):
        gp.fit_width(gp.Packing(steel, 8e-3, lattice="sc", friction=False), [1.0, 2.0], [500.0, 560.0], direction=(1, 0, 0))
    with pytest.raises(InputError, match="cannot tell young_modulus and diameter apart"):
        fit(parameters=("young_modulus", "diameter"))
    with pytest.raises(InputError, match="Give one or more, each at most once"):
        fit(parameters=())


def test_the_command_line_fits_a_crystal(tmp_path, monkeypatch, capsys, steel):
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(scene_text("lattice: fcc", "pressure: 1 MPa"))
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="fcc")).at_pressure([1e5, 1e6, 4e6])
    v = gp.sound_velocities(state, (1, 1, 0)).transverse_slow
    rows = "\n".join(f"{p},{x!r}" for p, x in zip((100, 1000, 4000), v.tolist(), strict=True))
    Path("data.csv").write_text(f"pressure (kPa),velocity (m/s)\n{rows}\n")
    asked = ["--no-width", "--parameter", "young_modulus", "--sigma", "1 m/s", "--branch", "transverse_slow"]
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "1 1 0", "-o", "out"]) == 0
    out = capsys.readouterr().out
    assert "young modulus         211.65 GPa +/-" in out
    assert "width" not in out
    assert {"fit.yaml", "fit.csv", "fit.png"} <= {path.name for path in Path("out").iterdir()}
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "up"]) == 2
    assert "--direction: found 'up'; allowed: numbers parted by spaces" in capsys.readouterr().err
    Path("data.csv").write_text("pressure (N/m),velocity (m/s)\n1000,500\n2000,560\n")
    assert main(["fit", "s.yaml", "data.csv", *asked, "--direction", "1 1 0"]) == 2
    assert "force per area" in capsys.readouterr().err


def test_a_sweep_says_which_branches_cost_nothing(steel):
    chain = gp.sweep(gp.Packing(steel, 8e-3, lattice="chain", motions="all"), force=[1.0, 2.0], bands="GX", npoints=3)
    assert "3 of 6 branches vanish at every wave vector" in chain.attrs["warnings"]
    square = gp.sweep(gp.Packing(steel, 8e-3, lattice="square"), force=[1.0, 2.0], bands="GXM", npoints=3)
    assert "the first at q = (0.5, 0.5)" in square.attrs["warnings"]
