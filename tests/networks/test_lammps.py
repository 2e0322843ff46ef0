"""Networks from dumps of LAMMPS, against LAMMPS' own forces."""

import ctypes
import re
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InconsistencyWarning, StoppedEarlyWarning
from granphon.networks.sources import find_rounding
from granphon.waves.operator import WaveOperator
from tests import packings

GLASS = packings.MATERIAL
NAMES = list(packings.KEPT)


def dumps(name):
    return packings.FOLDER / f"{name}_atoms.dump", packings.FOLDER / f"{name}_pairs.dump"


@pytest.fixture(scope="module", params=NAMES)
def packing(request):
    """A packing that LAMMPS has relaxed, with its rattlers."""
    return gp.ContactNetwork.from_lammps(*dumps(request.param), GLASS, keep_rattlers=True)


@pytest.fixture(scope="module", params=[(2, 30, 0.86, 0), (3, 36, 0.65, 1)], ids=NAMES)
def lmp(request):
    """LAMMPS with a relaxed packing, in which no contact is so weak that a small step opens it."""
    try:
        running = packings.start()
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    packings.relax(running, *request.param)
    yield running
    running.close()


# -- LAMMPS ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "dimension", "balls", "contacts", "loose"),
    [("disks", 2, 30, 64, 1), ("balls", 3, 36, 125, 1)],
)
def test_dumps_of_lammps(name, dimension, balls, contacts, loose):
    network = gp.ContactNetwork.from_lammps(*dumps(name), GLASS)
    whole = gp.ContactNetwork.from_lammps(*dumps(name), GLASS, keep_rattlers=True)
    assert (whole.n_balls, whole.n_contacts, whole.left_out) == (balls, contacts, 0)
    assert (network.n_balls, network.left_out, whole.rattlers.size) == (balls - loose, loose, loose)
    assert network.dimension == dimension
    assert network.pbc == (True, True, dimension == 3)
    np.testing.assert_array_equal(whole.labels, np.arange(1, balls + 1))
    np.testing.assert_array_equal(network.labels, np.delete(whole.labels, whole.rattlers))
    assert not network.rattlers.size
    assert len(network.pieces()) == 1
    # the box that holds these balls, their masses as solid spheres, and forces that hold each ball
    # in balance
    filled = packings.KEPT[name][2]
    volumes = np.pi * whole.radii**2 if dimension == 2 else 4.0 / 3.0 * np.pi * whole.radii**3
    side = (volumes.sum() / filled) ** (1.0 / dimension)
    np.testing.assert_allclose(
        whole.cell[:dimension, :dimension], side * np.eye(dimension), rtol=1e-8
    )
    np.testing.assert_allclose(
        whole.masses, GLASS.density * 4.0 / 3.0 * np.pi * whole.radii**3, rtol=1e-8
    )
    np.testing.assert_allclose(whole.inertias, 0.4 * whole.masses * whole.radii**2)
    pull = np.zeros((balls, 3))
    np.add.at(pull, whole.j, whole.normal * whole.normal_force[:, None])
    np.add.at(pull, whole.i, -whole.normal * whole.normal_force[:, None])
    assert np.max(np.abs(pull)) < 1e-7 * whole.normal_force.mean()  # nine digits are in the files


def test_forces_of_lammps_are_those_of_hertz(packing):
    radius = (
        packing.radii[packing.i]
        * packing.radii[packing.j]
        / (packing.radii[packing.i] + packing.radii[packing.j])
    )
    overlap = (
        packing.radii[packing.i] + packing.radii[packing.j] - np.linalg.norm(packing.vector, axis=1)
    )
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    np.testing.assert_allclose(
        packing.normal_force,
        4.0 / 3.0 * modulus * np.sqrt(radius) * np.maximum(overlap, 0.0) ** 1.5,
        rtol=1e-5,
        atol=1e-6 * packing.normal_force.mean(),
    )
    deep = packing.normal_force > 1e-3 * packing.normal_force.mean()
    spring = 2.0 * modulus * np.sqrt(radius * np.maximum(overlap, 0.0))
    np.testing.assert_allclose(packing.normal_stiffness[deep], spring[deep], rtol=1e-4)
    np.testing.assert_allclose(
        packing.shear_stiffness, GLASS.mindlin_ratio * packing.normal_stiffness
    )
    np.testing.assert_allclose(
        packing.arm_i + packing.arm_j, np.linalg.norm(packing.vector, axis=1)
    )
    np.testing.assert_allclose(
        packing.radii[packing.i] - packing.arm_i, 0.5 * overlap, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("name", NAMES)
def test_vectors_and_forces_of_a_dump_may_be_missing(name, tmp_path):
    atoms, pairs = dumps(name)
    whole = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True)
    # three columns, without names: the vectors are those to the nearest images
    head, below = re.split(r"(?<=\n)ITEM: ENTRIES.*\n", pairs.read_text())
    rows = [line.split()[:3] for line in below.splitlines()]
    bare = tmp_path / "pairs.dump"
    bare.write_text(
        head + "ITEM: ENTRIES c_ids[1] c_ids[2] c_pair[1]\n" + "\n".join(map(" ".join, rows)) + "\n"
    )
    again = gp.ContactNetwork.from_lammps(
        atoms, bare, GLASS, columns=["i", "j", "force"], keep_rattlers=True
    )
    assert again == whole
    # two columns: the forces are Hertz's at the overlap of the positions, of which the file has
    # nine digits
    bare.write_text(
        head + "ITEM: ENTRIES i j\n" + "\n".join(" ".join(row[:2]) for row in rows) + "\n"
    )
    again = gp.ContactNetwork.from_lammps(atoms, bare, GLASS, keep_rattlers=True)
    strong = whole.normal_force > 1e-3 * whole.normal_force.mean()
    kept = np.isin(
        np.stack([whole.i, whole.j]).T @ [1000, 1], np.stack([again.i, again.j]).T @ [1000, 1]
    )
    assert np.all(kept[strong])
    np.testing.assert_allclose(
        again.normal_force[strong[kept]], whole.normal_force[strong], rtol=1e-4
    )


@pytest.mark.claim("network-lammps")
def test_lammps_responds_as_the_network_without_friction(lmp, tmp_path):
    network = read(lmp, tmp_path, friction=False, prestress=True)
    count = network.n_balls
    dimension = network.dimension
    rest = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3)
    step = 5e-11

    def forces(places):
        lmp.scatter_atoms("x", 1, 3, (ctypes.c_double * places.size)(*places.ravel()))
        lmp.command("run 0 post no")
        return np.array(lmp.gather_atoms("f", 1, 3)).reshape(-1, 3)[:, :dimension].ravel()

    constants = np.empty((count * dimension,) * 2)
    for column in range(count * dimension):
        moved = np.zeros((count, 3))
        moved[divmod(column, dimension)] = step
        constants[:, column] = (forces(rest - moved) - forces(rest + moved)) / (2.0 * step)
    forces(rest)
    root = np.repeat(np.sqrt(network.masses), dimension)
    theirs = constants / root / root[:, None]
    ours = WaveOperator(network).matrix.toarray()
    # the curvature of Hertz's law over a step: k''' step^2 of the contact that is pressed least,
    # and rounding
    np.testing.assert_allclose(theirs, ours, atol=1e-6 * np.max(ours))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(0.5 * (theirs + theirs.T)),
        np.linalg.eigvalsh(ours),
        atol=1e-6 * np.max(ours),
    )


def measure(lmp, network, law):
    """LAMMPS' own response, of balls moved by one step of time at a velocity: it adds up slip along
    the way. Balls that do not move are left out.
    """
    time = 1e-12
    size = 5e-11
    p = network.dimension
    axes = [*range(p), *([3, 4, 5] if p == 3 else [5])]
    moving = np.flatnonzero(network.moving)
    count = lmp.get_natoms()
    lmp.commands_string(f"{packings.coefficients(law)}\nfix move all nve/sphere\ntimestep {time!r}")

    def go(motion):
        for name, values in (("v", motion[:, :3]), ("omega", motion[:, 3:])):
            lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*(values / time).ravel()))
        lmp.command("run 1 post no")
        found = [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("f", "torque")]
        return np.hstack(found)[moving][:, axes].ravel()

    columns = []
    for ball in moving.tolist():
        for axis in axes:
            motion = np.zeros((count, 6))
            motion[ball, axis] = size / (1.0 if axis < p else 1e-3)
            ahead = go(motion)
            go(-motion)
            behind = go(-motion)
            go(motion)
            columns.append((behind - ahead) / (2.0 * motion[ball, axis]))
    masses = network.masses[moving]
    inertias = network.inertias[moving]
    root = np.sqrt(np.column_stack([masses] * p + [inertias] * (len(axes) - p)).ravel())
    return np.array(columns).T / root / root[:, None]


def respond(network):
    """The response of a network, with the part that has no potential."""
    operator = WaveOperator(network)
    return (operator.matrix if operator.whole is None else operator.whole).toarray()


@pytest.mark.claim("network-lammps")
def test_lammps_responds_as_the_network_with_friction(lmp, tmp_path):
    """LAMMPS adds up slip along the way: one step of time at a velocity is a displacement."""
    network = read(lmp, tmp_path, prestress=True)
    expected = respond(network)
    # the arms differ from the radii by half an overlap
    overlap = np.max(
        1.0
        - np.minimum(
            network.arm_i / network.radii[network.i], network.arm_j / network.radii[network.j]
        )
    )
    ours = WaveOperator(network).matrix
    np.testing.assert_allclose(ours.toarray(), expected, atol=2.0 * overlap * ours.max())

    rest = np.array(lmp.gather_atoms("x", 1, 3))
    np.testing.assert_allclose(
        measure(lmp, network, "mindlin NULL 0 1e9"), expected, atol=1e-5 * np.max(expected)
    )
    lmp.scatter_atoms("x", 1, 3, (ctypes.c_double * rest.size)(*rest))
    lmp.commands_string("unfix move\nset group all omega 0 0 0\nvelocity all set 0 0 0")
    lmp.command(packings.coefficients("linear_nohistory 0 0"))


def read(lmp, folder, **more):
    """The network of what LAMMPS holds, through its files."""
    atoms = folder / "atoms.dump"
    pairs = folder / "pairs.dump"
    packings.write_dumps(lmp, atoms, pairs)
    return gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True, **more)


@pytest.mark.filterwarnings(
    "ignore::granphon.base.errors.InconsistencyWarning"
)  # the stiffness is another
def test_boxes_units_and_places_of_dumps(tmp_path, lmp):
    """What LAMMPS writes of one state: scaled and unwrapped places, the tilted box, a box of any
    vectors, other units.
    """
    lmp.commands_string(f"""
        compute ids all property/local patom1 patom2 cutoff radius
        compute pair all pair/local force p10 p11 p12 cutoff radius
        dump pairs all local 1 {tmp_path}/pairs.dump c_ids[1] c_ids[2] c_pair[1] c_pair[2] c_pair[3] c_pair[4]
        dump_modify pairs format float %.16g
        dump atoms all custom 1 {tmp_path}/atoms.dump id type x y z diameter
        dump scaled all custom 1 {tmp_path}/scaled.dump id xs ys zs radius mass
        dump unwrapped all custom 1 {tmp_path}/unwrapped.dump id xu yu zu radius mass
        dump_modify atoms format float %.16g time yes
        dump_modify scaled format float %.16g
        dump_modify unwrapped format float %.16g
        run 0
        undump pairs
        undump atoms
        undump scaled
        undump unwrapped
        uncompute pair
        uncompute ids""")
    columns = ["i", "j", "force", "dx", "dy", "dz"]
    networks = [
        gp.ContactNetwork.from_lammps(
            tmp_path / f"{name}.dump",
            tmp_path / "pairs.dump",
            GLASS,
            columns=columns,
            friction=False,
        )
        for name in ("atoms", "scaled", "unwrapped")
    ]
    for network in networks[1:]:
        order = np.argsort(networks[0].labels)
        other = np.argsort(network.labels)
        for name in ("radii", "masses"):
            np.testing.assert_allclose(
                getattr(network, name)[other], getattr(networks[0], name)[order], rtol=1e-12
            )
        np.testing.assert_allclose(network.vector, networks[0].vector, atol=1e-15)
    # the same numbers in centimetres, grams and dyn, and in scales of one's own
    in_cgs = networks[0]
    for units, scales in (("cgs", (1e-2, 1e-5)), (gp.Units(1e-3, 2.0, 3.0), (1e-3, 2e-3))):
        found = gp.ContactNetwork.from_lammps(
            tmp_path / "scaled.dump",
            tmp_path / "pairs.dump",
            columns=columns,
            units=units,
            normal_stiffness=7.0,
            friction=False,
        )
        np.testing.assert_allclose(found.cell, scales[0] * in_cgs.cell)
        np.testing.assert_allclose(found.normal_force, scales[1] * in_cgs.normal_force)
        assert np.all(found.normal_stiffness == 7.0)


def test_tilted_boxes(tmp_path):
    """Four balls of a triangular lattice in a box with an angle of 60 degrees, as LAMMPS writes
    it.
    """
    try:
        running = packings.start()
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    spacing = 1.9e-3
    running.commands_string(f"""
        units si
        dimension 2
        boundary p p p
        atom_style sphere
        newton off
        region cell prism 0 3.8e-3 0 {2.0 * spacing * 0.75**0.5!r} -1e-3 1e-3 1.9e-3 0 0
        create_box 1 cell""")
    places = [[k + 0.5 * row, row * 0.75**0.5, 0.0] for k in range(2) for row in range(2)]
    running.create_atoms(4, [1, 2, 3, 4], [1] * 4, (spacing * np.ravel(places)).tolist())
    running.commands_string(f"""
        set group all diameter 2e-3 density 2500
        pair_style granular
        {packings.coefficients("linear_nohistory 0 0")}
        comm_modify vel yes""")
    packings.write_dumps(running, tmp_path / "atoms.dump", tmp_path / "pairs.dump")
    running.close()
    assert "BOX BOUNDS xy xz yz" in (tmp_path / "atoms.dump").read_text()
    network = gp.ContactNetwork.from_lammps(tmp_path / "atoms.dump", tmp_path / "pairs.dump", GLASS)
    assert (network.n_balls, network.n_contacts, network.left_out) == (4, 12, 0)
    np.testing.assert_allclose(np.linalg.norm(network.vector, axis=1), spacing, rtol=1e-9)
    np.testing.assert_allclose(
        network.cell,
        3.8e-3 * np.array([[1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0], [0.0, 0.0, 0.0]]),
        atol=1e-12,
    )


def spoil(*changes):
    """A change of the texts of both files: pairs of a pattern and what stands in its place, for
    atoms or for pairs.
    """

    def spoiled(name, folder):
        texts = [path.read_text() for path in dumps(name)]
        for which, pattern, new in changes:
            texts[which], count = re.subn(pattern, new, texts[which], count=1, flags=re.MULTILINE)
            assert count
        for name, text in zip(("atoms", "pairs"), texts, strict=True):
            (folder / f"{name}.dump").write_text(text)
        return folder / "atoms.dump", folder / "pairs.dump"

    return spoiled


def test_contacts_without_force_are_counted_in_a_note(tmp_path):
    """By Hertz's law such a contact is open, which its overlap denies here; springs that are given
    stay.
    """
    files = spoil((1, "^15 21 175.991614", "15 21 0"))("disks", tmp_path)
    with pytest.warns(InconsistencyWarning, match="15 and 21 in line 10.* 176 N"):
        network = gp.ContactNetwork.from_lammps(*files, GLASS, keep_rattlers=True)
    assert network.n_contacts == 63
    assert any("1 of 64 contacts" in note and "pairs.dump" in note for note in network.notes)
    whole = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS, keep_rattlers=True)
    assert not any("64" in note for note in whole.notes)
    with pytest.warns(InconsistencyWarning):  # two balls are out of balance now
        springs = gp.ContactNetwork.from_lammps(
            *files, normal_stiffness=1e6, shear_stiffness=0.0, keep_rattlers=True
        )
    assert springs.n_contacts == 64
    assert not any("64" in note for note in springs.notes)


BAD_DUMPS = {
    "steps": (
        spoil((0, r"TIMESTEP\n\d+", "TIMESTEP\n7")),
        {},
        "time step 7, and .* one step",
    ),
    "step": (spoil(), {"step": 3}, "no time step 3. It has .* alone"),
    "units": (spoil((1, r"\A", "ITEM: UNITS\ncgs\n")), {}, "in units si, and .* in units cgs"),
    "units below the step": (
        spoil((1, r"TIMESTEP\n\d+", r"\g<0>\nITEM: UNITS\ncgs")),
        {},
        "in units si, and .* in units cgs",
    ),
    "units of lj": (
        spoil((0, r"UNITS\nsi", "UNITS\nlj")),
        {},
        "says that its units are 'lj'.*=gp.Units",
    ),
    "units of metals": (
        spoil((0, r"UNITS\nsi", "UNITS\nmetal")),
        {},
        "are 'metal'.* Write it in si",
    ),
    "units given": (spoil(), {"units": "cgs"}, "units are 'si', and units='cgs'"),
    "units of pairs": (
        spoil((0, r"ITEM: UNITS\nsi\n", ""), (1, r"\A", "ITEM: UNITS\nsi\n")),
        {"units": "cgs"},
        "pairs.*units are 'si', and units='cgs'",
    ),
    "unknown units": (
        spoil(),
        {"units": "feet"},
        "units: found 'feet'; .* si, cgs, micro, nano",
    ),
    "ids": (
        spoil((1, "ENTRIES i j", "ENTRIES a b")),
        {},
        "no column i and no column j. .* colname 1 i",
    ),
    "names": (spoil(), {"columns": ["i", "j"]}, "has 6: i, j, force"),
    "names twice": (spoil(), {"columns": "i j force j x x"}, "columns name j twice"),
    "many names": (
        spoil((1, "ENTRIES i j.*", "ENTRIES" + " name" * 5000)),
        {},
        "name and 4990 more. Name them",
    ),
    "radius": (spoil((0, "radius", "size")), {}, "no column radius.*radius mass"),
    "id": (spoil((0, "ATOMS id", "ATOMS name")), {}, "no column id"),
    "x": (spoil((0, " x y z", " a b c")), {}, "no columns x, y and z"),
    "mass": (
        spoil((0, "mass", "size")),
        {"material": None, "normal_stiffness": 1.0},
        "no column 'mass', and no material",
    ),
    "swapped": (
        lambda name, folder: dumps(name)[::-1],
        {},
        "dump of entries, .* dump of atoms",
    ),
    "cut off": (
        spoil((1, r"\n[^\n]*\n\Z", "\n")),
        {},
        "64 entries .* 63 are there",
    ),
    "too few rows said": (
        spoil((1, r"(NUMBER OF ENTRIES\n)\d+", r"\g<1>60")),
        {"step": 3456},
        r"pairs.dump:\d+: .*row .* 60 entries",
    ),
    "number of rows": (
        spoil((1, r"ITEM: NUMBER OF ENTRIES\n\d+\n", "")),
        {},
        r"pairs.dump:\d+: the number of entries",
    ),
    "cell": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", r"\1 much")),
        {},
        r"pairs.dump:\d+: force: found 'much', where",
    ),
    "short line": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+).*", r"\1")),
        {},
        r"pairs.dump:10: force: found nothing",
    ),
    "ball": (
        spoil((1, r"(ITEM: ENTRIES.*\n)\d+", r"\g<1>99")),
        {},
        "1 of 64 .* balls 99 and .* in line 10",
    ),
    "part": (spoil((1, r"(ITEM: ENTRIES.*\n)\d+", r"\g<1>1.5")), {}, "1.5 where a whole number"),
    "twice": (
        spoil((0, r"^2 ", "1 ")),
        {},
        "2 of 30 .*another ball.* ball 1 in line 12; ball 1",
    ),
    "tension": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+ )", r"\1-")),
        {},
        "a force that pulls.* in line 10 .-",
    ),
    "vector": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+ \S+ )\S+", r"\g<1>0.1")),
        {},
        "a vector .* from ball to ball",
    ),
    "boxes": (spoil((1, r"(BOUNDS.*\n\S+ )\S+", r"\g<1>0.1")), {}, "different boxes"),
    "box": (spoil((0, r"(BOUNDS.*\n)\S+", r"\g<1>wide")), {}, "bounds of the box"),
    "exchanged box": (
        spoil(
            (0, r"(BOUNDS.*\n)(\S+) (\S+)", r"\1\3 \2"), (1, r"(BOUNDS.*\n)(\S+) (\S+)", r"\1\3 \2")
        ),
        {},
        r"atoms.dump:\d+: the box .* -0\.\d+ along x.* lower bound",
    ),
    "flat box": (
        spoil(
            (0, r"(BOUNDS.*\n.*\n)(\S+) \S+", r"\1\2 \2"),
            (1, r"(BOUNDS.*\n.*\n)(\S+) \S+", r"\1\2 \2"),
        ),
        {},
        r"atoms.dump:\d+: the box .* 0 along y",
    ),
    "many digits": (
        spoil((0, r"(NUMBER OF ATOMS\n)\d+", r"\g<1>" + "9" * 5000)),
        {},
        "found '999.*whole number of at most 19",
    ),
    "time of many digits": (
        spoil((1, r"TIMESTEP\n\d+", "TIMESTEP\n" + "1" * 5000)),
        {},
        "whole number of at most",
    ),
    "other digits": (
        spoil((0, r"(NUMBER OF ATOMS\n)\d+", "\\1\u0663\u0660")),
        {},
        "whole number",
    ),
    "columns of a number": (spoil(), {"columns": 5}, "columns are 5, and .* has 6: i, j, force"),
    "columns of numbers": (spoil(), {"columns": [1, 2, 3, 4, 5, 6]}, "columns are .1, 2, 3"),
    "underscore": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", r"\1 1_0")),
        {},
        "force: found '1_0', where a number",
    ),
    "arabic": (
        spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", "\\1 \u0661\u0660")),
        {},
        "force: found '.*', where a number",
    ),
    "arabic box": (
        spoil((0, r"(BOUNDS.*\n)\S+", "\\1-\u0661")),
        {},
        "bounds of the box",
    ),
    "escape": (
        spoil((0, "radius", "\x1b[2Jradius")),
        {},
        r"found a column named '\\x1b\[2Jradius'",
    ),
    "backwards": (
        spoil((1, "ENTRIES i", "ENTRIES \u202ei")),
        {},
        r"found a column named '\\u202ei'",
    ),
    "escape in units": (
        spoil((0, "UNITS\nsi", "UNITS\n\x1b[31msi")),
        {"units": "si"},
        r"its units are '\\x1b\[31msi', .* Write it in",
    ),
    "escape in columns": (
        spoil(),
        {"columns": ["\x1b[2J", "b", "c", "d", "e", "f"]},
        r"columns are \\x1b\[2J, b, c",
    ),
    "general box": (spoil((0, "BOX BOUNDS", "BOX BOUNDS abc origin")), {}, "triclinic/general"),
    "count": (
        spoil((0, r"(NUMBER OF ATOMS\n)\d+", r"\1many")),
        {},
        "found 'many', where a whole number",
    ),
    "another file": (
        lambda name, folder: (dumps(name)[0], __file__),
        {},
        "where a line 'ITEM: ...' is needed",
    ),
    "no file": (lambda name, folder: (folder / "no.dump", dumps(name)[1]), {}, "no such file"),
    "material": (spoil(), {"material": "steel"}, "material is 'steel'.* gp.Material"),
    "no material": (
        spoil(),
        {"material": None},
        "no normal_stiffness, shear_stiffness, .*material",
    ),
    "far": (
        spoil((0, r"^2 \S+", "2 0.00444")),
        {"columns": ["i", "j", "force", "a", "b", "c"]},
        "not near each other",
    ),
    "dimension": (
        spoil((0, r"^(2 \S+ \S+) 0", r"\1 1e-4")),
        {"dimension": 2},
        "a vector .* from ball to ball",
    ),
}


@pytest.mark.parametrize("name", BAD_DUMPS)
def test_dumps_that_cannot_be_read(name, tmp_path):
    """Each has one error, which says what is wrong and where."""
    make, more, said = BAD_DUMPS[name]
    with pytest.raises(gp.GranphonError, match=said) as error:
        gp.ContactNetwork.from_lammps(*make("disks", tmp_path), **({"material": GLASS} | more))
    assert str(error.value).isprintable()


@pytest.mark.parametrize("digits", [16, 9, 6])
@pytest.mark.parametrize("scaled", [False, True])
def test_a_force_that_is_not_that_of_the_overlap_is_told(digits, scaled, tmp_path):
    """Where the file has too few digits for the overlap, only what is beyond them is told."""
    atoms, pairs = (path.read_text() for path in dumps("disks"))
    start = pairs.index("\n", pairs.index("ITEM: ENTRIES")) + 1
    rows = [line.split() for line in pairs[start:].splitlines()]
    frame = re.split(r"(ITEM: ATOMS.*\n)", atoms)
    names, low, side = (
        frame[1].split()[2:],
        *map(float, re.search(r"BOUNDS.*\n(\S+) (\S+)", atoms).groups()),
    )
    cells = [line.split() for line in frame[2].splitlines()]
    for line in cells:
        for axis in "xyz":
            place = float(line[names.index(axis)])
            at = names.index(axis)
            share = (
                (place - low) / (side - low) if scaled and axis != "z" else 0.5 if scaled else place
            )
            line[at] = f"{share:.{digits}g}"
    head = frame[1].replace(" x y z", " xs ys zs") if scaled else frame[1]
    (tmp_path / "atoms").write_text(frame[0] + head + "\n".join(map(" ".join, cells)) + "\n")

    def read(**changed):
        """The network with other forces of some of the pairs, by their number."""
        lines = [
            [*row[:2], f"{changed.get(f'of_{n}', 1.0) * float(row[2]):.16g}"]
            for n, row in enumerate(rows)
        ]
        head = re.sub("ENTRIES.*", "ENTRIES i j force", pairs[:start])
        (tmp_path / "pairs").write_text(head + "\n".join(map(" ".join, lines)) + "\n")
        return gp.ContactNetwork.from_lammps(
            tmp_path / "atoms", tmp_path / "pairs", GLASS, keep_rattlers=True
        )

    mean = np.mean([float(row[2]) for row in rows])
    ordinary = next(n for n, row in enumerate(rows) if float(row[2]) > 0.5 * mean)
    assert read(**{f"of_{ordinary}": 5.0}).n_contacts == read().n_contacts
    said = rf"pairs: 1 contact .* {rows[ordinary][0]} and {rows[ordinary][1]}, with .* N where"
    for factor in (500.0, 1.0 / 500.0):
        with pytest.raises(InconsistencyWarning, match=said):
            read(**{f"of_{ordinary}": factor})
    with pytest.raises(InconsistencyWarning, match=r"pairs: the forces are [345].. times"):
        read(**{f"of_{n}": 500.0 for n in range(len(rows))})
    with pytest.warns(InconsistencyWarning) as caught:
        read(of_0=1e6)
    assert caught[0].filename == __file__


DUMP = """ITEM: TIMESTEP
1000
ITEM: NUMBER OF {}
3
ITEM: BOX BOUNDS ff ff ff
0 0.1
0 0.1
-0.001 0.001
ITEM: {}
"""
#: three balls of 0.5 mm at the corners of a triangle, whose contacts overlap by 5.5e-8 m
OVERLAP = 5.5e-8
CORNERS = 0.05 + (1e-3 - OVERLAP) * np.array(
    [[0.0, 0.0, -50.0], [1.0, 0.0, -50.0], [0.5, 0.75**0.5, -50.0]]
)
CORNERS[:, 2] = 0.0


def write_triangle(folder, form, forces=None, density=2500.0, unit=1.0):
    """Write the dumps of three balls, with places and radii in this format; return their paths."""
    mass = density * 4.0 / 3.0 * np.pi * 5e-4**3
    rows = [
        f"{n} " + " ".join(form % (unit * x) for x in (*place, 5e-4))
        for n, place in enumerate(CORNERS.tolist(), 1)
    ]
    rows = [f"{row} {mass!r}\n" for row in rows]
    (folder / "atoms.dump").write_text(
        DUMP.format("ATOMS", "ATOMS id x y z radius mass") + "".join(rows)
    )
    ends = ["1 2", "2 3", "3 1"]
    rows = [f"{pair} {force!r}\n" for pair, force in zip(ends, forces or [0.0] * 3, strict=True)]
    (folder / "pairs.dump").write_text(
        DUMP.format("ENTRIES", f"ENTRIES i j {'force' if forces else 'none'}") + "".join(rows)
    )
    return folder / "atoms.dump", folder / "pairs.dump"


def hertz_force():
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    return float(4.0 / 3.0 * modulus * np.sqrt(2.5e-4) * OVERLAP**1.5)


@pytest.mark.claim("network-digits")
@pytest.mark.parametrize("table", [False, True])
def test_places_with_too_few_digits_give_no_forces(table, tmp_path):
    """Forces that follow from overlaps are compared with the error that rounded places leave in
    these.
    """

    def read(form, unit="m"):
        write_triangle(tmp_path, form, unit={"m": 1.0, "mm": 1e3, "inch": 1.0 / 0.0254}[unit])
        if not table:
            return gp.ContactNetwork.from_lammps(
                tmp_path / "atoms.dump", tmp_path / "pairs.dump", GLASS
            )
        rows = [line.split()[:5] for line in (tmp_path / "atoms.dump").read_text().splitlines()[9:]]
        head = ",".join(["id", *(f"{name} ({unit})" for name in ("x", "y", "z", "radius"))])
        (tmp_path / "balls.csv").write_text("\n".join([head, *map(",".join, rows), ""]))
        return gp.ContactNetwork.from_table(
            tmp_path / "balls.csv", {"i": [1, 2, 3], "j": [2, 3, 1]}, material=GLASS
        )

    np.testing.assert_allclose(read("%.16g").normal_force, hertz_force(), rtol=1e-6)
    for unit in ("m", "mm", "inch") if table else ("m",):
        # an overlap of 5.5e-8 m beside 5e-8 m, half of the last digit
        with pytest.raises(gp.GranphonError, match=r"rounded.* .*%\.16g"):
            read("%.6g", unit)
        with pytest.warns(InconsistencyWarning, match="rounded") as caught:
            found = read("%.8g", unit)
        assert caught[0].filename == __file__
        # the error that is told is a standard one
        told = float(re.search(r"leave (\S+)%", str(caught[0].message))[1]) / 100.0
        np.testing.assert_allclose(found.normal_force, hertz_force(), rtol=4.0 * told)
        np.testing.assert_allclose(read("%.9g", unit).normal_force, hertz_force(), rtol=6e-3)


@pytest.mark.claim("network-digits")
@pytest.mark.parametrize(
    ("form", "last"),
    [
        ("%.6g", None),
        ("%.9g", None),
        ("%.6f", 1e-6),
        ("%.8f", 1e-8),
        ("%.3e", None),
        ("single", None),
    ],
)
def test_the_rounding_of_a_file_is_found_in_its_numbers(form, last):
    """The bound holds for each number, and is no larger than half of its last digit."""
    exact = np.random.default_rng(4).uniform(0.0, 0.05, (400, 3))
    if form == "single":
        rounded = exact.astype(np.float32).astype(float)
        half = 0.5 * np.spacing(exact.astype(np.float32))
    else:
        rounded = np.vectorize(lambda value: float(form % value))(exact)
        digits = 4 if form.endswith("e") else int(form[2])
        half = 0.5 * (last or 10.0 ** (np.floor(np.log10(rounded)) - digits + 1))
    found = find_rounding(rounded)
    np.testing.assert_allclose(found, np.broadcast_to(half, found.shape), rtol=1e-9)
    assert np.all(np.abs(rounded - exact) <= found * (1.0 + 1e-9))


def test_few_numbers_of_few_digits_are_exact():
    for chosen in (
        [[0.0, 0.0079999, -0.004]],
        [[5e-4]],
        [[0.0]],
        np.zeros((0, 3)),
        [[np.inf, 1.5, np.nan]],
    ):
        assert not np.any(find_rounding(np.array(chosen)))


def test_masses_and_forces_that_have_one_factor_are_told(tmp_path):
    """The factor is named: that of all masses to the density, of all forces to Hertz's law."""
    force = hertz_force()

    def read(**more):
        return gp.ContactNetwork.from_lammps(*write_triangle(tmp_path, "%.16g", **more), GLASS)

    assert read(forces=[force] * 3).n_contacts == 3
    assert read(forces=[1.04 * force] * 3, density=2400.0).n_contacts == 3
    with pytest.warns(InconsistencyWarning, match=r"forces are 2 times") as caught:
        read(forces=[2.0 * force] * 3)
    assert caught[0].filename == __file__
    with pytest.warns(InconsistencyWarning, match="1000 times .* 2500 kg/m3") as caught:
        read(forces=[force] * 3, density=2.5e6)
    assert caught[0].filename == __file__
    with pytest.warns(InconsistencyWarning, match=r"masses are 0\.9 times"):
        read(forces=[force] * 3, density=2250.0)
    # where masses follow from the density, one that is too small is told
    paths = write_triangle(tmp_path, "%.16g", forces=[force] * 3)
    paths[0].write_text(paths[0].read_text().replace("mass", "size"))
    with pytest.warns(InconsistencyWarning, match=r"density .* 7\.84 kg/m\^3"):
        gp.ContactNetwork.from_lammps(*paths, replace(GLASS, density=7.84))


@pytest.mark.parametrize("which", [0, 1])
def test_a_dump_that_is_cut_is_read_before_that(which, tmp_path):
    """LAMMPS was killed: the step that is asked for is whole, and a later one is not."""
    paths = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    texts = [path.read_text() for path in dumps("disks")]
    steps = [
        re.sub(r"TIMESTEP\n\d+", f"TIMESTEP\n{step}", text) for text in texts for step in (100, 200)
    ]
    whole = steps[2 * which] + steps[2 * which + 1]
    paths[1 - which].write_text(steps[2 - 2 * which] + steps[3 - 2 * which])
    expected = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS)
    begin = len(steps[2 * which])
    for cut in (
        whole.index("\n", begin) + 7,
        whole.index("BOUNDS", begin),
        *(len(whole) - n for n in (700, 40, 5, 1)),
        begin + 9,
    ):
        paths[which].write_text(whole[:cut])
        with pytest.warns(StoppedEarlyWarning, match=f"{paths[which].name} .*step 100") as caught:
            assert gp.ContactNetwork.from_lammps(*paths, GLASS, step=100) == expected
        assert caught[0].filename == __file__
        for step in (None, 200):
            with pytest.raises(gp.GranphonError, match="step=100"):
                gp.ContactNetwork.from_lammps(*paths, GLASS, step=step)


def test_the_number_of_rows_is_that_of_the_step(tmp_path):
    paths = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    for path, source in zip(paths, dumps("disks"), strict=True):
        text = source.read_text()
        later = re.sub(r"ITEM: NUMBER OF \w+\n\d+\n", "", text)
        path.write_text(re.sub(r"TIMESTEP\n\d+", "TIMESTEP\n5", text) + later)
    with pytest.raises(gp.GranphonError, match="number of atoms"):
        gp.ContactNetwork.from_lammps(*paths, GLASS)


def test_vectors_that_lead_the_other_way_are_told(tmp_path):
    atoms, pairs = dumps("disks")
    head, below = re.split(r"(?<=\n)(?=ITEM: ENTRIES)", pairs.read_text())
    lines = [line.split() for line in below.splitlines()]
    turned = [[*row[:3], *(repr(-float(one)) for one in row[3:6])] for row in lines[1:]]
    (tmp_path / "pairs").write_text(head + "\n".join(map(" ".join, [lines[0], *turned])) + "\n")
    with pytest.raises(gp.GranphonError, match=r"64 of 64 .*ball j to"):
        gp.ContactNetwork.from_lammps(atoms, tmp_path / "pairs", GLASS)


def test_the_last_of_several_steps_is_read(tmp_path):
    for which, path in zip(("atoms", "pairs"), dumps("disks"), strict=True):
        text = path.read_text()
        early = re.sub(r"TIMESTEP\n\d+", "TIMESTEP\n5", text)
        late = re.sub(r"ITEM: UNITS\nsi\n", "", re.sub(r"TIMESTEP\n\d+", "TIMESTEP\n6", text))
        (tmp_path / f"{which}.dump").write_text(early + late)
    both = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    whole = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS)
    assert gp.ContactNetwork.from_lammps(*both, GLASS) == whole
    assert gp.ContactNetwork.from_lammps(*both, GLASS, step=5) == whole
    with pytest.raises(gp.GranphonError, match=r"step 4\..* 5 to 6"):
        gp.ContactNetwork.from_lammps(*both, GLASS, step=4)
