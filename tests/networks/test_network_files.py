"""Networks from files: dumps of LAMMPS, against LAMMPS' own forces; tables of balls and contacts, read and written."""

import ctypes
import re
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError, UnverifiedFileWarning
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


# -- LAMMPS ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "dimension", "balls", "contacts", "loose"), [("disks", 2, 30, 64, 1), ("balls", 3, 36, 125, 1)]
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
    # the box that holds these balls, their masses as solid spheres, and forces that hold each ball in balance
    filled = packings.KEPT[name][2]
    volumes = np.pi * whole.radii**2 if dimension == 2 else 4.0 / 3.0 * np.pi * whole.radii**3
    side = (volumes.sum() / filled) ** (1.0 / dimension)
    np.testing.assert_allclose(whole.cell[:dimension, :dimension], side * np.eye(dimension), rtol=1e-8)
    np.testing.assert_allclose(whole.masses, GLASS.density * 4.0 / 3.0 * np.pi * whole.radii**3, rtol=1e-8)
    np.testing.assert_allclose(whole.inertias, 0.4 * whole.masses * whole.radii**2)
    pull = np.zeros((balls, 3))
    np.add.at(pull, whole.j, whole.normal * whole.normal_force[:, None])
    np.add.at(pull, whole.i, -whole.normal * whole.normal_force[:, None])
    assert np.max(np.abs(pull)) < 1e-7 * whole.normal_force.mean()  # nine digits are in the files


def test_forces_of_lammps_are_those_of_hertz(packing):
    radius = packing.radii[packing.i] * packing.radii[packing.j] / (packing.radii[packing.i] + packing.radii[packing.j])
    overlap = packing.radii[packing.i] + packing.radii[packing.j] - np.linalg.norm(packing.vector, axis=1)
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    np.testing.assert_allclose(
        packing.normal_force, 4.0 / 3.0 * modulus * np.sqrt(radius) * np.maximum(overlap, 0.0) ** 1.5,
        rtol=1e-5, atol=1e-6 * packing.normal_force.mean(),
    )  # fmt: skip
    deep = packing.normal_force > 1e-3 * packing.normal_force.mean()
    spring = 2.0 * modulus * np.sqrt(radius * np.maximum(overlap, 0.0))
    np.testing.assert_allclose(packing.normal_stiffness[deep], spring[deep], rtol=1e-4)
    np.testing.assert_allclose(packing.shear_stiffness, GLASS.mindlin_ratio * packing.normal_stiffness)
    np.testing.assert_allclose(packing.arm_i + packing.arm_j, np.linalg.norm(packing.vector, axis=1))
    np.testing.assert_allclose(packing.radii[packing.i] - packing.arm_i, 0.5 * overlap, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_vectors_and_forces_of_a_dump_may_be_missing(name, tmp_path):
    atoms, pairs = dumps(name)
    whole = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True)
    # three columns, without names: the vectors are those to the nearest images
    head, below = re.split(r"(?<=\n)ITEM: ENTRIES.*\n", pairs.read_text())
    rows = [line.split()[:3] for line in below.splitlines()]
    bare = tmp_path / "pairs.dump"
    bare.write_text(head + "ITEM: ENTRIES c_ids[1] c_ids[2] c_pair[1]\n" + "\n".join(map(" ".join, rows)))
    again = gp.ContactNetwork.from_lammps(atoms, bare, GLASS, columns=["i", "j", "force"], keep_rattlers=True)
    assert again == whole
    # two columns: the forces are Hertz's at the overlap of the positions, of which the file has nine digits
    bare.write_text(head + "ITEM: ENTRIES i j\n" + "\n".join(" ".join(row[:2]) for row in rows))
    again = gp.ContactNetwork.from_lammps(atoms, bare, GLASS, keep_rattlers=True)
    strong = whole.normal_force > 1e-3 * whole.normal_force.mean()
    kept = np.isin(np.stack([whole.i, whole.j]).T @ [1000, 1], np.stack([again.i, again.j]).T @ [1000, 1])
    assert np.all(kept[strong])
    np.testing.assert_allclose(again.normal_force[strong[kept]], whole.normal_force[strong], rtol=1e-4)


@pytest.mark.claim("network-lammps")
def test_lammps_responds_as_the_network_without_friction(lmp, tmp_path):
    network = read(lmp, tmp_path, friction=False, prestress=True)
    count, dimension = network.n_balls, network.dimension
    rest, step = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3), 5e-11

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
    theirs, ours = constants / root / root[:, None], WaveOperator(network).matrix.toarray()
    # the curvature of Hertz's law over a step: k''' step^2 of the contact that is pressed least, and rounding
    np.testing.assert_allclose(theirs, ours, atol=1e-6 * np.max(ours))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(0.5 * (theirs + theirs.T)), np.linalg.eigvalsh(ours), atol=1e-6 * np.max(ours)
    )


@pytest.mark.claim("network-lammps")
def test_lammps_responds_as_the_network_with_friction(lmp, tmp_path):
    """LAMMPS adds up slip along the way: one step of time at a velocity is a displacement.

    It counts slip with the radii and torques with the arms. Each is one of two networks.
    """
    network = read(lmp, tmp_path, prestress=True)
    by_radii = replace(network, arm_i=network.radii[network.i], arm_j=network.radii[network.j])
    ours, slips = WaveOperator(network), WaveOperator(by_radii)
    pushed = ours.matrix - ours.root.T @ ours.root
    expected = (ours.root.T @ slips.root + pushed).toarray()
    # the arms differ from the radii by half an overlap
    overlap = np.max(1.0 - np.minimum(network.arm_i / by_radii.arm_i, network.arm_j / by_radii.arm_j))
    np.testing.assert_allclose(ours.matrix.toarray(), expected, atol=2.0 * overlap * ours.matrix.max())

    rest, time, size = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3), 1e-12, 5e-11
    lmp.command(packings.coefficients("mindlin NULL 0 1e9"))
    lmp.commands_string(f"fix move all nve/sphere\ntimestep {time!r}")
    motions, dimension, rng = ours.motions, network.dimension, np.random.default_rng(5)
    count, turns = len(motions.translations), list(motions.rotations)

    def go(motion):
        for name, values in (("v", motion[:, :3]), ("omega", motion[:, 3:])):
            lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*(values / time).ravel()))
        lmp.command("run 1 post no")
        return [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("f", "torque")]

    for _ in range(3):
        motion = np.zeros((network.n_balls, 6))
        motion[:, :dimension] = rng.normal(size=(network.n_balls, dimension))
        motion[:, [3 + axis for axis in turns]] = rng.normal(size=(network.n_balls, len(turns))) / 1e-3
        motion *= size
        ahead = go(motion)
        go(-motion)
        behind = go(-motion)
        go(motion)
        force, torque = ((one - other) / 2.0 for one, other in zip(ahead, behind, strict=True))
        root = np.sqrt(np.column_stack([network.masses] * count + [network.inertias] * len(turns)))
        own = np.column_stack([motion[:, :count], motion[:, [3 + axis for axis in turns]]])
        found = -np.column_stack([force[:, :count], torque[:, turns]]) / root
        wanted = ours.values(expected @ ours.vector(own * root))
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.max(np.abs(wanted)))
    lmp.scatter_atoms("x", 1, 3, (ctypes.c_double * rest.size)(*rest.ravel()))
    lmp.commands_string("unfix move\nset group all omega 0 0 0\nvelocity all set 0 0 0")
    lmp.command(packings.coefficients("linear_nohistory 0 0"))


def read(lmp, folder, **more):
    """The network of what LAMMPS holds, through its files."""
    atoms, pairs = folder / "atoms.dump", folder / "pairs.dump"
    packings.write_dumps(lmp, atoms, pairs)
    return gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True, **more)


def test_boxes_units_and_places_of_dumps(tmp_path, lmp):
    """What LAMMPS writes of one state: scaled and unwrapped places, the tilted box, a box of any vectors, other units."""
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
            tmp_path / f"{name}.dump", tmp_path / "pairs.dump", GLASS, columns=columns, friction=False
        )
        for name in ("atoms", "scaled", "unwrapped")
    ]
    for network in networks[1:]:
        order, other = np.argsort(networks[0].labels), np.argsort(network.labels)
        for name in ("radii", "masses"):
            np.testing.assert_allclose(getattr(network, name)[other], getattr(networks[0], name)[order], rtol=1e-12)
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
    """Four balls of a triangular lattice in a box with an angle of 60 degrees, as LAMMPS writes it."""
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
        network.cell, 3.8e-3 * np.array([[1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0], [0.0, 0.0, 0.0]]), atol=1e-12
    )


def spoil(*changes):
    """A change of the texts of both files: pairs of a pattern and what stands in its place, for atoms or for pairs."""

    def spoiled(name, folder):
        texts = [path.read_text() for path in dumps(name)]
        for which, pattern, new in changes:
            texts[which], count = re.subn(pattern, new, texts[which], count=1, flags=re.MULTILINE)
            assert count
        for name, text in zip(("atoms", "pairs"), texts, strict=True):
            (folder / f"{name}.dump").write_text(text)
        return folder / "atoms.dump", folder / "pairs.dump"

    return spoiled


BAD_DUMPS = {
    "steps": (spoil((0, r"TIMESTEP\n\d+", "TIMESTEP\n7")), {}, "time step 7, and .* Balls and contacts must be of one step"),
    "step": (spoil(), {"step": 3}, "no time step 3. It has .* alone"),
    "units": (spoil((1, r"\A", "ITEM: UNITS\ncgs\n")), {}, "in units si, and .* in others"),
    "units given": (spoil(), {"units": "cgs"}, "its units are si, and units='cgs' is given"),
    "unknown units": (spoil(), {"units": "feet"}, "units: found 'feet'; allowed: si, cgs, micro, nano"),
    "ids": (spoil((1, "ENTRIES i j", "ENTRIES a b")), {}, "no column i and no column j. .* colname 1 i"),
    "names": (spoil(), {"columns": ["i", "j"]}, "has 6: i, j, force"),
    "radius": (spoil((0, "radius", "size")), {}, "no column radius.*radius mass"),
    "id": (spoil((0, "ATOMS id", "ATOMS name")), {}, "no column id"),
    "x": (spoil((0, " x y z", " a b c")), {}, "no columns x, y and z"),
    "mass": (spoil((0, "mass", "size")), {"material": None, "normal_stiffness": 1.0}, "no column 'mass', and no material"),
    "swapped": (lambda name, folder: dumps(name)[::-1], {}, "is a dump of entries, and a dump of atoms"),
    "cut off": (spoil((1, r"\n[^\n]*\n\Z", "\n")), {}, "ends before its 64 entries do: 63 are there"),
    "cell": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", r"\1 much")), {}, r"pairs.dump:\d+: force: found 'much', where"),
    "short line": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+).*", r"\1")), {}, r"pairs.dump:\d+: dx: found nothing"),
    "ball": (spoil((1, r"(ITEM: ENTRIES.*\n)\d+", r"\g<1>99")), {}, "contact 0, of balls 99 and .* not among those of"),
    "part": (spoil((1, r"(ITEM: ENTRIES.*\n)\d+", r"\g<1>1.5")), {}, "1.5 where a whole number"),
    "twice": (spoil((0, r"^2 ", "1 ")), {}, "two balls with the id 1"),
    "tension": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+ )", r"\1-")), {}, "has the force -.* Forces that pull"),
    "vector": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+ \S+ )\S+", r"\g<1>0.1")), {}, "is not where its balls are"),
    "boxes": (spoil((1, r"(BOUNDS.*\n\S+ )\S+", r"\g<1>0.1")), {}, "different boxes"),
    "box": (spoil((0, r"(BOUNDS.*\n)\S+", r"\g<1>wide")), {}, "bounds of the box cannot be read"),
    "exchanged box": (
        spoil((0, r"(BOUNDS.*\n)(\S+) (\S+)", r"\1\3 \2"), (1, r"(BOUNDS.*\n)(\S+) (\S+)", r"\1\3 \2")), {},
        r"atoms.dump:\d+: the box has the length -0\.\d+ along x. Its lower bound must be below",
    ),
    "flat box": (
        spoil((0, r"(BOUNDS.*\n.*\n)(\S+) \S+", r"\1\2 \2"), (1, r"(BOUNDS.*\n.*\n)(\S+) \S+", r"\1\2 \2")), {},
        r"atoms.dump:\d+: the box has the length 0 along y",
    ),
    "many digits": (
        spoil((0, r"(NUMBER OF ATOMS\n)\d+", r"\g<1>" + "9" * 5000)), {}, "found '999.*, where a whole number of at most 19"
    ),
    "time of many digits": (spoil((1, r"TIMESTEP\n\d+", "TIMESTEP\n" + "1" * 5000)), {}, "where a whole number of at most"),
    "other digits": (spoil((0, r"(NUMBER OF ATOMS\n)\d+", "\\1\u0663\u0660")), {}, "where a whole number is needed"),
    "columns of a number": (spoil(), {"columns": 5}, "columns are 5, and .* has 6: i, j, force"),
    "columns of numbers": (spoil(), {"columns": [1, 2, 3, 4, 5, 6]}, "columns are .1, 2, 3"),
    "underscore": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", r"\1 1_0")), {}, "force: found '1_0', where a number"),
    "arabic": (spoil((1, r"(ITEM: ENTRIES.*\n\d+ \d+) \S+", "\\1 \u0661\u0660")), {}, "force: found '.*', where a number"),
    "arabic box": (spoil((0, r"(BOUNDS.*\n)\S+", "\\1-\u0661")), {}, "bounds of the box cannot be read"),
    "escape": (spoil((0, "radius", "\x1b[2Jradius")), {}, r"found a column named '\\x1b\[2Jradius'"),
    "backwards": (spoil((1, "ENTRIES i", "ENTRIES \u202ei")), {}, r"found a column named '\\u202ei'"),
    "escape in units": (spoil((0, "UNITS\nsi", "UNITS\n\x1b[31msi")), {"units": "si"}, r"its units are \\x1b\[31msi"),
    "escape in columns": (spoil(), {"columns": ["\x1b[2J", "b", "c", "d", "e", "f"]}, r"columns are \\x1b\[2J, b, c"),
    "general box": (spoil((0, "BOX BOUNDS", "BOX BOUNDS abc origin")), {}, "triclinic/general"),
    "count": (spoil((0, r"(NUMBER OF ATOMS\n)\d+", r"\1many")), {}, "found 'many', where a whole number"),
    "another file": (lambda name, folder: (dumps(name)[0], __file__), {}, "where a line 'ITEM: ...' is needed"),
    "no file": (lambda name, folder: (folder / "no.dump", dumps(name)[1]), {}, "no such file"),
    "material": (spoil(), {"material": "steel"}, "the material is 'steel'. Give a gp.Material"),
    "no material": (spoil(), {"material": None}, "no normal_stiffness, shear_stiffness, and no material is given"),
    "far": (spoil((0, r"^2 \S+", "2 0.00444")), {"columns": ["i", "j", "force", "a", "b", "c"]}, "not near each other"),
    "dimension": (spoil((0, r"^(2 \S+ \S+) 0", r"\1 1e-4")), {"dimension": 2}, "is not where its balls are"),
}  # fmt: skip


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
    names, low, side = frame[1].split()[2:], *map(float, re.search(r"BOUNDS.*\n(\S+) (\S+)", atoms).groups())
    cells = [line.split() for line in frame[2].splitlines()]
    for line in cells:
        for axis in "xyz":
            place, at = float(line[names.index(axis)]), names.index(axis)
            share = (place - low) / (side - low) if scaled and axis != "z" else 0.5 if scaled else place
            line[at] = f"{share:.{digits}g}"
    head = frame[1].replace(" x y z", " xs ys zs") if scaled else frame[1]
    (tmp_path / "atoms").write_text(frame[0] + head + "\n".join(map(" ".join, cells)) + "\n")

    def read(**changed):
        """The network with other forces of some of the pairs, by their number."""
        lines = [[*row[:2], f"{changed.get(f'of_{n}', 1.0) * float(row[2]):.16g}"] for n, row in enumerate(rows)]
        head = re.sub("ENTRIES.*", "ENTRIES i j force", pairs[:start])
        (tmp_path / "pairs").write_text(head + "\n".join(map(" ".join, lines)) + "\n")
        return gp.ContactNetwork.from_lammps(tmp_path / "atoms", tmp_path / "pairs", GLASS, keep_rattlers=True)

    mean = np.mean([float(row[2]) for row in rows])
    ordinary = next(n for n, row in enumerate(rows) if float(row[2]) > 0.5 * mean)
    assert read(**{f"of_{ordinary}": 5.0}).n_contacts == read().n_contacts
    said = (
        rf"pairs: contact {ordinary}, of balls {rows[ordinary][0]} and {rows[ordinary][1]}, has the force .* N, and the ov"
    )
    for factor in (500.0, 1.0 / 500.0):
        with pytest.raises(InconsistencyWarning, match=said):
            read(**{f"of_{ordinary}": factor})
    with pytest.raises(InconsistencyWarning, match=r"\(6[0-4] in all\)\. Compare units" if digits == 16 else "in all"):
        read(**{f"of_{n}": 500.0 for n in range(len(rows))})
    with pytest.warns(InconsistencyWarning) as caught:
        read(of_0=1e6)
    assert caught[0].filename == __file__


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
    with pytest.raises(gp.GranphonError, match=r"no time step 4\. It has 5 to 6, 2 in all"):
        gp.ContactNetwork.from_lammps(*both, GLASS, step=4)


# -- tables ---------------------------------------------------------------------------------------------------------


def network_of(kind):
    """Networks of several kinds: a packing with labels, a crystal in space with prestress and rolling, one with a wall."""
    if kind == "packing":
        network = gp.ContactNetwork.from_lammps(*dumps("balls"), GLASS)
        return replace(network, prestress=True, tangential_force=np.zeros_like(network.normal))
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    if kind == "sample":
        packing = gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6))
        return replace(
            gp.DirectSimulation(packing, shape=(4, 5), seed=1).at_force(2.0).sample.network, lattice=None, shape=None
        )
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="hcp", torsion=0.02, bending=0.01)).at_force(18.446)
    network = gp.ContactNetwork.from_state(state, shape=(2, 3, 2))
    masses = network.masses.copy()
    masses[3] = np.inf
    return replace(network, masses=masses, lattice=None, shape=None)


@pytest.mark.claim("api-network-tables")
@pytest.mark.parametrize("kind", ["packing", "sample", "wall"])
def test_tables_are_read_as_they_were_written(kind, tmp_path):
    network = network_of(kind)
    network.write_tables(tmp_path / "new" / "balls.csv", tmp_path / "contacts.csv")
    again = gp.ContactNetwork.from_table(tmp_path / "new" / "balls.csv", tmp_path / "contacts.csv", keep_rattlers=True)
    assert again == network
    with pytest.raises(OSError, match="cannot be written"):
        network.write_tables(tmp_path, tmp_path / "contacts.csv")


@pytest.mark.parametrize("seed", [pytest.param(n, marks=pytest.mark.exhaustive if n else ()) for n in range(20)])
def test_no_change_of_a_written_table_goes_unnoticed(seed, tmp_path):
    """Rows cut off, lines repeated, words or single letters changed: an error, or a warning where the digest is lost."""
    network = network_of(["packing", "sample", "wall"][seed % 3])
    paths = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    network.write_tables(*paths)
    whole, rng = [path.read_bytes().decode() for path in paths], np.random.default_rng(seed)
    for path, text in zip(paths, whole, strict=True):  # how lines end does not count
        path.write_bytes(text.replace("\n", "\r\n").encode())
    assert gp.ContactNetwork.from_table(*paths, keep_rattlers=True) == network
    lines = whole[1].split("\n")
    spoilt = [
        (1, "\n".join([*lines[:-41], ""])), (1, "\n".join(lines[:1] + lines[2:])),
        (0, re.sub("# sha256.*\n", "", whole[0])), (0, whole[0].replace("sha256", "sha257")),
    ]  # fmt: skip
    for _ in range(75):
        which = int(rng.integers(2))
        text = damage(whole[which], rng)
        if rng.random() < 0.5:
            place = int(rng.integers(len(whole[which])))
            text = whole[which][:place] + chr(rng.integers(32, 127)) + whole[which][place + 1 :]
        if text != whole[which]:
            spoilt.append((which, text))
    for which, text in spoilt:
        for n, path in enumerate(paths):
            path.write_bytes((text if n == which else whole[n]).encode())
        with pytest.raises((InputError, UnverifiedFileWarning)) as caught:
            gp.ContactNetwork.from_table(*paths, keep_rattlers=True)
        assert paths[which].name in str(caught.value)
        assert "\n" not in str(caught.value)


def arrays_of(name):
    """The balls and contacts of a packing as mappings of arrays, with nothing that follows from the rest."""
    whole = gp.ContactNetwork.from_lammps(*dumps(name), GLASS, keep_rattlers=True)
    balls = dict(zip("xyz", whole.positions.T[: whole.dimension], strict=False)) | {
        "id": whole.labels,
        "radius": whole.radii,
        "mass": whole.masses,
    }
    contacts = {"i": whole.labels[whole.i], "j": whole.labels[whole.j], "normal_force": whole.normal_force}
    return whole, balls, contacts, np.diag(whole.cell)[: whole.dimension]


@pytest.mark.parametrize("name", NAMES)
def test_what_a_table_lacks_follows_from_the_rest(name, tmp_path):
    """Arrays, structured arrays and CSV files in other units give the network that LAMMPS' dumps give."""
    whole, balls, contacts, cell = arrays_of(name)
    found = gp.ContactNetwork.from_table(balls, contacts, material=GLASS, cell=cell, keep_rattlers=True)
    assert found == whole
    structured = [np.rec.fromarrays(list(map(np.asarray, table.values())), names=list(table)) for table in (balls, contacts)]
    assert gp.ContactNetwork.from_table(*structured, material=GLASS, cell=np.diag(cell), keep_rattlers=True) == whole
    paths = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    units = {"mass": " (g)", "x": " (mm)", "y": " (mm)", "z": " (mm)", "radius": " (um)", "normal_force": " [kN]"}
    scales = {"mass": 1e3, "x": 1e3, "y": 1e3, "z": 1e3, "radius": 1e6, "normal_force": 1e-3}
    for path, table in zip(paths, (balls, contacts), strict=True):
        rows = zip(*((scales.get(key, 1) * np.asarray(column)).tolist() for key, column in table.items()), strict=True)
        heads = ";".join(key + units.get(key, "") for key in table)
        path.write_text("\n".join(["# made by hand", heads, *(";".join(map(repr, row)) for row in rows)]))
    read = gp.ContactNetwork.from_table(*paths, material=GLASS, cell=cell)
    assert (read.n_balls, read.left_out) == (whole.n_balls - 1, 1)
    trimmed = whole.without_rattlers()
    for field in ("positions", "radii", "masses", "normal_force", "normal_stiffness", "shear_stiffness", "arm_i"):
        np.testing.assert_allclose(getattr(read, field), getattr(trimmed, field), rtol=1e-10, atol=1e-18)
    # names of one's own
    paths[0].write_text(paths[0].read_text().replace("radius (um)", "R").replace("id", "name"))
    columns = {"radius": "R (um)", "id": "name"}
    assert gp.ContactNetwork.from_table(*paths, material=GLASS, cell=cell, columns=columns) == read


def test_tables_of_yade():
    """A packing that YADE has pressed and relaxed, by the script of the page on networks; its law: Hertz and Mindlin."""
    balls, contacts = packings.FOLDER / "yade_balls.csv", packings.FOLDER / "yade_contacts.csv"
    side = [0.005424017457709516] * 3
    network = gp.ContactNetwork.from_table(balls, contacts, cell=side)
    assert (network.n_balls, network.n_contacts, network.left_out, network.dimension) == (24, 88, 0, 3)
    pull = np.zeros((24, 3))
    np.add.at(pull, network.j, network.normal * network.normal_force[:, None])
    np.add.at(pull, network.i, -network.normal * network.normal_force[:, None])
    assert np.max(np.abs(pull)) < 1e-12 * network.normal_force.mean()
    # YADE's stiffnesses, masses, shifts and normals are those that follow from force, material and places
    alone = {name: getattr(network, field) for name, field in (("i", "i"), ("j", "j"), ("normal_force", "normal_force"))}
    places = dict(zip("xyz", network.positions.T, strict=True)) | {"radius": network.radii}
    follows = gp.ContactNetwork.from_table(places, alone, material=GLASS, cell=side)
    for name in ("masses", "inertias", "shift", "normal_stiffness", "shear_stiffness"):
        np.testing.assert_allclose(getattr(follows, name), getattr(network, name), rtol=1e-13)
    np.testing.assert_allclose(follows.normal, network.normal, atol=1e-14)


def test_a_table_of_a_row_between_walls():
    """Three balls and two flat walls: the stiffness of a wall contact is Hertz's of a ball on a plane."""
    balls = {
        "x": [0.0, 0.0199, 0.0398, -0.02, 0.06],
        "radius": [0.01, 0.01, 0.01, np.inf, np.inf],
        "mass": [1.0, 1.0, 1.0, np.inf, np.inf],
    }
    contacts = {"i": [0, 1, 3, 2], "j": [1, 2, 0, 4], "nx": [1.0] * 4, "normal_force": [100.0] * 4}
    network = gp.ContactNetwork.from_table(balls, contacts, material=GLASS)
    assert (network.dimension, network.motions, network.pbc, network.left_out) == (1, "longitudinal", (False,) * 3, 0)
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    between, at_wall = ((6.0 * modulus**2 * radius * 100.0) ** (1.0 / 3.0) for radius in (0.005, 0.01))
    # a wall has no side that is as elastic as a ball's: it is of the same material
    np.testing.assert_allclose(network.normal_stiffness, [between, between, at_wall, at_wall], rtol=1e-12)
    squares = np.linalg.eigvalsh(
        [[between + at_wall, -between, 0.0], [-between, 2.0 * between, -between], [0.0, -between, between + at_wall]]
    )
    operator = gp.Waves(network).operator
    np.testing.assert_allclose(np.linalg.eigvalsh(operator.matrix.toarray()), squares)


BAD_TABLES = {
    "a column": (lambda b, c: b.pop("radius"), {}, "no column 'radius'. Its columns are .* columns={'radius': 'NAME'}"),
    "ends": (lambda b, c: c.pop("j"), {}, "no column 'j'"),
    "no places": (lambda b, c: [b.pop(name) for name in "xyz"], {}, "no column 'x'"),
    "y alone": (lambda b, c: b.pop("y"), {}, "no column 'y'"),
    "nz alone": (lambda b, c: c.update(nz=np.ones(125)), {}, "no column 'nx', 'ny'"),
    "lengths": (lambda b, c: b.update(radius=b["radius"][1:]), {}, "different lengths: 36 of id, 36 of x"),
    "two radii": (lambda b, c: b.update(diameter=b["radius"]), {}, "both radius and diameter"),
    "table": (lambda b, c: b.update(radius=np.ones((36, 2))), {}, "radius of the table of balls has the shape"),
    "texts": (lambda b, c: b.update(radius=["a"] * 36), {}, "radius of the table of balls: found"),
    "ball": (lambda b, c: c.update(i=c["i"] + 100), {}, "contact 0, of balls .* not among those of the table of balls"),
    "part of a ball": (lambda b, c: c.update(i=c["i"] + 0.5), {}, "where a whole number is needed"),
    "ids": (lambda b, c: b.update(id=[1] * 36), {}, "two balls with the id 1"),
    "tension": (lambda b, c: c.update(normal_force=-c["normal_force"]), {}, "contact 0.*force -.*125 in all.*Forces that"),
    "nan": (lambda b, c: c.update(normal_force=np.nan * c["normal_force"]), {}, "contact 0.*force nan"),
    "misspelled": (lambda b, c: c.update(shear_stifness=np.ones(125)), {}, "stifness'. Did you mean 'shear_stiffness'"),
    "material": (lambda b, c: b.pop("mass"), {"material": None}, "no column 'mass', and no material"),
    "stiffness": (
        lambda b, c: b.update(mass=np.ones(36)), {"material": None}, "no normal_stiffness, shear_stiffness, and no material"
    ),
    "shear": (
        lambda b, c: (b.update(mass=np.ones(36)), c.update(normal_stiffness=np.ones(125))), {"material": None},
        "no shear_stiffness, .*friction=False",
    ),
    "no cell": (None, {"cell": None}, "not near each other: these, whose radii add up to .* Compare the cell"),
    "small cell": (None, {"cell": [1e-3] * 3}, "is not the only one of its balls|not near each other"),
    "flat cell": (None, {"cell": [[1.0, 0, 0], [1.0, 0, 0]]}, "not independent"),
    "cell": (None, {"cell": [[1.0]] * 3}, "the cell has the shape"),
    "pbc": (None, {"cell": None, "pbc": [True]}, "pbc is"),
    "dimension": (None, {"dimension": 2}, "(leaves the plane|not both in the plane|not near)"),
    "unit": (
        lambda b, c: b.update({"radius (mm)": b.pop("radius")}), {"columns": {"radius": "radius (mm)"}},
        "the column 'radius .mm.' is in mm, and arrays are in SI. Convert it",
    ),
    "columns": (None, {"columns": {"radios": "R"}}, "'radios' is not a column.* Did you mean 'radius'"),
    "motions": (None, {"motions": "in_plane"}, "no motions 'in_plane'"),
    "held": (None, {"held_by": 1.5}, "held_by"),
    "friction": (None, {"friction": "no"}, "friction"),
    "twice": (lambda b, c: c.update({n: np.append(v, v[0]) for n, v in c.items()}), {}, "are the same"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_TABLES)
def test_tables_that_make_no_network(name):
    """Each has one error, which names the table and the column or contact."""
    spoil, more, said = BAD_TABLES[name]
    _, balls, contacts, cell = arrays_of("balls")
    if spoil is not None:
        spoil(balls, contacts)
    with pytest.raises(gp.GranphonError, match=said) as error:
        gp.ContactNetwork.from_table(balls, contacts, **({"material": GLASS, "cell": cell} | more))
    assert "\n" not in str(error.value)


BAD_FILES = {
    "unit": ("x,y (mm),radius (mm)", "the column 'x' has no unit. Write the heading 'x \\(m\\)'"),
    "mixed": ("x (mm),y (m),radius (mm)", "coordinates in different units: x \\(mm\\), y \\(m\\). Use one unit"),
    "kind": ("x (mm),y (mm),radius (N)", "not a unit of length"),
    "needless unit": ("x (mm),y (mm),radius (mm),id (m)", "'id' has the unit 'm', and needs none"),
    "missing": ("x (mm),y (mm),size (mm)", "no column 'radius'. Its columns are x \\(mm\\), y \\(mm\\), size \\(mm\\)"),
    "escape": ("x (mm),y (mm),\x1b[2Jsize (mm)", r"no column 'radius'. Its columns are .*, \\x1b\[2Jsize \(mm\)"),
    "inertia": ("x (mm),y (mm),radius (mm),inertia (kg)", "not a unit of moment of inertia"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_files_that_are_no_table_of_balls(name, tmp_path):
    head, said = BAD_FILES[name]
    path = tmp_path / "balls.csv"
    path.write_text(head + "\n" + "\n".join(f"{2 * k},0,1" + ",1" * (head.count(",") - 2) for k in range(3)) + "\n")
    with pytest.raises(gp.GranphonError, match=said) as error:
        gp.ContactNetwork.from_table(path, {"i": [0, 1], "j": [1, 2], "normal_force": [1.0, 1.0]}, material=GLASS)
    assert "balls.csv" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("cell", "said"),
    [("2,0,-1", ":2: radius: found"), ("2,0,one", ":2: radius: found 'one'"), ("2,0", ":2: radius: found nothing")],
)
def test_cells_of_a_table_that_cannot_be_read(cell, said, tmp_path):
    path = tmp_path / "balls.csv"
    path.write_text(f"x (mm),y (mm),radius (mm)\n{cell}\n")
    with pytest.raises(gp.GranphonError, match=said):
        gp.ContactNetwork.from_table(path, {"i": [], "j": []}, material=GLASS)
    for number in ("1_0", "\u0661"):
        path.write_text("x (mm),y (mm),radius (mm)\n0,0,1\n2,0,1\n")
        contacts = tmp_path / "contacts.csv"
        contacts.write_text(f"i,j\n0,{number}\n")
        with pytest.raises(gp.GranphonError, match=rf"contacts.csv: line 2, j: found '{number}', where a number is needed"):
            gp.ContactNetwork.from_table(path, contacts, material=GLASS)
    with pytest.raises(gp.GranphonError, match="contacts is 3"):
        gp.ContactNetwork.from_table({"x": [0.0], "radius": [1.0]}, 3, material=GLASS)


WORDS = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e400",
    "1e-320",
    "1e308",
    "9" * 30,
    "9" * 5000,
    "1_0",
    "\u0663",
    "\x1b[2J",
    "1.5",
    "abc",
    "ITEM: ATOMS",
    "\0",
    "é",
    "\n",
    ",",
]


def damage(text, rng):
    """A text with a word replaced, its end cut off, or a line left out or repeated."""
    words = list(re.finditer(r"[^\s,]+", text))
    found, what = words[rng.integers(len(words) if rng.random() < 0.5 else min(60, len(words)))], rng.integers(6)
    if what < 3:
        return text[: found.start()] + WORDS[rng.integers(len(WORDS))] + text[found.end() :]
    if what == 3:
        return text[: found.start()]
    lines = text.split("\n")
    place = rng.integers(len(lines))
    lines[place : place + 1] = [lines[rng.integers(len(lines))]] * (2 * (int(what) - 4))
    return "\n".join(lines)


@pytest.mark.parametrize("seed", [pytest.param(n, marks=pytest.mark.exhaustive if n else ()) for n in range(20)])
@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
def test_damaged_files_give_one_error_or_a_network(seed, tmp_path):
    rng = np.random.default_rng(seed)
    network_of("wall").write_tables(tmp_path / "balls.csv", tmp_path / "contacts.csv")
    for name in ("balls.csv", "contacts.csv"):  # as other programs write them, without a digest
        (tmp_path / name).write_text(re.sub("# sha256.*\n", "", (tmp_path / name).read_text()))
    kept = [dumps("disks"), dumps("balls"), (tmp_path / "balls.csv", tmp_path / "contacts.csv")]
    wrong = fine = 0
    for count in range(60):
        texts = [path.read_text() for path in kept[count % 3]]
        which = rng.integers(2)
        texts[which] = damage(texts[which], rng)
        for name, text in zip("ab", texts, strict=True):
            (tmp_path / name).write_text(text, encoding="utf-8")
        read = gp.ContactNetwork.from_table if count % 3 == 2 else gp.ContactNetwork.from_lammps
        try:
            network = read(tmp_path / "a", tmp_path / "b", material=GLASS, prestress=True)
            assert np.isfinite(gp.Waves(network).operator.top)
        except gp.GranphonError as error:
            wrong += "\n" not in str(error)
        else:
            fine += 1
    assert wrong + fine == 60
    assert wrong > 30


@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
def test_nearest_images_in_an_oblique_cell(lattice):
    """In a cell that is tilted by a whole period more, the image with the least fractions is not always the nearest one."""
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice)).at_force(18.446, finite_overlap=True)
    network = gp.ContactNetwork.from_state(state, shape=(3,) * state.packing.structure.periods)
    cell = network.cell[: network.dimension].copy()
    cell[1] += np.sign(cell[0] @ cell[1]) * cell[0]
    places = network.positions + np.random.default_rng(2).integers(-2, 3, (network.n_balls, 3)) @ network.cell
    balls = dict(zip("xyz", places.T[: network.dimension], strict=False)) | {"radius": network.radii}
    contacts = {"i": network.i, "j": network.j, "normal_force": network.normal_force}
    found = gp.ContactNetwork.from_table(balls, contacts, material=steel, cell=cell)
    np.testing.assert_allclose(found.vector, network.vector, atol=1e-15)
    np.testing.assert_allclose(found.normal_stiffness, network.normal_stiffness)
