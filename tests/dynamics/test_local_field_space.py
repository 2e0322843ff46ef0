"""The local field of lattices on a line and in space, by three independent ways, and the media that
rest on it.

The first way is the lattice's Green's function, the second the response of a star in periodic
supercells, solved ball by ball and extrapolated, the third the law at high load of arrays of random
balls.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

import granphon as gp
from granphon.balls.lattices import LATTICES, Lattice, find_lattice
from granphon.base.errors import InputError, MechanismError, PrecisionError
from granphon.dynamics.local_field import local_field
from tests.conftest import only

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
#: Xi of steel (0.84) and without friction, to 1e-9
VALUES = {
    ("fcc", 0.0): 3.148424295, ("hcp", 0.0): 3.179145988, ("fcc", 0.84): 6.548829644, ("hcp", 0.84): 6.506911516,
    ("bcc", 0.84): 4.751496460, ("sc", 0.84): 3.307124611, ("square", 0.84): 1.578749224, ("kagome", 0.84): 0.628004709,
}  # fmt: skip
#: layers of triangles on top of each other; and the stacking ABAC, in which balls are of two kinds
STACKED = Lattice("stacked", [(1, 0, 0), (-0.5, np.sqrt(0.75), 0), (0, 0, 1)])
ABAC = Lattice(
    "ABAC", [(1, 0, 0), (-0.5, np.sqrt(0.75), 0), (0, 0, 4 * np.sqrt(2 / 3))],
    [(0, 0, 0), (1 / 3, 2 / 3, 0.25), (0, 0, 0.5), (2 / 3, 1 / 3, 0.75)],
)  # fmt: skip


def structure(name: str) -> Lattice:
    return {"stacked": STACKED, "ABAC": ABAC}.get(name) or find_lattice(name)


# -- the second way: periodic supercells, ball by ball ---------------------------------------------


class Supercell:
    """Balls of L^p cells on a torus, joined by contacts (i, j, normal); written without the
    package's rows.
    """

    def __init__(self, structure: Lattice, size: int) -> None:
        table = structure.contacts
        n = structure.n_balls
        p = structure.periods
        cells = np.stack(np.meshgrid(*[np.arange(size)] * p, indexing="ij"), axis=-1).reshape(-1, p)

        def number(cell):
            return np.ravel_multi_index(tuple((cell % size).T), (size,) * p)

        self.i = np.concatenate([number(cells) * n + ball for ball in table.i])
        self.j = np.concatenate(
            [number(cells + s) * n + ball for ball, s in zip(table.j, table.shift, strict=True)]
        )
        self.normal = np.zeros((len(self.i), 3))
        self.normal[:, : structure.dimension] = np.repeat(table.normal, len(cells), axis=0)
        self.balls = n * len(cells)
        self.first = n

    def rows(self, tail, head, stiffness=1.0):
        """Sparse rows of a deformation ``head . x_j + tail . x_i``, x = (u, phi): (n_c, r, 6)
        each.
        """
        count = len(self.i)
        each = tail.shape[1]
        columns = np.concatenate(
            [6 * self.i[:, None] + np.arange(6), 6 * self.j[:, None] + np.arange(6)], axis=1
        )
        data = np.sqrt(stiffness) * np.concatenate([tail, head], axis=2)
        where = (np.repeat(np.arange(count * each), 12), np.repeat(columns, each, axis=0).ravel())
        return csr_array((data.ravel(), where), shape=(count * each, 6 * self.balls))

    @property
    def elongations(self):
        """Sparse rows of the elongations."""
        along = np.concatenate([self.normal[:, None], np.zeros_like(self.normal[:, None])], axis=2)
        return self.rows(-along, along)

    def stiffness(self, eta, torsion=0.0, bending=0.0):
        """The sparse stiffness matrix."""
        n = self.normal
        along = n[:, :, None] * n[:, None]
        across = np.eye(3) - along
        none = np.zeros_like(along)
        turn = np.cross(np.eye(3)[None], n[:, None]).swapaxes(1, 2)  # turn @ phi = phi x n
        kinds = [
            self.elongations,
            self.rows(
                np.concatenate([-across, -0.5 * turn], 2),
                np.concatenate([across, -0.5 * turn], 2),
                eta,
            ),
            self.rows(np.concatenate([none, -along], 2), np.concatenate([none, along], 2), torsion),
            self.rows(
                np.concatenate([none, -across], 2), np.concatenate([none, across], 2), bending
            ),
        ]
        return csc_array(sum(one.T @ one for one in kinds))

    def compliance(self, eta, torsion=0.0, bending=0.0):
        """Mean elongation of the contacts of one ball under unit tension in them, over all balls of
        a cell.
        """
        free = np.ones((self.balls, 6), bool)
        free[0, :3] = False
        free[:, 3:] = bool(eta or torsion or bending)
        free = free.ravel()
        matrix = self.stiffness(eta, torsion, bending)[:, free][free]
        # modes that cost nothing, to which the star does not couple, are held by next to nothing
        matrix = csc_array(matrix + 1e-13 * eye_array(matrix.shape[0]))
        solve = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        ).solve
        rows, response = self.elongations, np.zeros(2)
        for ball in range(self.first):
            star = ((self.i == ball) | (self.j == ball)).astype(float)
            motion = np.zeros(6 * self.balls)
            motion[free] = solve((rows.T @ star)[free])
            response += [star @ (rows @ motion), star.sum()]
        return response[0] / response[1]


def extrapolated(sizes, values, orders):
    powers = (np.array(sizes, float)[:, None] / sizes[0]) ** -np.array([0, *orders])
    return np.linalg.solve(powers, np.array(values))[0]


# sizes are odd where an even supercell has modes that cost nothing, and whose error is of another
# kind
CLUSTERS = [
    ("fcc", 0.0, {}, (4, 6, 8, 10), 5e-5),
    ("sc", 0.84, {}, (3, 5, 7, 9), 1e-4),
    ("bcc", 0.84, {}, (3, 5, 7, 9), 1e-5),
    ("hcp", 0.0, {}, (3, 4, 5, 6), 2e-4),
    ("hcp", 0.84, {}, (3, 4, 5, 6), 3e-5),
    ("diamond", 0.84, {"bending": 0.05}, (3, 4, 5, 6, 7), 5e-4),
    ("fcc", 0.5, {"torsion": 0.1, "bending": 0.2}, (3, 4, 5, 6), 1e-4),
    ("fcc", 0.84, {}, (3, 5, 7, 9), 3e-6),
    ("sc", 0.84, {}, (5, 7, 9, 11), 1e-5),
    ("stacked", 0.84, {}, (3, 5, 7, 9), 1e-4),
    ("ABAC", 0.0, {}, (2, 3, 4, 5), 1e-3),
]


@pytest.mark.claim("local-field-space")
@pytest.mark.parametrize(
    ("name", "eta", "more", "sizes", "error"),
    [
        ("sc", 0.84, {}, (3, 5, 7), 1e-4),
        pytest.param("fcc", 0.84, {}, (3, 5, 7), 1e-4, marks=pytest.mark.slow),
        *(pytest.param(*case, marks=pytest.mark.exhaustive) for case in CLUSTERS),
    ],
)
def test_periodic_clusters_in_space_extrapolate(name, eta, more, sizes, error):
    values = [Supercell(structure(name), size).compliance(eta, **more) for size in sizes]
    exact = local_field(structure(name), eta, **more).compliance
    # images of the star are sums of dipoles, and fall as the inverse volume
    orders = -np.diff(np.log(np.abs(np.array(values) - exact))) / np.diff(np.log(sizes))
    assert 2.9 < orders[-1] < 5.0
    assert extrapolated(sizes, values, range(3, 2 * len(sizes) + 1, 2)) == pytest.approx(
        exact, abs=error
    )


@pytest.mark.claim("local-field-space")
@pytest.mark.parametrize(
    ("name", "eta"),
    [
        pytest.param(
            *key,
            marks=[pytest.mark.exhaustive] * (key[0] == "hcp")
            + [pytest.mark.slow] * (key[0] == "bcc"),
        )
        for key in VALUES
    ],
)
def test_reference_values(name, eta):
    assert local_field(name, eta).xi == pytest.approx(VALUES[name, eta], rel=2e-9)


#: the table of the page: lattice, contacts, Xi without friction, with it, and with bending as well
TABLE = re.findall(
    r"^\| (\w+) \| (\d+) \| ([\d.]+|none) \| ([\d.]+|none) \| ([\d.]+) \|$",
    (Path(__file__).parents[2] / "docs" / "explanation" / "ladder.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)


def test_the_table_of_the_page_has_every_lattice():
    assert [(name, float(contacts)) for name, contacts, *_ in TABLE] == [
        (n, one.coordination) for n, one in LATTICES.items()
    ]


@pytest.mark.claim("local-field-space")
@pytest.mark.parametrize(
    "name",
    [
        "chain",
        "triangular",
        "square",
        "honeycomb",
        "kagome",
        "sc",
        pytest.param("fcc", marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("bcc", "hcp", "diamond")),
    ],
)
def test_the_table_of_the_page(name):
    ((*_, smooth, rough, held),) = (row for row in TABLE if row[0] == name)
    friction = {"mindlin_ratio": 0.84}
    for shown, stiffness in (
        (smooth, {}),
        (rough, friction),
        (held, {**friction, "bending": 0.05}),
    ):
        if shown == "none":
            with pytest.raises(MechanismError):
                local_field(name, **stiffness)
        else:
            assert f"{local_field(name, **stiffness).xi:.6f}".startswith(shown)


@pytest.mark.exhaustive
@pytest.mark.claim("local-field-space")
@pytest.mark.parametrize(("name", "eta"), VALUES)
def test_more_points_change_nothing(name, eta):
    from granphon.dynamics.contact_lattice import ContactLattice
    from granphon.dynamics.local_field import _find_operations, _Response
    from granphon.dynamics.zone_means import divide_zone

    medium = ContactLattice.of(name, eta)
    zone = divide_zone(medium.reciprocal, 16, _find_operations(medium))
    finer = 1.0 / float(sum(weights @ _Response(medium)(q) for q, weights in zone)[0]) - 1.0
    assert local_field(name, eta).xi == pytest.approx(finer, rel=1e-9)


# -- the third way: arrays of random balls at high load --------------------------------------------


@cache
def supercell(name, size):
    return Supercell(structure(name), size)


def equilibrium_force(name, size, deviations, y):
    """Mean force f* of an array without friction at the overlap y, by Newton's method; all contacts
    must be closed.
    """
    cell = supercell(name, size)
    rows = cell.elongations[
        :, np.arange(6 * cell.balls).reshape(-1, 6)[:, : structure(name).dimension].ravel()
    ]
    base = y + 0.5 * (deviations[cell.i] + deviations[cell.j])
    motion = np.zeros(rows.shape[1])
    for _ in range(30):
        overlap = base - rows @ motion
        assert overlap.min() > 0.0
        step_matrix = rows.T @ diags_array(1.5 * np.sqrt(overlap)) @ rows + 1e-9 * np.sqrt(
            y
        ) * eye_array(rows.shape[1])
        step = splu(csc_array(step_matrix)).solve(rows.T @ overlap**1.5)
        motion += step
        if np.max(np.abs(step)) < 1e-13:
            break
    return np.mean((base - rows @ motion) ** 1.5)


def second_order(name, size, deviations):
    """The coefficient c of f* = y^(3/2) (1 + c/y^2 + ...) of one array, from its equilibria at
    three high loads.
    """
    y = 20.0 * 2.0 ** np.arange(3)
    found = [
        (equilibrium_force(name, size, deviations, one) / one**1.5 - 1.0) * one**2 for one in y
    ]
    return extrapolated(y, found, (1, 2))


@pytest.mark.claim("local-field-space", "second-order-any-lattice")
@pytest.mark.parametrize(
    ("name", "size"),
    only(
        [("triangular", 8), ("fcc", 4), ("ABAC", 2)],
        [("triangular", 8), ("fcc", 4), ("hcp", 3), ("fcc", 6), ("ABAC", 2)],
    ),
)
def test_high_load_law_of_arrays(name, size):
    """f* = y^(3/2) (1 + r/(64 y^2)), r = Xi/(1 + Xi), in any lattice: for one array, then for the
    mean over all arrays.

    To first order overlaps are y + (1 - P) m, with m = (x_i + x_j)/2 of each contact, so that the
    mean force is y^(3/2) +
    (3/8) y^(-1/2) <((1 - P) m)^2>. m is the sum over balls of x/2 times their stars, and <x^2> = 1/12: the mean over arrays
    is (1 - u_1)/24. Of n balls the mean of x is taken off, which leaves 1 - u_1 - 2/n.
    """
    cell = supercell(name, size)
    count = cell.balls
    contacts = len(cell.i)
    dimension = structure(name).dimension
    rows = cell.elongations[:, np.arange(6 * count).reshape(-1, 6)[:, :dimension].ravel()].toarray()
    left = np.linalg.svd(rows, full_matrices=False)
    basis = left[0][:, left[1] > 1e-9]
    members = np.zeros((contacts, count))
    np.add.at(members, (np.arange(contacts), cell.i), 0.5)
    np.add.at(members, (np.arange(contacts), cell.j), 0.5)
    members -= members.mean(axis=1, keepdims=True)  # the mean of x is taken off
    held = members - basis @ (basis.T @ members)
    # one array: a quadratic form in its deviations
    x = np.random.default_rng(1).uniform(-0.5, 0.5, count)
    expected = 3.0 / 8.0 * np.mean((held @ x) ** 2)
    assert second_order(name, size, x - x.mean()) == pytest.approx(expected, rel=2e-5)
    # the mean over arrays, from the response of the star in the same array
    mean = 3.0 / 8.0 * np.sum(held**2) / 12.0 / contacts
    finite = 1.0 - cell.compliance(0.0)
    assert mean == pytest.approx((finite - 2.0 / count) / 64.0, rel=1e-9)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["triangular", "fcc", "hcp"])
def test_the_limit_of_many_balls_is_xi(name):
    # the mean of the second order over arrays, of growing size, tends to r/64 with the Xi of the
    # infinite lattice
    p = find_lattice(name).periods
    sizes = (6, 8, 10, 12, 16) if p == 2 else (4, 6, 8, 10) if name == "fcc" else (3, 4, 5, 6)
    rest = [1.0 - Supercell(find_lattice(name), size).compliance(0.0) for size in sizes]
    field = local_field(name)
    limit = extrapolated(sizes, rest, range(p, p + 2 * len(sizes) - 2, 2))
    assert limit == pytest.approx(field.xi / (1.0 + field.xi), abs=2e-4)


# -- what is known without a calculation -----------------------------------------------------------


@pytest.mark.claim("chain-one-force")
@pytest.mark.parametrize("eta", [0.0, 0.84])
def test_nothing_holds_the_neighbours_on_a_line(eta):
    field = local_field("chain", eta, bending=0.1 if eta else 0.0)
    assert (field.xi, field.compliance, field.alpha) == (0.0, 1.0, None)
    assert field.is_determinate
    # several balls in the cell, and a line in the plane
    for cell, sites in (([[3.0]], [[0.0], [1.0 / 3.0], [2.0 / 3.0]]), ([[1.0, 0.0]], [[0.0]])):
        assert local_field(Lattice("line", cell, sites), eta).xi == 0.0


_ROOT = np.sqrt(2.0)
CELLS = {
    ("fcc", 0.0, "cube"): Lattice(
        "cube", np.eye(3) * _ROOT, [(0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)]
    ),
    ("fcc", 0.84, "cube"): Lattice(
        "cube", np.eye(3) * _ROOT, [(0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)]
    ),
    ("fcc", 0.84, "tilted"): Lattice("tilted", [(1, 0, 0), (0, 1, 0), (0.5, 0.5, 0.5 * _ROOT)]),
    ("sc", 0.84, "double"): Lattice("double", np.diag([1.0, 1.0, 2.0]), [(0, 0, 0), (0, 0, 0.5)]),
}


@pytest.mark.parametrize(
    ("name", "eta", "cell"),
    [
        ("fcc", 0.84, "tilted"),
        pytest.param("fcc", 0.0, "cube", marks=pytest.mark.slow),
        pytest.param("fcc", 0.84, "cube", marks=pytest.mark.exhaustive),
        pytest.param("sc", 0.84, "double", marks=pytest.mark.exhaustive),
    ],
)
def test_any_cell_of_a_crystal_gives_the_same(name, eta, cell):
    assert local_field(CELLS[name, eta, cell], eta).xi == pytest.approx(VALUES[name, eta], rel=2e-8)


@settings(deadline=None, max_examples=3)
@given(
    st.floats(0.3, 3.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.sampled_from(["square", "kagome"]),
)
def test_stiffer_contacts_make_no_lattice_softer(eta, torsion, bending, name):
    field = local_field(name, eta, torsion=torsion, bending=bending)
    assert 0.0 < field.compliance < 1.0
    for more in (
        {"torsion": torsion + 0.1, "bending": bending},
        {"torsion": torsion, "bending": bending + 0.1},
    ):
        assert local_field(name, eta, **more).xi >= field.xi * (1.0 - 1e-8)
    assert local_field(name, 1.1 * eta, torsion=torsion, bending=bending).xi > field.xi


def test_torsion_and_bending_go_to_zero_smoothly():
    start = local_field("sc", 0.84)
    for small in (1e-6, 1e-4):
        field = local_field("sc", 0.84, torsion=small, bending=small)
        assert (field.torsion, field.bending) == (small, small)
        assert abs(field.xi - start.xi) < 0.02 * small
    # in the plane torsion acts on nothing that static forces move
    assert local_field("kagome", 0.84, torsion=0.3).xi == local_field("kagome", 0.84).xi


# -- what there is not -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["square", "honeycomb", "kagome", "sc", "bcc", "diamond"])
def test_lattices_that_do_not_hold_a_ball(name):
    held = {"bending": 0.05} if name in ("honeycomb", "diamond") else {}
    with pytest.raises(
        MechanismError,
        match=f"'{name}' .*neighbours",
    ):
        local_field(name)
    if held:
        with pytest.raises(MechanismError, match=r"Use bending"):
            local_field(name, 0.84)
    if find_lattice(name).periods == 2:
        assert local_field(name, 0.84, **held).xi > 0.0


@pytest.mark.parametrize("name", only(["square"], ["kagome", "square", "sc"]))
def test_too_little_friction(name):
    with pytest.raises(
        PrecisionError,
        match=rf"'{name}' at mindlin_ratio 1e-08",
    ):
        local_field(name, 1e-8)


@pytest.mark.parametrize("name", ["triangular", pytest.param("fcc", marks=pytest.mark.slow)])
def test_extreme_stiffnesses_of_a_lattice_that_needs_none(name):
    start = local_field(name)
    assert local_field(name, 1e-12).xi == pytest.approx(start.xi, rel=1e-9)
    # without friction nothing joins rotations to displacements
    assert local_field(name, torsion=1e6).xi == start.xi
    # at strong friction the stiffness that holds the corona is that of shear
    ratio = local_field(name, 1e8).xi / local_field(name, 1e4).xi
    assert ratio == pytest.approx(1e4, rel=2e-4)


@pytest.mark.parametrize("name", ["mindlin_ratio", "torsion", "bending"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_stiffness_that_cannot_be(name, value):
    with pytest.raises(InputError, match=f"{name}.*zero or above"):
        local_field("fcc", **{"mindlin_ratio": 0.84, name: value})


# -- the media -------------------------------------------------------------------------------------


def packing(lattice, **more):
    return gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice=lattice, **more)


@pytest.mark.claim("chain-one-force")
@pytest.mark.parametrize("medium", [gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium])
@pytest.mark.parametrize(
    "spread", [gp.Uniform(2.04e-6), gp.Normal(5e-5), gp.Discrete([7e-3, 9e-3], [0.5, 0.5]), None]
)
def test_every_medium_gives_hertz_on_a_line(medium, spread):
    balls = gp.Packing(STEEL, 8e-3, spread, lattice="chain")
    force = np.array([1e-6, 1e-2, 1.0, 100.0])
    state = medium(balls).at_force(force)
    equal = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="chain")).at_force(force)
    for name in ("force", "overlap", "normal_stiffness", "pressure", "exponent", "stiffness_ratio"):
        np.testing.assert_array_equal(getattr(state, name), getattr(equal, name))
    np.testing.assert_array_equal(state.contact_fraction, 1.0)
    np.testing.assert_array_equal(state.force_fluctuation, 0.0)
    assert np.all(state.valid)
    np.testing.assert_array_equal(
        gp.sound_velocities(state).longitudinal, gp.sound_velocities(equal).longitudinal
    )


@pytest.mark.claim("chain-one-force")
def test_balls_on_a_line_carry_one_force():
    # the statement itself: on a ring of random balls in equilibrium every overlap is the same,
    # whatever the diameters
    deviations = np.random.default_rng(5).uniform(-0.5, 0.5, 40)
    deviations -= deviations.mean()
    assert equilibrium_force("chain", 40, deviations, 3.0) == pytest.approx(3.0**1.5, rel=1e-13)


@pytest.mark.claim("second-order-any-lattice")
@pytest.mark.parametrize("lattice", only(["fcc", "sc", "kagome"], ["fcc", "hcp", "sc", "kagome"]))
def test_second_order_of_the_medium(lattice):
    medium = gp.EffectiveMedium(packing(lattice, friction=lattice not in ("fcc", "hcp")))
    y = 200.0
    state = medium.at_overlap(y * medium.packing.width)
    xi = medium.local_field.xi
    assert (state.reduced_force / y**1.5 - 1.0) * 64.0 * y**2 == pytest.approx(
        xi / (1.0 + xi), rel=1e-4
    )
    # the averaged force is the medium of infinite Xi
    averaged = gp.AveragedForce(medium.packing).at_overlap(y * medium.packing.width)
    assert (averaged.reduced_force / y**1.5 - 1.0) * 64.0 * y**2 == pytest.approx(1.0, rel=1e-4)


def test_the_packing_says_what_the_local_field_is_made_of():
    plain = gp.EffectiveMedium(packing("sc")).local_field
    assert (plain.mindlin_ratio, plain.torsion, plain.bending) == (STEEL.mindlin_ratio, 0.0, 0.0)
    held = gp.EffectiveMedium(packing("sc", torsion=0.1, bending=0.2)).local_field
    assert (held.torsion, held.bending) == (0.1, 0.2)
    assert held.xi > plain.xi
    # the torsion of a Hertz contact is of the order of what the medium leaves out
    assert gp.EffectiveMedium(packing("sc", torsion="mindlin")).local_field is plain
    with pytest.raises(MechanismError, match="'diamond'"):
        _ = gp.EffectiveMedium(packing("diamond", torsion="mindlin")).at_force(1.0)
    with pytest.raises(InputError, match=r"paper .*bending"):
        gp.EffectiveMedium(packing("triangular", bending=0.1), local_field="paper")
    # which motions are asked for does not change what static forces meet
    for motions in ("in_plane", "out_of_plane", "all"):
        assert gp.EffectiveMedium(
            packing("triangular", motions=motions)
        ).local_field.xi == pytest.approx(2.39082, abs=1e-5)


@pytest.mark.parametrize("lattice", [pytest.param("fcc", marks=pytest.mark.slow), "sc", "kagome"])
def test_everything_downstream(lattice):
    medium = gp.EffectiveMedium(packing(lattice))
    unit = medium.packing.width_units.force
    state = medium.at_force(np.array([0.1, 1.0]) * unit)
    factor = find_lattice(lattice).pressure_factor
    d = medium.packing.diameter
    p = find_lattice(lattice).periods
    np.testing.assert_allclose(state.pressure, factor * state.force / d ** (p - 1), rtol=1e-14)
    np.testing.assert_allclose(
        medium.at_pressure(state.pressure).overlap, state.overlap, rtol=1e-8, atol=1e-14
    )
    # sound, moduli and bands are those of the lattice of the medium's stiffness
    ideal = gp.AveragedLattice(gp.Packing(STEEL, d, lattice=lattice))
    same = ideal.at_overlap((state.normal_stiffness / (1.5 * ideal.law.coefficient)) ** 2)
    np.testing.assert_allclose(gp.moduli(state).tensor, gp.moduli(same).tensor, rtol=1e-12)
    along = np.eye(p)[0]
    found, expected = (gp.sound_velocities(one, along).velocities for one in (state, same))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    fractions = [[0.3, 0.1, 0.0]]
    found, expected = (gp.Phonons(one[1]).frequencies(fractions) for one in (state, same))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)
    # a local exponent of v over P, by a difference
    near = medium.at_force(state.force * np.exp([[-1e-4], [1e-4]]))
    waves = np.log(gp.sound_velocities(near, along).velocities[..., -1])
    rise = (waves[1] - waves[0]) / np.diff(np.log(near.pressure), axis=0)[0]
    np.testing.assert_allclose(rise, gp.local_exponent(state), rtol=1e-6)


def test_a_line_tells_no_width():
    state = gp.EffectiveMedium(packing("chain")).at_force(np.geomspace(0.1, 10.0, 5))
    with pytest.raises(InputError, match="same force"):
        gp.fit_width(state.packing, state.force, gp.sound_velocities(state).longitudinal)


def test_widths_are_fitted_in_space():
    balls = packing("fcc")
    force = np.geomspace(0.1, 3.0, 8) * balls.width_units.force
    velocity = gp.sound_velocities(
        gp.EffectiveMedium(balls).at_force(force), direction=[0, 0, 1]
    ).longitudinal
    fit = gp.fit_width(
        gp.Packing(STEEL, 8e-3, gp.Uniform(1e-6), lattice="fcc"),
        force,
        velocity,
        direction=[0, 0, 1],
    )
    assert fit.width == pytest.approx(2.04e-6, rel=1e-6)


@pytest.mark.exhaustive
@pytest.mark.claim("medium-in-space")
@pytest.mark.parametrize(("name", "size"), [("fcc", 6), ("hcp", 5)])
def test_the_medium_against_arrays_in_space(name, size):
    """Force of the medium over that of arrays without friction, at the same spacing."""
    medium = gp.EffectiveMedium(packing(name, friction=False))
    cell = Supercell(find_lattice(name), size)
    rows = cell.elongations[:, np.arange(6 * cell.balls).reshape(-1, 6)[:, :3].ravel()]
    for y, error in ((1.0, 1e-3), (0.43, 0.01), (0.135, 0.025)):
        found = []
        for seed in range(4):
            x = np.random.default_rng(seed).uniform(-0.5, 0.5, cell.balls)
            x -= x.mean()
            found.append(minimise(rows, y + 0.5 * (x[cell.i] + x[cell.j])))
        force = medium.at_overlap(y * medium.packing.width).reduced_force
        assert force == pytest.approx(np.mean(found), rel=error)


def minimise(rows, base):
    """Mean force of the array of least energy; contacts may open. Newton's method, held where balls
    are loose.
    """
    motion = np.zeros(rows.shape[1])

    def energy(motion):
        return 0.4 * np.sum(np.maximum(base - rows @ motion, 0.0) ** 2.5)

    for _ in range(200):
        overlap = np.maximum(base - rows @ motion, 0.0)
        force = rows.T @ overlap**1.5
        if np.max(np.abs(force)) < 1e-10 * np.mean(overlap**1.5):
            return np.mean(overlap**1.5)
        matrix = rows.T @ diags_array(1.5 * np.sqrt(overlap)) @ rows
        held = 1e-9 + 1e-2 * np.sqrt(np.mean(force**2)) / np.mean(overlap**1.5)
        step = splu(csc_array(matrix + held * eye_array(rows.shape[1]))).solve(force)
        length = 1.0
        now = energy(motion)
        while energy(motion + length * step) > now and length > 1e-6:
            length *= 0.5
        motion += length * step
    raise AssertionError("no equilibrium")
