"""Networks from tables of balls and contacts, read and written, and files that are damaged."""

import json
import re
import warnings
from contextlib import nullcontext
from dataclasses import replace
from urllib.parse import quote, unquote

import ase
import ase.io
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import (
    FileExistsInRunError,
    InconsistencyWarning,
    InputError,
    UnverifiedFileWarning,
)
from granphon.figures.forces import plot_forces
from tests import packings
from tests.dynamics.test_network_lattice import random_network
from tests.figures.conftest import with_gid
from tests.networks.test_lammps import GLASS, NAMES, dumps


def network_of(kind):
    """Networks of several kinds: a packing with labels, a crystal in space with prestress and
    rolling, one with a wall.
    """
    if kind == "packing":
        network = gp.ContactNetwork.from_lammps(*dumps("balls"), GLASS)
        return replace(network, prestress=True, tangential_force=np.zeros_like(network.normal))
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    if kind == "kinds":
        names = ("steel", 'of "glass", clear', "1")
        balls = [
            gp.Ball(steel, 8e-3, mass=mass, name=name)
            for mass, name in zip((1e-3, 2e-3, 3e-3), names, strict=True)
        ]
        return (
            gp.Crystal.on("chain", balls)
            .repeat((2,))
            .cut(0, 3, ("floor", "clamped"))
            .at_force(1.0)
            .network
        )
    if kind == "adhesive":  # rows that are pulled along
        layer = gp.Crystal.on("triangular", [gp.Ball(steel, 8e-3)], law=gp.JKR(0.05))
        network = layer.at_stress([[0.01, 0.0], [0.0, -0.05]]).network
        assert network.adhesive
        assert np.min(network.normal_force) < 0.0
        return network
    if kind in ("plane", "friction"):
        shape = {"plane": ("triangular", (4, 3)), "friction": ("fcc", (2, 2, 3))}[kind]
        made = packings.balance(random_network(*shape))
        rng = np.random.default_rng(3)
        twist = rng.uniform(-1.0, 1.0, made.normal.shape) if kind == "friction" else [0.0, 0.0, 1.0]
        across = np.cross(made.normal, twist) * rng.uniform(0.0, 0.3, (made.n_contacts, 1))
        return replace(
            made,
            tangential_force=across * made.normal_force[:, None],
            prestress=True,
            tangential_law="mindlin_rescale",
            slip_levers="radii",
            left_out=7,
        )
    if kind == "sample":
        packing = gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6))
        return replace(
            gp.DirectSimulation(packing, shape=(4, 5), seed=1).at_force(2.0).sample.network,
            lattice=None,
            shape=None,
        )
    state = gp.AveragedLattice(
        gp.Packing(steel, 8e-3, lattice="hcp", torsion=0.02, bending=0.01)
    ).at_force(18.446)
    network = state.network.repeat((2, 3, 2))
    masses = network.masses.copy()
    masses[3] = np.inf
    return replace(network, masses=masses, lattice=None, shape=None)


@pytest.mark.claim("api-network-tables")
@pytest.mark.parametrize("kind", ["packing", "sample", "wall", "kinds", "adhesive"])
def test_tables_are_read_as_they_were_written(kind, tmp_path):
    network = network_of(kind)
    network.write_tables(tmp_path / "new" / "balls.csv", tmp_path / "contacts.csv")
    again = gp.ContactNetwork.from_table(
        tmp_path / "new" / "balls.csv", tmp_path / "contacts.csv", keep_rattlers=True
    )
    assert again == network
    # the cell is that of the file, of which pbc says what repeats
    paths = tmp_path / "new" / "balls.csv", tmp_path / "contacts.csv"
    same = gp.ContactNetwork.from_table(*paths, pbc=network.pbc, keep_rattlers=True)
    assert same == network
    with pytest.raises(OSError, match="is a folder"):
        network.write_tables(tmp_path, tmp_path / "contacts.csv")


# tangential forces made at random are not in balance, which reading tells
@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
@pytest.mark.claim("network-extxyz")
@pytest.mark.parametrize(
    "kind", ["packing", "sample", "wall", "kinds", "adhesive", "plane", "friction"]
)
def test_frames_are_read_as_they_were_written(kind, tmp_path):
    """ASE's own reader keeps every ball, in the cell of the network, and the place and the force
    of every contact.
    """
    network = network_of(kind)
    files = tmp_path / "new" / "balls.extxyz", tmp_path / "contacts.xyz"
    network.write_tables(*files)
    for pbc in (None, network.pbc):
        again = gp.ContactNetwork.from_table(*files, pbc=pbc, keep_rattlers=True)
        assert again == network
        assert not again.notes
    atoms, touching = map(ase.io.read, files)
    for name, column in (("mass", "masses"), ("masses", "masses"), ("radius", "radii")):
        assert_array_equal(atoms.arrays[name], getattr(network, column))
    assert_array_equal(atoms.positions, network.positions)
    assert tuple(atoms.pbc) == network.pbc
    assert_array_equal(atoms.cell.array[atoms.pbc], network.cell[atoms.pbc])
    assert_array_equal(np.flatnonzero(atoms.arrays["rattler"]), network.rattlers)
    assert_array_equal(touching.positions, network.contact_places)
    # the forces on each ball, of the contacts at both of its ends, are those of the network
    force = touching.arrays["force"]
    pushed = np.zeros_like(network.positions)
    np.add.at(pushed, network.j, force)
    np.add.at(pushed, network.i, -force)
    scale = np.max(np.abs(force))
    pushed[~network.moving] = 0.0
    assert_allclose(pushed, network.residual_forces, rtol=0.0, atol=1e-13 * scale)
    if kind in ("plane", "friction"):
        across = force - network.normal_force[:, None] * network.normal
        assert_allclose(across, network.tangential_force, rtol=0.0, atol=1e-13 * scale)
        assert np.max(np.abs(across)) > 1e-3 * scale
    # balls lie in a box of ASE's cell and the corner, along what does not repeat too
    box = np.linalg.solve(atoms.cell.array.T, (atoms.positions - atoms.info["Origin"]).T).T
    is_ball = np.isfinite(network.radii)
    assert np.all((box > 0.0) & (box < 1.0), where=is_ball[:, None] & ~atoms.pbc)


@pytest.mark.parametrize(
    "seed", [pytest.param(n, marks=pytest.mark.exhaustive if n else ()) for n in range(10)]
)
def test_no_change_of_a_written_frame_goes_unnoticed(seed, tmp_path):
    network = network_of(["packing", "sample", "wall"][seed % 3])
    paths = tmp_path / "balls.extxyz", tmp_path / "contacts.extxyz"
    network.write_tables(*paths)
    whole = [path.read_text() for path in paths]
    rng = np.random.default_rng(seed)
    spoilt = [
        (0, ""),
        (1, "1"),
        (0, whole[0] + whole[0]),
        (1, whole[1][: len(whole[1]) // 2]),
        (0, re.sub(" granphon_sha256.*", "", whole[0])),
        (1, re.sub(" granphon_.*", "", whole[1])),
        (1, re.sub("Properties=[^ ]*|granphon_sha.*", "", whole[1])),
        (0, re.sub(":R:3| granphon_sha.*", "", whole[0])),
    ]
    spoilt += [(which, damage(whole[which], rng)) for which in rng.integers(2, size=40)]
    for which, text in spoilt:
        if text == whole[which]:
            continue
        for n, path in enumerate(paths):
            path.write_text(text if n == which else whole[n])
        with pytest.raises((InputError, UnverifiedFileWarning)) as caught:
            gp.ContactNetwork.from_table(*paths, keep_rattlers=True)
        assert paths[which].name in str(caught.value)


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
@pytest.mark.parametrize("end", ["csv", "extxyz", "dump"])
def test_two_files_are_written_or_none(end, tmp_path):
    """Of one name, or where a file of somebody else has one of the names, nothing is written."""
    network = network_of("plane")
    other = replace(network, tangential_force=None, prestress=False)
    first, second = tmp_path / f"one.{end}", tmp_path / f"two.{end}"

    def write(made, *files):
        (made.write_dumps if end == "dump" else made.write_tables)(*files)

    with pytest.raises(InputError, match="two names"):
        write(network, first, tmp_path / ".." / tmp_path.name / first.name)
    second.write_text("mine\n")
    with pytest.raises(FileExistsInRunError):
        write(network, first, second)
    assert [path.name for path in tmp_path.iterdir()] == [second.name]
    assert second.read_text() == "mine\n"
    second.unlink()
    write(network, first, second)
    write(other, first, second)  # with other columns
    if end != "dump":
        assert gp.ContactNetwork.from_table(first, second, keep_rattlers=True) == other


@pytest.mark.parametrize("end", ["csv", "extxyz"])
def test_tables_in_the_other_order_are_told(end, tmp_path):
    files = tmp_path / f"balls.{end}", tmp_path / f"contacts.{end}"
    network_of("packing").write_tables(*files)
    with pytest.raises(InputError, match="these are contacts"):
        gp.ContactNetwork.from_table(*files[::-1])


def test_labels_that_files_could_not_give_back_are_not_written(tmp_path):
    """The largest labels come back; the next ones would be rounded as floats."""
    network = gp.Crystal.on("square", [gp.Ball(GLASS, 8e-3)]).at_force(10.0).network
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    largest = replace(network, labels=[2**53 - 1])
    largest.write_tables(*files)
    assert gp.ContactNetwork.from_table(*files) == largest
    for label in (2**53, -(2**53), -(2**63)):
        beyond = replace(network, labels=np.array([label]))
        for write in (beyond.write_tables, beyond.write_dumps):
            with pytest.raises(InputError, match=str(label)):
                write(tmp_path / "a", tmp_path / "b")
    assert not (tmp_path / "a").exists()


def test_kinds_that_files_could_not_give_back_are_not_written(tmp_path):
    """Cells of CSV lose the spaces at their ends; extended XYZ keeps them."""
    network = gp.ContactLattice.of("square", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0))
    network = replace(network, kinds=(" steel",))
    frames = tmp_path / "balls.xyz", tmp_path / "contacts.xyz"
    network.write_tables(*frames)
    assert gp.ContactNetwork.from_table(*frames, keep_rattlers=True).kinds == (" steel",)
    with pytest.raises(InputError, match="' steel'"):
        network.write_tables(tmp_path / "balls.csv", tmp_path / "contacts.csv")
    assert not list(tmp_path.glob("*.csv"))


def test_dumps_warn_of_moments_of_inertia_that_are_lost(tmp_path):
    """Those of hollow balls change modes where balls rotate, and only there."""
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    for has_friction in (True, False):
        packing = gp.Packing(GLASS, 8e-3, lattice="square", friction=has_friction)
        network = gp.AveragedLattice(packing).at_force(1.0).network
        network.write_dumps(*files)
        hollow = replace(network, inertias=5.0 / 3.0 * network.inertias)
        telling = pytest.warns(InconsistencyWarning, match="inertia")
        with telling if has_friction else nullcontext():
            hollow.write_dumps(*files)


@pytest.mark.parametrize("heading", ["nope", "m (g)", ""])
def test_a_heading_that_the_table_does_not_have_is_told(heading):
    """An optional column would be replaced by its default."""
    balls = {"x": [0.0, 8e-3], "radius": [4e-3, 4e-3], "m": [1.0, 2.0]}
    contacts = {"i": [0], "j": [1], "normal_force": [1.0]}
    with pytest.raises(InputError, match=re.escape(repr(heading))):
        gp.ContactNetwork.from_table(balls, contacts, material=GLASS, columns={"mass": heading})
    with pytest.raises(InputError, match="normal_force"):
        gp.ContactNetwork.from_table(
            balls, contacts, material=GLASS, columns={"normal_force": heading}
        )


# without the digest, which would tell the change
@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
@pytest.mark.parametrize(
    ("which", "pattern", "into", "told"),
    [
        (0, 'Lattice="', 'Lattice="1', "Lattice or pbc"),
        (0, 'pbc="T', 'pbc="F', "Lattice or pbc"),
        (0, 'pbc="T', 'pbc="T', ""),
        (0, r"(?s).*", "", "is empty"),
        (1, r"\nX \S+", "\nX nan", ":3: x is 'nan'"),
        (1, r"\nX \S+", "\nX 1e999", ":3: x is '1e999'"),
        (1, r"\nX \S+", "\nX 1_0", ":3: x is '1_0'"),
        (1, r"\nX", "\nX", ""),
    ],
)
def test_changes_of_a_frame_that_contradict_the_rest_are_told(which, pattern, into, told, tmp_path):
    network = network_of("packing")
    files = tmp_path / "balls.extxyz", tmp_path / "contacts.extxyz"
    network.write_tables(*files)
    text = re.sub(" granphon_sha256.*", "", files[which].read_text())
    files[which].write_text(re.sub(pattern, into, text, count=1))
    if told:
        with pytest.raises(InputError, match=told):
            gp.ContactNetwork.from_table(*files, keep_rattlers=True)
    else:
        assert gp.ContactNetwork.from_table(*files, keep_rattlers=True) == network


@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
@pytest.mark.parametrize("pbc", [[True, True], [[1], [1, 2]], [True] * 4, "x", 5])
def test_a_pbc_of_another_shape_in_a_frame_is_refused(pbc, tmp_path):
    files = tmp_path / "balls.extxyz", tmp_path / "contacts.extxyz"
    network_of("packing").write_tables(*files)
    text = re.sub(" granphon_sha256.*", "", files[0].read_text())
    fields = re.search(r"granphon_network=(\S+)", text)[1]
    changed = json.loads(unquote(fields)) | {"pbc": pbc}
    files[0].write_text(text.replace(fields, quote(json.dumps(changed), safe="")))
    with pytest.raises(InputError, match="pbc"):
        gp.ContactNetwork.from_table(*files, keep_rattlers=True)


def test_a_frame_of_another_program_is_refused(tmp_path):
    path = tmp_path / "gold.xyz"
    ase.io.write(path, ase.Atoms("Au2", positions=[[0, 0, 0], [0, 0, 2]]), format="extxyz")
    with pytest.raises(InputError, match="units of other files"):
        gp.ContactNetwork.from_table(path, path)


@pytest.mark.parametrize(
    "seed", [pytest.param(n, marks=pytest.mark.exhaustive if n else ()) for n in range(20)]
)
def test_no_change_of_a_written_table_goes_unnoticed(seed, tmp_path):
    """Rows cut off, lines repeated, words or single letters changed: an error, or a warning where
    the digest is lost.
    """
    network = network_of(["packing", "sample", "wall"][seed % 3])
    paths = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    network.write_tables(*paths)
    whole = [path.read_bytes().decode() for path in paths]
    rng = np.random.default_rng(seed)
    for path, text in zip(paths, whole, strict=True):  # how lines end does not count
        path.write_bytes(text.replace("\n", "\r\n").encode())
    assert gp.ContactNetwork.from_table(*paths, keep_rattlers=True) == network
    lines = whole[1].split("\n")
    spoilt = [
        (1, "\n".join([*lines[:-41], ""])),
        (1, "\n".join(lines[:1] + lines[2:])),
        (0, re.sub("# sha256.*\n", "", whole[0])),
        (0, whole[0].replace("sha256", "sha257")),
    ]
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
    """The balls and contacts of a packing as mappings of arrays, with nothing that follows from the
    rest.
    """
    whole = gp.ContactNetwork.from_lammps(*dumps(name), GLASS, keep_rattlers=True)
    balls = dict(zip("xyz", whole.positions.T[: whole.dimension], strict=False)) | {
        "id": whole.labels,
        "radius": whole.radii,
        "mass": whole.masses,
    }
    contacts = {
        "i": whole.labels[whole.i],
        "j": whole.labels[whole.j],
        "normal_force": whole.normal_force,
    }
    return whole, balls, contacts, np.diag(whole.cell)[: whole.dimension]


@pytest.mark.parametrize("name", NAMES)
def test_what_a_table_lacks_follows_from_the_rest(name, tmp_path):
    """Arrays, structured arrays and CSV files in other units give the network that LAMMPS' dumps
    give.
    """
    whole, balls, contacts, cell = arrays_of(name)
    found = gp.ContactNetwork.from_table(
        balls, contacts, material=GLASS, cell=cell, keep_rattlers=True
    )
    whole = replace(whole, slip_levers="arms")  # those of LAMMPS are the radii
    assert found == whole
    structured = [
        np.rec.fromarrays(list(map(np.asarray, table.values())), names=list(table))
        for table in (balls, contacts)
    ]
    assert (
        gp.ContactNetwork.from_table(
            *structured, material=GLASS, cell=np.diag(cell), keep_rattlers=True
        )
        == whole
    )
    paths = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    units = {
        "mass": " (g)",
        "x": " (mm)",
        "y": " (mm)",
        "z": " (mm)",
        "radius": " (um)",
        "normal_force": " [kN]",
    }
    scales = {"mass": 1e3, "x": 1e3, "y": 1e3, "z": 1e3, "radius": 1e6, "normal_force": 1e-3}
    for path, table in zip(paths, (balls, contacts), strict=True):
        rows = zip(
            *((scales.get(key, 1) * np.asarray(column)).tolist() for key, column in table.items()),
            strict=True,
        )
        heads = ";".join(key + units.get(key, "") for key in table)
        path.write_text(
            "\n".join(["# made by hand", heads, *(";".join(map(repr, row)) for row in rows), ""])
        )
    read = gp.ContactNetwork.from_table(*paths, material=GLASS, cell=cell)
    assert (read.n_balls, read.left_out) == (whole.n_balls - 1, 1)
    trimmed = whole.without_rattlers()
    for field in (
        "positions",
        "radii",
        "masses",
        "normal_force",
        "normal_stiffness",
        "shear_stiffness",
        "arm_i",
    ):
        np.testing.assert_allclose(
            getattr(read, field), getattr(trimmed, field), rtol=1e-10, atol=1e-18
        )
    # names of one's own
    paths[0].write_text(paths[0].read_text().replace("radius (um)", "R").replace("id", "name"))
    columns = {"radius": "R (um)", "id": "name"}
    assert gp.ContactNetwork.from_table(*paths, material=GLASS, cell=cell, columns=columns) == read


def test_tables_of_yade():
    """A packing that YADE has pressed and relaxed, by the script of the page on networks; its law:
    Hertz and Mindlin.
    """
    balls = packings.FOLDER / "yade_balls.csv"
    contacts = packings.FOLDER / "yade_contacts.csv"
    side = [5.5e-3] * 3
    network = gp.ContactNetwork.from_table(balls, contacts, cell=side)
    assert (network.n_balls, network.n_contacts, network.left_out, network.dimension) == (
        24,
        71,
        0,
        3,
    )
    pull = np.zeros((24, 3))
    force = network.normal * network.normal_force[:, None] + network.tangential_force
    np.add.at(pull, network.j, force)
    np.add.at(pull, network.i, -force)
    assert np.max(np.abs(pull)) < 1e-12 * network.normal_force.mean()
    # YADE's stiffnesses, masses, shifts and normals are those that follow from force, material and
    # places
    alone = {
        name: getattr(network, field)
        for name, field in (("i", "i"), ("j", "j"), ("normal_force", "normal_force"))
    }
    places = dict(zip("xyz", network.positions.T, strict=True)) | {"radius": network.radii}
    follows = gp.ContactNetwork.from_table(places, alone, material=GLASS, cell=side)
    for name in ("masses", "inertias", "shift", "normal_stiffness", "shear_stiffness"):
        np.testing.assert_allclose(getattr(follows, name), getattr(network, name), rtol=1e-13)
    np.testing.assert_allclose(follows.normal, network.normal, atol=1e-14)


@pytest.mark.parametrize("factor", [1.0, 1.05, 20.0, 1000.0])
def test_forces_of_arrays_are_compared_with_the_overlaps(factor):
    """The same judgement as of dumps: a factor of all forces to Hertz's law is told, also one of
    1.05.
    """
    network = (
        gp.AveragedLattice(gp.Packing(GLASS, 2e-3))
        .at_force(1.0, finite_overlap=True)
        .network.repeat((4, 4))
    )
    balls = {"x": network.positions[:, 0], "y": network.positions[:, 1], "radius": network.radii}
    contacts = {"i": network.i, "j": network.j, "normal_force": factor * network.normal_force}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        gp.ContactNetwork.from_table(balls, contacts, cell=network.cell[:2, :2], material=GLASS)
    assert [one.category for one in caught] == [InconsistencyWarning] * (factor != 1.0)
    assert all(one.filename == __file__ for one in caught)


@pytest.mark.parametrize(("push", "told"), [(3e-3, True), (1e-5, False)])
def test_a_network_that_is_read_out_of_balance_is_told(push, told, tmp_path):
    """The sentence is that of its waves; forces that do not act need no balance."""
    network = (
        gp.AveragedLattice(gp.Packing(GLASS, 2e-3))
        .at_force(1.0, finite_overlap=True)
        .network.repeat((4, 4))
    )
    force = network.normal_force.copy()
    force[0] *= 1.0 + push
    made = replace(network, normal_force=force)
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    made.write_tables(*files)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read = gp.ContactNetwork.from_table(*files)
        assert np.array_equal(read.normal_force, force)
        gp.ContactNetwork.from_table(*files, prestress=False)
    sentences = [one for one in gp.Waves(made).warnings if "static forces" in one]
    assert [str(one.message) for one in caught] == [
        f"{files[1]}: {one[0].lower()}{one[1:]}" for one in sentences
    ]
    assert len(caught) == told
    assert all(one.filename == __file__ for one in caught)


def test_a_table_of_a_row_between_walls():
    """Three balls and two flat walls: the stiffness of a wall contact is Hertz's of a ball on a
    plane.
    """
    mass = GLASS.ball_mass(0.02)
    pressed = gp.Hertz().between(gp.Ball(GLASS, 0.02), gp.Ball(GLASS, 0.02)).overlap(100.0)
    balls = {
        "x": [0.0, 0.02 - pressed, 0.04 - 2.0 * pressed, -0.02, 0.06],
        "radius": [0.01, 0.01, 0.01, np.inf, np.inf],
        "mass": [mass, mass, mass, np.inf, np.inf],
    }
    contacts = {"i": [0, 1, 3, 2], "j": [1, 2, 0, 4], "nx": [1.0] * 4, "normal_force": [100.0] * 4}
    network = gp.ContactNetwork.from_table(balls, contacts, material=GLASS)
    assert (network.dimension, network.motions, network.pbc, network.left_out) == (
        1,
        "longitudinal",
        (False,) * 3,
        0,
    )
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    between, at_wall = (
        (6.0 * modulus**2 * radius * 100.0) ** (1.0 / 3.0) for radius in (0.005, 0.01)
    )
    # a wall has no side that is as elastic as a ball's: it is of the same material
    np.testing.assert_allclose(
        network.normal_stiffness, [between, between, at_wall, at_wall], rtol=1e-12
    )
    squares = np.linalg.eigvalsh(
        [
            [between + at_wall, -between, 0.0],
            [-between, 2.0 * between, -between],
            [0.0, -between, between + at_wall],
        ]
    )
    operator = gp.Waves(network).operator
    np.testing.assert_allclose(mass * np.linalg.eigvalsh(operator.matrix.toarray()), squares)


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
def test_a_flat_wall_of_a_periodic_row_may_be_at_any_place():
    radius = 0.005
    balls = {
        "x": [0.0, 2.0 * radius, 1e9],
        "y": [0.0, 0.0, 0.0],
        "radius": [radius, radius, np.inf],
        "mass": [1e-3, 1e-3, np.inf],
    }
    contacts = {
        "i": [0, 1, 0, 1],
        "j": [1, 0, 2, 2],
        "nx": [1.0, 1.0, 0.0, 0.0],
        "ny": [0.0, 0.0, -1.0, -1.0],
        "normal_force": [1.0] * 4,
        "normal_stiffness": [1e5] * 4,
        "shift_1": [0, 1, 0, 0],
    }
    options = {"cell": [[4.0 * radius, 0.0]], "friction": False, "keep_rattlers": True}
    found = gp.ContactNetwork.from_table(balls, contacts, **options)
    del contacts["shift_1"]
    balls["x"][1] = 2.2 * radius  # so that one of the images of the neighbour is nearer
    contacts = {name: values[1:] for name, values in contacts.items()}
    nearest = gp.ContactNetwork.from_table(balls, contacts, **options)
    np.testing.assert_array_equal(nearest.shift, found.shift[1:])


@pytest.mark.filterwarnings("ignore:.* the network falls into")
@pytest.mark.parametrize("n_cells", [1, 3])
def test_a_ball_that_is_held_is_where_the_normal_leads_across_a_side_of_the_cell(n_cells):
    """Without shifts a clamped ball has the image that touches, on both sides in a cell of two
    balls: with prestress, rows are pushed sideways as with shifts, by -f/r of the true distance.
    """
    diameter = 0.01
    spacing = 0.999 * diameter
    n = 2 * n_cells
    balls = {
        "x": spacing * (0.3 + np.arange(n)),
        "y": np.zeros(n),
        "radius": np.full(n, 0.5 * diameter),
        "mass": np.where(np.arange(n) % 2, np.inf, 1e-3),
        "inertia": np.where(np.arange(n) % 2, np.inf, 1e-8),
    }
    contacts = {
        "i": np.arange(n),
        "j": (np.arange(n) + 1) % n,
        "nx": np.ones(n),
        "ny": np.zeros(n),
        "normal_force": np.full(n, 100.0),
        "normal_stiffness": np.full(n, 1e6),
    }
    # each contact from its other end
    contacts["i"][::3], contacts["j"][::3] = contacts["j"][::3].copy(), contacts["i"][::3].copy()
    contacts["nx"][::3] *= -1.0
    crossing = np.arange(n) == n - 1
    shifts = np.where(crossing, np.where(np.arange(n) % 3 == 0, -1, 1), 0)
    options = {"cell": [[n * spacing, 0.0]], "prestress": True, "friction": False}
    known = gp.ContactNetwork.from_table(
        balls, contacts | {"shift_1": shifts}, keep_rattlers=True, **options
    )
    found = gp.ContactNetwork.from_table(balls, contacts, keep_rattlers=True, **options)
    np.testing.assert_allclose(known.distance, spacing, rtol=1e-12)
    np.testing.assert_array_equal(found.shift, known.shift)
    stiffness = gp.Waves(found).operator.matrix.toarray()
    np.testing.assert_allclose(np.diag(stiffness)[1::2], -2.0 * 100.0 / spacing / 1e-3, rtol=1e-12)


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
@pytest.mark.parametrize("wall", [0.0, -0.001])
def test_a_flat_wall_leaves_a_network_in_space(wall):
    """A radius of inf is no scale for heights: three balls on a floor are in space, a layer on a
    floor too.
    """
    radius = 0.001
    balls = {
        "x": [0.0, 0.0019, 0.00095, 0.0],
        "y": [0.0, 0.0, 0.0016, 0.0],
        "z": [radius, radius, 0.0012, wall],
        "radius": [radius, radius, radius, np.inf],
        "mass": [1e-5, 1e-5, 1e-5, np.inf],
    }
    places = np.stack([balls[axis] for axis in "xyz"], axis=1)
    i, j = np.array([0, 0, 1, 0, 1]), np.array([1, 2, 2, 3, 3])

    def read(places):
        normal = places[j] - places[i]
        normal[3:] = [0.0, 0.0, -1.0]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        contacts = {"i": i, "j": j} | dict(zip(("nx", "ny", "nz"), normal.T, strict=True))
        contacts |= {
            "normal_force": [1.0] * 5,
            "normal_stiffness": [1e5] * 5,
            "shear_stiffness": [8e4] * 5,
        }
        table = balls | dict(zip("xyz", places.T, strict=True))
        return gp.ContactNetwork.from_table(table, contacts, keep_rattlers=True)

    assert read(places).dimension == 3
    level = places.copy()
    level[2, 2] = radius
    assert read(level).dimension == 3  # contacts lead down
    # by its shift a contact leads up, too
    row = {
        "x": [0.0, 2.0],
        "y": [0.0, 0.0],
        "z": [1.0, 1.0],
        "radius": [1.0, 1.0],
        "mass": [1.0] * 2,
    }
    images = {"i": [0, 0, 1], "j": [1, 0, 1], "shift_1": [0] * 3, "shift_2": [0] * 3}
    images |= {
        "normal_force": [1.0] * 3,
        "normal_stiffness": [1e5] * 3,
        "shear_stiffness": [8e4] * 3,
    }
    for up, dimension in ((1, 3), (0, 2)):
        shifts = images | {"shift_2": [0, 1 - up, 1 - up], "shift_3": [0, up, up]}
        network = gp.ContactNetwork.from_table(row, shifts, cell=[20.0, 2.0, 2.0])
        assert network.dimension == dimension
    # walls that stand beside a layer leave it in the plane, wherever they are
    beside = {
        "i": [0, 1, 1, 0],
        "j": [1, 2, 3, 2],
        "nx": [1.0, -0.5, 1.0, 0.5],
        "ny": [0.0, 0.75**0.5, 0.0, 0.75**0.5],
    }
    beside |= {
        "nz": [0.0] * 4,
        "normal_force": [1.0] * 4,
        "normal_stiffness": [1e5] * 4,
        "shear_stiffness": [8e4] * 4,
    }
    table = balls | {"z": [radius, radius, radius, wall]}
    assert gp.ContactNetwork.from_table(table, beside, keep_rattlers=True).dimension == 2


BAD_TABLES = {
    "a column": (
        lambda b, c: b.pop("radius"),
        {},
        "no column 'radius'.* columns={'radius': 'NAME'}",
    ),
    "ends": (lambda b, c: c.pop("j"), {}, "no column 'j'"),
    "no places": (lambda b, c: [b.pop(name) for name in "xyz"], {}, "no column 'x'"),
    "y alone": (lambda b, c: b.pop("y"), {}, "no column 'y'"),
    "nz alone": (lambda b, c: c.update(nz=np.ones(125)), {}, "no column 'nx', 'ny'"),
    "lengths": (
        lambda b, c: b.update(radius=b["radius"][1:]),
        {},
        "different lengths: 36 of id, 36 of x",
    ),
    "two radii": (lambda b, c: b.update(diameter=b["radius"]), {}, "both radius and diameter"),
    "table": (
        lambda b, c: b.update(radius=np.ones((36, 2))),
        {},
        "radius of the table .* shape",
    ),
    "texts": (lambda b, c: b.update(radius=["a"] * 36), {}, "radius of the table .*: found"),
    "ball": (
        lambda b, c: c.update(i=c["i"] + 100),
        {},
        "125 of 125 .* table of balls: balls 123 and",
    ),
    "part of a ball": (lambda b, c: c.update(i=c["i"] + 0.5), {}, "whole number"),
    "ids": (lambda b, c: b.update(id=[1] * 36), {}, "36 with an id"),
    "tension": (
        lambda b, c: c.update(normal_force=-c["normal_force"]),
        {},
        "125 with .*pulls: balls .*-4",
    ),
    "nan": (
        lambda b, c: c.update(normal_force=np.nan * c["normal_force"]),
        {},
        "125 with a normal_force .*finite.*nan",
    ),
    "misspelled": (
        lambda b, c: c.update(shear_stifness=np.ones(125)),
        {},
        "stifness'. Did you mean 'shear_stiffness'",
    ),
    "material": (
        lambda b, c: b.pop("mass"),
        {"material": None},
        "no column 'mass', and no material",
    ),
    "stiffness": (
        lambda b, c: b.update(mass=np.ones(36)),
        {"material": None},
        "no normal_stiffness, shear_stiffness, .*material",
    ),
    "shear": (
        lambda b, c: (b.update(mass=np.ones(36)), c.update(normal_stiffness=np.ones(125))),
        {"material": None},
        "no shear_stiffness, .*friction=False",
    ),
    "no cell": (
        None,
        {"cell": None},
        "near each other.* the cell",
    ),
    "small cell": (
        None,
        {"cell": [1e-3] * 3},
        "one place|near each other",
    ),
    "flat cell": (None, {"cell": [[1.0, 0, 0], [1.0, 0, 0]]}, "not independent"),
    "cell": (None, {"cell": [[1.0]] * 3}, "the cell has the shape"),
    "pbc": (None, {"cell": None, "pbc": [True]}, "pbc is"),
    "dimension": (None, {"dimension": 2}, "(leaves|both in) the plane|not near"),
    "unit": (
        lambda b, c: b.update({"radius (mm)": b.pop("radius")}),
        {"columns": {"radius": "radius (mm)"}},
        "'radius .mm.' is in mm.* SI",
    ),
    "columns": (
        None,
        {"columns": {"radios": "R"}},
        "'radios' .* column.*'radius'",
    ),
    "motions": (None, {"motions": "in_plane"}, "no motions 'in_plane'"),
    "held": (None, {"held_by": 1.5}, "held_by"),
    "masked kind": (
        lambda b, c: b.update(kind=np.ma.array(["a"] * 36, mask=[True] + [False] * 35)),
        {},
        "no name in row 0",
    ),
    "held and kept": (None, {"held_by": -1, "keep_rattlers": True}, "held_by"),
    "endless height": (lambda b, c: b.update(z=np.full(36, np.inf)), {}, "36 with a place"),
    "two walls": (
        lambda b, c: (
            b.update(radius=np.full(36, np.inf), mass=np.full(36, np.inf)),
            b["radius"].__setitem__(0, 1e-3),
            c.update(nx=np.ones(125), ny=np.zeros(125), nz=np.zeros(125)),
        ),
        {},
        "with two flat walls",
    ),
    "friction": (None, {"friction": "no"}, "friction"),
    "twice": (
        lambda b, c: c.update({n: np.append(v, v[0]) for n, v in c.items()}),
        {},
        "1 of 126 .* contact before: balls 23 and 4",
    ),
}


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
    "unit": ("x,y (mm),radius (mm)", "'x' has no unit.*'x \\(m\\)'"),
    "mixed": (
        "x (mm),y (m),radius (mm)",
        "different units: x \\(mm\\), y \\(m\\)",
    ),
    "kind": ("x (mm),y (mm),radius (N)", "not a unit of length"),
    "needless unit": ("x (mm),y (mm),radius (mm),id (m)", "'id' has the unit 'm'"),
    "missing": (
        "x (mm),y (mm),size (mm)",
        "no column 'radius'.* x \\(mm\\), y \\(mm\\), size \\(mm\\)",
    ),
    "escape": (
        "x (mm),y (mm),\x1b[2Jsize (mm)",
        r"no column 'radius'.*, \\x1b\[2Jsize \(mm\)",
    ),
    "inertia": ("x (mm),y (mm),radius (mm),inertia (kg)", "not a unit of moment of inertia"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_files_that_are_no_table_of_balls(name, tmp_path):
    head, said = BAD_FILES[name]
    path = tmp_path / "balls.csv"
    path.write_text(
        head
        + "\n"
        + "\n".join(f"{2 * k},0,1" + ",1" * (head.count(",") - 2) for k in range(3))
        + "\n"
    )
    with pytest.raises(gp.GranphonError, match=said) as error:
        gp.ContactNetwork.from_table(
            path, {"i": [0, 1], "j": [1, 2], "normal_force": [1.0, 1.0]}, material=GLASS
        )
    assert "balls.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_cells_of_a_table_that_cannot_be_read(tmp_path):
    path = tmp_path / "balls.csv"
    path.write_text("x (mm),y (mm),radius (mm)\n2,0,-1\n")
    with pytest.raises(gp.GranphonError, match=":2: radius: found"):
        gp.ContactNetwork.from_table(path, {"i": [], "j": []}, material=GLASS)
    for number in ("1_0", "\u0661"):
        path.write_text("x (mm),y (mm),radius (mm)\n0,0,1\n2,0,1\n")
        contacts = tmp_path / "contacts.csv"
        contacts.write_text(f"i,j\n0,{number}\n")
        with pytest.raises(
            gp.GranphonError,
            match=f"contacts.csv: line 2, j: .*'{number}'",
        ):
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
    found = words[rng.integers(len(words) if rng.random() < 0.5 else min(60, len(words)))]
    what = rng.integers(6)
    if what < 3:
        return text[: found.start()] + WORDS[rng.integers(len(WORDS))] + text[found.end() :]
    if what == 3:
        return text[: found.start()]
    lines = text.split("\n")
    place = rng.integers(len(lines))
    lines[place : place + 1] = [lines[rng.integers(len(lines))]] * (2 * (int(what) - 4))
    return "\n".join(lines)


@pytest.mark.parametrize(
    "seed", [pytest.param(n, marks=pytest.mark.exhaustive if n else ()) for n in range(20)]
)
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


@pytest.mark.parametrize("n_tilts", [1, 7])
@pytest.mark.parametrize("lattice", ["triangular", "fcc"])
def test_nearest_images_in_an_oblique_cell(lattice, n_tilts):
    """In a cell that is tilted by whole periods more, the image with the least fractions is not
    always the nearest one, and may be many cells away from it.
    """
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=lattice)).at_force(
        18.446, finite_overlap=True
    )
    network = state.network.repeat((3,) * state.packing.structure.periods)
    cell = network.cell[: network.dimension].copy()
    cell[1] += n_tilts * np.sign(cell[0] @ cell[1]) * cell[0]
    if network.dimension == 3:
        cell[2] -= (n_tilts - 1) * cell[1]
    places = (
        network.positions
        + np.random.default_rng(2).integers(-2, 3, (network.n_balls, 3)) @ network.cell
    )
    balls = dict(zip("xyz", places.T[: network.dimension], strict=False)) | {
        "radius": network.radii
    }
    contacts = {"i": network.i, "j": network.j, "normal_force": network.normal_force}
    found = gp.ContactNetwork.from_table(balls, contacts, material=steel, cell=cell)
    np.testing.assert_allclose(found.vector, network.vector, atol=1e-15 * n_tilts**2)
    np.testing.assert_allclose(found.normal_stiffness, network.normal_stiffness)


def test_periods_of_very_different_lengths_are_independent():
    """A row beside whose images nothing is; its twin in the class asks for the same."""
    row = {"x": [0.0, 2.0], "y": [0.0, 0.0], "radius": [1.0, 1.0], "mass": [1.0, 1.0]}
    contacts = {"i": [0, 1], "j": [1, 0], "shift_1": [0, 1], "shift_2": [0, 0], "shift_3": [0, 0]}
    contacts |= {"normal_force": [1.0] * 2, "normal_stiffness": [1.0] * 2}
    network = gp.ContactNetwork.from_table(row, contacts, cell=[4.0, 4e20], friction=False)
    assert network.pbc == (True, True, False)
    oblique = [[4.0, 0.0], [4e20, 4.0]]
    with pytest.raises(InputError, match="not independent"):
        gp.ContactNetwork.from_table(row, contacts, cell=oblique, friction=False)
    with pytest.raises(InputError, match="not independent"):
        replace(network, cell=np.pad(oblique, ((0, 1), (0, 1))))


def test_a_ball_that_touches_its_own_image_does_so_once():
    """One direction leads there as well as the other; two such contacts are not told apart without
    shifts.
    """
    steel = gp.Material(200e9, 0.3, 7800.0)
    d = 8e-3
    ball = {"x": [0.0], "y": [0.0], "radius": [0.5 * d]}
    found = gp.ContactNetwork.from_table(
        ball, {"i": [0], "j": [0]}, material=steel, cell=[[0.999 * d, 0.0], [0.3 * d, 1.2 * d]]
    )
    np.testing.assert_array_equal(np.abs(found.shift), [[1, 0, 0]])
    for side in (1, -1):  # a normal says which of the two directions
        contact = {"i": [0], "j": [0], "nx": [float(side)], "ny": [0.0]}
        led = gp.ContactNetwork.from_table(
            ball, contact, material=steel, cell=[[0.999 * d, 0.0], [0.3 * d, 1.2 * d]]
        )
        np.testing.assert_array_equal(led.shift, [[side, 0, 0]])
    with pytest.raises(InputError, match="more than one place"):
        gp.ContactNetwork.from_table(
            ball, {"i": [0, 0], "j": [0, 0]}, material=steel, cell=[0.999 * d, 0.999 * d]
        )


def test_kinds_of_balls_are_names_or_numbers_of_a_column():
    """They stay with their balls in parts and repeats of the network."""
    balls = {
        "x": [0.0, 2.0, 4.0],
        "radius": [1.0, 1.0, 1.0],
        "mass": [1.0, 2.0, 1.0],
        "type": [7, 3, 7],
    }
    contacts = {
        "i": [0, 1, 2],
        "j": [1, 2, 0],
        "normal_force": [1.0] * 3,
        "normal_stiffness": [1.0] * 3,
    }
    network = gp.ContactNetwork.from_table(
        balls,
        contacts,
        cell=[6.0],
        dimension=1,
        friction=False,
        columns={"kind": "type"},
        keep_rattlers=True,
    )
    assert network.kinds == ("7", "3", "7")
    assert network.repeat((2,)).kinds == network.kinds * 2
    part = network.select([2, 1])
    assert part.kinds == ("7", "3")
    assert [part.name_ball(ball) for ball in (0, 1)] == [2, 1]
    with pytest.raises(InputError, match="ball"):
        part.name_ball(2)
    with pytest.raises(InputError, match=r"\(2, 3\)"):
        part.find_farthest(np.zeros((3, 3)))
    for force in (np.nan, np.inf, 1e200):
        with pytest.raises(InputError, match="forces"):
            part.find_farthest(np.full((2, 3), force))
    without_force = replace(part, normal_force=np.zeros(part.n_contacts))
    assert without_force.find_farthest(np.array([[0.0, 0.0, 0.0], [0.0, -2.0, 0.0]])) == (
        1,
        2.0,
        np.inf,
    )
    assert without_force.find_farthest(np.zeros((2, 3))) == (0, 0.0, 0.0)
    assert gp.ContactNetwork.from_dict(network.to_dict()) == network
    assert (
        gp.ContactNetwork.from_table(
            balls, contacts, cell=[6.0], friction=False, keep_rattlers=True
        ).kinds
        is None
    )
    for kinds, told in (
        (["a", "b"], "different lengths"),
        ([["a", "b", "c"]], r"\(1, 3\)"),
        ([["a"], ["b", "c"]], "list of names"),
    ):
        with pytest.raises(InputError, match=told):
            gp.ContactNetwork.from_table(balls | {"kind": kinds}, contacts, cell=[6.0])
    with pytest.raises(InputError, match="no motions"):  # also of balls on springs
        gp.ContactNetwork.from_table(
            balls | {"on_site_x": [1.0] * 3}, contacts, cell=[6.0], friction=False, motions=["all"]
        )
    for kinds, said in (
        (["7"], "kinds of the ContactNetwork .* shape"),
        (["7", "=1+1", "7"], "the name of a kind"),
    ):
        with pytest.raises(InputError, match=said):
            replace(network, kinds=kinds)


@pytest.mark.parametrize(
    ("columns", "kinds"), [("type", ("1", "2")), ("type element", ("Fe", "Al")), ("mol", None)]
)
def test_elements_or_types_of_a_dump_are_kinds(columns, kinds, tmp_path):
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF {}\n{}\nITEM: BOX BOUNDS pp ff ff\n0 4\n-1 1\n-1 1\n"
    atoms = [{"type": "1", "element": "Fe", "mol": "1"}, {"type": "2", "element": "Al", "mol": "1"}]
    rows = [
        f"{n + 1} {1 + 2 * n} 0 0 1 1 " + " ".join(map(one.get, columns.split()))
        for n, one in enumerate(atoms)
    ]
    (tmp_path / "atoms").write_text(
        "\n".join(
            [head.format("ATOMS", 2) + f"ITEM: ATOMS id x y z radius mass {columns}", *rows, ""]
        )
    )
    pairs = head.format("ENTRIES", 2) + "ITEM: ENTRIES i j force dx\n1 2 1.0 -1.9\n2 1 1.0 -1.9\n"
    (tmp_path / "pairs").write_text(pairs)
    network = gp.ContactNetwork.from_lammps(
        tmp_path / "atoms",
        tmp_path / "pairs",
        columns=["i", "j", "force", "shift"],
        normal_stiffness=1.0,
        friction=False,
        dimension=1,
        keep_rattlers=True,
    )
    assert network.kinds == kinds


@pytest.mark.parametrize(
    ("balls", "told"),
    [
        ({"x": [], "radius": []}, "no rows"),
        ({"x": [0.0], "radius": [np.inf], "mass": [np.inf]}, "flat walls alone"),
        ({"x": [0.0, 2e-3], "radius": [1e-3, 1e-3]}, "carry no load"),  # they just touch
    ],
)
def test_tables_without_a_ball_or_a_force(balls, told):
    ends = [0, 1] if len(balls["x"]) == 2 else []
    contacts = {"i": ends[:1], "j": ends[1:]}
    with pytest.raises(InputError, match=told):
        gp.ContactNetwork.from_table(balls, contacts, material=GLASS)


def test_balls_without_contacts_are_written_as_a_frame(tmp_path):
    balls = {"x": [0.0, 1.0], "y": [0.0, 1.0], "radius": [1e-3, 1e-3]}
    network = gp.ContactNetwork.from_table(
        balls, {"i": [], "j": []}, material=GLASS, keep_rattlers=True, cell=[[2.0, 2.0, 0.0]],
        pbc=[True],
    )  # fmt: skip
    files = tmp_path / "balls.extxyz", tmp_path / "contacts.extxyz"
    network.write_tables(*files)
    assert gp.ContactNetwork.from_table(*files, keep_rattlers=True) == network
    box = ase.io.read(files[0]).cell
    assert abs(np.linalg.det(box)) > 0.0


@pytest.mark.parametrize(
    ("column", "values"),
    [("shift_1", [0, 1]), ("tangential_x", [0.0, 5.0]), ("arm_i", [1e-3, 1e-2])],
)
def test_contacts_that_cannot_be_are_left_out(column, values):
    balls = {"x": [0.0, 1.99e-3, 3.98e-3], "y": [0.0] * 3, "radius": [1e-3] * 3}
    contacts = {"i": [0, 1], "j": [1, 2], column: values}
    options = {"material": GLASS, "keep_rattlers": True}
    with pytest.raises(InputError, match="balls 1 and 2"):
        gp.ContactNetwork.from_table(balls, contacts, **options)
    with pytest.warns(InconsistencyWarning, match="left out"):
        network = gp.ContactNetwork.from_table(balls, contacts, bad="drop", **options)
    assert network.n_contacts == 1


def test_balls_of_data_frames_without_a_kind_are_refused():
    balls = {"x": [0.0, 3e-3], "radius": [1e-3] * 2}
    for nothing in (None, np.nan):
        kinds = {"kind": np.array(["glass", nothing], object)}
        with pytest.raises(InputError, match="row 1"):
            gp.ContactNetwork.from_table(balls | kinds, {"i": [], "j": []}, material=GLASS)


def test_bodies_that_do_not_move_may_touch():
    balls = {"x": [0.0, 2e-3], "radius": [1e-3] * 2, "mass": [np.inf] * 2}
    contacts = {"i": [0], "j": [1], "normal_force": [1.0], "normal_stiffness": [1e6]}
    network = gp.ContactNetwork.from_table(balls, contacts, friction=False, keep_rattlers=True)
    assert (network.n_contacts, network.coordination) == (1, 0.0)


@pytest.mark.parametrize("law", ["mindlin/force", "yade"])
def test_two_flat_walls_may_touch_with_a_stiffness(law, tmp_path):
    """A ball lies in a corner: its two walls meet, and their contact has no place."""
    balls = {"x": [0.0] * 3, "z": [0.0] * 3, "radius": [4e-3, np.inf, np.inf]}
    balls |= {"y": [0.0] * 3, "mass": [1e-3, np.inf, np.inf]}
    contacts = {"i": [0, 0, 1], "j": [1, 2, 2], "nx": [1.0, 0.0, 1.0], "nz": [0.0, 1.0, 0.0]}
    contacts |= {"ny": [0.0] * 3, "normal_force": [1.0] * 3}
    contacts |= {"normal_stiffness": [1e5] * 3, "shear_stiffness": [8e4] * 3}
    zeros = {f"tangential_{axis}": [0.0] * 3 for axis in "xyz"}
    options = {"dimension": 3, "prestress": True, "keep_rattlers": True, "tangential_law": law}
    network = gp.ContactNetwork.from_table(balls, contacts | zeros, **options)
    assert network.bending_stiffness[2] == 0.0
    assert np.all(np.isfinite(network.slip_stretch))
    assert set(network.walls) == {1, 2}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        network.write_dumps(tmp_path / "atoms.dump", tmp_path / "pairs.dump")
        ax = plot_forces(network, show="all")
    assert len(with_gid(ax, "forces").get_paths()) == 2
    assert len(with_gid(ax, "walls").get_paths()) == 2


def test_a_cell_and_a_shift_that_cannot_be_are_named(tmp_path):
    balls = {"x": [0.0, 2e-3], "radius": [1e-3] * 2, "mass": [1e-3] * 2}
    contacts = {"i": [0], "j": [1], "normal_force": [1.0], "normal_stiffness": [1e6]}
    options = {"friction": False, "keep_rattlers": True}
    with pytest.raises(InputError, match="period 1 of the cell"):
        gp.ContactNetwork.from_table(balls, contacts, cell=[1.0], pbc=[True, True], **options)
    path = tmp_path / "contacts.csv"
    path.write_text("i,j,shift_1,normal_force (N),normal_stiffness (N/m)\n0,1,0.5,1,1e6\n")
    with pytest.raises(InputError, match=r"contacts\.csv:2: shift_1"):
        gp.ContactNetwork.from_table(balls, path, cell=[1.0], **options)


def test_forces_that_gravity_may_balance_are_said_to_be_left_out():
    """The first of two balls on a floor bears the wrong way."""
    balls = {"x": [0.0, 8e-3, 0.0], "y": [4e-3, 4e-3, 0.0], "radius": [4e-3, 4e-3, np.inf]}
    balls |= {"mass": [1e-3, 1e-3, np.inf]}
    contacts = {"i": [0, 1, 0], "j": [2, 2, 1], "nx": [0.0, 0.0, 1.0], "ny": [-1.0, -1.0, 0.0]}
    contacts |= {"normal_force": [1.0, 1.0, 1.0], "normal_stiffness": [1e5] * 3}
    options = {"friction": False, "keep_rattlers": True, "prestress": True}
    with pytest.warns(InconsistencyWarning, match="less what gravity may balance"):
        gp.ContactNetwork.from_table(balls, contacts, **options)
