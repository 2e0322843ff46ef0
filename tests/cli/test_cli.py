import io
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import granphon as gp
from granphon.base import text as files
from granphon.base.errors import FileExistsInRunError
from granphon.base.progress import Silent, Terminal, on_stderr, silent
from granphon.base.staging import LIST
from granphon.cli.commands import main
from granphon.scene.file import FIELDS
from granphon.scene.scene import Scene, expected_files
from tests.conftest import one_error

SCENE = """\
schema: 1
material:
  young_modulus: 211.65 GPa
  poisson_ratio: 0.276
  density: 7840 kg/m^3
packing:
  lattice: triangular
  diameter: 8 mm
  friction: true
load:
  force: 18.446 N
medium: ala
observe: [velocities]
phonopy:
  band: 0 0 0 1/3 1/3 0 1/2 0 0 0 0 0
  band_labels: G K M G
  band_points: 11
  mesh: 8 8 1
"""
SPECTRA = SCENE.replace("[velocities]", "[velocities, bands, dos]")


def command(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "granphon", *arguments], capture_output=True, text=True, **options
    )


def tree(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.name != LIST}


# -- every mistake in a scene is one clear error --------------------------------------------------------------------

LENGTHS = "a length above zero with its unit, such as '8 mm' (m, cm, mm, um, nm, inch)"
TOP = ", ".join(dict.fromkeys(field.key.partition(".")[0] for field in FIELDS))
ONE = "exactly one of force, pressure, overlap, or side_force with balls_per_side"
FORCES = "a force above zero with its unit"

#: what is replaced, by what; line and key; what was found; what is allowed; the suggestion
MISTAKES: dict[str, tuple[str, str, int, str, str, str, str]] = {
    # keys
    "misspelt block": (
        "material:",
        "materal:",
        2,
        "materal",
        "an unknown key",
        TOP,
        "Did you mean 'material'?",
    ),
    "misspelt key in packing": (
        "diameter:",
        "diametre:",
        8,
        "packing.diametre",
        "an unknown key",
        "lattice, diameter, spread, friction, finite_overlap",
        "Did you mean 'diameter'?",
    ),
    "key in the wrong block": (
        "medium: ala",
        "diameter: 8 mm",
        12,
        "diameter",
        "an unknown key",
        TOP,
        "belongs under 'packing'",
    ),
    "key too deep": (
        "  lattice: triangular",
        "  medium: ala",
        7,
        "packing.medium",
        "an unknown key",
        "lattice",
        "the top level",
    ),
    "merge key": ("medium: ala", "<<: {}", 12, "<<", "an unknown key", TOP, ""),
    "duplicate key": (
        "  friction: true",
        "  diameter: 9 mm",
        9,
        "packing.diameter",
        "the key twice (first on line 8)",
        "each key once",
        "Remove",
    ),
    "missing key": (
        "  diameter: 8 mm\n",
        "",
        6,
        "packing.diameter",
        "nothing, and it has no default",
        LENGTHS,
        "",
    ),
    "empty block": ("  force: 18.446 N\n", "", 10, "load", "nothing", "a block of keys: force", ""),
    # quantities
    "no unit": (
        "8 mm",
        "8",
        8,
        "packing.diameter",
        "8, without a unit",
        LENGTHS,
        "Write the unit too",
    ),
    "stress for a linear pressure": (
        "force: 18.446 N",
        "pressure: 4 kPa",
        11,
        "load.pressure",
        "'4 kPa', whose unit is not a unit of force per length",
        "N/m, kN/m",
        "",
    ),
    "half of a number": (
        "211.65 GPa",
        "7,0 GPa",
        3,
        "material.young_modulus",
        "'7,0 GPa'",
        "GPa",
        "",
    ),
    "misspelt unit": (
        "GPa",
        "Gpa",
        3,
        "material.young_modulus",
        "'211.65 Gpa', whose unit",
        "GPa",
        "Did you mean '211.65 GPa'?",
    ),
    "many digits": (
        "18.446 N",
        f"{'1' * 5000} N",
        11,
        "load.force",
        "a text of 5002 letters",
        "in 100 letters at most",
        "",
    ),
    "far point of the band": (
        "0 0 0 1/3",
        "0 0 0 1e9",
        15,
        "phonopy.band",
        "'1e9' in '0 0 0 1e9 1/3 0",
        "a plain number from -1000 to 1000",
        "",
    ),
    "empty value": ("8 mm", "", 8, "packing.diameter", "nothing", LENGTHS, ""),
    "nan": (
        "8 mm",
        "nan mm",
        8,
        "packing.diameter",
        "'nan mm', which is not a finite number",
        LENGTHS,
        "",
    ),
    "huge": (
        "8 mm",
        "1e9999 mm",
        8,
        "packing.diameter",
        "'1e9999 mm', which is not a finite number",
        LENGTHS,
        "",
    ),
    "zero size": ("8 mm", "0 mm", 8, "packing.diameter", "'0 mm', which is zero", LENGTHS, ""),
    "a modulus beyond double precision": (
        "211.65 GPa",
        "1e300 Pa",
        3,
        "material.young_modulus",
        "'1e300 Pa'",
        "a ball that double precision can hold",
        "balls of 0.008 m of 1e+300 Pa and 7840 kg/m^3 are beyond double precision",
    ),
    "a ball beyond double precision": (
        "8 mm",
        "1e-150 m",
        8,
        "packing.diameter",
        "'1e-150 m'",
        "double precision",
        "",
    ),
    # numbers
    "Poisson ratio too large": (
        "0.276",
        "0.51",
        4,
        "material.poisson_ratio",
        "0.51",
        "-1 < poisson_ratio <= 0.5",
        "not stable",
    ),
    "number with underscores": (
        "points: 11",
        "points: 1_1",
        17,
        "phonopy.band_points",
        "'1_1'",
        "a whole number from 2",
        "",
    ),
    "newer schema": ("schema: 1", "schema: 2", 1, "schema", "2", "1.", "newer granphon"),
    # loads
    "tensile load": (
        "18.446 N",
        "-18.446 N",
        11,
        "load.force",
        "'-18.446 N', which is tensile",
        FORCES,
        "",
    ),
    "zero load": ("18.446 N", "0 N", 11, "load.force", "'0 N', which is zero", FORCES, ""),
    "overlap of the diameter": (
        "force: 18.446 N",
        "overlap: 8 mm",
        11,
        "load.overlap",
        "'8 mm'",
        "can carry",
        "Lower the load",
    ),
    "force that crushes": (
        "18.446 N",
        "1 TN",
        11,
        "load.force",
        "'1 TN'",
        "a load that the balls can carry",
        "Lower the load",
    ),
    "two loads": (
        "  force: 18.446 N",
        "  force: 18.446 N\n  overlap: 1 um",
        10,
        "load",
        "force and overlap",
        ONE,
        "Remove all but one",
    ),
    "side force alone": (
        "force: 18.446 N",
        "side_force: 990 N",
        10,
        "load",
        "side_force alone",
        ONE,
        "",
    ),
    "half a ball": (
        "force: 18.446 N",
        "side_force: 1 N\n  balls_per_side: 0.5",
        12,
        "load.balls_per_side",
        "0.5",
        "a whole number from 1",
        "",
    ),
    "no load in a list": (
        "18.446 N",
        "[]",
        11,
        "load.force",
        "an empty list",
        "a list of one or more values",
        "",
    ),
    "one of many loads": (
        "18.446 N",
        "[1 N, 2 kg]",
        11,
        "load.force.1",
        "'2 kg', whose unit is not a unit of force",
        FORCES,
        "'2 kgf'",
    ),
    "load without a kind": (
        "force: 18.446 N",
        "{from: 1 N, to: 9 N}",
        10,
        "load",
        "without the kind of load",
        ONE,
        "'force:'",
    ),
    "range without points": (
        "18.446 N",
        "{from: 1 N, to: 9 N}",
        11,
        "load.force.points",
        "nothing, and it has no default",
        "a whole number",
        "",
    ),
    "range of too many points": (
        "18.446 N",
        "{from: 1 N, to: 9 N, points: 200001}",
        11,
        "load.force.points",
        "200001",
        "200000",
        "",
    ),
    "range of one point": (
        "18.446 N",
        "{from: 1 N, to: 9 N, points: 1}",
        11,
        "load.force.points",
        "1 for the range from 1 N",
        "1 if",
        "",
    ),
    "range on an unknown scale": (
        "18.446 N",
        "{from: 1 N, to: 9 N, points: 3, scale: logarithmic}",
        11,
        "load.force.scale",
        "'logarithmic'",
        "log, linear",
        "",
    ),
    "range that crushes": (
        "18.446 N",
        "{from: 1 N, to: 1 TN, points: 3}",
        11,
        "load.force.to",
        "'1 TN'",
        "balls can carry",
        "Lower",
    ),
    "log range from below zero": (
        "force: 18.446 N",
        "overlap: {from: -1 um, to: 1 um, points: 3}",
        11,
        "load.overlap",
        "a log range from -1 um to 1 um",
        "values above zero",
        "Write scale: linear",
    ),
    "negative overlap of equal balls": (
        "force: 18.446 N",
        "overlap: -1 um",
        11,
        "load.overlap",
        "'-1 um'",
        "can carry",
        "tensile",
    ),
    "overlap at which no balls touch": (
        "friction: true\nload:\n  force: 18.446 N\nmedium: ala",
        "spread: {uniform: 2 um}\nload:\n  overlap: [1 um, -1.1 um]",
        11,
        "load.overlap.1",
        "'-1.1 um'",
        "can carry",
        "no balls touch",
    ),
    "force below what a medium is solved for": (
        "friction: true\nload:\n  force: 18.446 N\nmedium: ala",
        "spread: {uniform: 2 um}\nload:\n  force: 1 nN",
        11,
        "load.force",
        "'1 nN'",
        "can carry",
        "Raise the load",
    ),
    # names
    "unknown medium": (
        "medium: ala",
        "medium: emma",
        12,
        "medium",
        "'emma'",
        "ala, afa, ema",
        "Did you mean 'ema'?",
    ),
    "unknown option of a medium": (
        "medium: ala",
        "medium: {ema: {tol: 1}}",
        12,
        "medium.ema.tol",
        "an unknown key",
        "local_field",
        "",
    ),
    "value of an option": (
        "medium: ala",
        "medium: {ema: {local_field: papr}}",
        12,
        "medium.ema.local_field",
        "'papr'",
        "computed, paper",
        "'paper'?",
    ),
    "options that are no block": (
        "medium: ala",
        "medium: {ema: paper}",
        12,
        "medium.ema",
        "'paper'",
        "a block of keys: local_field",
        "",
    ),
    "misspelt option of a simulation": (
        "medium: ala",
        "medium:\n  simulation:\n    shape: 16 16\n    sampels: 4",
        15,
        "medium.simulation.sampels",
        "an unknown key",
        "shape, seed, samples",
        "Did you mean 'samples'?",
    ),
    "shape of three": (
        "medium: ala",
        "medium: {simulation: {shape: 16 16 1}}",
        12,
        "medium.simulation.shape",
        "'16 16 1'",
        "two whole numbers from 1",
        "such as 128 128",
    ),
    "seed that is none": (
        "medium: ala",
        "medium: [ala, simulation: {seed: -1}]",
        12,
        "medium.1.simulation.seed",
        "-1",
        "a whole number from 0",
        "",
    ),
    "simulation with finite overlap": (
        "  friction: true\nload:\n  force: 18.446 N\nmedium: ala",
        "  finite_overlap: true\nload:\n  force: 9 N\nmedium: [ala, {simulation: {geometry: lattice}}]",
        9,
        "packing.finite_overlap",
        "true",
        "false, with a simulation",
        "Leave finite_overlap out",
    ),
    "simulation of another lattice": (
        "lattice: triangular\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N\nmedium: ala",
        "lattice: square\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N\nmedium: simulation",
        12,
        "medium",
        "'simulation'",
        "a medium for the",
        "the square lattice is not simulated",
    ),
    "two media in a block": (
        "medium: ala",
        "medium: {ala: , ema: }",
        12,
        "medium",
        "a block of keys",
        "ala, afa, ema",
        "",
    ),
    "medium twice": (
        "medium: ala",
        "medium: [ema, afa, ema]",
        12,
        "medium",
        "'ema' twice",
        "each once",
        "",
    ),
    "unknown lattice": (
        "triangular",
        "triangle",
        7,
        "packing.lattice",
        "'triangle'",
        "chain, triangular, square",
        "'triangular'?",
    ),
    "unknown observable": (
        "[velocities]",
        "[velocity]",
        13,
        "observe",
        "'velocity'",
        "velocities, bands, gaps, dos",
        "'velocities'?",
    ),
    "observable without a list": (
        "[velocities]",
        "dos",
        13,
        "observe",
        "'dos'",
        "a list of",
        "Did you mean [dos]?",
    ),
    "yes for true": (
        "friction: true",
        "friction: yes",
        9,
        "packing.friction",
        "'yes'",
        "true or false",
        "Did you mean true?",
    ),
    # spreads
    "empty spread": (
        "friction: true",
        "spread:",
        9,
        "packing.spread",
        "nothing",
        "exactly one of uniform",
        "Leave spread out",
    ),
    "width in per cent": (
        "friction: true",
        "spread: {uniform: 1 %}",
        9,
        "packing.spread.uniform",
        "'1 %', whose unit is not a unit of length",
        "a length, zero or above",
        "1 % of 8 mm is 80 um: write '80 um'.",
    ),
    "swept width in per cent": (
        "medium: ala",
        "sweep: {width: [1 um, 0.5 percent]}",
        12,
        "sweep.width.1",
        "'0.5 percent'",
        "a length, zero or above",
        "0.5 % of 8 mm is 40 um: write '40 um'.",
    ),
    "spread without a kind": (
        "friction: true",
        "spread: 2 um",
        9,
        "packing.spread",
        "'2 um'",
        "exactly one of",
        "{uniform: 2 um}?",
    ),
    "misspelt spread": (
        "friction: true",
        "spread: {unifrom: 2 um}",
        9,
        "packing.spread.unifrom",
        "an unknown key",
        "uniform, normal",
        "'uniform'?",
    ),
    "spread wider than the balls": (
        "friction: true",
        "spread: {uniform: 17 mm}",
        9,
        "packing.spread.uniform",
        "'17 mm'",
        "all above zero",
        "smaller spread",
    ),
    "normal without a width": (
        "friction: true",
        "spread: {normal: {cutoff: 3}}",
        9,
        "packing.spread.normal.std",
        "nothing",
        "a length, zero or above",
        "",
    ),
    "cutoff too large": (
        "friction: true",
        "spread: {normal: {std: 1 um, cutoff: 11}}",
        9,
        "packing.spread.normal.cutoff",
        "11",
        "from 0.001 to 10",
        "",
    ),
    "discrete without fractions": (
        "friction: true",
        "spread: {discrete: {diameters: [8 mm]}}",
        9,
        "packing.spread.discrete.fractions",
        "nothing",
        "one or more fractions",
        "",
    ),
    "one diameter for a list": (
        "friction: true",
        "spread: {measured: {diameters: 8 mm}}",
        9,
        "packing.spread.measured.diameters",
        "'8 mm'",
        "a list of",
        "",
    ),
    "fractions that are too few": (
        "friction: true",
        "spread: {discrete: {diameters: [7 mm, 9 mm], fractions: [1]}}",
        9,
        "packing.spread.discrete.fractions",
        "[1.0]",
        "one fraction for each diameter",
        "2 diameters and 1 fractions",
    ),
    "fractions of another sum": (
        "friction: true",
        "spread: {discrete: {diameters: [7 mm, 9 mm], fractions: [0.5, 0.6]}}",
        9,
        "packing.spread.discrete.fractions",
        "[0.5, 0.6]",
        "with the sum 1",
        "Divide them by their sum",
    ),
    "another mean": (
        "friction: true",
        "spread: {discrete: {diameters: [7 mm, 9.1 mm], fractions: [0.5, 0.5]}}",
        9,
        "packing.spread.discrete",
        "a block of keys",
        "diameters about the packing's",
        "Give the mean, 0.00805",
    ),
    "no such table": (
        "friction: true",
        "spread: {measured: no.csv}",
        9,
        "packing.spread.measured",
        "'no.csv'",
        "a table with a column",
        "cannot be read",
    ),
    "no name of a table": (
        "friction: true",
        "spread: {measured: }",
        9,
        "packing.spread.measured",
        "nothing",
        "a name",
        "",
    ),
    # sweeps
    "misspelt parameter": (
        "medium: ala",
        "sweep: {widht: [1 um]}",
        12,
        "sweep.widht",
        "an unknown key",
        "young_modulus, poisson_ratio",
        "'width'?",
    ),
    "sweep without values": (
        "medium: ala",
        "sweep: {friction: true}",
        12,
        "sweep.friction",
        "true",
        "a list of one or more values",
        "",
    ),
    "one of the values of a sweep": (
        "medium: ala",
        "sweep: {width: [1 um, 2]}",
        12,
        "sweep.width.1",
        "2, without a unit",
        "length",
        "",
    ),
    "value that makes no packing": (
        "medium: ala",
        "sweep: {width: [1 um, 20 mm]}",
        12,
        "sweep.width.1",
        "'20 mm'",
        "that the packing can have",
        "smaller spread",
    ),
    "mechanism in a sweep": (
        "medium: ala",
        "sweep: {friction: [true, false], lattice: [triangular, kagome]}",
        12,
        "sweep.lattice",
        "'kagome'",
        "a lattice that is rigid",
        "lattice = kagome",
    ),
    "load that one packing of a sweep cannot carry": (
        "  force: 18.446 N\nmedium: ala",
        "  overlap: -0.4 um\nmedium: ala\nsweep: {width: [2 um, 0.5 um]}",
        11,
        "load.overlap",
        "'-0.4 um'",
        "balls can carry",
        "width = 2e-06 m",
    ),
    "density of states of a sweep": (
        "  force: 18.446 N\nmedium: ala\nobserve: [velocities]",
        "  force: [1 N, 2 N]\nmedium: ala\nobserve: [dos]",
        13,
        "observe",
        "'dos'",
        "dos of one state, or of arrays that a medium: simulation makes",
        "Take medium: simulation",
    ),
    "bands of a sweep over friction": (
        "medium: ala\nobserve: [velocities]",
        "sweep: {friction: [true, false]}\nobserve: [bands]",
        13,
        "observe",
        "'bands'",
        "velocities, as the branches differ",
        "Make a scene of each",
    ),
    # phonopy
    "band leaves the plane": (
        "1/3 1/3 0",
        "1/3 1/3 1/2",
        15,
        "phonopy.band",
        "third number that is not 0",
        "three numbers",
        "layer",
    ),
    "band with a word": (
        "1/3 1/3 0",
        "1/3 K 0",
        15,
        "phonopy.band",
        "'K' in '0 0 0 1/3 K 0",
        "three numbers or fractions",
        "",
    ),
    "labels that do not match": (
        "G K M G",
        "G K M",
        16,
        "phonopy.band_labels",
        "3 labels",
        "4, one for each point",
        "",
    ),
    "mesh out of the plane": (
        "8 8 1",
        "8 8 8",
        18,
        "phonopy.mesh",
        "whose third number is 8",
        "such as 64 64 1",
        "one layer",
    ),
    "mesh of nothing": ("8 8 1", "0 8 1", 18, "phonopy.mesh", "'0 8 1'", "from 1 to 4096", ""),
    # the text itself
    "broken YAML": ("medium: ala", "medium: [ala", 13, "", "broken YAML", "YAML", ""),
    "tab": ("  force", "\tforce", 11, "", "broken YAML", "YAML", "Indent with spaces"),
    "object tag": (
        "18.446 N",
        "!!python/object/apply:os.getcwd []",
        11,
        "load.force",
        "the tag",
        "plain values",
        "Leave the tag out",
    ),
    "alias": (
        "medium: ala",
        "medium: &a ala",
        12,
        "medium",
        "an anchor or alias",
        "plain values",
        "Write the value out",
    ),
    "control character": ("ala", "a\x07la", 12, "", "the character '\\x07'", "printable text", ""),
    "empty file": (SCENE, "", 1, "", "an empty text", "a scene", "granphon init"),
    "a list": (SCENE, "- a\n- b\n", 1, "", "a list", TOP, ""),
    "two documents": (
        "medium: ala",
        "---\nmedium: ala",
        12,
        "",
        "a second document",
        "one document",
        "",
    ),
    # what no lattice of this kind can do
    "mechanism": (
        "triangular\n  diameter: 8 mm\n  friction: true",
        "square\n  diameter: 8 mm\n  friction: false",
        7,
        "packing.lattice",
        "'square'",
        "a lattice that is rigid",
        "Use friction",
    ),
    "frame around squares": (
        "triangular\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N",
        "square\n  diameter: 8 mm\n  friction: true\nload:\n  side_force: 9 N\n  balls_per_side: 3",
        11,
        "load.side_force",
        "a side_force",
        "on the triangular lattice only",
        "",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_in_a_scene(work, capsys, name):
    old, new, line, key, found, allowed, suggestion = MISTAKES[name]
    assert SCENE.count(old) == 1
    (work / "scene.yaml").write_text(SCENE.replace(old, new), encoding="utf-8")
    before = tree(work)
    assert main(["run", "scene.yaml", "-o", "out"]) == 2
    text = one_error(capsys)
    assert text.startswith(f"scene.yaml:{line}: {key + ': ' if key else ''}"), text
    head, _, tail = text.partition("; allowed: ")
    assert "found " in head or "broken YAML" in head
    assert found in head
    assert allowed in tail
    assert suggestion in tail if suggestion else "Did you mean" not in tail
    assert tree(work) == before


def test_scenes_that_cannot_be_read(work, capsys):
    (work / "binary.yaml").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    (work / "large.yaml").write_text("# " + "x" * 200_000)
    (work / "folder.yaml").mkdir()
    before = tree(work)
    for name, expected in (
        (
            "binary.yaml",
            "binary.yaml:3 cannot be read: found the byte 0x00 where text in UTF-8 is needed. The file does not look like text",
        ),
        ("large.yaml", "large.yaml holds more than 100 kB"),
        ("folder.yaml", "folder.yaml cannot be read: it is a folder. Give the file itself"),
        ("missing.yaml", "missing.yaml: there is no such file. 'granphon init' writes one"),
        ("scene.yaml/x", "scene.yaml/x cannot be read: Not a directory"),
    ):
        assert main(["run", name, "-o", "out"]) == 2
        assert expected in one_error(capsys)
    assert tree(work) == before


# -- run ------------------------------------------------------------------------------------------------------------

#: the files of every run
ALONE = ("scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv")


def test_run_writes_velocities(work, capsys):
    assert main(["run", "scene.yaml", "-o", "new/out"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "longitudinal velocity 790.96 m/s" in out
    assert "Wrote scene.yaml, summary.yaml, sweep.nc, sweep.csv into new/out" in out
    assert tree(work / "new") == {"out", *(f"out/{name}" for name in ALONE)}
    assert Scene.from_yaml("new/out/scene.yaml") == Scene.from_yaml("scene.yaml")
    summary = yaml.safe_load(Path("new/out/summary.yaml").read_text())
    state = Scene.from_yaml("scene.yaml").state()
    velocities = gp.sound_velocities(state)
    moduli = gp.moduli(state)
    for name, unit in state.units.items():
        assert summary[name] == getattr(state, name)
        assert summary["units"][name] == unit
    assert (summary["longitudinal"], summary["transverse"]) == (
        velocities.longitudinal,
        velocities.transverse,
    )
    assert (summary["bulk"], summary["shear"]) == (moduli.bulk, moduli.shear)
    assert summary["mindlin_ratio"] == state.packing.mindlin_ratio
    assert summary["tensor"] == moduli.tensor.tolist()
    assert summary["versions"] == files.versions("numpy", "scipy", "xarray", "h5netcdf")
    assert (summary["valid"], summary["ok"]) == (True, True)
    assert [check["name"] for check in summary["validity"]] == [
        "contact_radius",
        "load",
        "velocity",
        "resonance",
        "young_modulus",
        "density",
        "high_density",
        "diameter",
        "large_diameter",
    ]
    assert summary["files"] == ["scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv"]
    numbers = {key for key, value in summary.items() if isinstance(value, float)}
    assert numbers <= set(summary["units"])


def test_run_computes_only_what_is_observed(work):
    (work / "scene.yaml").write_text(SCENE.replace("[velocities]", "[dos]"), encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    assert (result.velocities, result.moduli, result.bands) == (None, None, None)
    assert tree(work / "out") == {*ALONE, "dos.csv"}
    assert "longitudinal" not in (work / "out/summary.yaml").read_text()


def test_run_writes_spectra_that_are_read_back(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    assert tree(work / "out") == {*ALONE, "band.yaml", "phonopy_params.yaml", "dos.csv"}
    assert {str(p) for p in result.files} == {f"out/{name}" for name in tree(work / "out")}
    bands, dos = gp.Bands.read("out/band.yaml"), gp.DensityOfStates.read_csv("out/dos.csv")
    phonons = gp.Phonons(result.state)
    expected = phonons.bands("GKMG", npoints=11)
    np.testing.assert_allclose(bands.frequencies, expected.frequencies, rtol=1e-12, atol=1e-9)
    assert bands.labels == ("G", "K", "M", "G")
    np.testing.assert_allclose(dos.total, phonons.dos((8, 8)).total, rtol=1e-12)
    summary = yaml.safe_load((work / "out/summary.yaml").read_text())
    assert summary["top_frequency"] == expected.frequencies.max()
    # and what was expected
    plan = Scene.from_yaml("scene.yaml")
    assert tuple(path.name for path in result.files) == expected_files(plan, figures=False)
    assert set(expected_files(plan)) - set(expected_files(plan, figures=False)) == {"bands.png"}
    alone = Scene.from_text(SPECTRA.replace("[velocities, bands, dos]", "[dos]"))
    assert expected_files(alone) == (*ALONE, "dos.csv", "dos.png")
    assert set(summary["versions"]) == {
        "granphon",
        "numpy",
        "scipy",
        "xarray",
        "h5netcdf",
        "ase",
        "phonopy",
        "spglib",
    }


def test_finite_overlap_reaches_every_result(work):
    text = SPECTRA.replace("friction: true", "friction: true\n  finite_overlap: true").replace(
        "force: 18.446 N", "overlap: 40 um"
    )
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    result = Scene.from_yaml("scene.yaml").run("out", figures=False)
    state = result.state
    assert result.velocities.longitudinal == gp.sound_velocities(state).longitudinal
    limit = gp.AveragedLattice(state.packing).at_overlap(state.overlap)
    assert result.velocities.longitudinal != gp.sound_velocities(limit).longitudinal
    assert result.moduli.bulk == gp.moduli(state).bulk
    expected = gp.Phonons(state).bands("GKMG", npoints=11)
    np.testing.assert_array_equal(result.bands.frequencies, expected.frequencies)


def test_plot_draws_the_figure_of_a_run(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "out", "--quiet", "--no-figures"]) == 0
    assert main(["plot", "out"]) == 0
    assert (work / "out" / "bands.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["plot", "out"]) == 1
    assert "already holds bands.png" in one_error(capsys)
    assert main(["plot", "out", "-o", "both.xyz"]) == 2
    assert "format" in one_error(capsys)
    (work / "out" / "band.yaml").write_text("broken: [")
    assert main(["plot", "out", "-o", "again.pdf"]) == 2
    assert "band.yaml" in one_error(capsys)
    assert tree(work) == {"scene.yaml", "out"} | {f"out/{name}" for name in tree(work / "out")}


@pytest.mark.slow
def test_runs_and_plots_draw_figures_of_several_formats(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "out", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert {name for name in tree(work / "out") if name.endswith(".png")} == {"bands.png"}
    assert main(["plot", "out", "--force"]) == 0
    assert (work / "out" / "bands.png").read_bytes().startswith(b"\x89PNG")
    assert main(["plot", "out", "--asymptotes", "-o", "figures/both.pdf"]) == 0
    assert (work / "figures" / "both.pdf").read_bytes().startswith(b"%PDF")


def test_plot_of_nothing(work, capsys):
    for folder, told in (
        (".", ". holds no result that can be drawn"),
        ("missing", "there is no folder missing."),
        ("scene.yaml", "scene.yaml is no folder, and no file of results"),
    ):
        assert main(["plot", folder]) == 2
        assert told in one_error(capsys)


@pytest.mark.skipif(os.name != "posix", reason="links and pipes of POSIX")
def test_plot_leaves_out_nothing_that_the_run_wrote(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "out", "--quiet", "--no-figures"]) == 0
    bands = work / "out" / "band.yaml"
    told = "band.yaml cannot be read: "
    whole = bands.read_bytes()
    for make, why in (
        (lambda: None, "out holds no band.yaml, though a run wrote it there."),
        (bands.mkdir, told + "it is a folder"),
        (lambda: os.mkfifo(bands), told + "it is a device or a pipe"),
        (lambda: bands.symlink_to("nowhere"), told + "there is no such file"),
        (lambda: bands.symlink_to("band.yaml"), told + "Too many levels of symbolic links"),
    ):
        bands.rmdir() if bands.is_dir() else bands.unlink(missing_ok=True)
        make()
        assert main(["plot", "out"]) == 2
        assert why in one_error(capsys)
    (work / "copy").mkdir()
    for name in ("summary.yaml", "dos.csv", "sweep.nc"):  # as a copy without hidden files
        (work / "copy" / name).write_bytes((work / "out" / name).read_bytes())
    assert main(["plot", "copy"]) == 2
    assert "copy holds no band.yaml, though a run wrote it there." in one_error(capsys)
    (work / "copy" / "band.yaml").write_bytes(whole)
    assert main(["plot", "copy"]) == 0
    assert tree(work / "copy") == {"summary.yaml", "dos.csv", "sweep.nc", "band.yaml", "bands.png"}


def test_an_existing_result_is_not_overwritten(work, capsys):
    assert main(["run", "scene.yaml", "-o", "out"]) == 0
    capsys.readouterr()
    before = (work / "out" / "summary.yaml").stat().st_mtime_ns
    assert main(["run", "scene.yaml", "-o", "out"]) == 1
    text = one_error(capsys)
    assert "out already holds scene.yaml, summary.yaml" in text
    assert "--force" in text
    assert (work / "out" / "summary.yaml").stat().st_mtime_ns == before
    with pytest.raises(FileExistsInRunError):
        Scene.from_yaml("scene.yaml").run("out")
    assert main(["run", "scene.yaml", "-o", "out", "--force"]) == 0
    assert (work / "out" / "summary.yaml").stat().st_mtime_ns > before
    capsys.readouterr()
    (work / "out" / "summary.yaml").write_text("mine")
    assert main(["run", "scene.yaml", "-o", "out", "--force"]) == 1
    assert (
        "it has been changed since. Such a file is never replaced, not even with --force"
        in one_error(capsys)
    )
    assert (work / "out" / "summary.yaml").read_text() == "mine"


def test_a_failing_computation_leaves_nothing(work, capsys):
    # a large overlap with the prestress kept: the lattice buckles
    text = SPECTRA.replace("friction: true", "friction: false\n  finite_overlap: true").replace(
        "force: 18.446 N", "overlap: 6 mm"
    )
    (work / "scene.yaml").write_text(text, encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "new/out"]) == 2
    told = one_error(capsys)
    assert "negative" in told
    assert (
        ": packing.finite_overlap: found true; allowed: false where the lattice buckles; the lattice"
        in told
    )
    assert tree(work) == {"scene.yaml"}
    assert main(["check", "scene.yaml"]) == 2
    assert one_error(capsys) == told


def test_folders_that_cannot_be_written(work, capsys):
    for folder, found in (
        ("scene.yaml", "scene.yaml is not a folder"),
        ("scene.yaml/out", "scene.yaml is not a folder"),
        ("a\0b", "a null character"),
        ("x" * 300, "File name too long"),
    ):
        assert main(["run", "scene.yaml", "-o", folder]) == 1
        assert found in one_error(capsys)
    assert tree(work) == {"scene.yaml"}


def test_warnings_go_to_stderr_and_into_the_summary(work, capsys):
    (work / "scene.yaml").write_text(SCENE.replace("18.446 N", "200 kN"), encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    expected = [
        f"granphon: warning: {w}"
        for w in gp.validity(Scene.from_yaml("scene.yaml").state()).warnings
    ]
    assert expected
    assert capsys.readouterr().err.splitlines() == expected
    assert main(["run", "scene.yaml", "-o", "out", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == expected
    summary = yaml.safe_load((work / "out/summary.yaml").read_text())
    assert [f"granphon: warning: {w}" for w in summary["warnings"]] == expected
    # the load is within the range of the medium, as for equal balls every load is, and beyond that
    # of the contact law
    assert (summary["valid"], summary["ok"]) == (True, False)


# -- init and check -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", ["steel_hexagon", "glass", "hydrogel"])
def test_init_writes_a_scene_that_check_accepts(tmp_path, monkeypatch, capsys, preset):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--preset", preset]) == 0
    assert "granphon check scene.yaml" in capsys.readouterr().out
    assert main(["check", "scene.yaml"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("scene.yaml can be run.")
    assert err == ""
    assert tree(tmp_path) == {"scene.yaml"}


def test_init_does_not_overwrite(work, capsys):
    assert main(["init"]) == 1
    assert "already holds scene.yaml" in one_error(capsys)
    # nor with --force, unless it is as another "init" has written it
    assert main(["init", "--force"]) == 1
    assert "there is no record that granphon wrote it" in one_error(capsys)
    assert (work / "scene.yaml").read_text() == SCENE
    (work / "scene.yaml").unlink()
    assert main(["init", "--preset", "hydrogel"]) == 0
    assert main(["init", "--force", "--preset", "glass"]) == 0
    assert "glass" in (work / "scene.yaml").read_text()
    capsys.readouterr()
    assert main(["init", "other.yaml", "--preset", "hidrogel"]) == 2
    assert (
        "allowed: steel_hexagon, steel_spread, glass, hydrogel, chain, membrane, fcc, hcp, diatomic. Did you mean 'hydrogel'"
        in one_error(capsys)
    )
    assert tree(work) == {"scene.yaml"}


def test_check_tells_what_will_be_done(work, capsys):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    assert main(["check", "scene.yaml"]) == 0
    out = capsys.readouterr().out
    for expected in (
        "211.65 GPa",
        "0.276",
        "7840 kg/m^3",
        "triangular",
        "8 mm",
        "force 18.446 N",
        "overlap 1.9392 um",
        "G K M G",
        "11",
        "8 x 8",
        "velocities, bands, dos",
        "scene.yaml, summary.yaml, sweep.nc, sweep.csv, band.yaml, phonopy_params.yaml, dos.csv, bands.png",
    ):
        assert expected in out
    assert tree(work) == {"scene.yaml"}


# -- the command itself ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [[], ["init"], ["check"], ["run"], ["plot"]])
def test_help_has_examples(capsys, verb):
    assert main([*verb, "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "Example" in out
    assert "granphon " + " ".join(verb) in out
    if not verb:
        assert main(["--version"]) == 0
        assert capsys.readouterr().out == f"granphon {gp.__version__}\n"
        assert "Exit codes:" in out
        for name in ("init", "check", "run", "plot"):
            assert f"\n  {name} " in out


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["rum"], "No such command 'rum'"),
        (["nonsense"], "'nonsense'. See 'granphon --help'."),
        (["run", "scene.yaml"], "--out"),
        *(
            (words, "is empty")
            for words in (["run", "scene.yaml", "-o", ""], ["init", ""], ["plot", ".", "-o", ""])
        ),
        *(
            (words, "'-'")
            for words in (["run", "scene.yaml", "-o", "-"], ["init", "-"], ["plot", ".", "-o", "-"])
        ),
        (["run", "scene.yaml", "-o", "--"], "'--'"),
        (["run", "scene.yaml", "-o", "---"], "'---'"),
        (["run"], "Missing argument 'SCENE'. See 'granphon run --help'."),
        (["mode", "s.yaml", "--at", "K", "-o", "m.png", "--branch", "-1"], "'--branch'"),
        (["run", "scene.yaml", "-o", "out", "--forse"], "No such option"),
        (["check", "a", "b"], "unexpected extra argument"),
        (["--nonsense"], "No such option"),
    ],
)
def test_wrong_usage(work, capsys, arguments, found):
    assert main(arguments) == 2
    assert found in one_error(capsys)
    assert tree(work) == {"scene.yaml"}


def test_without_a_word_the_command_shows_its_help(capsys):
    assert main([]) == 0
    alone = capsys.readouterr().out
    assert main(["--help"]) == 0
    assert capsys.readouterr().out.strip() == alone.strip()


def test_the_module_is_the_command(work):
    failed = command("run", "nothing.yaml", "-o", "more")
    assert failed.returncode == 2
    assert failed.stderr.startswith("granphon: error: nothing.yaml: ")
    assert failed.stderr.count("\n") == 1
    assert failed.stdout == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_output_that_cannot_be_printed(work):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "granphon", "check", "scene.yaml"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("granphon: error: ")
    assert done.stderr.count("\n") == 1


def test_a_reader_that_goes_away(work):
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "granphon", "check", "scene.yaml"],
        stdout=writing,
        stderr=subprocess.PIPE,
    )
    os.close(writing)
    assert done.stderr == b""
    assert done.returncode == 1


def test_help_says_each_command_in_one_whole_line_and_no_types(capsys):
    main(["--help"])
    text = capsys.readouterr().out
    assert "..." not in text.partition("Scenes:")[2]
    for verb in re.findall(
        r"^  (\w+)  ", text.partition("Scenes:")[2].partition("Exit codes:")[0], re.MULTILINE
    ):
        main([verb, "--help"])
        assert not re.search(r"<\w", capsys.readouterr().out), verb


def test_help_loads_no_library_of_the_computation():
    code = (
        "import sys\nfrom granphon.cli.commands import main\nmain(['run', '--help'])\n"
        "assert not {'numpy', 'scipy', 'ase', 'phonopy', 'pint', 'yaml', 'matplotlib', 'rich'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


# -- progress -------------------------------------------------------------------------------------------------------


class Listener(Silent):
    def __init__(self, stop=None):
        self.labels = []
        self.left = {}
        self.stop = stop

    def step(self, label, total=None):
        self.labels.append(label)
        self.left[label] = total or 0
        if label == self.stop:
            raise KeyboardInterrupt
        return super().step(label, total)

    def advance(self, amount=1.0):
        self.left[self.labels[-1]] -= amount


def test_progress_is_told_of_long_work(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    listener = Listener()
    Scene.from_yaml("scene.yaml").run("out", progress=listener, figures=False)
    assert listener.labels == ["force constants", "bands", "density of states", "writing"]
    assert listener.left["writing"] == 0


@pytest.mark.parametrize("moment", ["density of states", "writing"])
def test_interruption_is_clean(work, moment):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    with pytest.raises(KeyboardInterrupt):
        Scene.from_yaml("scene.yaml").run("new/out", progress=Listener(stop=moment))
    assert tree(work) == {"scene.yaml"}


@pytest.mark.parametrize(
    ("before", "each", "told"),
    [
        (0, [7.0, 7.0, 7.0], "3/10 0:00:21 left 0:00:49"),
        (0, [200.0, 400.0], "2/10 0:10:00 left 0:40:00"),
        (4, [60.0], "5/10 0:01:00 left 0:05:00"),  # what was there when it began has taken no time
        (10, [], "10/10 0:00:00 left 0:00:00"),
    ],
)
def test_progress_tells_the_time_that_is_left(monkeypatch, before, each, told):
    class Screen(io.StringIO):
        def isatty(self):
            return True

    now, screen = [1e4], Screen()
    assert on_stderr() is silent
    monkeypatch.setattr(sys, "stderr", screen)
    assert on_stderr(quiet=True) is silent
    assert isinstance(on_stderr(), Terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with Terminal(lambda: now[0]).step("sweep", 10) as step:
        step.advance(before)
        for duration in each:
            now[0] += duration
            step.advance()
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())
    last = re.findall(r"sweep[^\r\n]*", shown)[-1]
    assert " ".join(last.split()).endswith(told)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a pseudo-terminal")
def test_progress_on_a_real_terminal_leaves_stdout_alone(work):
    (work / "scene.yaml").write_text(SPECTRA, encoding="utf-8")
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "granphon", "run", "scene.yaml", "-o", "out", "--no-figures"],
        stdout=subprocess.PIPE,
        stderr=theirs,
    )
    os.close(theirs)
    seen = b""
    try:
        while piece := os.read(ours, 4096):
            seen += piece
    except OSError:  # the other side has closed
        pass
    out, _ = process.communicate(timeout=60)
    os.close(ours)
    assert process.returncode == 0
    assert b"density of states" in seen
    assert b"\x1b" not in out
    assert b"longitudinal velocity" in out


def test_a_closed_stdout_is_no_failure(work, monkeypatch, capsys):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert main(["check", "scene.yaml"]) == 0
    assert capsys.readouterr().err == ""


def test_names_of_files_do_not_command_the_terminal(work, capsys):
    name = "red\x1b[31m\u202e.yaml"
    Path(name).write_text(SCENE, encoding="utf-8")
    assert main(["check", name]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith("red\\x1b[31m\\u202e.yaml can be run.\n")
    assert out.replace("\n", "").isprintable()
    Path(name).write_text("colour: 1\n", encoding="utf-8")
    assert main(["check", name]) == 2
    assert one_error(capsys).startswith("red\\x1b[31m\\u202e.yaml:1: colour: ")
