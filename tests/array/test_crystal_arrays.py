"""Disordered arrays on lattices in one, two and three dimensions, against arrays written out ball
by ball.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import granphon as gp
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Motion, Stencils, dot
from granphon.balls.lattices import CHAIN, FCC, HCP, KAGOME, SC, TRIANGULAR, Lattice, find_lattice
from granphon.base.errors import InputError
from granphon.dynamics.elasticity import bulk_and_shear, point_group, symmetrise

ETA = 0.84
#: fcc in its cube of four balls
CUBE = Lattice(
    "cube of fcc",
    tuple(map(tuple, math.sqrt(2.0) * np.eye(3))),
    ((0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)),
)
SMALL = {
    CHAIN: (5,),
    TRIANGULAR: (3, 4),
    KAGOME: (3, 3),
    SC: (3, 2, 3),
    FCC: (3, 2, 3),
    HCP: (2, 3, 2),
    CUBE: (2, 1, 2),
}
every_lattice = pytest.mark.parametrize("lattice", SMALL, ids=lambda lattice: lattice.name)
STANDING = [CHAIN, TRIANGULAR, FCC, HCP, CUBE]
every_standing = pytest.mark.parametrize("lattice", STANDING, ids=lambda lattice: lattice.name)
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
WIDTH = 2.04e-6
D = 8e-3


class Explicit:
    """A periodic array of balls in space, one contact after the other, from the positions alone.

    Six motions a ball: u, then phi. Balls are in the order (cell, ball of the cell). Rows:
    elongation, two slips, twist and two rolls, for contact after contact.
    """

    def __init__(self, lattice, shape):
        p = lattice.periods
        self.p = p
        self.n = lattice.n_balls
        cells = list(itertools.product(*map(range, shape)))
        base = np.zeros((self.n, 3))
        base[:, : lattice.dimension] = lattice.positions
        vectors = np.zeros((p, 3))
        vectors[:, : lattice.dimension] = lattice.vectors
        self.sites = np.array([np.array(cell) @ vectors + ball for cell in cells for ball in base])
        images = [
            np.array(step) * shape @ vectors for step in itertools.product((-1, 0, 1), repeat=p)
        ]
        self.contacts = []
        for i, j in itertools.product(range(len(self.sites)), repeat=2):
            for image in images:
                apart = self.sites[j] + image - self.sites[i]
                first = next((x for x in apart if abs(x) > 1e-9), 0.0)
                if abs(np.linalg.norm(apart) - 1.0) < 1e-6 and first > 0.0:  # each once
                    self.contacts.append((i, j, apart))

    def rows(self, kinds):
        """Dense C, (contacts, kinds, 6 balls): of e, s, s, twist, roll, roll of each contact the
        ``kinds``.
        """
        return self.all_rows[:, kinds]

    @functools.cached_property
    def all_rows(self):
        """Dense C of all six kinds of rows."""
        out = np.zeros((len(self.contacts), 6, len(self.sites), 6))
        for row, (i, j, n) in enumerate(self.contacts):
            t = np.cross(n, [0.3, -0.5, 0.8])
            t /= np.linalg.norm(t)
            b = np.cross(n, t)
            for kind, axis in ((0, n), (1, t), (2, b)):
                out[row, kind, j, :3] += axis
                out[row, kind, i, :3] -= axis
            for kind, axis in (
                (1, t),
                (2, b),
            ):
                # -(d/2)(phi_i + phi_j) x n . axis = -(d/2) phi . (n x axis)
                for ball in (i, j):
                    out[row, kind, ball, 3:] -= 0.5 * np.cross(n, axis)
            for kind, axis in ((3, n), (4, t), (5, b)):
                out[row, kind, j, 3:] += axis
                out[row, kind, i, 3:] -= axis
        return out.reshape(len(self.contacts), 6, 6 * len(self.sites))

    def means(self, deviations):
        """(x_i + x_j)/2 of contact after contact, of deviations in the order of the balls."""
        return np.array([0.5 * (deviations[i] + deviations[j]) for i, j, _ in self.contacts])


@functools.cache
def write_out(lattice):
    """The small array of a lattice, ball by ball."""
    return Explicit(lattice, SMALL[lattice])


def in_order(lattice, values):
    """Values (..., n, cells) of an array as (..., balls) in the order of the explicit one."""
    lead = values.ndim - lattice.periods - (lattice.n_balls > 1)
    if lattice.n_balls > 1:
        values = np.moveaxis(values, lead, -1)
    return values.reshape(*values.shape[:lead], -1)


def six_motions(lattice, stencils, balls):
    """A motion of the stencils as a flat one of six motions a ball."""
    p = lattice.periods
    m = stencils.motions
    out = np.zeros((6, math.prod(stencils.shape) * lattice.n_balls))
    out[:p] = in_order(lattice, stencils.displacements(balls))
    fields = balls.reshape(lattice.n_balls, m.count, *stencils.shape)
    for at, axis in enumerate(m.rotations):
        out[3 + axis] = in_order(
            lattice, fields[:, len(m.translations) + at].reshape(stencils.ball_shape)
        )
    return out.T.ravel()


def kinds_of(eta, torsion, bending):
    return [0, *[1, 2] * bool(eta), *[3] * bool(torsion), *[4, 5] * bool(bending)]


@every_lattice
@pytest.mark.parametrize(("eta", "torsion", "bending"), [(0.0, 0.0, 0.0), (ETA, 0.1, 0.02)])
def test_energy_and_forces_are_those_of_the_array_ball_by_ball(lattice, eta, torsion, bending):
    shape = SMALL[lattice]
    stencils = Stencils(shape, eta, 1, lattice, torsion, bending)
    explicit = write_out(lattice)
    kept = kinds_of(eta, torsion, bending)
    dense = explicit.rows(kept)
    rng = np.random.default_rng(5)
    weights = np.array([1.0, eta, eta, torsion, bending, bending])[kept]
    matrix = np.einsum("crx,r,cry->xy", dense, weights, dense)
    one, other = rng.normal(size=(2, stencils.n_fields, *shape))
    flat = six_motions(lattice, stencils, one)
    second = six_motions(lattice, stencils, other)
    level = stencils.weights(np.ones((stencils.n_contacts, *shape)))
    forces = stencils.forces(level * stencils.deformations(Motion(one, 0.0)))
    scale = float(flat @ matrix @ flat)
    assert dot(other, forces) == pytest.approx(float(second @ matrix @ flat), abs=1e-13 * scale)
    assert dot(one, forces) == pytest.approx(scale, rel=1e-13)
    # the product in one go, with stiffnesses that differ from contact to contact
    rough = stencils.weights(rng.uniform(0.0, 2.0, (stencils.n_contacts, *shape)))
    found, push = stencils.hessian(rough)(one, 0.3)
    strain = stencils.deformations(Motion(one, 0.3))
    np.testing.assert_allclose(found, stencils.forces(rough * strain), rtol=0.0, atol=1e-12)
    assert push == pytest.approx(
        -float(np.sum((rough * strain)[: stencils.n_contacts])), rel=1e-11, abs=1e-11
    )
    assert dot(strain, rough) == pytest.approx(
        dot(one, stencils.forces(rough)) - 0.3 * float(np.sum(rough[: stencils.n_contacts])),
        rel=1e-11,
        abs=1e-11,
    )


@every_standing
@pytest.mark.parametrize("eta", [0.0, ETA], ids=["smooth", "rough"])
@pytest.mark.parametrize("levels", [(0.7,), (0.175, 0.7)], ids=["equal", "unequal"])
def test_preconditioner_holds_the_inverse_of_equal_contacts(lattice, eta, levels):
    shape = SMALL[lattice]
    stencils = Stencils(shape, eta, 1, lattice, 0.1 * eta, 0.02 * eta)
    size = stencils.n_fields * math.prod(shape)
    units = np.eye(size).reshape(size, stencils.n_fields, *shape)

    def matrix_of(contacts):
        product = stencils.hessian(stencils.weights(contacts))

        def apply(balls):
            return product(balls)[0]

        return np.stack([apply(unit).ravel() for unit in units], axis=1)

    contacts = np.resize(levels, (stencils.n_contacts, *shape))
    matrix = matrix_of(np.full_like(contacts, np.mean(contacts)))
    both = []
    for precision in (float, np.float32):
        precondition = stencils.preconditioner(stencils.weights(contacts).astype(precision))
        both.append(
            np.stack([precondition(unit.astype(precision)).ravel() for unit in units], axis=1)
        )
        assert both[-1].dtype == precision
    found = both[0]
    np.testing.assert_allclose(both[1], found, rtol=0.0, atol=1e-5 * np.max(np.abs(found)))
    np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-13 * np.max(np.abs(found)))
    # on what costs energy it is the inverse, and that of each ball alone
    values, vectors = np.linalg.eigh(matrix)
    keep = values > 1e-9
    assert np.count_nonzero(~keep) == lattice.periods
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    if len(levels) == 1:  # that of each ball alone is left out
        np.testing.assert_allclose(found, inverse, rtol=0.0, atol=1e-11)
        return
    assert np.linalg.eigvalsh(found)[0] > 0.02
    alone = np.zeros_like(matrix)  # each ball's own block, displacements and rotations apart
    ball = np.arange(stencils.n_fields) // stencils.motions.count
    group = 2 * ball + np.tile(stencils.motions.is_rotation, lattice.n_balls)
    cell = np.tile(np.arange(math.prod(shape)), stencils.n_fields)
    same = (cell[:, None] == cell) & (
        np.repeat(group, math.prod(shape))[:, None] == np.repeat(group, math.prod(shape))
    )
    uneven = matrix_of(contacts)
    alone[same] = np.linalg.inv(np.where(same, uneven, 0.0))[same]
    expected = inverse + alone
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=3e-5 * np.max(expected))


def draw(lattice, shape, seed=0):
    full = shape if lattice.n_balls == 1 else (lattice.n_balls, *shape)
    x = np.random.default_rng(seed).uniform(-0.5, 0.5, full)
    return x - np.mean(x)


@every_standing
@pytest.mark.parametrize("overlap", [0.1, 3.0])
def test_equilibrium_is_the_minimum_of_the_energy_written_out(lattice, overlap):
    shape = SMALL[lattice]
    x = draw(lattice, shape)
    state = bring_to_rest(x, ReducedLoad(overlap=overlap), Stencils(shape, lattice=lattice))
    explicit = write_out(lattice)
    rows = explicit.rows([0])[:, 0].reshape(len(explicit.contacts), -1, 6)[..., : lattice.periods]
    rows = rows.reshape(len(explicit.contacts), -1)
    means = explicit.means(in_order(lattice, x))

    def energy(u):
        h = np.maximum(overlap + means - rows @ u, 0.0)
        return 0.4 * np.sum(h**2.5), -rows.T @ h**1.5

    found = minimize(
        energy,
        np.zeros(rows.shape[1]),
        jac=True,
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 5000},
    )
    h = np.maximum(overlap + means - rows @ found.x, 0.0)
    assert state.energy == pytest.approx(np.mean(0.4 * h**2.5), rel=1e-9)
    np.testing.assert_allclose(
        np.sort(state.forces.ravel()), np.sort(h**1.5), rtol=0.0, atol=1e-5 * state.force
    )
    at_force = bring_to_rest(x, ReducedLoad(force=state.force), Stencils(shape, lattice=lattice))
    assert at_force.overlap == pytest.approx(overlap, rel=1e-9)


@every_standing
@pytest.mark.parametrize(
    ("eta", "torsion", "bending", "own"),
    [(0.0, 0.0, 0.0, False), (ETA, 0.1, 0.02, False), (ETA, 0.5, 0.02, True)],
)
def test_elastic_tensor_is_the_linear_response_of_the_array_ball_by_ball(
    lattice, eta, torsion, bending, own
):
    shape = SMALL[lattice]
    p = lattice.periods
    x = draw(lattice, shape, 1)
    state = bring_to_rest(x, ReducedLoad(overlap=0.15), Stencils(shape, lattice=lattice))
    # each contact may have a torsion of its own, in proportion to its overlap
    found = state.find_elasticity(
        eta, torsion * np.maximum(state.overlaps, 0.0) if own else torsion, bending
    )
    explicit = write_out(lattice)
    kept = kinds_of(eta, torsion, bending)
    dense = explicit.rows(kept)
    overlaps = np.maximum(
        0.15 + explicit.means(in_order(lattice, x)) - _elongations(lattice, explicit, state), 0.0
    )
    stiffness = 1.5 * np.sqrt(np.where(overlaps > 1e-8, overlaps, 0.0))
    ratios = np.tile([1.0, eta, eta, torsion, bending, bending], (len(stiffness), 1))
    ratios[:, 3] *= overlaps if own else 1.0
    weights = np.sqrt(stiffness[:, None] * ratios[:, kept])
    pairs = {
        1: [(0, 0)],
        2: [(0, 0), (1, 1), (0, 1)],
        3: [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)],
    }[p]
    affine = []
    for a, b in pairs:
        strain = np.zeros((3, 3))
        strain[a, b] = strain[b, a] = 1.0 if a == b else 0.5
        moved = np.zeros((len(explicit.contacts), len(kept)))
        for row, (_, _, n) in enumerate(explicit.contacts):
            t = np.cross(n, [0.3, -0.5, 0.8])
            t /= np.linalg.norm(t)
            for at, kind in enumerate(kept[:3]):
                moved[row, at] = (n, t, np.cross(n, t))[kind] @ strain @ n if kind < 3 else 0.0
        affine.append((weights * moved).ravel())
    affine = np.array(affine).T
    matrix = (weights[..., None] * dense).reshape(affine.shape[0], -1)
    left = affine - matrix @ np.linalg.lstsq(matrix, affine, rcond=1e-11)[0]
    wanted = left.T @ left / (lattice.measure * math.prod(shape))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.max(wanted))
    if not eta:  # under an even strain the overlaps change evenly: K follows from the stiffness
        bulk = bulk_and_shear(found)[0]
        assert bulk == pytest.approx(lattice.pressure_factor / p * state.stiffness, rel=1e-10)


def _elongations(lattice, explicit, state):
    u = six_motions(lattice, state.stencils, state.balls)
    return explicit.rows([0])[:, 0] @ u


@every_standing
def test_equal_balls_have_the_elastic_tensor_of_the_lattice(lattice):
    shape = SMALL[lattice]
    state = bring_to_rest(
        np.zeros_like(draw(lattice, shape)),
        ReducedLoad(overlap=0.3),
        Stencils(shape, lattice=lattice),
    )
    for eta, torsion, bending in ((0.0, 0.0, 0.0), (ETA, 0.0, 0.0), (ETA, 0.2, 0.1)):
        wanted = gp.ContactLattice.of(
            lattice, eta, torsion=torsion, bending=bending
        ).elastic_tensor()
        found = state.find_elasticity(eta, torsion, bending) / state.stiffness
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * np.max(wanted))


@settings(max_examples=6)
@given(st.sampled_from([FCC, HCP, TRIANGULAR]), st.integers(0, 2**32 - 1), st.data())
def test_moving_all_balls_by_a_lattice_vector_moves_the_forces(lattice, seed, data):
    shape = SMALL[lattice]
    x = draw(lattice, shape, seed)
    axes = tuple(range(-lattice.periods, 0))
    shift = [data.draw(st.integers(0, length - 1)) for length in shape]
    stencils = Stencils(shape, lattice=lattice)
    one = bring_to_rest(x, ReducedLoad(force=0.2), stencils)
    other = bring_to_rest(np.roll(x, shift, axes), ReducedLoad(force=0.2), stencils)
    np.testing.assert_allclose(np.roll(one.forces, shift, axes), other.forces, rtol=0.0, atol=1e-9)


# -- symmetry --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("chain", 2),
        ("square", 8),
        ("triangular", 12),
        ("sc", 48),
        ("bcc", 48),
        ("fcc", 48),
        ("diamond", 48),
        ("hcp", 24),
    ],
)
def test_point_groups_have_their_orders_and_keep_the_elastic_tensor(name, order):
    lattice = find_lattice(name)
    assert len(point_group(lattice)) == order
    tensor = gp.ContactLattice.of(lattice, ETA, bending=0.1).elastic_tensor()
    np.testing.assert_allclose(
        symmetrise(tensor, lattice), tensor, rtol=0.0, atol=1e-13 * np.max(tensor)
    )


def test_the_symmetric_part_on_the_triangular_lattice_is_isotropic():
    rough = np.random.default_rng(0).normal(size=(4, 3, 3))
    rough = rough + rough.swapaxes(1, 2)
    bulk, shear = bulk_and_shear(rough).T
    found = symmetrise(rough, TRIANGULAR)
    np.testing.assert_allclose(found[:, 0, 0], bulk + shear, atol=1e-14)
    np.testing.assert_allclose(found[:, 0, 1], bulk - shear, atol=1e-14)
    np.testing.assert_allclose(found[:, 2, 2], shear, atol=1e-14)
    assert np.max(np.abs(found[:, :2, 2])) < 1e-14


# -- the medium ------------------------------------------------------------------------------------


def packing(lattice, friction=True, **more):
    return gp.Packing(
        STEEL, D, spread=gp.Uniform(WIDTH), lattice=lattice, friction=friction, **more
    )


def test_diameters_are_given_for_each_ball_of_each_cell():
    with pytest.raises(InputError, match=r"\(L1, L2, L3, 2\)"):
        gp.DirectSimulation(packing("hcp"), diameters=np.full((3, 3, 3), D))


@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize(("lattice", "shape"), [("fcc", (3, 3, 3)), ("hcp", (3, 3, 2))])
def test_each_contact_of_a_sample_has_the_torsion_of_its_own_overlap(lattice, shape, friction):
    balls = packing(lattice, friction, torsion="mindlin")
    sample = gp.DirectSimulation(balls, shape).at_force(2.0).sample
    rest = sample.equilibrium
    # (1 - nu)/3 of the overlap of the contact over the diameter; without friction nothing but
    # torsion resists rotations
    torsion = (1.0 - 0.276) / 3.0 * WIDTH / D * np.maximum(rest.overlaps, 0.0)
    wanted = rest.find_elasticity(balls.mindlin_ratio, torsion) * balls.width_units.stiffness / D
    np.testing.assert_allclose(sample.elastic_tensor, wanted, rtol=0.0, atol=1e-11 * np.max(wanted))
    none = rest.find_elasticity(balls.mindlin_ratio) * balls.width_units.stiffness / D
    assert (np.max(np.abs(wanted - none)) > 1e-8 * np.max(none)) == friction


@pytest.mark.parametrize("lattice", ["fcc", "hcp"])
def test_without_shear_no_torsion_or_bending_changes_the_elastic_tensor(lattice):
    x = draw(find_lattice(lattice), SMALL[find_lattice(lattice)])
    shape = SMALL[find_lattice(lattice)]
    state = bring_to_rest(x, ReducedLoad(force=0.1), Stencils(shape, lattice=find_lattice(lattice)))
    plain = state.find_elasticity(0.0)
    for torsion, bending in ((0.1, 0.0), (0.0, 0.1), (0.1, 0.02)):
        np.testing.assert_allclose(
            state.find_elasticity(0.0, torsion, bending),
            plain,
            rtol=0.0,
            atol=1e-12 * np.max(plain),
        )


@pytest.mark.parametrize("lattice", ["fcc", "hcp"])
def test_equal_balls_with_the_torsion_of_a_hertz_contact_are_the_lattice(lattice):
    balls = gp.Packing(STEEL, D, lattice=lattice, torsion="mindlin")
    found = gp.DirectSimulation(balls, (2, 3, 2)).at_force([2.0, 50.0])
    exact = gp.AveragedLattice(balls).at_force([2.0, 50.0])
    np.testing.assert_allclose(found.torsion, (1.0 - 0.276) / 3.0 * exact.overlap / D, rtol=1e-12)
    for one, other in zip(found.elastic_tensor, exact.elastic_tensor, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.max(other))
    wanted = gp.ContactLattice.of(
        lattice, balls.mindlin_ratio, torsion=float(found.torsion[1])
    ).elastic_tensor()
    scale = exact.normal_stiffness[1] / D
    np.testing.assert_allclose(
        found.elastic_tensor[1], scale * wanted, rtol=0.0, atol=1e-11 * scale * np.max(wanted)
    )
    # the bands are those of the mean state, scaled to its long waves; those of rotations are
    # stiffer under more load
    one, other = (gp.Phonons(state[1]).frequencies([[0.3, 0.1, 0.2]]) for state in (found, exact))
    np.testing.assert_allclose(one, other, rtol=1e-9)


def test_arrays_of_a_sample_are_indexed_by_cell_then_ball():
    state = gp.DirectSimulation(packing("hcp"), (3, 4, 5)).at_force(10.0)
    sample = state.sample
    assert sample.diameters.shape == (3, 4, 5, 2)
    assert sample.displacements.shape == sample.sites.shape == (3, 4, 5, 2, 3)
    assert sample.contact_forces.shape == (3, 4, 5, 12)
    np.testing.assert_allclose(
        sample.sites[1, 2, 3, 1], np.array([1, 2, 3]) @ HCP.vectors + HCP.positions[1], atol=1e-14
    )
    again = gp.DirectSimulation(packing("hcp"), diameters=sample.diameters).at_force(10.0)
    np.testing.assert_allclose(again.sample.contact_forces, sample.contact_forces, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "shape"), [("fcc", (4, 4, 4)), ("hcp", (3, 4, 3)), ("chain", (30,))]
)
@pytest.mark.parametrize("friction", [False, True])
def test_the_calculator_finds_the_balls_of_a_sample_at_rest(name, shape, friction):
    state = gp.DirectSimulation(packing(name, friction), shape).at_force(10.0)
    balls = gp.HertzMindlin(state).adopt(state.sample.atoms())
    balls.calc = gp.HertzMindlin(state)
    force = 10.0 / (state.normal_stiffness * D)  # of a contact, in reduced units
    assert np.max(np.abs(balls.get_forces())) < 1e-9 * force


def test_velocities_in_fcc_have_its_symmetry_and_errors():
    state = gp.DirectSimulation(packing("fcc"), (3, 3, 3), samples=3).at_force([8.0, 30.0])
    v = gp.sound_velocities(state, [[1, 0, 0], [0, 0, 1], [1, 1, 1]])
    np.testing.assert_allclose(v.velocities[:, 0], v.velocities[:, 1], rtol=1e-13)
    np.testing.assert_allclose(
        v.transverse[..., [0, 2], 0], v.transverse[..., [0, 2], 1], rtol=1e-12
    )
    assert v.longitudinal_error.shape == (2, 3)
    assert v.transverse_error.shape == (2, 3, 2)
    assert np.all(v.longitudinal_error > 0.0)
    c = symmetrise(state.elastic_tensor, state.packing.structure)
    rho = state.effective_density
    np.testing.assert_allclose(v.longitudinal[:, 0], np.sqrt(c[:, 0, 0] / rho), rtol=1e-12)
    np.testing.assert_allclose(v.transverse[:, 0, 0], np.sqrt(c[:, 3, 3] / rho), rtol=1e-12)
    with pytest.raises(InputError, match="depend on the direction"):
        gp.sound_velocities(state)
    moduli = gp.moduli(state)
    assert not moduli.isotropic
    assert np.all(moduli.voigt.shear > 0.0)
    assert state.standard_error("elastic_tensor").shape == (2, 6, 6)
