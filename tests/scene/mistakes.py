"""Mistakes in scenes, in one table: what is wrong, the line and the key that the error names, and what
else it says.

``granphon check`` refuses those of :data:`MISTAKES`. Those of :data:`LATE` a run alone can find.
"""

from __future__ import annotations

from tests import packings

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


def edit(old: str, new: str, scene: str = SCENE) -> str:
    """The scene with something else in place of a text that it has once."""
    assert scene.count(old) == 1
    return scene.replace(old, new)


def pack(packing: str, load: str = "force: 1 N", more: str = "") -> str:
    """A scene of a packing, on its second line; a load on the third; and more."""
    return (
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        f"packing: {{diameter: 8 mm, {packing}}}\nload: {{{load}}}\n{more}"
    )


def kinds(lines: str) -> str:
    """A scene of two kinds of balls, from its fifth line on."""
    return f"{BALLS}{lines}\n"


#: one kind of balls, driven
RESPONSE = kinds(
    """crystal: {lattice: chain, kinds: [S]}
load: {force: 20 N}
observe: [response]
response:
  frequencies: [400 Hz, 14 kHz]
  source: plane
  receiver: [19 x, 0 x]
  quantity: transmissibility
  cut: {axis: 0, layers: 20, edges: floor free}"""
)
#: bands with losses
BANDS = kinds(
    """crystal: {lattice: chain}
load: {force: 20 N}
observe: [bands]
bands: {loss_factor: 0.02}"""
)
SURFACE = pack("lattice: square", more="observe: [surface]\nsurface: {axis: 1, points: 3}\n")
WALL = "{wall: {young_modulus: 103 GPa, poisson_ratio: 0.34, density: 8500 kg/m^3}}"
#: a row of balls on springs, at a wall
ROW = kinds(
    "crystal: {lattice: chain, kinds: [S], repeat: 4, cut: {axis: 0, layers: 1, edges:"
    f" [{WALL}, free]}}, on_site: 20 kN/m}}\nload: {{force: 20 N}}\nobserve: [response]\n"
    "response: {frequencies: [1 kHz, 2 kHz], source: 3 x, receiver: 0 x, damping: 1 us}"
)
#: balls on springs
HELD = kinds(
    "crystal: {lattice: chain, kinds: [S], motions: in_plane, on_site: {x: 1 MN/m,"
    " rotation: 30 N*m}}\nload: {force: [10 N, 20 N]}\nobserve: [bands, gaps]"
)
#: a packing that another program has left
NETWORK = f"""
network:
  format: lammps
  files: [{packings.FOLDER}/disks_atoms.dump, {packings.FOLDER}/disks_pairs.dump]
  material: {{young_modulus: 70 GPa, poisson_ratio: 0.2, density: 2500 kg/m^3}}
observe: [velocities, dos, modes, response, pulse]
direction: [1, 0]
response: {{frequencies: [100 kHz, 150 kHz], source: 3 x, receiver: 7 x, loss_factor: 0.1}}
pulse: {{frequency: 90 kHz, distance: 4 mm, cycles: 2}}
modes: {{count: 3}}
"""
PUSH = "balls: 2, impact: 0.2 m/s"
MOTION = pack(
    "lattice: triangular",
    "force: 5 N",
    f"""observe: [motion]
motion:
  repeat: 5 1
  cut: {{axis: 1, layers: 4, edges: floor free}}
  drive: {{{PUSH}}}
  friction_coefficient: 0.3
  damping: 1 us
  duration: 40 us
  frames: 21
""",
)
DESIGN = kinds(
    """crystal: {lattice: chain, kinds: [S, S], friction: false}
load: {force: 20 N}
observe: [design]
design:
  goal: widest_gap
  vary: {mass: [9 g, 50 g]}
  constraints: {mass: 57 g}"""
)
#: quantities with standard errors
ERRORS = """\
material: {young_modulus: 211.65 +- 2 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {normal: 0.6 +- 0.05 um}}
load: {force: 18.4 +- 1 N}
observe: [velocities]
correlations: {'young_modulus, force': 0.3}
"""


def drive(words: str) -> str:
    """A scene whose balls are moved in another way."""
    return edit(f"{{{PUSH}}}", words, MOTION)


def array(observe: str, more: str = "", medium: str = "{simulation: {shape: [6, 18]}}") -> str:
    """A scene of a medium of balls that differ, from its fourth line on: it, what is observed, and more."""
    return pack(
        "spread: {uniform: 2.04 um}",
        "force: 5 N",
        f"medium: {medium}\nobserve: [{observe}]\n{more}",
    )


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
        "the name of a table",
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
    "broken YAML": (edit("medium: ala", "medium: [ala"), "13", "broken YAML", "YAML"),
    "tab": (edit("  force", "\tforce"), "11", "broken YAML", "YAML", "Indent"),
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
    "control character": (edit("ala", "a\x07la"), "12", "'\\x07'", "printable text"),
    "empty file": (edit(SCENE, ""), "1", "an empty text", "a scene", "granphon init"),
    "a list": (edit(SCENE, "- a\n- b\n"), "1", "a list", "direction"),
    "a text with an error": (edit(SCENE, "8 mm +- 4 um\n"), "1", "8 mm +- 4 um", "packing"),
    "a list with a fit": (edit(SCENE, "- {fit: fit.yaml}\n"), "1", "a list", "packing"),
    "an error of a measured diameter": (
        pack("spread: {measured: [8 mm +- 4 um, 8.1 mm]}").replace("diameter: 8 mm, ", ""),
        "2: packing.spread.measured.diameters.0",
        "standard error",
        "results",
    ),
    "two documents": (edit("medium: ala", "---\nmedium: ala"), "12", "document", "one document"),
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
        "1e+06",
        "'longitudinal'",
    ),
    "torsion where contacts do not twist": (
        pack("lattice: kagome, torsion: mindlin"),
        "2: packing.torsion",
        "mindlin",
        "1e+06",
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
        "three axes",
    ),
    "one direction in two lengths": (
        pack("lattice: triangular", more="direction: [[1, 3], [0.1, 0.3]]"),
        "4: direction.1",
        "twice",
    ),
    "direction of space in a plane": (
        pack("lattice: square", more="direction: [[1, 0], [1, 0, 0]]"),
        "4: direction.1",
        "[1, 0, 0]",
        "two numbers",
        "two axes",
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
    "sensitivities of a mechanism": (
        pack("lattice: square, friction: false", more="observe: [sensitivities]"),
        "2: packing.lattice",
        "'square'",
        "rigid",
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
    "no crystal": (kinds("load: {force: 1 N}"), "2: crystal", "nothing"),
    "no lattice": (kinds("crystal: {kinds: [A]}\nload: {force: 1 N}"), "5: crystal", "lattice"),
    "no kind": (
        kinds("crystal: {lattice: chain, kinds: [A, T]}\nload: {force: 1 N}"),
        "5: crystal",
        "'T'",
    ),
    "no pair of laws": (
        kinds("crystal: {lattice: chain, law: {}}\nload: {force: 1 N}"),
        "5: crystal.law",
        "hertz",
    ),
    "pairs inside a pair of laws": (
        kinds("crystal: {lattice: chain, law: {A S: {A S: hertz}}}\nload: {force: 1 N}"),
        "5: crystal.law.A S",
        "hertz",
    ),
    "a law without its numbers": (
        kinds("crystal: {lattice: chain, law: {hertz: 0}}\nload: {force: 1 N}"),
        "5: crystal.law.hertz",
        "found 0",
    ),
    "a ball that is replaced twice": (
        kinds("crystal: {lattice: chain, replace: {1: A, '01': S}}\nload: {force: 1 N}"),
        "5: crystal.replace",
        "ball 1",
    ),
    "a kind whose name is a formula": (
        kinds("crystal: {lattice: chain}\nload: {force: 1 N}").replace("  A: {", "  =A: {"),
        "4: balls.=A",
        "begin",
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
        "6: load.stress.0",
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
        "7: sweep.width",
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
    "a structure that is misspelt": (
        kinds("crystal: {lattice: zincblend, kinds: [A, S]}\nload: {force: 1 N}"),
        "5: crystal.lattice",
        "'zincblende'",
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
    # responses in frequency
    "a ball that moves itself": (
        edit("plane", "3 x", RESPONSE),
        "10: response.source",
        "ball 3",
        "moves",
    ),
    "a list in a list of sources": (
        edit("source: plane", "source: [[plane]]", RESPONSE),
        "10: response.source.0",
        "['plane']",
        "ball",
    ),
    "a ball of the floor is pushed": (
        edit(
            "source: plane\n  receiver: [19 x, 0 x]\n  quantity: transmissibility",
            "source: 20 x\n  receiver: plane",
            RESPONSE,
        ),
        "10: response.source",
        "ball 20",
        "held",
    ),
    "frequencies that fall": (
        edit("[400 Hz, 14 kHz]", "[2 kHz, 1 kHz]", RESPONSE),
        "9: response.frequencies",
        "1000 Hz after 2000 Hz",
        "ascending",
    ),
    "frequencies without a unit": (
        edit("[400 Hz, 14 kHz]", "[2, 1]", RESPONSE),
        "9: response.frequencies.0",
        "unit",
    ),
    "a frequency beyond any": (
        edit("[400 Hz, 14 kHz]", "[1e200 Hz]", RESPONSE),
        "9: response.frequencies",
        "frequencies up to",
    ),
    "a receiver that is no ball": (
        edit("[19 x, 0 x]", "77 x", RESPONSE),
        "11: response.receiver",
        "77",
        "0 to 20",
    ),
    "a receiver across the chain": (
        edit("[19 x, 0 x]", "7 y", RESPONSE),
        "11: response.receiver",
        "(0, 1, 0)",
        "x only",
    ),
    "a receiver without a direction": (
        edit("[19 x, 0 x]", "7", RESPONSE),
        "11: response.receiver",
        "found 7",
        "12 x",
    ),
    "a receiver twice": (
        edit("[19 x, 0 x]", "[7 x, 7 x]", RESPONSE),
        "11: response.receiver",
        "['7 x', '7 x']",
        "once",
    ),
    "a displacement of a contact": (
        edit("[19 x, 0 x]", "3-4", RESPONSE),
        "11: response.receiver",
        "(3, 4)",
        "force",
    ),
    "half of a contact": (
        edit("[19 x, 0 x]", "3-", RESPONSE),
        "11: response.receiver",
        "'3-'",
        "contact",
    ),
    "a misspelt quantity": (
        edit("quantity: transmissibility", "quantity: transmission", RESPONSE),
        "12: response.quantity",
        "'transmission'",
        "'transmissibility'",
    ),
    "an axis that a chain has not": (
        edit("axis: 0", "axis: 1", RESPONSE),
        "13: response.cut",
        "axis is 1",
        "Miller",
    ),
    "no layers": (
        edit("layers: 20", "layers: 0", RESPONSE),
        "13: response.cut.layers",
        "found 0",
        "1000000",
    ),
    "a distance of balls": (
        RESPONSE + "\n  distance: 3 mm",
        "15: response.distance",
        "no plane that is heard",
        "receiver: plane",
    ),
    "a polarisation of balls": (
        edit(
            "source: plane\n  receiver: [19 x, 0 x]\n  quantity: transmissibility",
            "source: 3 x\n  receiver: 7 x\n  polarisation: transverse",
            RESPONSE,
        ),
        "12: response.polarisation",
        "no plane",
        "source: plane",
    ),
    "a response without a source": (
        edit("  source: plane\n", "", RESPONSE),
        "8: response.source",
        "nothing",
        "default",
    ),
    "lattices beside arrays": (
        array(
            "response",
            "response: {frequencies: [2 kHz], source: plane, receiver: plane}\n",
            "[ema, {simulation: {shape: 4 8}}]",
        ),
        "5: observe",
        "'response'",
        "lattices",
    ),
    # losses
    "damping below zero": (
        RESPONSE + "  damping: -1 us\n",
        "14: response.damping",
        "'-1 us'",
        "negative",
    ),
    "damping beyond any": (
        RESPONSE + "  damping: 1e300 s\n",
        "14: response.damping",
        "1e+300",
        "1e+30 s",
    ),
    "a loss factor below zero": (
        RESPONSE + "  loss_factor: -0.1\n",
        "14: response.loss_factor",
        "-0.1",
        "zero",
    ),
    "a loss factor beyond any": (
        RESPONSE + "  loss_factor: 1e300\n",
        "14: response.loss_factor",
        "1e+300",
        "1e+06",
    ),
    "three loss factors": (
        RESPONSE + "  loss_factor: [0.1, 0.1, 0.1]\n",
        "14: response.loss_factor",
        "[0.1, 0.1, 0.1]",
        "normal",
    ),
    "a restitution of nothing": (
        RESPONSE + "  restitution: 0\n",
        "14: response.restitution",
        "found 0",
        "1e-06 to 1",
    ),
    "a restitution above one": (
        RESPONSE + "  restitution: 1.2\n",
        "14: response.restitution",
        "1.2",
        "1e-06 to 1",
    ),
    "a drag below zero": (
        RESPONSE + "  drag: -1 1/s\n",
        "14: response.drag",
        "'-1 1/s'",
        "negative",
    ),
    "a dashpot in kilograms": (
        RESPONSE + "  dashpot: 3 kg\n",
        "14: response.dashpot",
        "'3 kg'",
        "viscosity",
    ),
    "bands that gain energy": (
        edit("0.02", "-0.02", BANDS),
        "8: bands.loss_factor",
        "-0.02",
        "zero",
    ),
    # waves of an edge
    "no edge": (
        edit("surface: {axis: 1, points: 3}\n", "", SURFACE),
        "4: observe",
        "'surface'",
        "axis",
    ),
    "an edge without an axis": (
        edit("axis: 1", "edge: free", SURFACE),
        "5: surface.axis",
        "nothing",
        "default",
    ),
    "an axis beyond three": (
        edit("axis: 1", "axis: 5", SURFACE),
        "5: surface.axis",
        "found 5",
        "0 to 2",
    ),
    "four indices in a plane": (
        edit("axis: 1", "axis: 1 1 1 1", SURFACE),
        "5: surface.axis",
        "[1, 1, 1, 1]",
        "2 Miller",
    ),
    "an axis in letters": (
        edit("axis: 1", "axis: one", SURFACE),
        "5: surface.axis.0",
        "'one'",
        "number",
    ),
    "one point of a path": (
        edit("points: 3", "points: 1", SURFACE),
        "5: surface.points",
        "found 1",
        "from 2",
    ),
    "an edge of glue": (
        edit("points: 3", "edge: glued", SURFACE),
        "5: surface.edge",
        "'glued'",
        "clamped",
    ),
    "an edge of a simulation": (
        edit("observe:", "medium: {simulation: {shape: 4 4}}\nobserve:", SURFACE),
        "5: observe",
        "'surface'",
        "simulation",
    ),
    "edges of many lattices": (
        edit("observe:", "sweep: {lattice: [square, triangular]}\nobserve:", SURFACE),
        "5: observe",
        "'surface'",
        "sweep",
    ),
    # walls and springs to the ground
    "a spring below zero": (
        edit("20 kN/m", "-20 kN/m", ROW),
        "5: crystal.on_site",
        "'-20 kN/m'",
        "negative",
    ),
    "a spring without a unit": (
        edit("20 kN/m", "20", ROW),
        "5: crystal.on_site",
        "found 20",
        "unit",
    ),
    "a spring along no axis": (
        edit("20 kN/m", "{w: 20 kN/m}", ROW),
        "5: crystal.on_site.w",
        "unknown key",
        "rotation_x",
    ),
    "a spring along a motion that a chain has not": (
        edit("20 kN/m", "{z: 20 kN/m}", ROW),
        "5: crystal: on_site.z",
        "unknown key",
        "x",
    ),
    "a wall of nothing": (
        edit(WALL, "{wall: }", ROW),
        "5: crystal.cut.edges.0.wall",
        "nothing",
        "block",
    ),
    "a wall of no kind": (edit(WALL, "{wall: X}", ROW), "5: crystal.cut", "'X'", "S, A"),
    "a misspelt wall": (
        edit(WALL, "{wal: S}", ROW),
        "5: crystal.cut.edges.0.wal",
        "unknown key",
        "'wall'",
    ),
    "a wall without a unit": (
        edit("8500 kg/m^3", "8500", ROW),
        "5: crystal.cut.edges.0.wall.density",
        "8500",
        "unit",
    ),
    "sound of balls on springs": (
        edit("[bands, gaps]", "[velocities]", HELD),
        "7: observe",
        "'velocities'",
        "springs",
    ),
    # packings that another program has left
    "an option of another reader": (
        edit("  format", "  keywords: id\n  format", NETWORK),
        "2: network",
        "'keywords'",
        "rolling_stiffness",
    ),
    "walls without a name": (
        edit("format: lammps", 'format: liggghts\n  walls: ""', NETWORK),
        "4: network.walls",
        "''",
        "one or more names",
    ),
    "frozen balls without a column": (
        edit("  format", "  frozen: {}\n  format", NETWORK),
        "3: network.frozen",
        "an empty block",
        "{type: 2}",
    ),
    "columns without a name": (
        edit("  format", "  columns: {}\n  format", NETWORK),
        "3: network.columns",
        "an empty block",
        "R (mm)",
    ),
    "a load beside files": (
        edit("observe:", "load: {force: 3 N}\nobserve:", NETWORK),
        "6: load",
        "network",
        "Remove",
    ),
    "a medium beside files": (
        edit("observe:", "medium: ala\nobserve:", NETWORK),
        "6: medium",
        "network",
        "Remove",
    ),
    "a misspelt program": (
        edit("lammps", "lamps", NETWORK),
        "3: network.format",
        "'lamps'",
        "'lammps'",
    ),
    "a file too few": (
        edit(f", {packings.FOLDER}/disks_pairs.dump", "", NETWORK),
        "2: network",
        "1 file",
        "pairs",
    ),
    "a file too many": (
        edit("disks_pairs.dump", "disks_pairs.dump, b.dump", NETWORK),
        "2: network",
        "3 files",
        "pairs",
    ),
    "no such file": (
        edit("disks_pairs.dump", "no.dump", NETWORK),
        "2: network",
        "no.dump",
        "no such",
    ),
    "files in another order": (
        edit("disks_atoms.dump", "disks_pairs.dump", NETWORK),
        "2: network",
        "disks_pairs.dump",
    ),
    "a spectrum of files": (
        edit("dos, modes", "spectrum, modes", NETWORK) + "phonopy: {band: 0 0 0 1/3 0 0}\n",
        "2: spectrum",
        "no wave vector of the packing but zero",
        "0 0 0 8 0 0",
    ),
    "more modes than motions": (
        edit("count: 3", "count: 9999", NETWORK),
        "10: modes.count",
        "9999",
        "87 motions",
    ),
    "a modulus of length": (
        edit("70 GPa", "70 mm", NETWORK),
        "5: network.material.young_modulus",
        "'70 mm'",
        "pressure",
    ),
    # motion
    "no block of motion": (MOTION.partition("motion:\n")[0], "4: observe", "'motion'"),
    "a time below zero": (
        edit("40 us", "-1 us", MOTION),
        "11: motion.duration",
        "'-1 us'",
        "negative",
    ),
    "an hour of motion": (edit("40 us", "1 h", MOTION), "5: motion", "e+10", "steps"),
    "motion without a time": (
        edit("  duration: 40 us\n", "", MOTION),
        "5: motion.duration",
        "nothing",
        "default",
    ),
    "one frame": (
        edit("frames: 21", "frames: 1", MOTION),
        "12: motion.frames",
        "found 1",
        "from 2",
    ),
    "motion that is damped below zero": (
        edit("damping: 1 us", "damping: -1 us", MOTION),
        "10: motion.damping",
        "'-1 us'",
        "negative",
    ),
    "friction below zero": (
        edit("friction_coefficient: 0.3", "friction_coefficient: -1", MOTION),
        "9: motion.friction_coefficient",
        "-1",
        "zero",
    ),
    "friction of balls without friction": (
        edit("lattice: triangular", "lattice: triangular, friction: false", MOTION),
        "9: motion.friction_coefficient",
        "0.3",
        "slip",
    ),
    "a limit of slip that is not limited": (
        edit("friction_coefficient: 0.3", "coulomb: total", MOTION),
        "9: motion.coulomb",
        "total",
        "friction_coefficient",
    ),
    "a limit of dashpots that are not there": (
        edit("damping: 1 us", "viscous_pull: limited", MOTION),
        "10: motion.viscous_pull",
        "limited",
        "restitution",
    ),
    "an axis of motion beyond three": (
        edit("axis: 1", "axis: 7", MOTION),
        "7: motion.cut.axis",
        "found 7",
        "0 to 2",
    ),
    "repeated no times": (
        edit("repeat: 5 1", "repeat: 0 1", MOTION),
        "6: motion.repeat.0",
        "found 0",
        "from 1",
    ),
    "a geometry that is none": (
        edit("frames: 21", "geometry: true", MOTION),
        "12: motion.geometry",
        "true",
        "exact",
    ),
    "a scheme that is none": (
        edit("frames: 21", "scheme: euler", MOTION),
        "12: motion.scheme",
        "'euler'",
        "midpoint",
    ),
    "more balls than memory": (
        edit("repeat: 5 1", "repeat: 1000000 1000000", MOTION),
        "5: motion",
        "4,000,000,000,000",
        "memory",
    ),
    # drives
    "balls alone": (drive("{balls: 2}"), "8: motion.drive", "balls alone", "displacement"),
    "two drives in one": (
        drive("{balls: 2, impact: 1 m/s, force: push.csv}"),
        "8: motion.drive",
        "impact and force",
        "displacement",
    ),
    "a drive of no ball": (
        drive("{balls: 99, impact: 1 m/s}"),
        "8: motion.drive",
        "[99]",
        "0 to 20",
    ),
    "an impact on the floor": (
        drive("{balls: lower, impact: 1 m/s}"),
        "8: motion.drive",
        "impact",
        "held",
    ),
    "an impact on a shaken ball": (
        drive(
            "[{balls: 2, shaker: {amplitude: 1 um, frequency: 1 kHz}}, {balls: 2, impact: 1 m/s}]"
        ),
        "8: motion.drive",
        "impact",
        "displaced",
    ),
    "a ball shaken twice": (
        drive(f"[{', '.join(2 * ['{balls: 2, shaker: {amplitude: 1 um, frequency: 1 kHz}}'])}]"),
        "8: motion.drive",
        "two drives",
        "one drive",
    ),
    "a force on a shaken ball": (
        drive(
            "[{balls: 2, shaker: {amplitude: 1 um, frequency: 1 kHz}},"
            " {balls: 2, force: {time: [0 us, 20 us, 40 us], force: [0 N, 1 N, 0 N]}}]"
        ),
        "8: motion.drive",
        "two drives",
        "one drive",
    ),
    "a displacement that begins with a jump": (
        drive("{balls: 2, displacement: {time: [0 us, 40 us], displacement: [1 um, 0 um]}}"),
        "8: motion.drive",
        "does not begin at zero",
        "zero at zero",
    ),
    "a displacement of all balls": (
        drive(
            f"{{balls: {' '.join(map(str, range(21)))}, shaker: {{amplitude: 1 um, frequency: 1 kHz}}}}"
        ),
        "8: motion.drive",
        "no ball that moves",
        "network",
    ),
    "a force on the floor": (
        drive("{balls: lower, force: {time: [0 us, 20 us, 40 us], force: [0 N, 1 N, 0 N]}}"),
        "8: motion.drive",
        "held",
        "displacement",
    ),
    "a drive out of the plane": (
        drive("{balls: 2, impact: 1 m/s, direction: 0 0 1}"),
        "8: motion.drive",
        "(0, 0, 1)",
        "x and y",
    ),
    "a shaker faster than steps": (
        drive("{balls: 2, shaker: {amplitude: 1 nm, frequency: 1 THz}}"),
        "8: motion.drive",
        "1e+12 Hz",
        "10 steps",
    ),
    "balls in the middle": (
        drive("{balls: middle, impact: 1 m/s}"),
        "8: motion.drive.balls",
        "'middle'",
        "upper",
    ),
    "an impact in kilograms": (
        drive("{balls: 2, impact: 1 kg}"),
        "8: motion.drive.impact",
        "'1 kg'",
        "velocity",
    ),
    "an impact along nothing": (
        drive("{balls: 2, impact: 1 m/s, direction: 0 0}"),
        "8: motion.drive.direction",
        "'0 0'",
        "zero",
    ),
    "a push between steps": (
        drive("{balls: 2, force: {time: [10.1 us, 10.2 us, 10.3 us], force: [0 N, 9 N, 0 N]}}"),
        "8: motion.drive",
        "88.1 %",
        "lost",
    ),
    "a shaker without a frequency": (
        drive("{balls: 2, shaker: {amplitude: 1 um}}"),
        "8: motion.drive.shaker.frequency",
        "nothing",
        "default",
    ),
    "a push before the start": (
        drive("{balls: 2, force: {time: [0 s, -1 us], force: [0 N, 1 N]}}"),
        "8: motion.drive.force.time.1",
        "'-1 us'",
        "negative",
    ),
    "times that fall": (
        drive("{balls: 2, force: {time: [1 us, 0 s], force: [0 N, 1 N]}}"),
        "8: motion.drive.force",
        "row 2",
        "before",
    ),
    "a time without a force": (
        drive("{balls: 2, force: {time: [0 s, 1 us], force: [0 N]}}"),
        "8: motion.drive.force",
        "2 times and 1",
        "value",
    ),
    "no table of a push": (
        drive("{balls: 2, force: none.csv}"),
        "8: motion.drive.force",
        "none.csv",
        "columns",
    ),
    "no drive": (drive("[]"), "8: motion.drive", "empty list", "drives"),
    # designs
    "a misspelt goal": (
        edit("widest_gap", "widest_gaps", DESIGN),
        "9: design.goal",
        "'widest_gaps'",
        "'widest_gap'",
    ),
    "a gap above the bands": (
        edit("widest_gap", "{widest_gap: {near: 1 MHz}}", DESIGN),
        "9: design.goal",
        "1e+06 Hz",
        "between",
    ),
    "a design of cells along too few periods": (
        DESIGN + "  repeat: 4 4\n",
        "12: design.repeat",
        "[4, 4]",
        "one whole number",
    ),
    "a misspelt load to vary": (
        edit("mass: [9 g", "frce: [9 g", DESIGN),
        "10: design.vary.frce",
        "'frce'",
        "'load.force'",
    ),
    "a sum that bounds exclude": (
        edit("57 g", "1 kg", DESIGN),
        "11: design.constraints.mass",
        "0.018 to 0.1 kg",
        "reach",
    ),
    "bounds that exclude the balls": (
        edit("mass: [9 g", "mass: [40 g", DESIGN),
        "10: design.vary.mass",
        "0.04 to 0.05 kg",
        "outside",
    ),
    "a colour to vary": (
        edit("mass: [9 g", "colour: [9 g", DESIGN),
        "10: design.vary.colour",
        "'colour'",
        "normal_stiffness",
    ),
    "bounds that fall": (
        edit("[9 g, 50 g]", "[50 g, 9 g]", DESIGN),
        "10: design.vary.mass",
        "['50 g', '9 g']",
        "greatest",
    ),
    "numbers beside parameters": (
        edit("[9 g, 50 g]", "[9 g, 50 g], force: [1 N, 50 N]", DESIGN),
        "10: design.vary.mass",
        "force",
        "alone",
    ),
    "bounds that exclude the load": (
        edit("mass: [9 g, 50 g]}\n  constraints: {mass: 57 g}", "force: [30 N, 300 N]}", DESIGN),
        "10: design.vary.force",
        "20 N",
    ),
    "a goal that depends on nothing": (
        edit(
            "mass: [9 g, 50 g]}\n  constraints: {mass: 57 g}",
            "shear_stiffness: [0 N/m, 1 MN/m]}",
            DESIGN,
        ),
        "10: design.vary",
        "shear_stiffness",
        "contact 1",
    ),
    "a design of two loads": (
        edit("{force: 20 N}", "{force: [20 N, 30 N]}", DESIGN),
        "7: observe",
        "'design'",
        "several",
    ),
    "a design of a sweep": (
        edit("[design]", "[design]\nsweep: {S.mass: [20 g, 30 g]}", DESIGN),
        "7: observe",
        "'design'",
        "several",
    ),
    "a design with standard errors": (
        edit("20 N", "20 +- 1 N", DESIGN),
        "7: observe",
        "'design'",
        "errors",
    ),
    # waves in arrays
    "a spectrum of a medium": (
        array("spectrum", "", "ema"),
        "5: observe",
        "'spectrum'",
        "simulation",
    ),
    "a pulse in a medium": (
        array("pulse", "pulse: {frequency: 1 kHz}\n", "ema"),
        "5: observe",
        "'pulse'",
        "simulation",
    ),
    "a density of states of two loads": (
        pack("spread: {uniform: 2.04 um}", "force: [5 N, 6 N]", "observe: [dos]\n"),
        "4: observe",
        "'dos'",
        "simulation",
    ),
    "a pulse in a medium beside an array": (
        array("pulse", "pulse: {frequency: 1 kHz}\n", "[ema, {simulation: {shape: 6 18}}]"),
        "5: observe",
        "'pulse'",
        "'ema'",
    ),
    "a pulse without a block": (array("pulse"), "5: observe", "'pulse'", "6.5 kHz"),
    "a pulse without a frequency": (
        array("pulse", "pulse: {cycles: 3}\n"),
        "6: pulse.frequency",
        "nothing",
        "default",
    ),
    "a frequency without a unit": (
        array("pulse", "pulse: {frequency: 6500}\n"),
        "6: pulse.frequency",
        "6500",
        "unit",
    ),
    "a misspelt key of a pulse": (
        array("pulse", "pulse: {frequency: 1 kHz, cycle: 3}\n"),
        "6: pulse.cycle",
        "unknown key",
        "'cycles'",
    ),
    "a pulse that is damped below zero": (
        array("pulse", "pulse: {frequency: 1 kHz, damping: -1 us}\n"),
        "6: pulse.damping",
        "'-1 us'",
        "negative",
    ),
    "a pulse in two directions": (
        array("pulse", "pulse: {frequency: 1 kHz}\ndirection: [[0, 1], [1, 0]]\n"),
        "7: direction",
        "pulse",
        "one direction",
    ),
    "an unknown polarisation": (
        array("spectrum", "spectrum: {polarisation: long}\n"),
        "6: spectrum.polarisation",
        "'long'",
        "longitudinal",
    ),
    "a polarisation twice": (
        array("spectrum", "spectrum: {polarisation: [transverse, transverse]}\n"),
        "6: spectrum.polarisation",
        "['transverse', 'transverse']",
        "once",
    ),
    # standard errors
    "a force in millimetres with an error": (
        edit("18.4 +- 1 N", "18.4 +- 2 mm", ERRORS),
        "3: load.force",
        "'18.4 mm'",
        "unit",
    ),
    "an error in another unit": (
        edit("18.4 +- 1 N", "18.4 N +- 2 mm", ERRORS),
        "3: load.force",
        "in mm",
        "in N",
    ),
    "an error of zero": (
        edit("18.4 +- 1 N", "18.4 N +- 0 N", ERRORS),
        "3: load.force",
        "error of 0",
        "above zero",
    ),
    "an error below zero": (
        edit("18.4 +- 1 N", "18.4 +- -0.2 N", ERRORS),
        "3: load.force",
        "-0.2",
        "above zero",
    ),
    "an error as large as the value": (
        edit("18.4 +- 1 N", "18.4 +- 20 N", ERRORS),
        "3: load.force",
        "20",
        "large",
    ),
    "an error in letters": (
        edit("18.4 +- 1 N", "18.4 +- two N", ERRORS),
        "3: load.force",
        "'18.4 +- two N'",
        "error",
    ),
    "two errors": (
        edit("18.4 +- 1 N", "18.4 +- 0.2 +- 0.1 N", ERRORS),
        "3: load.force",
        "'18.4 +- 0.2 +- 0.1 N'",
        "error",
    ),
    "an error that leads out of what is stable": (
        edit("0.276", "0.49 +- 0.02", ERRORS),
        "1: material.poisson_ratio",
        "0.51",
        "stable",
    ),
    "an error of what is true": (
        edit("8 mm", "8 mm, friction: true +- 1", ERRORS),
        "2: packing.friction",
        "'true +- 1'",
        "false",
    ),
    "an error of an observable": (
        edit("[velocities]", "velocities +- bands", ERRORS),
        "4: observe",
        "'velocities +- bands'",
        "list",
    ),
    "an error of points": (
        edit("observe: [velocities]", "phonopy: {band_points: 11 +- 1}", ERRORS),
        "4: phonopy.band_points",
        "whole number",
    ),
    "an error of a seed": (
        edit("observe: [velocities]", "medium: {simulation: {seed: 3 +- 1}}", ERRORS),
        "4: medium.simulation.seed",
        "whole number",
    ),
    "no such fit": (
        edit("211.65 +- 2 GPa", "{fit: nowhere.yaml}", ERRORS),
        "1: material.young_modulus",
        "nowhere.yaml",
        "granphon fit",
    ),
    "more than a fit": (
        edit("211.65 +- 2 GPa", "{fit: a.yaml, of: b}", ERRORS),
        "1: material.young_modulus",
        "block",
        "alone",
    ),
    "a correlation of nothing": (
        edit("{'young_modulus, force': 0.3}", "0.3", ERRORS),
        "5: correlations",
        "0.3",
        "pairs",
    ),
    "a correlation of one": (
        edit("{'young_modulus, force': 0.3}", "{young_modulus: 0.3}", ERRORS),
        "5: correlations.young_modulus",
        "'young_modulus'",
        "two",
    ),
    "a correlation of what is exact": (
        edit("{'young_modulus, force': 0.3}", "{'young_modulus, density': 0.3}", ERRORS),
        "5: correlations.young_modulus, density",
        "'density'",
        "packing.spread.normal.std",
    ),
    "a correlation with itself": (
        edit("{'young_modulus, force': 0.3}", "{'young_modulus, young_modulus': 0.3}", ERRORS),
        "5: correlations.young_modulus, young_modulus",
        "twice",
    ),
    "a correlation twice": (
        edit(
            "{'young_modulus, force': 0.3}",
            "{'young_modulus, force': 0.3, 'force, young_modulus': 0.3}",
            ERRORS,
        ),
        "5: correlations.force, young_modulus",
        "twice",
    ),
    "a correlation above one": (
        edit("0.3}", "1.5}", ERRORS),
        "5: correlations.young_modulus, force",
        "1.5",
        "-1 to 1",
    ),
    "correlations that no errors have": (
        edit(
            "{'young_modulus, force': 0.3}",
            "{'young_modulus, force': 1, 'force, std': 1, 'young_modulus, std': 0}",
            ERRORS,
        ),
        "5: correlations",
        "-0.41",
        "semidefinite",
    ),
    # loads that no sample bears
    "a force that crushes a sample": (
        edit("force: 5 N", "force: 1e9 N", array("velocities")),
        "3: load.force",
        "'1e9 N'",
        "34.72 diameters",
    ),
    "a force too low for a sample": (
        edit("force: 5 N", "force: [5 N, 1e-9 N]", array("velocities")),
        "3: load.force.1",
        "nN",
        "rigidity",
    ),
    "a sample without contacts": (
        edit("force: 5 N", "overlap: -3 um", array("velocities")),
        "3: load.overlap",
        "'-3 um'",
        "touch",
    ),
    # names of lattices
    "a lattice with the name of another": (
        pack("lattice: {name: fcc, cell: [[1, 0], [0, 1]]}"),
        "2: packing.lattice",
        "'fcc'",
        "name",
    ),
    "a lattice in space with the name of another": (
        pack("lattice: {name: fcc, cell: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}"),
        "2: packing.lattice",
        "'fcc'",
        "name",
    ),
    "a lattice of no name": (
        pack("lattice: {name: '', cell: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}"),
        "2: packing.lattice.name",
        "''",
    ),
    "two lattices of one name": (
        pack(
            "lattice: fcc",
            more="sweep: {lattice: [{name: mine, cell: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},"
            " {name: mine, cell: [[1, 0, 0], [0, 1, 0], [0, -1, 1]]}]}",
        ),
        "4: sweep.lattice",
        "'mine'",
        "name",
    ),
    "a lattice that is read after its load": (
        "load: {pressure: 10 kPa}\n"
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm, lattice: fc}",
        "3: packing.lattice",
        "'fc'",
    ),
    "torsion of lattices whose contacts do not twist": (
        pack("lattice: fcc, torsion: 0.02", more="sweep: {lattice: [square, kagome]}"),
        "2: packing.torsion",
        "'in_plane'",
        "square",
    ),
    # values of a sweep that make no packing
    "the third of five values": (
        pack("spread: {uniform: 2 um}", more="sweep: {width: [1 um, 2 um, 17 mm, 18 mm, 3 um]}"),
        "4: sweep.width.2",
        "'17 mm'",
    ),
    "two values that do not go together": (
        pack("", more="sweep: {width: [1 um, 10 mm, 2 um], diameter: [8 mm, 4 mm]}"),
        "4: sweep",
        "width = 10 mm, diameter = 4 mm",
    ),
    "a value within a range": (
        pack("", more="sweep: {width: {from: 1 um, to: 40 mm, points: 3, scale: linear}}"),
        "4: sweep.width",
        "2 of 3",
        "'40 mm'",
    ),
    # balls of several kinds
    "a ball heavier to turn than a shell": (
        edit(
            "mass: 28.84 g",
            "inertia: 1 kg*m^2",
            kinds("crystal: {lattice: chain}\nload: {force: 1 N}"),
        ),
        "3: balls.S.inertia",
        "'1 kg*m^2'",
        "shell",
    ),
    "a strain of a packing": (
        pack("", "strain: [-1e-4, 0, 0]"),
        "3: load.strain",
        "packing",
        "force",
    ),
    "more modes than a crystal has": (
        kinds(
            "crystal: {lattice: chain, kinds: [S]}\nload: {force: 1 N}\nobserve: [modes]\nmodes: {count: 30, repeat: 2}"
        ),
        "8: modes.count",
        "30",
        "2 motions",
    ),
}
#: those that a run finds
LATE: dict[str, tuple[str, ...]] = {
    "a step that is not stable": (
        edit("frames: 21", "frames: 2\n  step: 20 us", MOTION),
        "5: motion",
        "2e-05 s",
        "stable",
    ),
}
