"""The numbers of a network against each other: each fault is told by its own check, with the balls
that have it and what it does to frequencies, which is measured here.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.balls.contact_model import ContactModel
from granphon.base.errors import InconsistencyWarning
from granphon.networks.consistency import compare_numbers
from tests import packings

CELL = [5.5e-3] * 3
#: of the contacts in the kept packings, the limit that they exceed
RADIUS = "contact_radius"


def read(name):
    """A kept packing of LAMMPS, or of YADE."""
    if name == "yade":
        files = (packings.FOLDER / f"yade_{part}.csv" for part in ("balls", "contacts"))
        return gp.ContactNetwork.from_table(*files, cell=CELL)
    files = (packings.FOLDER / f"{name}_{part}.dump" for part in ("atoms", "pairs"))
    return gp.ContactNetwork.from_lammps(*files, packings.MATERIAL)


def failing(network):
    """The checks that a network fails, by name, but for the size of contacts."""
    checks = gp.validity(network).checks
    return {check.name: check for check in checks if not check.ok and check.name != RADIUS}


def find_effect(check):
    """The part by which frequencies are off, in the words of a check."""
    return float(re.search(r"by about ([\d.]+)%|by ([\d.]+)%", check.reason)[2]) / 100.0


@pytest.mark.parametrize("name", ["disks", "balls", "glass", "yade"])
def test_packings_of_programs_fail_nothing(name):
    network = read(name)
    assert not failing(network)
    expected = {"law", "scatter", "rounding", "inertias", "rattlers", "pieces", "contacts"}
    checks = {check.name for check in gp.validity(network).checks}
    assert expected <= checks
    assert ("masses" in checks) == ("stiffness" in checks) == (name != "yade")


@pytest.mark.claim("network-validity")
@pytest.mark.parametrize(
    ("fields", "name", "power"),
    [
        (("masses", "inertias"), "masses", -0.5),
        (("inertias",), "inertias", -0.5),
        (("normal_stiffness", "shear_stiffness"), "stiffness", 0.5),
    ],
)
@pytest.mark.parametrize("ratio", [0.8, 1.2])
def test_a_ratio_that_is_off_changes_frequencies_as_its_check_says(fields, name, power, ratio):
    """Masses, with the inertias, or stiffnesses, scale all frequencies; inertias alone bound them."""
    network = read("disks")
    off = replace(network, **{field: ratio * getattr(network, field) for field in fields})
    checks = failing(off)
    # forces that are those of overlaps no longer fit to the stiffnesses: f p/k is not the overlap
    assert set(checks) == {name} | ({"law"} if name == "stiffness" else set())
    check = checks[name]
    assert check.value == pytest.approx(abs(ratio - 1.0), rel=1e-6)
    effect = abs(ratio**power - 1.0)
    assert find_effect(check) == pytest.approx(effect, abs=6e-4)
    change = gp.Waves(off).modes(6).frequencies / gp.Waves(network).modes(6).frequencies - 1.0
    if name == "inertias":
        assert 0.0 < np.max(np.abs(change)) <= effect
    else:
        np.testing.assert_allclose(np.abs(change), effect, rtol=1e-7)


@pytest.mark.claim("network-validity")
@pytest.mark.parametrize("ratio", [0.5, 2.0, 1000.0])
def test_forces_in_another_unit_change_frequencies_by_the_sixth_root(ratio):
    network = read("balls")
    off = replace(
        network,
        normal_force=network.normal_force / ratio,
        normal_stiffness=network.normal_stiffness / np.cbrt(ratio),
        shear_stiffness=network.shear_stiffness / np.cbrt(ratio),
    )
    (check,) = failing(off).values()
    assert check.name == "law"
    assert check.value == pytest.approx(abs(1.0 / ratio - 1.0), rel=1e-6)
    change = gp.Waves(network).modes(2).frequencies / gp.Waves(off).modes(2).frequencies - 1.0
    assert find_effect(check) == pytest.approx(np.mean(np.abs(change)), abs=6e-4)


def test_forces_in_another_order_scatter():
    network = read("glass")
    off = replace(network, normal_force=np.roll(network.normal_force, 1), contact_model=None)
    check = failing(off)["scatter"]
    assert check.value > 0.1
    labels = network.labels.tolist()
    for first, second in check.worst:
        pair = labels.index(first), labels.index(second)
        assert pair in set(zip(network.i.tolist(), network.j.tolist(), strict=True))


def test_rounded_places_leave_forces_open_that_follow_from_them():
    """Forces of their own do not depend on the digits of places."""
    network = read("glass")
    decimals = 6  # m, of radii of 1 mm and overlaps of some 10 um
    rounded = np.round(network.positions, decimals)
    vector = rounded[network.j] + network.shift @ network.cell - rounded[network.i]
    touch = network.radii[network.i] + network.radii[network.j]
    overlap = touch - np.linalg.norm(vector, axis=1)
    force = network.normal_force * (overlap / np.median(overlap)) ** 1.5 / network.normal_force
    off = replace(
        network,
        positions=rounded,
        normal=vector / np.linalg.norm(vector, axis=1)[:, None],
        normal_force=force,
        normal_stiffness=1.5 * force / overlap,
        contact_model=None,
    )
    assert failing(off)["rounding"].value == pytest.approx(
        1.5 * np.sqrt(1.0 / 6.0) * 1e-6 / np.median(overlap), rel=0.5
    )
    own = replace(network, positions=rounded, contact_model=None)
    assert not failing(own)


@pytest.fixture(scope="module")
def lattice():
    """Balls of an ideal lattice, at rest under their static forces."""
    packing = gp.Packing(packings.MATERIAL, 2e-3)
    state = gp.AveragedLattice(packing).at_force(1.0, finite_overlap=True)
    return state.network.repeat((4, 4))


@pytest.mark.parametrize("prestress", [True, False])
def test_a_packing_that_still_moves_is_told(lattice, prestress):
    factors = np.ones(lattice.n_contacts)
    factors[7] = 1.02
    off = replace(lattice, normal_force=factors * lattice.normal_force, prestress=prestress)
    check = failing(off)["balance"]
    assert check.value == pytest.approx(0.02, rel=1e-2)
    assert check.typical == pytest.approx(0.02 * np.sqrt(2.0 / 16.0), rel=1e-2)
    assert {ball for (ball,) in check.worst} == {int(off.i[7]), int(off.j[7])}
    still = replace(off, normal_force=lattice.normal_force)
    assert not failing(still)


def test_weights_are_no_imbalance(lattice):
    held = np.arange(lattice.n_balls) == 0
    still = replace(
        lattice,
        masses=np.where(held, np.inf, lattice.masses),
        inertias=np.where(held, np.inf, lattice.inertias),
    )
    resting = packings.balance(still, [0.0, -0.05 * np.mean(still.normal_force), 0.0])
    assert resting.imbalance[2] > 0.04
    assert not failing(resting)
    assert not gp.Waves(resting).warnings


def test_tangential_forces_of_the_other_sign_turn_balls(lattice):
    """Each force is across its contact, and turns both balls the same way."""
    across = np.cross(lattice.normal, [0.0, 0.0, 1.0])
    off = replace(lattice, tangential_force=0.1 * lattice.mean_force * across)
    check = failing(off)["torques"]
    # six contacts turn each ball
    arm = lattice.arm_i[0] / lattice.radii[0]
    assert check.value == pytest.approx(0.6 * arm / np.hypot(1.0, 0.1), rel=1e-6)


@pytest.mark.claim("network-validity")
@pytest.mark.parametrize("friction", [True, False])
def test_too_few_contacts_leave_modes_without_energy(friction):
    """At least as many as motions are more than the deformations that are resisted."""
    units = gp.Units(1.0, 1.0, 1.0)
    if friction:
        network = gp.ContactLattice.of("triangular", 0.8).contact_network(units).repeat((4, 4))
        is_kept = np.random.default_rng(4).random(network.n_contacts) < 0.42
    else:
        network = gp.ContactLattice.of("square", 0.0).contact_network(units).repeat((4, 4))
        is_kept = ~np.isin(network.i, [0, 2, 8, 10]) | (np.abs(network.normal[:, 0]) < 0.5)
    fields = {name: getattr(network, name)[is_kept] for name in network.contact_fields}
    loose = replace(network, **fields).without_rattlers()
    check = gp.validity(loose)["contacts"]
    n_rows = (2 if friction else 1) * loose.n_contacts
    n_motions = (3 if friction else 2) * loose.n_balls
    assert check.value == pytest.approx(2.0 * loose.n_contacts / loose.n_balls)
    assert check.ok == (n_rows >= n_motions - 2)
    matrix = gp.Waves(loose).operator.matrix.toarray()
    squares = np.linalg.eigvalsh(matrix)
    n_zeros = np.count_nonzero(squares < 1e-10 * squares[-1])
    assert not check.ok
    assert n_zeros >= int(check.reason.split()[0]) + 2 == n_motions - n_rows
    assert check.limit == pytest.approx((n_motions - 2) / n_rows * check.value)


def test_a_network_without_contacts_has_a_check_of_them(lattice):
    """Each ball, which moves along two axes, would need four."""
    no_contact = np.zeros(lattice.n_contacts, bool)
    fields = {name: getattr(lattice, name)[no_contact] for name in lattice.contact_fields}
    report = gp.validity(replace(lattice, **fields))
    assert report.ok is report["contacts"].ok is False
    check = report["contacts"]
    n = lattice.n_balls
    assert (check.value, check.limit) == (0.0, pytest.approx(2.0 * (2 * n - 2) / n))
    assert check.reason.startswith(f"{2 * n - 2} modes")


def test_a_contact_with_a_wall_is_one_of_one_ball():
    """Of a row of two balls on each of two walls: two contacts each, three in all."""
    places = np.outer([0.0, 1.0, 2.0, 3.0], [2e-3, 0.0, 0.0])
    mass = np.array([np.inf, 1.0, 1.0, np.inf])
    balls = {"x": places[:, 0], "y": places[:, 1], "radius": np.full(4, 1e-3), "mass": mass}
    # the walls touch each other, too, which holds no ball
    balls = {name: np.append(values, values[-1]) for name, values in balls.items()}
    balls["y"][-1] = 2e-3
    contacts = {"i": [0, 1, 2, 3], "j": [1, 2, 3, 4], "normal_force": [1.0] * 4}
    contacts |= {"normal_stiffness": [1e6] * 4, "shear_stiffness": [0.0] * 4}
    network = gp.ContactNetwork.from_table(balls, contacts)
    assert network.coordination == 2.0
    check = {each.name: each for each in compare_numbers(network)}["contacts"]
    # four displacements against three contacts, which have four ends at balls that move
    assert (check.value, check.limit) == (2.0, pytest.approx(4.0 / 3.0 * 2.0))
    assert check.reason.startswith("1 mode")
    held = replace(network, on_site=np.full((5, network.named_motions.count), [0.0, 1.0, 0.0]))
    check = {each.name: each for each in compare_numbers(held)}["contacts"]
    assert check.holds
    assert check.limit == pytest.approx(4.0 / 3.0)


def test_bodies_that_do_not_move_have_no_balance(lattice):
    still = replace(lattice, masses=np.full(lattice.n_balls, np.inf))
    assert not np.any(still.residual_forces)
    assert "balance" not in {each.name for each in compare_numbers(still)}


def test_too_few_contacts_are_told_of_no_lattice(tmp_path):
    """Two rows of a square lattice shear freely; without one of their contacts they are none."""
    units = gp.Units(1.0, 1.0, 1.0)
    rows = gp.ContactLattice.of("square", 0.0).contact_network(units).repeat((4, 1)).cut(1, 2)
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    rows.write_tables(*files)
    assert "contacts" in failing(gp.ContactNetwork.from_table(*files))
    is_kept = np.arange(rows.n_contacts) > 0
    fields = {name: getattr(rows, name)[is_kept] for name in rows.contact_fields}
    replace(rows, **fields).write_tables(*files)
    with pytest.warns(InconsistencyWarning, match=r"contacts\.csv: the balls have"):
        gp.ContactNetwork.from_table(*files)


def test_a_force_of_another_contact_is_counted():
    network = read("glass")
    force = network.normal_force.copy()
    strongest = int(np.argmax(force))
    force[strongest] *= 1e3
    check = failing(replace(network, normal_force=force))["single forces"]
    pair = network.name_ball(network.i[strongest]), network.name_ball(network.j[strongest])
    assert (check.value, check.worst) == (1.0, (pair,))


def test_a_force_that_underflows_is_none():
    network = read("disks")
    force = network.normal_force.copy()
    found = []
    for least in (1e-320, 0.0):
        force[0] = least
        comparisons = compare_numbers(replace(network, normal_force=force))
        found.append({each.name: each.value for each in comparisons})
    assert found[0] == found[1]


@pytest.mark.parametrize("factor", [1e-2, 1e2])
@pytest.mark.parametrize("field", ["masses", "inertias", "normal_stiffness"])
def test_a_single_number_that_is_off_is_told_by_its_own_check(field, factor):
    network = read("disks")
    values = getattr(network, field).copy()
    values[4] *= factor
    checks = failing(replace(network, **{field: values}))
    names = {
        "masses": {"single masses", "single inertias"},  # the inertia no longer fits to the mass
        "inertias": {"single inertias"},
        "normal_stiffness": {"single stiffnesses"},
    }[field]
    assert set(checks) == names
    ends = (network.i[4], network.j[4]) if field == "normal_stiffness" else (4,)
    for check in checks.values():
        assert (check.value, check.worst) == (1.0, (tuple(map(network.name_ball, ends)),))


@pytest.mark.parametrize(("share", "is_told"), [(0.66, False), (0.75, True)])
def test_no_sphere_has_more_inertia_than_a_hollow_one(share, is_told):
    network = read("balls")
    inertias = network.inertias.copy()
    inertias[7] = share * network.masses[7] * network.radii[7] ** 2
    names = {"single inertias"} if is_told else set()
    assert set(failing(replace(network, inertias=inertias))) == names


def test_no_factor_of_forces_makes_hertzian_contacts_linear():
    """Stiffnesses of Hertz under forces that are 1.84 times his: f/k is the overlap, as of linear
    springs.
    """
    network = read("balls")
    factor = 1.5**1.5
    off = replace(
        network,
        normal_force=factor * network.normal_force,
        normal_stiffness=np.cbrt(factor) * network.normal_stiffness,
        shear_stiffness=np.cbrt(factor) * network.shear_stiffness,
    )
    assert failing(off)["law"].value == pytest.approx(factor - 1.0, rel=1e-6)
    linear = replace(off, normal_stiffness=np.full(off.n_contacts, 1e6))
    overlap = linear.radii[linear.i] + linear.radii[linear.j] - linear.distance
    assert "law" not in failing(replace(linear, normal_force=1e6 * np.maximum(overlap, 0.0)))


def test_materials_of_balls_that_are_apart_tell_nothing_of_stiffnesses():
    """Half of the balls are of a known material. They are apart from each other by their radii, and
    other contacts have overlaps.
    """
    network = read("disks")
    is_known = np.arange(network.n_balls) % 2 == 1
    overlap = network.radii[network.i] + network.radii[network.j] - network.distance
    ball = network.contact_model.kinds[0]
    half = replace(
        network,
        radii=network.radii - 0.7 * np.median(overlap) * is_known,
        kinds=tuple(np.where(is_known, "steel", "stone").tolist()),
        contact_model=ContactModel((ball, ball), names=("steel", "glass"), own_radii=True),
    )
    comparisons = {each.name: each for each in compare_numbers(half)}
    assert comparisons["stiffness"].holds
    assert comparisons["single stiffnesses"].holds


def test_torques_of_rolling_contacts_are_not_known(lattice):
    across = np.cross(lattice.normal, [0.0, 0.0, 1.0])
    off = replace(lattice, tangential_force=0.1 * lattice.mean_force * across)
    rolling = replace(off, bending_stiffness=np.full(off.n_contacts, 1e-3))
    assert "torques" in failing(off)
    assert "torques" not in failing(rolling)


def test_rattlers_and_pieces_are_counted():
    whole = gp.ContactNetwork.from_lammps(
        packings.FOLDER / "disks_atoms.dump",
        packings.FOLDER / "disks_pairs.dump",
        packings.MATERIAL,
        keep_rattlers=True,
    )
    check = failing(whole)["rattlers"]
    assert (check.value, check.worst) == (1.0, ((27,),))
    lattice = gp.ContactLattice.of("square", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0))
    rows = lattice.repeat((4, 4))
    is_along = np.abs(rows.normal[:, 0]) > 0.5
    fields = {name: getattr(rows, name)[is_along] for name in rows.contact_fields}
    assert failing(replace(rows, **fields))["pieces"].value == 4.0


def test_what_is_read_is_judged():
    """A row between walls, whose forces are not in balance."""
    balls = {"x": [0.0, 1.9, 3.8, 5.7], "radius": [1.0] * 4, "mass": [np.inf, 1.0, 1.0, np.inf]}
    contacts = {"i": [0, 1, 2], "j": [1, 2, 3], "nx": [1.0] * 3, "normal_stiffness": [10.0] * 3}

    def read_row(force):
        table = contacts | {"normal_force": [1.0, force, 1.0]}
        return gp.ContactNetwork.from_table(balls, table, friction=False)

    with (
        pytest.warns(InconsistencyWarning, match="contacts: .*forces on ball 1 .* weight"),
        pytest.warns(InconsistencyWarning, match=r"contacts: the forces are 1\.1 times"),
    ):
        off = read_row(1.1)
    check = gp.validity(off)["balance"]
    assert check.value == pytest.approx(0.1 / (3.1 / 3.0))
    assert check.worst == ((1,), (2,))
    assert not failing(read_row(1.0))
