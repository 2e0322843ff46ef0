"""What readers of the files of other programs have in common: forms, faults, cuts, notes, and the
formats of LIGGGHTS and MercuryDPM.
"""

import gzip
import inspect
import re
import tracemalloc
import warnings
from contextlib import suppress
from dataclasses import fields, replace
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError, OutputError, StoppedEarlyWarning
from granphon.networks import dumps as dumps_of_programs
from granphon.networks.faults import Faults, settle
from granphon.networks.sources import Completion
from tests import packings
from tests.networks import written
from tests.networks.test_lammps import dumps

GLASS = packings.MATERIAL
FIELDS = (
    "positions", "radii", "masses", "normal_force", "normal_stiffness", "shear_stiffness",
    "normal", "tangential_force",
)  # fmt: skip


def sort(network):
    """The contacts of a network from the lower to the higher ball, in their order; walls last."""
    turned = (network.i > network.j) & ~np.isinf(network.radii[network.j])
    sign = np.where(turned, -1, 1)[:, None]
    fields = {
        "i": np.where(turned, network.j, network.i),
        "j": np.where(turned, network.i, network.j),
        "arm_i": np.where(turned, network.arm_j, network.arm_i),
        "arm_j": np.where(turned, network.arm_i, network.arm_j),
        "shift": sign * network.shift,
        "normal": sign * network.normal,
    }
    if network.tangential_force is not None:
        fields["tangential_force"] = sign * network.tangential_force
    whole = replace(network, **fields)
    order = np.lexsort((*whole.shift.T, whole.j, whole.i))
    ordered = {name: getattr(whole, name)[order] for name in whole.contact_fields}
    return replace(whole, **ordered)


def require_same(found, expected):
    """Assert that two networks have the same balls, contacts and forces, whatever the order of the
    contacts.
    """
    found, expected = sort(found), sort(expected)
    for name in ("i", "j", "shift"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    has_size = np.isfinite(expected.radii)
    for name in FIELDS:
        ours, theirs = getattr(found, name), getattr(expected, name)
        if name == "positions":  # a flat wall may be anywhere
            ours, theirs = ours[has_size], theirs[has_size]
        if theirs is not None and ours is not None:
            of = expected.normal_force if name == "tangential_force" else theirs
            scale = np.max(np.abs(of[np.isfinite(of)]), initial=0.0)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * scale, err_msg=name)
    assert found.pbc == expected.pbc


NETWORKS = {"packing": written.glass_packing, "floor": written.layer_on_floor}


# -- LIGGGHTS --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "keywords"),
    [
        ("packing", "id force delta"),
        ("packing", ""),
        ("packing", "pos id force"),
        ("floor", "pos id force"),
    ],
)
def test_dumps_of_liggghts(kind, keywords, tmp_path):
    network = NETWORKS[kind]()
    atoms, pairs, walls = written.write_liggghts(network, tmp_path, keywords)
    found = gp.ContactNetwork.from_liggghts(
        atoms, pairs, GLASS, walls=walls if kind == "floor" else None, keywords=keywords or None,
        held_by=None if kind == "packing" else 1,
    )  # fmt: skip
    require_same(found, network)
    is_wall = np.isinf(found.radii[found.j])
    surfaces = found.radii[found.i[is_wall]]  # arms end amid the overlap, seen from either side
    np.testing.assert_allclose(found.arm_i[is_wall] - found.arm_j[is_wall], surfaces, rtol=1e-12)
    assert any("not read" in note for note in found.notes)
    with pytest.raises(InputError, match="columns, and pos id of"):
        gp.ContactNetwork.from_liggghts(atoms, pairs, GLASS, keywords="pos id")
    for wrong_keywords in ("ids", "pos id pos"):
        with pytest.raises(InputError, match=f"keywords are '{wrong_keywords}'"):
            gp.ContactNetwork.from_liggghts(atoms, pairs, GLASS, keywords=wrong_keywords)
    with pytest.raises(InputError, match="keywords: found 3"):
        gp.ContactNetwork.from_liggghts(atoms, pairs, GLASS, keywords=3)
    if kind == "floor":
        no_balls = re.sub(r"(NUMBER OF ATOMS\n)\d+", r"\g<1>0", atoms.read_text())
        atoms.write_text(re.sub(r"(ITEM: ATOMS.*\n)[^I]*", r"\1", no_balls))
        with pytest.raises(InputError, match="no balls"):
            gp.ContactNetwork.from_liggghts(atoms, pairs, GLASS, walls=walls, keywords=keywords)


# -- MercuryDPM ------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.* the static forces")  # the upper balls of the floor
@pytest.mark.parametrize("kind", NETWORKS)
@pytest.mark.parametrize("particles", ["data", "restart"])
def test_files_of_mercury(kind, particles, tmp_path):
    network = NETWORKS[kind]()
    fstat, data, restart = written.write_mercury(network, tmp_path)
    options = {"held_by": None if kind == "packing" else 1}
    if particles == "data":
        options["pbc"] = network.pbc
    found = gp.ContactNetwork.from_mercury(
        fstat, data if particles == "data" else restart, GLASS, **options
    )
    require_same(found, network)
    with pytest.raises(InputError, match="time"):
        gp.ContactNetwork.from_mercury(fstat, data, GLASS, time=0.1)


@pytest.mark.parametrize("particles", ["data", "restart"])
def test_fixed_balls_of_mercury_are_those_without_lines_of_their_own(particles, tmp_path):
    network = written.glass_packing()
    still = np.arange(network.n_balls) % 7 == 0
    touching = ~(still[network.i] & still[network.j])
    contacts = {name: getattr(network, name)[touching] for name in network.contact_fields}
    network = replace(
        network,
        masses=np.where(still, np.inf, network.masses),
        inertias=np.where(still, np.inf, network.inertias),
        **contacts,
    )
    fstat, data, restart = written.write_mercury(network, tmp_path)
    options = {"pbc": network.pbc} if particles == "data" else {}
    found = gp.ContactNetwork.from_mercury(
        fstat, data if particles == "data" else restart, GLASS, keep_rattlers=True, **options
    )
    require_same(found, network)
    np.testing.assert_array_equal(found.moving, ~still)
    assert any("do not move" in note for note in found.notes) == (particles == "data")


@pytest.mark.filterwarnings("ignore:.* the static forces")  # the upper balls of the floor
def test_a_file_of_mercury_that_is_cut_between_two_lines_is_told_by_the_restart(tmp_path):
    network = written.layer_on_floor()
    fstat, data, restart = written.write_mercury(network, tmp_path)
    found = gp.ContactNetwork.from_mercury(fstat, data, GLASS, pbc=network.pbc, held_by=1)
    assert any(".restart" in note for note in found.notes)
    lines = fstat.read_text().splitlines()
    # more contacts than those across the periodic boundary, which may count twice
    fstat.write_text("\n".join([*lines[:-16], ""]))
    with pytest.warns(InconsistencyWarning, match=f"says that there are {network.n_contacts}"):
        gp.ContactNetwork.from_mercury(fstat, restart, GLASS, held_by=1)


@pytest.mark.parametrize(
    ("pattern", "text", "told"),
    [
        ("Particles [0-9]+", "Particles 0", "no ball at the time"),
        ("Particles [0-9]+", "Particles nan", "restart:[0-9]+: found Particles nan"),
        ("Particles [0-9]+", "Particles -3", "restart:[0-9]+: found Particles -3"),
        ("Interactions [0-9]+", "Interactions inf", "restart:[0-9]+: found Interactions inf"),
        (" time [0-9.]+", " time nan", "restart:2: found the time nan"),
    ],
)
def test_counts_and_times_of_mercury_are_numbers(pattern, text, told, tmp_path):
    fstat, _data, restart = written.write_mercury(written.glass_packing(), tmp_path)
    restart.write_text(re.sub(pattern, text, restart.read_text()))
    with pytest.raises(InputError, match=told):
        gp.ContactNetwork.from_mercury(fstat, restart, GLASS)


def test_bounds_of_the_box_of_mercury_are_finite(tmp_path):
    network = written.glass_packing()
    fstat, data, _restart = written.write_mercury(network, tmp_path)
    heading, rows = data.read_text().split("\n", 1)
    number, time, *_bounds = heading.split()
    data.write_text("\n".join([" ".join([number, time, *["inf"] * 6]), rows]))
    with pytest.raises(InputError, match=r"data:1: .*heading is needed"):
        gp.ContactNetwork.from_mercury(fstat, data, GLASS, pbc=network.pbc)


def test_rows_of_contacts_of_mercury_that_have_run_together_are_told(tmp_path):
    network = written.glass_packing()
    fstat, data, _restart = written.write_mercury(network, tmp_path)
    lines = fstat.read_text().splitlines()
    for joined in (f"{lines[8]} {lines[9]}", f"{lines[8]} 0"):
        fstat.write_text("\n".join([*lines[:8], joined, *lines[10:], ""]))
        with pytest.raises(InputError, match=r"run\.fstat:9: found \d+ cells"):
            gp.ContactNetwork.from_mercury(fstat, data, GLASS, pbc=network.pbc)


@pytest.mark.parametrize("column", [6, 9, 13])
def test_infinite_numbers_of_mercury_are_told_by_their_line(column, tmp_path):
    """Beside zeros, with which their product is no number."""
    network = written.layer_on_floor()
    fstat, data, _restart = written.write_mercury(network, tmp_path)
    rows = [line.split() for line in fstat.read_text().splitlines()]
    for row in rows:
        if row[0] != "#":
            row[column] = "inf"
            row[9 if column == 13 else 11] = "0"
    fstat.write_text("\n".join([*map(" ".join, rows), ""]))
    with pytest.raises(InputError, match=r"not finite, or too large: .*line \d+"):
        gp.ContactNetwork.from_mercury(fstat, data, GLASS, pbc=network.pbc)


def test_times_of_mercury_follow_each_other(tmp_path):
    network = written.glass_packing()
    fstat, data, restart = written.write_mercury(network, tmp_path)
    options = {"material": GLASS, "pbc": network.pbc, "keep_rattlers": True}
    for file in (fstat, data):
        text = file.read_text()
        # the same balls and contacts at a later time
        later = re.sub(r"^(# |35 |)0\.25 ", r"\g<1>0.5 ", text, flags=re.MULTILINE)
        file.write_text(text + re.sub(r"^(#|35) 0(\.0)? ", r"\1 0.4 ", later))
    found = dict(gp.ContactNetwork.series("mercury", fstat, data, **options))
    assert list(found) == [0.0, 0.25, 0.4, 0.5]
    assert found[0.0].n_contacts == found[0.4].n_contacts == 0
    require_same(found[0.25], network)
    assert found[0.25] == found[0.5]
    raw = fstat.read_bytes()
    fstat.write_bytes(raw[:-20])
    with pytest.warns(StoppedEarlyWarning, match="ends early"):
        whole = dict(gp.ContactNetwork.series("mercury", fstat, data, **options))
    assert list(whole) == [0.0, 0.25, 0.4]
    with pytest.raises(InputError, match="one time"):
        next(gp.ContactNetwork.series("mercury", fstat, restart, **options))
    with pytest.raises(InputError, match="Leave time out"):
        next(gp.ContactNetwork.series("mercury", "nowhere", "nowhere", time=0.25, **options))


def test_a_series_reads_the_file_of_walls_once(tmp_path, monkeypatch):
    names = ("atoms", "pairs", "walls")
    for name in names:
        text = (packings.FOLDER / f"liggghts_floor_{name}.dump").read_text()
        frames = [re.sub(r"TIMESTEP\n\d+", f"TIMESTEP\n{step}", text) for step in (3, 5)]
        (tmp_path / name).write_text("".join(frames))
    opened = []
    open_lines = dumps_of_programs.open_lines
    monkeypatch.setattr(
        dumps_of_programs, "open_lines", lambda path: opened.append(path) or open_lines(path)
    )
    atoms, pairs, walls = (tmp_path / name for name in names)
    options = {"material": GLASS, "walls": walls, "keywords": "pos id force delta"}
    found = dict(gp.ContactNetwork.series("liggghts", atoms, pairs, **options))
    assert list(found) == [3, 5]
    assert found[3] == found[5]
    assert np.any(np.isinf(found[3].radii))
    assert opened == [atoms, pairs, walls]


# -- faults ----------------------------------------------------------------------------------------


def spoil(folder):
    """The disks of the page on networks, with four kinds of fault in six of their 64 contacts."""
    atoms, pairs = dumps("disks")
    head, below = re.split(r"(?<=\n)(?=ITEM: ENTRIES)", pairs.read_text())
    lines = below.splitlines()
    rows = [line.split() for line in lines[1:]]
    for row, force in ((3, "-2"), (7, "-90"), (9, "-5"), (11, "-0.5")):
        rows[row][2] = force
    rows[20][0] = "99"
    rows[30][2] = "nan"
    rows[40] = rows[41]
    (folder / "pairs.dump").write_text(
        head + "\n".join([lines[0], *(" ".join(row) for row in rows)]) + "\n"
    )
    return atoms, folder / "pairs.dump", {3, 7, 9, 11, 20, 30, 40}


def test_all_faults_of_a_file_are_told_at_once(tmp_path):
    atoms, pairs, bad = spoil(tmp_path)
    with pytest.raises(InputError) as caught:
        gp.ContactNetwork.from_lammps(atoms, pairs, GLASS)
    text = str(caught.value)
    assert "7 of 64 contacts" in text
    first_line = (
        pairs.read_text()
        .splitlines()
        .index(next(line for line in pairs.read_text().splitlines() if "ITEM: ENTRIES" in line))
        + 2
    )
    # of each kind the number, and the worst three with ids and lines
    assert re.search(r"4 with a force that pulls: .*-90 N.*-5 N.*-2 N.*\.\.\.", text)
    assert "-0.5 N" not in text
    assert (
        f"balls 99 and 27 in line {first_line + 20}" in text.replace("  ", " ")
        or "balls 99" in text
    )
    assert f"line {first_line + 7} (-90 N)" in text
    assert "1 with a normal_force" in text
    assert "1 with the balls" in text
    assert "\n" not in text
    with pytest.warns(InconsistencyWarning, match=r"7 of 64 .* left out") as told:
        found = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, bad="drop", keep_rattlers=True)
    assert told[0].filename == __file__
    whole = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS, keep_rattlers=True)
    kept = np.delete(np.arange(64), sorted(bad))  # row 41 stands in row 40
    np.testing.assert_array_equal(found.normal_force, whole.normal_force[kept])
    np.testing.assert_array_equal(found.i, whole.i[kept])
    with pytest.raises(InputError, match="bad"):
        gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, bad="some")


def test_contacts_may_be_left_out_where_those_of_another_list_are_fine():
    """As contacts with walls may be where all pairs have faults; where none is left, they may not
    be.
    """
    pairs, walls = (Faults(name, "contacts", 2, str) for name in ("pairs", "walls"))
    pairs.note(np.ones(2, bool), "a force that pulls")
    with pytest.raises(InputError, match="bad='drop'"):
        settle([pairs, walls], drops=False)
    walls.note(np.ones(2, bool), "a force that pulls")
    with pytest.raises(InputError) as caught:
        settle([pairs, walls], drops=False)
    assert "drop" not in str(caught.value)


def test_faults_of_balls_and_contacts_are_told_together(tmp_path):
    atoms, pairs, _bad = spoil(tmp_path)
    lines = atoms.read_text().splitlines()
    first = next(n for n, line in enumerate(lines) if "ITEM: ATOMS" in line) + 1
    rows = [line.split() for line in lines[first:]]
    names = lines[first - 1].split()[2:]
    rows[4][names.index("radius")] = "-1"
    rows[6][names.index("mass")] = "0"
    rows[8][names.index("x")] = "nan"
    rows[12][names.index("id")] = rows[13][names.index("id")]
    (tmp_path / "atoms.dump").write_text("\n".join([*lines[:first], *map(" ".join, rows), ""]))
    for bad in ("refuse", "drop"):  # contacts without balls cannot be left out
        with pytest.raises(InputError) as caught:
            gp.ContactNetwork.from_lammps(tmp_path / "atoms.dump", pairs, GLASS, bad=bad)
        text = str(caught.value)
        assert "5 of 30 balls" in text
        for words in ("a radius", "a mass", "a place", "2 with an id", "a force that pulls"):
            assert words in text
        assert f"in line {first + 5} (-1" in text


# -- forms of dumps --------------------------------------------------------------------------------


def test_options_that_all_readers_share_have_one_list():
    shared = {field.name: field.default for field in fields(Completion)}
    names = ("from_table", "from_lammps", "from_liggghts", "from_mercury")
    for reader in [getattr(gp.ContactNetwork, name) for name in names]:
        arguments = inspect.signature(reader).parameters
        assert shared.items() <= {name: one.default for name, one in arguments.items()}.items()
        with pytest.raises(TypeError, match="fricton"):
            reader("balls", "contacts", fricton=False)
        with pytest.raises(InputError, match="friction"):  # before any file is read
            reader("balls", "contacts", friction="no")


def test_a_series_of_dumps(tmp_path):
    """Several steps are read one after the other; those that only one file has are left out."""
    for which, path in zip(("atoms", "pairs"), dumps("disks"), strict=True):
        text = path.read_text()
        steps = (5, 10, 20) if which == "atoms" else (10, 20, 30)
        frames = [re.sub(r"TIMESTEP\n\d+", f"TIMESTEP\n{step}", text) for step in steps]
        (tmp_path / which).write_text("".join(frames))
    expected = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS)
    paths = tmp_path / "atoms", tmp_path / "pairs"
    found = dict(gp.ContactNetwork.series("lammps", *paths, material=GLASS))
    assert [*found] == [10, 20]
    assert all(network == expected for network in found.values())
    whole = paths[0].read_text()
    paths[0].write_text(whole[:-30])
    with pytest.warns(StoppedEarlyWarning, match="series ends early"):
        steps = [
            step for step, _network in gp.ContactNetwork.series("lammps", *paths, material=GLASS)
        ]
    assert steps == [10]
    paths[0].write_text(whole)
    with pytest.raises(InputError, match="in common"):
        next(gp.ContactNetwork.series("lammps", paths[0], dumps("disks")[1], material=GLASS))
    with pytest.raises(InputError, match="program"):
        next(gp.ContactNetwork.series("tables", *paths))


def test_packed_dumps(tmp_path):
    """By gzip, in one member or several, and by Zstandard where it can be read."""
    atoms, pairs = dumps("balls")
    expected = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS)
    raw = atoms.read_bytes()
    (tmp_path / "a.gz").write_bytes(gzip.compress(raw[:500]) + gzip.compress(raw[500:]))
    assert gp.ContactNetwork.from_lammps(tmp_path / "a.gz", pairs, GLASS) == expected
    packed = gzip.compress(raw * 2)
    (tmp_path / "cut.gz").write_bytes(packed[:-40])
    with pytest.raises(InputError, match="not whole"):
        gp.ContactNetwork.from_lammps(tmp_path / "cut.gz", pairs, GLASS)
    (tmp_path / "bad.gz").write_bytes(packed[:50] + b"\xff" * 40 + packed[90:])
    with pytest.raises(InputError, match=r"unpacked|not whole"):
        gp.ContactNetwork.from_lammps(tmp_path / "bad.gz", pairs, GLASS)
    (tmp_path / "a.zst").write_bytes(b"\x28\xb5\x2f\xfd" + raw)
    with pytest.raises(gp.GranphonError, match=r"Zstandard|unpacked"):
        gp.ContactNetwork.from_lammps(tmp_path / "a.zst", pairs, GLASS)


def test_dumps_packed_by_zstandard(tmp_path):
    """In one frame or several, where a module of the form of the standard library is there."""
    for name in ("compression.zstd", "backports.zstd"):
        with suppress(ImportError):
            zstandard = import_module(name)
            break
    else:
        pytest.skip("nothing is installed that reads Zstandard")
    atoms, pairs = dumps("balls")
    expected = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS)
    raw = atoms.read_bytes()
    packed = zstandard.compress(raw[:500]) + zstandard.compress(raw[500:])
    file = tmp_path / "atoms.dump.zst"
    file.write_bytes(packed)
    assert gp.ContactNetwork.from_lammps(file, pairs, GLASS) == expected
    file.write_bytes(packed[:-40])
    with pytest.raises(InputError, match="not whole"):
        gp.ContactNetwork.from_lammps(file, pairs, GLASS)
    file.write_bytes(packed[:50] + b"\xff" * 40 + packed[90:])
    with pytest.raises(InputError, match=r"unpacked|not whole"):
        gp.ContactNetwork.from_lammps(file, pairs, GLASS)


def test_notes_name_what_is_passed_over(tmp_path):
    atoms, pairs = dumps("disks")
    assert not gp.ContactNetwork.from_lammps(atoms, pairs, GLASS).notes
    names = " ".join(f"f_lid[{n}]" for n in range(1, 9))
    lines = atoms.read_text().splitlines()
    first = next(n for n, line in enumerate(lines) if "ITEM: ATOMS" in line)
    lines[first] += f" vx {names}"
    lines[first + 1 :] = [line + " 3" + " 0" * 8 for line in lines[first + 1 :]]
    (tmp_path / "atoms").write_text("\n".join([*lines, ""]))
    notes = gp.ContactNetwork.from_lammps(tmp_path / "atoms", pairs, GLASS).notes
    assert [bool(re.search("fix lid|: vx", note)) for note in notes] == [True, True]
    # the same columns by the reader of LIGGGHTS, which a dump may name as that of LAMMPS
    named = gp.ContactNetwork.from_liggghts(atoms, pairs, GLASS)
    assert not any("pairs.dump" in note for note in named.notes)
    with pytest.raises(InputError, match=r"no column f_floor\[1\]"):
        gp.ContactNetwork.from_lammps(tmp_path / "atoms", pairs, GLASS, walls="floor")
    for frozen, said in (
        ({"type": 9}, "type"),
        ({"id": 99}, "no ball with id = 99"),
        ({"id": [1, 99]}, "no ball with id = 99"),
        ({"id": []}, "no value of the column id"),
        (3, "frozen is 3"),
    ):
        with pytest.raises(InputError, match=said):
            gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, frozen=frozen)
    for units in ("lj", "LJ"):
        with pytest.raises(InputError, match=units):
            gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, units=units)
    still = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, frozen={"id": [1, 2.0]})
    for ids in (np.array([1, 2]), np.array([1.0, 2.0]), {1, 2}):
        assert gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, frozen={"id": ids}) == still
    with pytest.raises(InputError, match="no value"):
        gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, frozen={"id": np.zeros(0)})
    assert still.labels[~still.moving].tolist() == [1, 2]
    for options, said in (
        ({"walls": 3}, "walls: found 3"),
        ({"walls": ["lid", "lid"]}, "'lid' twice"),
        ({"step": 10**400}, "step: found"),
    ):
        with pytest.raises(InputError, match=said):
            gp.ContactNetwork.from_lammps(tmp_path / "atoms", pairs, GLASS, **options)
    balls = {"x": [0.0, 1.9], "radius": [1.0, 1.0], "mass": [1.0, 1.0], "colour": [1, 2]}
    contacts = {"i": [0], "j": [1], "normal_stiffness": [1.0], "normal_force": [0.1]}
    found = gp.ContactNetwork.from_table(balls, contacts, friction=False, keep_rattlers=True)
    assert "colour" in found.notes[0]


def test_overlaps_and_force_vectors_take_the_place_of_few_digits(tmp_path):
    """Places of six digits say nothing of overlaps; the columns of these and of forces do."""
    network = written.glass_packing()
    balls = dict(zip("xyz", np.round(network.positions, 7).T, strict=True))
    balls |= {"radius": network.radii, "mass": network.masses}
    ends = {"i": network.i, "j": network.j}
    vectors = dict(
        zip(("force_x", "force_y", "force_z"), -written.force_on_i(network).T, strict=True)
    )
    options = {"material": GLASS, "cell": np.diag(network.cell)}
    by_vectors = gp.ContactNetwork.from_table(balls, ends | vectors, **options)
    np.testing.assert_allclose(by_vectors.normal_force, network.normal_force, rtol=2e-3)
    size = np.linalg.norm(network.tangential_force, axis=1)
    off = np.linalg.norm(by_vectors.tangential_force - network.tangential_force, axis=1)
    assert np.max(off / network.normal_force) < 2e-3 < np.median(size / network.normal_force)
    deltas = {"overlap": written.overlaps(network)}
    by_overlaps = gp.ContactNetwork.from_table(balls, ends | deltas, **options)
    strong = network.normal_force > 1e-2 * network.normal_force.mean()
    np.testing.assert_allclose(
        by_overlaps.normal_force[strong], network.normal_force[strong], rtol=1e-3
    )
    turned = {name: -values for name, values in vectors.items()}
    with pytest.raises(InputError, match="Turn the signs"):
        gp.ContactNetwork.from_table(balls, ends | turned, **options)
    exact = balls | dict(zip("xyz", network.positions.T, strict=True))
    with pytest.warns(InconsistencyWarning, match="overlaps are 2 times"):
        gp.ContactNetwork.from_table(
            exact, ends | vectors | {"overlap": 2.0 * deltas["overlap"]}, **options
        )
    one_off = deltas["overlap"].copy()
    one_off[3] = 0.0
    with pytest.warns(InconsistencyWarning, match=f"balls {network.i[3]} and {network.j[3]}, 0 m"):
        gp.ContactNetwork.from_table(exact, ends | vectors | {"overlap": one_off}, **options)
    in_mm = {"overlap": 1e3 * deltas["overlap"]}
    with pytest.raises(InputError, match=r"an overlap .* places"):
        gp.ContactNetwork.from_table(exact, ends | vectors | in_mm, **options)


def test_torques_of_pairs_stay_where_walls_are_read_too(tmp_path):
    """The columns of walls have none."""
    texts = {
        "atoms": "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS ff ff ff\n"
        "0 1\n0 1\n0 1\nITEM: ATOMS id x y z radius mass "
        + " ".join(f"f_lid[{number}]" for number in range(1, 9))
        + "\n1 0.5 0.5 0.000999 0.001 1e-5 1 0 0 2 0.5 0.5 0 0.001"
        "\n2 0.5 0.5 0.002997 0.001 1e-5 0 0 0 0 0 0 0 0\n",
        "pairs": "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ENTRIES\n1\nITEM: BOX BOUNDS ff ff ff\n"
        "0 1\n0 1\n0 1\nITEM: ENTRIES i j force rx ry rz twist\n2 1 2 4 0 0 0.5\n",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    options = {"normal_stiffness": 1e6, "shear_stiffness": 1e6, "keep_rattlers": True}
    options |= {"rolling_stiffness": 1e5, "twisting_stiffness": 0.1}
    network = gp.ContactNetwork.from_lammps(
        tmp_path / "atoms", tmp_path / "pairs", walls="lid", **options
    )
    assert network.n_contacts == 2
    # on ball 2, above: the reduced radius 0.5 mm times n x f, with n from ball 1 to ball 2; the
    # twist is counted along n
    on_upper = np.array([0.0, 2e-3, 0.5])
    upper_is_j = network.labels[network.j[0]] == 2
    expected = on_upper if upper_is_j else -on_upper
    np.testing.assert_allclose(network.contact_torque, [expected, np.zeros(3)], atol=1e-15)


# -- dumps that granphon writes -----------------------------------------------------------------


@pytest.mark.parametrize("name", ["disks", "balls"])
def test_dumps_that_are_written_are_read_back(name, tmp_path):
    """With tangential forces, ids and kinds; of a box that is tilted by a whole period too."""
    network = gp.ContactNetwork.from_lammps(*dumps(name), GLASS)
    rng = np.random.default_rng(1)
    across = np.cross(network.normal, rng.normal(size=(network.n_contacts, 3)))
    kinds = tuple("AB"[ball % 2] for ball in range(network.n_balls))
    network = replace(network, tangential_force=across * (1.0 if name == "balls" else 0.0),
                      kinds=kinds)  # fmt: skip
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    cell = network.cell.copy()
    cell[1] += cell[0]
    shift = network.shift.copy()
    shift[:, 0] -= shift[:, 1]
    tilted = replace(network, cell=cell, shift=shift)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)  # these forces are not in balance
        for made in (network, tilted):
            made.write_dumps(*files)
            found = gp.ContactNetwork.from_lammps(*files, GLASS)
            np.testing.assert_array_equal(found.labels, network.labels)
            np.testing.assert_allclose(found.vector, network.vector, atol=1e-15)
            for field in ("radii", "masses", "normal_force", "tangential_force", "normal"):
                np.testing.assert_allclose(
                    getattr(found, field), getattr(network, field), rtol=1e-9, atol=1e-12
                )
            assert found.kinds == tuple("12"[kind == "B"] for kind in kinds)
            np.testing.assert_allclose(found.cell[:2, :2], made.cell[:2, :2])
    swapped = replace(network, cell=network.cell[[1, 0, 2]], shift=network.shift[:, [1, 0, 2]])
    with pytest.raises(InputError, match="along x"):
        swapped.write_dumps(*files)
    # the only period is the second vector, and lies along x
    repeats_along_x = ~np.any(network.shift[:, 1:], axis=1)
    fields = {name: getattr(network, name)[repeats_along_x] for name in network.contact_fields}
    fields["shift"] = fields["shift"][:, [1, 0, 2]]
    chain = replace(network, cell=network.cell[[1, 0, 2]], pbc=(False, True, False), **fields)
    with pytest.raises(InputError, match="along x"):
        chain.write_dumps(*files)


@pytest.mark.parametrize("which", [0, 1])
def test_dumps_of_lammps_are_not_replaced(which, tmp_path):
    """Those of granphon are, and LAMMPS' own has the same first lines; then neither is written."""
    network = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS)
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    network.write_dumps(*files)
    smaller = network.select(np.arange(12))
    smaller.write_dumps(*files)
    texts = [path.read_text() for path in files]
    assert texts[0].splitlines()[5] == "12"
    texts[which] = texts[which].replace(" granphon", "")  # as LAMMPS writes it
    files[which].write_text(texts[which])
    with pytest.raises(OutputError, match=files[which].name):
        network.write_dumps(*files)
    assert [path.read_text() for path in files] == texts
    assert len(list(tmp_path.iterdir())) == 2


def test_a_box_that_periods_tilt_holds_all_balls(tmp_path):
    """Along x, which is open, the sides of the box follow y, which is tilted; of extended XYZ the
    box is across the periods.
    """
    network = gp.ContactNetwork.from_lammps(*dumps("disks"), GLASS)
    kept = ~np.any(network.shift, axis=1)
    fields = {name: getattr(network, name)[kept] for name in network.contact_fields}
    cell = network.cell.copy()
    cell[1, 0] += 1.7 * cell[0, 0]
    ribbon = replace(network, cell=cell, pbc=(False, True, False), **fields)
    ribbon.write_dumps(tmp_path / "atoms.dump", tmp_path / "pairs.dump")
    lines = (tmp_path / "atoms.dump").read_text().splitlines()
    start = next(n for n, line in enumerate(lines) if "BOX" in line) + 1
    (low, high, tilt), (bottom, top, _), _ = (
        map(float, line.split()) for line in lines[start : start + 3]
    )
    length = high - low - tilt  # the bounds are those of the orthogonal box around it
    fraction = (ribbon.positions[:, 1] - bottom) / (top - bottom)
    coordinate = ribbon.positions[:, 0] - low - tilt * fraction
    assert np.min(coordinate - ribbon.radii) > 0.0
    assert np.max(coordinate + ribbon.radii) < length


@pytest.mark.filterwarnings("ignore:.* the static forces")  # the upper balls of the floor
def test_places_of_dumps_are_those_that_were_written(tmp_path):
    """To the last digit, also where the box does not begin at the origin."""
    network = written.layer_on_floor()
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    network.write_dumps(*files)
    found = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, keep_rattlers=True)
    is_ball = np.isfinite(network.radii)
    np.testing.assert_array_equal(found.positions[is_ball], network.positions[is_ball])
    # the reader gives the label -1 to the wall
    taken = replace(network, labels=-1 - np.arange(network.n_balls))
    with pytest.raises(InputError, match="label -1"):
        taken.write_dumps(*files)


def make_pair_on_wall(length, length_of_pairs, size=1e-6):
    """Dumps of two balls that touch each other and the wall of a fix with seven columns, in boxes
    of these lengths.
    """
    head = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF {}\n{}\nITEM: BOX BOUNDS pp ff ff\n"
    box = "0 {0!r}\n{1!r} {0!r}\n{1!r} {0!r}\n"
    columns = " ".join(f"f_floor[{number}]" for number in range(1, 8))
    atoms = head.format("ATOMS", 2) + box.format(length, -size)
    atoms += f"ITEM: ATOMS id x y z radius {columns}\n"
    atoms += f"1 0 0 0 {size!r} 1 0 1 0 0 {-0.999 * size!r} 0\n"
    atoms += f"2 {1.999 * size!r} 0 0 {size!r} 1 0 1 0 {1.999 * size!r} {-0.999 * size!r} 0\n"
    pairs = head.format("ENTRIES", 1) + box.format(length_of_pairs, -size)
    return atoms, pairs + "ITEM: ENTRIES i j force\n1 2 1\n"


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
def test_small_boxes_and_walls_of_seven_columns(tmp_path):
    """Boxes differ by parts of their length, however small; what is read has no note."""
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"

    def read(lengths, **options):
        for path, text in zip(files, make_pair_on_wall(*lengths), strict=True):
            path.write_text(text)
        return gp.ContactNetwork.from_lammps(*files, GLASS, **options)

    found = read((9e-6, 9e-6 * (1.0 + 1e-6)), walls="floor")
    assert (found.n_contacts, found.notes) == (3, ())
    (note,) = read((9e-6, 9e-6), keep_rattlers=True).notes
    assert "walls='floor'" in note
    with pytest.raises(InputError, match="different boxes"):
        read((9e-6, 9.005e-6), walls="floor")
    files[0].write_text(files[0].read_text().replace("0 9e-06", "-1.5e308 1.5e308"))
    with pytest.raises(InputError, match=r"atoms\.dump:6: the bounds"):
        gp.ContactNetwork.from_lammps(*files, GLASS)


@pytest.mark.parametrize("prestress", [False, True])
@pytest.mark.parametrize("law", ["mindlin", "yade", "liggghts"])
def test_dumps_keep_walls_and_the_tangential_law(law, prestress, tmp_path):
    """A layer on a floor has the modes it had, with static forces, too."""
    network = replace(
        written.layer_on_floor(),
        prestress=prestress,
        tangential_law=law,
        slip_levers="yade" if law == "yade" else "arms",
    )
    across = np.cross(network.normal, [0.0, 0.0, 1.0])
    network = replace(network, tangential_force=0.1 * network.normal_force[:, None] * across)
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    network.write_dumps(*files)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)  # the top is free: not in balance
        found = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, keep_rattlers=True)
    assert found.prestress == prestress
    assert found.n_balls == network.n_balls
    assert found.n_contacts == network.n_contacts
    assert found.tangential_law == law
    assert found.slip_levers == network.slip_levers
    expected = written.eigenvalues(network)
    np.testing.assert_allclose(written.eigenvalues(found), expected, atol=1e-7 * expected[-1])


def test_dumps_tell_what_they_leave_out(tmp_path):
    """The stiffnesses of a floor of another material: the greatest difference is told."""
    network = written.layer_on_floor()
    at_wall = np.isinf(network.radii[network.j])
    stiffness = np.where(at_wall, 1.2, 1.0) * network.normal_stiffness
    stiff = replace(network, normal_stiffness=stiffness)
    with pytest.warns(InconsistencyWarning, match="20 %.*write_tables"):
        stiff.write_dumps(tmp_path / "atoms.dump", tmp_path / "pairs.dump")


def test_dumps_of_contacts_that_adhere_warn_and_tables_keep_them(tmp_path):
    lattice = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 1e-2)).at_force(1.0)
    network = lattice.network.repeat((4, 4))
    force = network.normal_force.copy()
    force[3] = -0.2
    adhesive = replace(network, normal_force=force, adhesive=True)
    files = (tmp_path / "atoms.dump", tmp_path / "pairs.dump")
    with pytest.warns(InconsistencyWarning, match=r"adhere.*1 of 48.*write_tables"):
        adhesive.write_dumps(*files)
    with pytest.raises(InputError, match="force that pulls"):
        gp.ContactNetwork.from_lammps(*files, packings.MATERIAL)
    tables = (tmp_path / "balls.csv", tmp_path / "contacts.csv")
    adhesive.write_tables(*tables)
    kept = gp.ContactNetwork.from_table(*tables)
    assert kept.adhesive
    np.testing.assert_allclose(np.sort(kept.normal_force), np.sort(force), rtol=1e-12)


def test_a_wall_that_touches_a_ball_twice_is_two_walls(tmp_path):
    """The corner of a box: contacts of a fix have one row for each ball."""
    network = written.layer_on_floor()
    row = np.flatnonzero(np.isinf(network.radii[network.j]))[:1]
    again = {
        name: np.append(getattr(network, name), getattr(network, name)[row], axis=0)
        for name in network.contact_fields
    }
    again["normal"][-1] = [-1.0, 0.0, 0.0]
    corner = replace(network, **again)
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    corner.write_dumps(*files)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)
        found = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, keep_rattlers=True)
    assert found.n_contacts == corner.n_contacts
    expected = written.eigenvalues(corner)
    np.testing.assert_allclose(written.eigenvalues(found), expected, atol=1e-7 * expected[-1])


# -- balls that do not move, and scripts of pages --------------------------------------------------


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")
def test_spheres_that_do_not_move_need_no_normals():
    """Two spheres that are held, and one on them: normals, overlaps and arms are those of balls."""
    radius = 5e-4
    balls = {"x": [0.0, 9e-4, 4.5e-4], "y": [0.0, 0.0, 8.8e-4], "z": [0.0, 0.0, 1e-4]}
    balls |= {"radius": [radius] * 3, "mass": [np.inf, np.inf, 1.3e-6]}
    springs = {"normal_stiffness": [39.0] * 2, "shear_stiffness": [11.0] * 2}
    contacts = {"i": [0, 1], "j": [2, 2], "normal_force": [1e-4] * 2} | springs
    found = gp.ContactNetwork.from_table(balls, contacts, keep_rattlers=True)
    distance = np.linalg.norm([4.5e-4, 8.8e-4, 1e-4])
    np.testing.assert_allclose(found.normal[0], np.array([4.5e-4, 8.8e-4, 1e-4]) / distance)
    np.testing.assert_allclose(found.arm_i, 0.5 * distance)
    free = gp.ContactNetwork.from_table(
        balls | {"mass": [1.3e-6] * 3}, contacts, keep_rattlers=True
    )
    np.testing.assert_array_equal(found.normal, free.normal)
    np.testing.assert_array_equal(found.arm_i, free.arm_i)
    flat = balls | {"radius": [np.inf, radius, radius]}
    with pytest.raises(InputError, match=r"flat wall.* normal: balls 0 and 2"):
        gp.ContactNetwork.from_table(flat, contacts, keep_rattlers=True)


@pytest.mark.slow
def test_the_script_of_the_page_makes_its_packing(tmp_path, monkeypatch):
    """LAMMPS runs it, and the files are read as those that are kept."""
    lmp = packings.start_or_skip()
    page = (packings.FOLDER.parent.parent / "docs" / "how-to" / "lammps.md").read_text()
    script = re.search(r"```\{code-block\} text\n(.*?)```", page, re.DOTALL)[1]
    (tmp_path / "press.lmp").write_text(script)
    monkeypatch.chdir(tmp_path)
    lmp.file("press.lmp")
    lmp.close()
    options = {"material": GLASS, "rolling_stiffness": 1e5, "prestress": True}
    made, kept = (
        gp.ContactNetwork.from_lammps(
            folder / f"{name}atoms.dump", folder / f"{name}pairs.dump", **options
        )
        for folder, name in ((tmp_path, ""), (packings.FOLDER, "pressed_"))
    )
    for network in (made, kept):
        assert network.imbalance[2] < 1e-6
    # how rounding grows on the way is that of the machine
    assert abs(made.n_contacts - kept.n_contacts) < 10
    np.testing.assert_allclose(made.normal_force.mean(), kept.normal_force.mean(), rtol=0.1)


# -- files that are damaged ------------------------------------------------------------------------


def lammps_files(folder):
    return [path.read_bytes() for path in dumps("disks")], gp.ContactNetwork.from_lammps


def yaml_files(folder):
    text, pairs = (path.read_text() for path in dumps("disks"))
    lines = text.splitlines()
    first = next(n for n, line in enumerate(lines) if "ITEM: ATOMS" in line)
    box = next(n for n, line in enumerate(lines) if "BOX BOUNDS" in line)
    names = lines[first].split()[2:]
    head = ["---", "creator: LAMMPS", "timestep: 0", f"natoms: {len(lines) - first - 1}"]
    step = lines[lines.index("ITEM: TIMESTEP") + 1]
    head[2] = f"timestep: {step}"
    head += [
        "boundary: [ p, p, p, p, f, f, ]"
        if "ff" in lines[box]
        else "boundary: [ p, p, p, p, p, p, ]"
    ]
    head += ["box:", *(f"  - [ {', '.join(line.split())} ]" for line in lines[box + 1 : box + 4])]
    head += [f"keywords: [ {', '.join(names)},  ]", "data:"]
    rows = [f"  - [ {' , '.join(line.split())}, ]" for line in lines[first + 1 :]]
    return [
        "\n".join([*head, *rows, "...", ""]).encode(),
        pairs.encode(),
    ], gp.ContactNetwork.from_lammps


def packed_files(folder):
    raw, read = lammps_files(folder)
    return [gzip.compress(raw[0], mtime=0), raw[1]], read


def liggghts_files(folder):
    paths = written.write_liggghts(written.glass_packing(), folder)
    return [path.read_bytes() for path in paths[:2]], read_forces


def read_forces(atoms, pairs, material):
    return gp.ContactNetwork.from_liggghts(atoms, pairs, material, keywords="id force delta")


def mercury_files(folder):
    paths = written.write_mercury(written.glass_packing(), folder)
    return [path.read_bytes() for path in paths[:2]], read_in_the_box


def restart_files(folder):
    paths = written.write_mercury(written.glass_packing(), folder)
    return [paths[0].read_bytes(), paths[2].read_bytes()], gp.ContactNetwork.from_mercury


def read_in_the_box(fstat, data, material):
    return gp.ContactNetwork.from_mercury(fstat, data, material, pbc=(True, True, True))


def wall_files(folder):
    """Contacts of balls, and of balls with walls; that of the balls plays no part here."""
    paths = written.write_liggghts(written.layer_on_floor(), folder, "pos id force")

    def read(pairs, walls, material):
        options = {"walls": walls, "keywords": "pos id force", "held_by": 1}
        return gp.ContactNetwork.from_liggghts(paths[0], pairs, material, **options)

    return [path.read_bytes() for path in paths[1:3]], read


def yade_files(_folder):
    paths = [packings.FOLDER / f"yade_{name}.csv" for name in ("balls", "contacts")]
    return [path.read_bytes() for path in paths], read_in_a_cube


def read_in_a_cube(balls, contacts, material):
    cell = [5.5e-3] * 3
    return gp.ContactNetwork.from_table(balls, contacts, material=material, cell=cell)


SOURCES = {
    "lammps": lammps_files,
    "yaml": yaml_files,
    "gzip": packed_files,
    "liggghts": liggghts_files,
    "mercury": mercury_files,
    "restart": restart_files,
    "walls": wall_files,
    "yade": yade_files,
}
#: what stands in place of a number: ids that are missing, negative and huge, no numbers, other units
WORDS = [
    b"-3",
    b"0",
    b"99999999",
    b"9" * 25,
    b"nan",
    b"inf",
    b"",
    b"1e300",
    b"x",
    b"1_0",
    b"-1e-3",
    b"1.5",
]


def flip(raw):
    """The bytes packed by gzip, one of them another one."""
    packed = bytearray(gzip.compress(raw, mtime=0))
    packed[len(packed) // 2] ^= 0xFF
    return bytes(packed)


#: damages of a whole file
DAMAGES = {
    "empty": lambda _raw: b"",
    "an empty line": lambda _raw: b"\n",
    "zeros": lambda raw: bytes(len(raw)),
    "random bytes": lambda raw: np.random.default_rng(0).bytes(len(raw)),
    "in UTF-16": lambda raw: raw.decode("latin-1").encode("utf-16"),
    "accents": lambda raw: raw.replace(b"e", b"\xe9", 3),
    "lines of Windows": lambda raw: raw.replace(b"\n", b"\r\n"),
    "lines of old": lambda raw: raw.replace(b"\n", b"\r"),
    "a mark in front": lambda raw: b"\xef\xbb\xbf" + raw,
    "blanks at ends": lambda raw: raw.replace(b"\n", b" \n"),
    "empty lines": lambda raw: raw.replace(b"\n", b"\n\n"),
    "twice": lambda raw: raw + raw,
    "backwards": lambda raw: b"".join(reversed(raw.splitlines(keepends=True))),
    "packed": lambda raw: gzip.compress(raw, mtime=0),
    "packed and cut": lambda raw: gzip.compress(raw, mtime=0)[: len(raw) // 8],
    "packed, a bit flipped": flip,
    "more columns": lambda raw: raw.replace(b"\n", b" 1 2 3\n"),
    "commas in numbers": lambda raw: re.sub(rb"(\d)\.(\d)", rb"\1,\2", raw),
    "no numbers": lambda raw: re.sub(rb"\d+\.\d+(e-?\d+)?", b"nan", raw),
    "counts below zero": lambda raw: re.sub(rb"\n(\d+)\n", rb"\n-\1\n", raw),
    "a long line": lambda raw: raw[: len(raw) // 2] + b"x" * 100_000 + raw[len(raw) // 2 :],
}


class Files:
    """Two files of a program in a folder, their bytes, and their network."""

    def __init__(self, name, folder):
        self.folder = folder
        self.name = name
        self.raws, self.reader = SOURCES[name](folder)
        self.network = self.read()

    def read(self, which=0, raw=None):
        """The network, with other bytes for one of the two files."""
        for number, content in enumerate(self.raws):
            has_other = raw is not None and number == which
            (self.folder / "ab"[number]).write_bytes(raw if has_other else content)
        return self.reader(self.folder / "a", self.folder / "b", GLASS)

    def find_error(self, which, raw):
        """What is said of a file that is damaged; "" if it is read."""
        try:
            self.read(which, raw)
        except gp.GranphonError as error:
            return str(error)
        return ""


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=() if name in ("lammps", "mercury") else pytest.mark.slow)
        for name in SOURCES
    ],
)
def files(request, tmp_path_factory):
    return Files(request.param, tmp_path_factory.mktemp(request.param))


@given(which=st.integers(0, 1), place=st.floats(0.0, 1.0))
def test_a_file_that_is_cut_is_never_read_as_if_it_were_whole(files, which, place):
    """It is an error or a warning, or nothing is lost."""
    raw = files.raws[which]
    try:
        found = files.read(which, raw[: min(int(place * len(raw)), len(raw) - 1)])
    except (gp.GranphonError, UserWarning) as told:
        text = str(told)
    else:
        text = ""
        assert found == files.network
    assert "\n" not in text


@given(which=st.integers(0, 1), place=st.floats(0.0, 1.0), word=st.sampled_from(WORDS))
def test_a_number_that_is_none_is_told_or_plays_no_part(files, which, place, word):
    """One error, which is short; or a network, as where the number is that of an image or a
    flag.
    """
    raw = files.raws[which]
    words = [match.span() for match in re.finditer(rb"[^\s,\[\]]+", raw)]
    start, end = words[min(int(place * len(words)), len(words) - 1)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        text = files.find_error(which, raw[:start] + word + raw[end:])
    assert "\n" not in text
    assert len(text) < 2500
    assert not text or text.isprintable()


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_told_in_one_line_or_read_as_it_is(files, which, damage):
    """Of what is not told by an error, a warning or a note, nothing is lost."""
    raw = DAMAGES[damage](files.raws[which])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            found = files.read(which, raw)
        except gp.GranphonError as error:
            text = str(error)
            assert "\n" not in text
            assert text.isprintable()
            assert len(text) < 2500
            return
    # a heading that is another one is a column that is not read
    assert told or found == files.network or found.notes != files.network.notes


@pytest.mark.parametrize("which", [0, 1])
def test_every_line_that_lacks_or_is_there_twice_is_told(files, which):
    """Whatever is lost of a file with a count of its rows; of tables, which have none, a contact
    that is listed twice.
    """
    lines = files.raws[which].splitlines(keepends=True)
    has_count = files.name != "yade"
    for at in range(0, len(lines), max(len(lines) // 8, 1)):
        changed = [lines[: at + 1] + lines[at:]]
        if has_count:
            changed += [lines[:at] + lines[at + 1 :], [*lines[:at], b"\n", *lines[at + 1 :]]]
        for some in changed:
            with warnings.catch_warnings(record=True) as told, suppress(gp.GranphonError):
                warnings.simplefilter("always")
                found = files.read(which, b"".join(some))
                assert told or found == files.network


@pytest.mark.parametrize("which", [0, 1])
def test_memory_is_bounded_by_the_size_of_a_file(files, which):
    """A count of rows that the file does not have takes no memory."""
    raw = files.raws[which]
    pattern = rb"(?:NUMBER OF \w+\n|natoms: |Particles )(\d+)|\A(\d+) "
    for match in re.finditer(pattern, raw):
        start, end = match.span(match.lastindex)
        tracemalloc.start()
        try:
            assert files.find_error(which, raw[:start] + b"99999999999" + raw[end:])
            assert tracemalloc.get_traced_memory()[1] < 4_000_000 + 60 * len(raw)
        finally:
            tracemalloc.stop()
