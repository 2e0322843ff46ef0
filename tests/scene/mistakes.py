"""Mistakes in scenes, in one table: what is wrong, the line and the key that the error names, and what
else it says.
"""

from __future__ import annotations

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
#: two kinds of balls
BALLS = """
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19.05 mm, mass: 28.84 g}
  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19.05 mm, mass: 9.75 g}
"""


def edit(old: str, new: str) -> str:
    """The scene with something else in place of a text that it has once."""
    assert SCENE.count(old) == 1
    return SCENE.replace(old, new)


def pack(packing: str, load: str = "force: 1 N", more: str = "") -> str:
    """A scene of a packing, on its second line; a load on the third; and more."""
    return (
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        f"packing: {{diameter: 8 mm, {packing}}}\nload: {{{load}}}\n{more}"
    )


def kinds(lines: str) -> str:
    """A scene of two kinds of balls, from its fifth line on."""
    return f"{BALLS}{lines}\n"


#: the scene; line and key; values and words of the error
MISTAKES: dict[str, tuple[str, ...]] = {
    # keys
    "misspelt block": (
        edit("material:", "materal:"),
        "2: materal",
        "an unknown key",
        "direction",
        "'material'",
    ),
    "misspelt key in packing": (
        edit("diameter:", "diametre:"),
        "8: packing.diametre",
        "an unknown key",
        "finite_overlap",
        "'diameter'",
    ),
    "key in the wrong block": (
        edit("medium: ala", "diameter: 8 mm"),
        "12: diameter",
        "an unknown key",
        "direction",
        "'packing'",
    ),
    "key too deep": (
        edit("  lattice: triangular", "  medium: ala"),
        "7: packing.medium",
        "an unknown key",
        "lattice",
        "the top level",
    ),
    "merge key": (edit("medium: ala", "<<: {}"), "12: <<", "an unknown key", "direction"),
    "duplicate key": (
        edit("  friction: true", "  diameter: 9 mm"),
        "9: packing.diameter",
        "twice",
        "each key once",
        "Remove",
    ),
    "missing key": (edit("  diameter: 8 mm\n", ""), "6: packing.diameter", "default", "'8 mm'"),
    "empty block": (edit("  force: 18.446 N\n", ""), "10: load", "nothing", "block"),
    # quantities
    "no unit": (edit("8 mm", "8"), "8: packing.diameter", "unit", "'8 mm'", "Write"),
    "stress for a linear pressure": (
        edit("force: 18.446 N", "pressure: 4 kPa"),
        "11: load.pressure",
        "'4 kPa'",
        "N/m, kN/m",
    ),
    "half of a number": (
        edit("211.65 GPa", "7,0 GPa"),
        "3: material.young_modulus",
        "'7,0 GPa'",
        "GPa",
    ),
    "misspelt unit": (
        edit("GPa", "Gpa"),
        "3: material.young_modulus",
        "'211.65 Gpa'",
        "GPa",
        "'211.65 GPa'",
    ),
    "many digits": (edit("18.446 N", f"{'1' * 200} N"), "11: load.force", "202", "100"),
    "far point of the band": (edit("0 0 0 1/3", "0 0 0 1e9"), "15: phonopy.band", "'1e9'", "-1000"),
    "empty value": (edit("8 mm", ""), "8: packing.diameter", "nothing", "'8 mm'"),
    "nan": (edit("8 mm", "nan mm"), "8: packing.diameter", "'nan mm'", "'8 mm'"),
    "huge": (edit("8 mm", "1e9999 mm"), "8: packing.diameter", "'1e9999 mm'", "'8 mm'"),
    "zero size": (edit("8 mm", "0 mm"), "8: packing.diameter", "'0 mm'", "'8 mm'"),
    "a modulus beyond double precision": (
        edit("211.65 GPa", "1e300 Pa"),
        "3: material.young_modulus",
        "'1e300 Pa'",
        "precision",
        "0.008",
    ),
    "a ball beyond double precision": (
        edit("8 mm", "1e-150 m"),
        "8: packing.diameter",
        "'1e-150 m'",
        "precision",
    ),
    # numbers
    "Poisson ratio too large": (
        edit("0.276", "0.51"),
        "4: material.poisson_ratio",
        "0.51",
        "not stable",
    ),
    "number with underscores": (
        edit("points: 11", "points: 1_1"),
        "17: phonopy.band_points",
        "'1_1'",
        "number",
    ),
    "newer schema": (edit("schema: 1", "schema: 2"), "1: schema", "2", "1.", "newer granphon"),
    # loads
    "tensile load": (edit("18.446 N", "-18.446 N"), "11: load.force", "'-18.446 N'"),
    "zero load": (edit("18.446 N", "0 N"), "11: load.force", "'0 N'"),
    "overlap of the diameter": (
        edit("force: 18.446 N", "overlap: 8 mm"),
        "11: load.overlap",
        "'8 mm'",
        "can carry",
        "Lower the load",
    ),
    "force that crushes": (
        edit("18.446 N", "1 TN"),
        "11: load.force",
        "'1 TN'",
        "balls",
        "Lower the load",
    ),
    "two loads": (
        edit("  force: 18.446 N", "  force: 18.446 N\n  overlap: 1 um"),
        "10: load",
        "overlap",
        "balls_per_side",
        "Remove",
    ),
    "side force alone": (
        edit("force: 18.446 N", "side_force: 990 N"),
        "10: load",
        "side_force",
        "balls_per_side",
    ),
    "half a ball": (
        edit("force: 18.446 N", "side_force: 1 N\n  balls_per_side: 0.5"),
        "12: load.balls_per_side",
        "0.5",
        "number",
    ),
    "no load in a list": (edit("18.446 N", "[]"), "11: load.force", "an empty list", "values"),
    "one of many loads": (edit("18.446 N", "[1 N, 2 kg]"), "11: load.force.1", "'2 kg'", "'2 kgf'"),
    "load without a kind": (
        edit("force: 18.446 N", "{from: 1 N, to: 9 N}"),
        "10: load",
        "kind",
        "balls_per_side",
        "'force:'",
    ),
    "range without points": (
        edit("18.446 N", "{from: 1 N, to: 9 N}"),
        "11: load.force.points",
        "default",
        "a whole number",
    ),
    "range of too many points": (
        edit("18.446 N", "{from: 1 N, to: 9 N, points: 200001}"),
        "11: load.force.points",
        "200001",
        "200000",
    ),
    "range of one point": (
        edit("18.446 N", "{from: 1 N, to: 9 N, points: 1}"),
        "11: load.force.points",
        "range",
        "1 if",
    ),
    "range on an unknown scale": (
        edit("18.446 N", "{from: 1 N, to: 9 N, points: 3, scale: logarithmic}"),
        "11: load.force.scale",
        "'logarithmic'",
        "log, linear",
    ),
    "range that crushes": (
        edit("18.446 N", "{from: 1 N, to: 1 TN, points: 3}"),
        "11: load.force.to",
        "'1 TN'",
        "balls",
        "Lower",
    ),
    "log range from below zero": (
        edit("force: 18.446 N", "overlap: {from: -1 um, to: 1 um, points: 3}"),
        "11: load.overlap",
        "range",
        "values",
        "linear",
    ),
    "negative overlap of equal balls": (
        edit("force: 18.446 N", "overlap: -1 um"),
        "11: load.overlap",
        "'-1 um'",
        "can carry",
        "tensile",
    ),
    "overlap at which no balls touch": (
        edit(
            "friction: true\nload:\n  force: 18.446 N\nmedium: ala",
            "spread: {uniform: 2 um}\nload:\n  overlap: [1 um, -1.1 um]",
        ),
        "11: load.overlap.1",
        "'-1.1 um'",
        "can carry",
        "no balls touch",
    ),
    "force below what a medium is solved for": (
        edit(
            "friction: true\nload:\n  force: 18.446 N\nmedium: ala",
            "spread: {uniform: 2 um}\nload:\n  force: 1 nN",
        ),
        "11: load.force",
        "'1 nN'",
        "can carry",
        "Raise the load",
    ),
    # names
    "unknown medium": (
        edit("medium: ala", "medium: emma"),
        "12: medium",
        "'emma'",
        "ala, afa, ema",
        "'ema'",
    ),
    "unknown option of a medium": (
        edit("medium: ala", "medium: {ema: {tol: 1}}"),
        "12: medium.ema.tol",
        "an unknown key",
        "local_field",
    ),
    "value of an option": (
        edit("medium: ala", "medium: {ema: {local_field: papr}}"),
        "12: medium.ema.local_field",
        "'papr'",
        "computed",
        "'paper'",
    ),
    "options that are no block": (
        edit("medium: ala", "medium: {ema: paper}"),
        "12: medium.ema",
        "'paper'",
        "local_field",
    ),
    "misspelt option of a simulation": (
        edit("medium: ala", "medium:\n  simulation:\n    shape: 16 16\n    sampels: 4"),
        "15: medium.simulation.sampels",
        "an unknown key",
        "samples",
        "'samples'",
    ),
    "shape of three": (
        edit("medium: ala", "medium: {simulation: {shape: 16 16 1}}"),
        "12: medium.simulation.shape",
        "'16 16 1'",
        "numbers",
        "128",
    ),
    "seed that is none": (
        edit("medium: ala", "medium: [ala, simulation: {seed: -1}]"),
        "12: medium.1.simulation.seed",
        "-1",
        "number",
    ),
    "simulation with finite overlap": (
        edit(
            "  friction: true\nload:\n  force: 18.446 N\nmedium: ala",
            "  finite_overlap: true\nload:\n  force: 9 N\nmedium: [ala, {simulation: {geometry: lattice}}]",
        ),
        "9: packing.finite_overlap",
        "true",
        "simulation",
    ),
    "simulation of another lattice": (
        edit(
            "lattice: triangular\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N\nmedium: ala",
            "lattice: square\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N\nmedium: simulation",
        ),
        "12: medium",
        "'simulation'",
        "simulated",
    ),
    "two media in a block": (
        edit("medium: ala", "medium: {ala: , ema: }"),
        "12: medium",
        "block",
        "ala, afa, ema",
    ),
    "medium twice": (
        edit("medium: ala", "medium: [ema, afa, ema]"),
        "12: medium",
        "'ema'",
        "each once",
    ),
    "unknown lattice": (
        edit("triangular", "triangle"),
        "7: packing.lattice",
        "'triangle'",
        "triangular",
        "'triangular'",
    ),
    "unknown observable": (
        edit("[velocities]", "[velocity]"),
        "13: observe",
        "'velocity'",
        "velocities",
        "'velocities'",
    ),
    "observable without a list": (
        edit("[velocities]", "dos"),
        "13: observe",
        "'dos'",
        "a list of",
        "mean",
    ),
    "yes for true": (
        edit("friction: true", "friction: yes"),
        "9: packing.friction",
        "'yes'",
        "true or false",
        "mean",
    ),
    # spreads
    "empty spread": (edit("friction: true", "spread:"), "9: packing.spread", "nothing", "exactly"),
    "width in per cent": (
        edit("friction: true", "spread: {uniform: 1 %}"),
        "9: packing.spread.uniform",
        "'1 %'",
        "length",
        "'80 um'",
    ),
    "swept width in per cent": (
        edit("medium: ala", "sweep: {width: [1 um, 0.5 percent]}"),
        "12: sweep.width.1",
        "'0.5 percent'",
        "length",
        "'40 um'",
    ),
    "spread without a kind": (
        edit("friction: true", "spread: 2 um"),
        "9: packing.spread",
        "'2 um'",
        "exactly one of",
        "uniform",
    ),
    "misspelt spread": (
        edit("friction: true", "spread: {unifrom: 2 um}"),
        "9: packing.spread.unifrom",
        "an unknown key",
        "uniform",
        "'uniform'",
    ),
    "spread wider than the balls": (
        edit("friction: true", "spread: {uniform: 17 mm}"),
        "9: packing.spread.uniform",
        "'17 mm'",
        "all above zero",
        "smaller spread",
    ),
    "normal without a width": (
        edit("friction: true", "spread: {normal: {cutoff: 3}}"),
        "9: packing.spread.normal.std",
        "nothing",
        "length",
    ),
    "cutoff too large": (
        edit("friction: true", "spread: {normal: {std: 1 um, cutoff: 11}}"),
        "9: packing.spread.normal.cutoff",
        "11",
        "0.001",
    ),
    "discrete without fractions": (
        edit("friction: true", "spread: {discrete: {diameters: [8 mm]}}"),
        "9: packing.spread.discrete.fractions",
        "nothing",
    ),
    "one diameter for a list": (
        edit("friction: true", "spread: {measured: {diameters: 8 mm}}"),
        "9: packing.spread.measured.diameters",
        "'8 mm'",
        "a list of",
    ),
    "fractions that are too few": (
        edit("friction: true", "spread: {discrete: {diameters: [7 mm, 9 mm], fractions: [1]}}"),
        "9: packing.spread.discrete.fractions",
        "[1.0]",
        "diameters",
    ),
    "fractions of another sum": (
        edit(
            "friction: true", "spread: {discrete: {diameters: [7 mm, 9 mm], fractions: [0.5, 0.6]}}"
        ),
        "9: packing.spread.discrete.fractions",
        "[0.5, 0.6]",
        "with the sum 1",
        "Divide",
    ),
    "another mean": (
        edit(
            "friction: true",
            "spread: {discrete: {diameters: [7 mm, 9.1 mm], fractions: [0.5, 0.5]}}",
        ),
        "9: packing.spread.discrete",
        "block",
        "diameters",
        "0.00805",
    ),
    "no such table": (
        edit("friction: true", "spread: {measured: no.csv}"),
        "9: packing.spread.measured",
        "'no.csv'",
        "column",
        "cannot be read",
    ),
    "no name of a table": (
        edit("friction: true", "spread: {measured: }"),
        "9: packing.spread.measured",
        "nothing",
        "a name",
    ),
    # sweeps
    "misspelt parameter": (
        edit("medium: ala", "sweep: {widht: [1 um]}"),
        "12: sweep.widht",
        "an unknown key",
        "young_modulus",
        "'width'",
    ),
    "sweep without values": (
        edit("medium: ala", "sweep: {friction: true}"),
        "12: sweep.friction",
        "true",
        "values",
    ),
    "one of the values of a sweep": (
        edit("medium: ala", "sweep: {width: [1 um, 2]}"),
        "12: sweep.width.1",
        "unit",
        "length",
    ),
    "value that makes no packing": (
        edit("medium: ala", "sweep: {width: [1 um, 20 mm]}"),
        "12: sweep.width.1",
        "'20 mm'",
        "packing",
        "smaller spread",
    ),
    "mechanism in a sweep": (
        edit("medium: ala", "sweep: {friction: [true, false], lattice: [triangular, kagome]}"),
        "12: sweep.lattice",
        "'kagome'",
    ),
    "load that one packing of a sweep cannot carry": (
        edit(
            "  force: 18.446 N\nmedium: ala",
            "  overlap: -0.4 um\nmedium: ala\nsweep: {width: [2 um, 0.5 um]}",
        ),
        "11: load.overlap",
        "'-0.4 um'",
        "balls",
        "2 um",
    ),
    "density of states of a sweep": (
        edit(
            "  force: 18.446 N\nmedium: ala\nobserve: [velocities]",
            "  force: [1 N, 2 N]\nmedium: ala\nobserve: [dos]",
        ),
        "13: observe",
        "'dos'",
        "simulation",
    ),
    "bands of a sweep over friction": (
        edit(
            "medium: ala\nobserve: [velocities]",
            "sweep: {friction: [true, false]}\nobserve: [bands]",
        ),
        "13: observe",
        "'bands'",
        "velocities",
        "scene",
    ),
    # phonopy
    "band leaves the plane": (
        edit("1/3 1/3 0", "1/3 1/3 1/2"),
        "15: phonopy.band",
        "number",
        "three numbers",
        "layer",
    ),
    "band with a word": (edit("1/3 1/3 0", "1/3 K 0"), "15: phonopy.band", "'K'", "fractions"),
    "labels that do not match": (
        edit("G K M G", "G K M"),
        "16: phonopy.band_labels",
        "3 labels",
        "point",
    ),
    "mesh out of the plane": (
        edit("8 8 1", "8 8 8"),
        "18: phonopy.mesh",
        "number",
        "64",
        "one layer",
    ),
    "mesh of nothing": (edit("8 8 1", "0 8 1"), "18: phonopy.mesh", "'0 8 1'", "from 1 to 4096"),
    # the text itself
    "broken YAML": (edit("medium: ala", "medium: [ala"), "13: ", "broken YAML", "YAML"),
    "tab": (edit("  force", "\tforce"), "11: ", "broken YAML", "YAML", "Indent"),
    "object tag": (
        edit("18.446 N", "!!python/object/apply:os.getcwd []"),
        "11: load.force",
        "the tag",
        "plain values",
        "Leave",
    ),
    "alias": (
        edit("medium: ala", "medium: &a ala"),
        "12: medium",
        "anchor",
        "plain values",
        "Write",
    ),
    "control character": (edit("ala", "a\x07la"), "12: ", "'\\x07'", "printable text"),
    "empty file": (edit(SCENE, ""), "1: ", "an empty text", "a scene", "granphon init"),
    "a list": (edit(SCENE, "- a\n- b\n"), "1: ", "a list", "direction"),
    "two documents": (edit("medium: ala", "---\nmedium: ala"), "12: ", "document", "one document"),
    # what no lattice of this kind can do
    "mechanism": (
        edit(
            "triangular\n  diameter: 8 mm\n  friction: true",
            "square\n  diameter: 8 mm\n  friction: false",
        ),
        "7: packing.lattice",
        "'square'",
        "Use friction",
    ),
    "frame around squares": (
        edit(
            "triangular\n  diameter: 8 mm\n  friction: true\nload:\n  force: 18.446 N",
            "square\n  diameter: 8 mm\n  friction: true\nload:\n  side_force: 9 N\n  balls_per_side: 3",
        ),
        "11: load.side_force",
        "a side_force",
        "triangular",
    ),
    # lattices of one, two and three dimensions
    "unknown lattice in space": (
        pack("lattice: fccc"),
        "2: packing.lattice",
        "'fccc'",
        "bcc",
        "'fcc'",
    ),
    "balls overlap": (
        pack("lattice: {name: box, cell: [[0.5, 0], [0, 1]]}"),
        "2: packing.lattice",
        "'box'",
        "do not overlap",
        "0.5 apart",
    ),
    "lattice without a cell": (
        pack("lattice: {name: box}"),
        "2: packing.lattice.cell",
        "nothing",
        "list",
    ),
    "motions in space": (
        pack("lattice: fcc, motions: in_plane"),
        "2: packing.motions",
        "'in_plane'",
        "all; the fcc",
        "space",
    ),
    "torsion without rotations": (
        pack("lattice: chain, torsion: 0.1"),
        "2: packing.torsion",
        "0.1",
        "1e6",
        "'longitudinal'",
    ),
    "torsion where contacts do not twist": (
        pack("lattice: kagome, torsion: mindlin"),
        "2: packing.torsion",
        "mindlin",
        "1e6",
        "out_of_plane",
    ),
    "swept motions that twist no contact": (
        pack(
            "lattice: square, motions: all, torsion: 0.1", more="sweep: {motions: [all, in_plane]}"
        ),
        "4: sweep.motions.1",
        "in_plane",
        "packing",
        "out_of_plane",
    ),
    "bending with a unit": (
        pack("lattice: fcc, bending: 1 N m"),
        "2: packing.bending",
        "'1 N m'",
        "a finite",
        "unit",
    ),
    "pressure of a plane in space": (
        pack("lattice: fcc", load="pressure: 4 kN/m"),
        "3: load.pressure",
        "'4 kN/m'",
        "force",
        "is in Pa",
    ),
    "pressure of space in a plane": (
        pack("lattice: square", load="pressure: 4 kPa"),
        "3: load.pressure",
        "'4 kPa'",
        "length",
        "is in N/m",
    ),
    "side force in space": (
        pack("lattice: fcc", load="side_force: 1 N, balls_per_side: 3"),
        "3: load.side_force",
        "a side_force",
        "triangular",
    ),
    "mesh of a layer in space": (
        pack("lattice: fcc", more="phonopy: {mesh: 8 8 1}"),
        "4: phonopy.mesh",
        "'8 8 1'",
        "from 2 to",
    ),
    "path in space for a plane": (
        pack("lattice: square", more="phonopy: {band: 0 0 0 0 0 1/2}"),
        "4: phonopy.band",
        "a third number",
        "points",
        "one layer",
    ),
    "letter of another lattice": (
        pack("lattice: square", more="phonopy: {band: GKMG}"),
        "4: phonopy.band",
        "'GKMG'",
        "G, M, X",
        "numbers",
    ),
    "direction of a plane in space": (
        pack("lattice: fcc", more="direction: [1, 1]"),
        "4: direction",
        "[1, 1]",
        "numbers",
        "in space",
    ),
    "direction of space in a plane": (
        pack("lattice: square", more="direction: [[1, 0], [1, 0, 0]]"),
        "4: direction.1",
        "[1, 0, 0]",
        "two numbers",
        "in a plane",
    ),
    "direction twice": (
        pack("lattice: fcc", more="direction: [[1, 1, 0], [2, 2, 0]]"),
        "4: direction.1",
        "twice",
    ),
    "lattices of two dimensions": (
        pack("lattice: fcc", more="sweep: {lattice: [fcc, chain]}"),
        "4: sweep.lattice",
        "'fcc'",
        "one dimension",
        "sweep of each",
    ),
    "motions of a sweep over lattices": (
        pack(
            "",
            more="sweep: {motions: [in_plane], lattice: [square, {name: flat, cell: [[1, 0, 0], [0, 1, 0]], sites: [[0, 0, 0]]}]}",
        ),
        "4: sweep.motions.0",
        "'in_plane'",
        "lattice",
        "in space",
    ),
    "torsion twice in a sweep": (
        pack("lattice: fcc", more="sweep: {torsion: [0.1, 0, 0.]}"),
        "4: sweep.torsion.2",
        "0.0 twice",
        "value",
    ),
    "diameter twice in a sweep": (
        pack("lattice: fcc", more="sweep: {diameter: [8 mm, 0.8 cm]}"),
        "4: sweep.diameter.1",
        "'0.8 cm'",
        "each value",
    ),
    "torsion of a chain of a sweep": (
        pack("lattice: chain", more="sweep: {torsion: [0, 1]}"),
        "4: sweep.torsion.1",
        "packing",
        "rotation",
    ),
    "mechanism in space": (
        pack("lattice: diamond"),
        "2: packing.lattice",
        "'diamond'",
        "without a cost",
    ),
    "mechanism, and what it has": (
        pack("lattice: square, friction: false", more="observe: [velocities, bands]"),
        "2: packing.lattice",
        "'square'",
        "rigid",
        "velocities",
    ),
    "mechanism in a sweep without friction": (
        pack("lattice: square, friction: false", load="force: [1 N, 2 N]"),
        "2: packing.lattice",
        "'square'",
        "rigid",
        "velocities",
    ),
    "mechanism in a sweep without bands": (
        pack("lattice: square", more="sweep: {friction: [true, false]}"),
        "2: packing.lattice",
        "'square'",
        "friction",
        "density",
    ),
    "effective medium of a mechanism by default": (
        pack("lattice: sc, friction: false, spread: {uniform: 1 um}", more="observe: [bands]"),
        "1: medium",
        "'ema'",
        "Use friction",
    ),
    "simulation in space": (
        pack("lattice: sc, spread: {uniform: 1 um}", more="medium: simulation"),
        "4: medium",
        "'simulation'",
        "friction",
    ),
    "choice of medium in space": (
        pack("lattice: sc, spread: {uniform: 1 um}", more="medium: auto"),
        "4: medium",
        "'auto'",
        "a tolerance",
        "Name a medium",
    ),
    "bands of different motions": (
        pack("lattice: fcc, friction: false", more="observe: [bands]\nsweep: {torsion: [0, 0.1]}"),
        "4: observe",
        "torsion",
        "velocities",
    ),
    # crystals of several kinds
    "a packing beside": (
        kinds("crystal: {lattice: chain}\npacking: {diameter: 8 mm}\nload: {force: 1 N}"),
        "6: packing",
        "in place of",
    ),
    "no crystal": (kinds("load: {force: 1 N}"), "2: ", "crystal"),
    "no lattice": (kinds("crystal: {kinds: [A]}\nload: {force: 1 N}"), "5: crystal", "lattice"),
    "no kind": (
        kinds("crystal: {lattice: chain, kinds: [A, T]}\nload: {force: 1 N}"),
        "5: crystal",
        "'T'",
    ),
    "no law": (
        kinds("crystal: {lattice: chain, law: hooke}\nload: {force: 1 N}"),
        "5: crystal.law",
        "hertz, power",
    ),
    "a pair is missing": (
        kinds("crystal: {lattice: chain, law: {A A: hertz}}\nload: {force: 1 N}"),
        "5: crystal",
        "'S'",
    ),
    "an unknown edge": (
        kinds(
            "crystal: {lattice: square, kinds: [A], cut: {axis: 1, layers: 3, edges: glued}}\nload: {force: 1 N}"
        ),
        "5: crystal.cut.edges",
        "clamped",
    ),
    "two loads of a crystal": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N, strain: [-1e-4]}"),
        "6: load",
        "Remove",
    ),
    "times alone": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N, times: [1, 2]}"),
        "6: load.times",
        "stress",
    ),
    "gravity and the size of a frame": (
        kinds("crystal: {lattice: chain}\nload: {gravity: 9.81 m/s^2, balls_per_side: 3}"),
        "6: load",
        "balls_per_side",
    ),
    "gravity and a pressure without a floor": (
        kinds("crystal: {lattice: chain}\nload: {force: 10 N, gravity: 9.81 m/s^2}"),
        "6: load.gravity",
        "nothing holds",
    ),
    "gravity without a floor": (
        kinds("crystal: {lattice: chain}\nload: {gravity: 9.81 m/s^2}"),
        "6: load.gravity",
        "nothing holds",
    ),
    "a short tensor": (
        kinds("crystal: {lattice: fcc, kinds: [A]}\nload: {strain: [-1e-4]}"),
        "6: load.strain",
        "6 numbers",
    ),
    "a tensor of zeros": (
        kinds("crystal: {lattice: chain}\nload: {stress: [0 N]}"),
        "6: load.stress",
        "which is zero",
    ),
    "a stress without a unit": (
        kinds("crystal: {lattice: chain}\nload: {stress: [-3]}"),
        "6: load.stress",
        "with its unit",
    ),
    "another medium": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N}\nmedium: ema"),
        "7: medium",
        "crystal",
    ),
    "a pulse": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N}\nobserve: [pulse]"),
        "7: observe",
        "gp.Waves",
    ),
    "sound of what is held": (
        kinds(
            "crystal: {lattice: square, kinds: [A], cut: {axis: 1, layers: 3, edges: floor free}}\nload: {gravity: 9.81 m/s^2}"
        ),
        "2: observe",
        "Long waves",
    ),
    "a stress that opens": (
        kinds("crystal: {lattice: chain}\nload: {stress: [3 N]}"),
        "6: load.stress",
        "balls",
    ),
    "a parameter of a packing": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N}\nsweep: {width: [1 um]}"),
        "7: sweep",
        "A.diameter",
    ),
    "a side force": (
        kinds("crystal: {lattice: chain}\nload: {side_force: 9 N, balls_per_side: 3}"),
        "6: load.side_force",
        "triangular",
    ),
    "no period": (
        kinds("crystal: {lattice: chain, cut: {axis: 0, layers: 5}}\nload: {force: 1 N}"),
        "2: observe",
        "repeats",
    ),
    "twice": (
        kinds("crystal: {lattice: chain, repeat: 8, remove: 3 5 3}\nload: {force: 1 N}"),
        "5: crystal.remove",
        "ball 3 more",
    ),
    "no such ball": (
        kinds("crystal: {lattice: chain, remove: [7]}\nload: {force: 1 N}"),
        "5: crystal.remove",
        "once",
    ),
    "no such layer": (
        kinds(
            "crystal: {lattice: fcc, kinds: [A], repeat: 2 2 2, cut: {axis: 1 1, layers: 3}}\nload: {force: 1 N}"
        ),
        "5: crystal.cut",
        "Miller",
    ),
    "a mechanism": (
        kinds("crystal: {lattice: square, kinds: [A], friction: false}\nload: {force: 1 N}"),
        "5: crystal",
        "mechanism",
    ),
    "contacts that open": (
        kinds("crystal: {lattice: NaCl, kinds: [A, S]}\nload: {strain: [0, 0, -1e-4, 0, 0, 0]}"),
        "5: crystal",
        "mechanism",
    ),
    "a spectrum": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N}\nspectrum: {points: 3}"),
        "7: spectrum",
        "unknown key",
    ),
    "a kind without a ball": (
        kinds("crystal: {lattice: fcc, kinds: [A]}\nload: {force: 1 N}\nsweep: {S.mass: [1 g]}"),
        "7: sweep.S.mass",
        "unknown key",
    ),
}
