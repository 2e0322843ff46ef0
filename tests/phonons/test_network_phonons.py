"""Phonons, sound, moduli and pulses of networks: of ribbons, samples, several kinds of balls, and
their files.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import ase.io
import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.phonons.phonons import find_gaps_between
from tests.dynamics.test_network_lattice import (
    CASES,
    hold,
    random_network,
    ribbon,
    rock_salt,
    table_network,
)
from tests.phonons.conftest import RESISTED, STEEL, at_overlap, random_points

DIATOMIC = ([[0.0], [1.0]], [[2.0]], [1.0, 2.5], [(0, 1, [0]), (1, 0, [1])], [[1.0]] * 2, 3.0)


def diatomic_chain():
    return table_network(*DIATOMIC, dimension=1, motions="longitudinal")


@pytest.fixture(scope="module")
def sample():
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    return gp.DirectSimulation(packing, shape=(6, 6), seed=0).at_force(2.0).sample


# -- the packings' own numbers ---------------------------------------------------------------------

STATES = {
    "triangular": {},
    "smooth": {"friction": False},
    "finite overlap": {"finite_overlap": True},
    "square": {"lattice": "square"},
    "kagome": {"lattice": "kagome"},
    "fcc": {"lattice": "fcc"},
    "chain": {"lattice": "chain", "motions": "all", "torsion": 0.1},
    "hcp": {"lattice": "hcp", **RESISTED},
    "finite fcc": {"lattice": "fcc", "finite_overlap": True},
}


@pytest.mark.claim("network-bands")
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=[pytest.mark.slow] * (case in ("finite overlap", "kagome", "fcc")))
        for case in STATES
    ],
)
def test_a_network_of_a_state_has_the_numbers_of_the_state(case):
    """Bands, velocities, moduli and pulses; a state of its own with a network is one too."""
    state = at_overlap(1e-3, **STATES[case])
    periods = state.packing.structure.periods
    along = np.array([0.3, -0.5, 0.8])[:periods]
    for other in (state.network, SimpleNamespace(network=state.network, warnings=())):
        one = gp.Phonons(state)
        two = gp.Phonons(other)
        q = random_points(one)
        assert_allclose(two.frequencies(q), one.frequencies(q), rtol=1e-12)
        own = one.bands(npoints=5)
        found = two.bands(npoints=5)
        assert found.labels == own.labels
        assert_allclose(
            found.frequencies, own.frequencies, rtol=1e-12, atol=1e-14 * own.frequencies.max()
        )
        v = gp.sound_velocities(state, along)
        w = gp.sound_velocities(other, along)
        assert_allclose(w.velocities, v.velocities, rtol=1e-12)
        assert_allclose(
            np.nan if w.twist is None else w.twist,
            np.nan if v.twist is None else v.twist,
            rtol=1e-12,
        )
        m = gp.moduli(state)
        n = gp.moduli(other)
        assert_allclose(n.tensor, m.tensor, rtol=0.0, atol=1e-12 * np.max(m.tensor))
        assert (n.isotropic, n.cubic) == (m.isotropic, m.cubic)
        frequency = 0.1 * own.frequencies.max()
        p, r = (gp.pulse_velocities(x, frequency, along) for x in (state, other))
        assert p.branches == r.branches
        assert_allclose(r.group_vector, p.group_vector, rtol=1e-11, atol=1e-12 * np.max(p.group))
        assert_allclose(r.phase, p.phase, rtol=1e-12)
    assert (
        gp.sound_velocities(
            SimpleNamespace(network=state.network, warnings=("so",)), along
        ).warnings[0]
        == "so"
    )
    atoms = gp.atoms(state)
    cell = gp.atoms(state.network)
    for name in ("positions", "masses", "radius"):
        assert_allclose(cell.arrays[name], atoms.arrays[name], atol=1e-14)
    assert_allclose(cell.cell.array, atoms.cell.array, atol=1e-14)
    assert cell.info == pytest.approx(atoms.info)
    assert cell.symbols.get_chemical_formula() == atoms.symbols.get_chemical_formula()


def test_a_sample_at_gamma_has_the_modes_of_its_waves(sample):
    ph = gp.Phonons(sample)
    modes = gp.Waves(sample).modes(12)
    at_gamma = ph.frequencies([[0.0, 0.0]])[0]
    assert np.count_nonzero(at_gamma == 0.0) == 2
    assert_allclose(at_gamma[2:14], modes.frequencies, rtol=1e-12)
    # and the moduli of its own cell are those of its linear response, which leaves out what stress
    # makes unsymmetric
    tensor = gp.moduli(sample).tensor
    assert_allclose(0.5 * (tensor + tensor.T), sample.elastic_tensor, rtol=1e-9)


def test_velocities_are_the_slopes_of_the_bands():
    for case in ("plane", "fcc", "ribbon along x", "turned wire", "prestress"):
        network = CASES[case]()
        ph = gp.Phonons(network)
        along = np.array([0.6, -0.3, 0.74])[: ph.lattice.periods]
        along /= np.linalg.norm(along)
        found = gp.sound_velocities(network, along).velocities
        step = 1e-4 / ph.scales.length  # 1/m
        q = along * step * ph.scales.length @ np.linalg.inv(ph.lattice.reciprocal)
        slopes = ph.frequencies([q])[0, : len(found)] * 2.0 * np.pi / step
        sounds = found > 0.0  # a wave across a ribbon is flexural
        assert_allclose(slopes[sounds], found[sounds], rtol=1e-5)
        assert np.all(slopes[~sounds] < 0.05 * found[-1])


def test_sound_in_many_directions_and_isotropy():
    network = CASES["fcc"]()
    directions = [[1, 0, 0], [1, 1, 0], [1, 2, 3]]
    many = gp.sound_velocities(network, directions)
    assert many.velocities.shape == (3, 3)
    assert_allclose(
        many.velocities[2], gp.sound_velocities(network, directions[2]).velocities, rtol=1e-13
    )
    with pytest.raises(
        InputError,
        match=r"sound .*direction=\(",
    ):
        gp.sound_velocities(network)
    salt = rock_salt(2.0, 1.4, (1.0, 3.0))
    assert gp.moduli(salt).cubic
    assert not gp.moduli(salt).isotropic
    with pytest.raises(InputError, match="pulses of the network"):
        gp.pulse_velocities(network, 1.0)


def test_moduli_of_a_ribbon_are_a_force_and_of_a_slab_one_over_a_diameter():
    """Of chains side by side, none of which touches another: each adds its modulus, k d in N and k
    in N/m.
    """
    k = 3.0
    count = 4
    side = [[0.0, 1.0 * n] for n in range(count)]
    contacts = [(n, n, [1]) for n in range(count)] + [(n, n + 1, [0]) for n in range(count - 1)]
    normals = [[1.0, 0.0]] * count + [[0.0, 1.0]] * (count - 1)
    wide = table_network(
        side, [[1.0, 0.0]], 1.0, contacts, normals, k, 1.2, dimension=2, motions="in_plane"
    )
    assert_allclose(gp.moduli(wide).tensor, [[count * k]], rtol=1e-13)
    assert_allclose(gp.sound_velocities(wide).longitudinal, np.sqrt(k), rtol=1e-13)
    slab = ribbon_of_layers(k)
    layer = gp.moduli(
        table_network(
            [[0, 0, 0]], np.eye(3)[:2], 1.0, [(0, 0, [1, 0]), (0, 0, [0, 1])], np.eye(3)[:2], k, 1.2
        )
    )
    assert_allclose(gp.moduli(slab).tensor[:2, :2], 3 * layer.tensor[:2, :2], rtol=0.0, atol=1e-12)


def ribbon_of_layers(k):
    """Three square layers one above the other."""
    at = [[0, 0, n] for n in range(3)]
    contacts = [(n, n, step) for n in range(3) for step in ([1, 0], [0, 1])] + [
        (0, 1, [0, 0]),
        (1, 2, [0, 0]),
    ]
    normals = [axis for _ in range(3) for axis in np.eye(3)[:2]] + [np.eye(3)[2]] * 2
    return table_network(at, np.eye(3)[:2], 1.0, contacts, normals, k, 1.2)


# -- gaps ------------------------------------------------------------------------------------------


def test_there_is_no_gap_where_branches_touch():
    """Equal masses fold a band at the edge of the zone; in the plane they touch at K."""
    assert (
        gp.Phonons(
            table_network(*DIATOMIC[:2], 1.0, *DIATOMIC[3:], dimension=1, motions="longitudinal")
        )
        .gaps()
        .size
        == 0
    )
    assert gp.Phonons(at_overlap(1e-3)).gaps().shape == (0, 2)


@pytest.mark.parametrize(
    ("lattice", "count"),
    [
        ("square", 0),
        ("honeycomb", 0),
        ("kagome", 1),
    ],
)
def test_branches_that_cross_away_from_the_mesh_leave_no_gap(lattice, count):
    ball = gp.Ball(STEEL, 8e-3)
    assert len(gp.Phonons(gp.Crystal.on(lattice, [ball]).at_force(1.0)).gaps()) == count


def test_edges_of_gaps_are_found_between_the_points_of_the_mesh():
    ph = gp.Phonons(random_network("triangular", (1, 2), seed=4))
    coarse = ph.gaps(mesh=(12, 12))
    fine = ph.gaps(mesh=(23, 23))
    assert len(fine) == 2
    assert_allclose(coarse, fine, rtol=1e-9)
    values = ph.frequencies(np.random.default_rng(1).uniform(0.0, 1.0, (300, 2)))
    for low, high in fine:
        assert not np.any((values > low * (1 + 1e-12)) & (values < high * (1 - 1e-12)))


def test_there_is_no_gap_beside_a_peak_that_the_mesh_misses():
    # two branches nearly touch: the lower one rises there above where the upper one is lowest
    kinds = [
        (73.16e9, 0.0393, 0.42564e-3),
        (158.65e9, 0.2826, 0.64773e-3),
        (2.6029e9, 0.1863, 0.64615e-3),
    ]
    balls = [
        gp.Ball(gp.Material(young, poisson, 5e3), 6e-3, mass=mass) for young, poisson, mass in kinds
    ]
    ph = gp.Phonons(gp.Crystal.on("kagome", balls).at_force(1.32))
    peak, hollow = ph.frequencies([[0.43757, 0.66210], [0.13313, 0.76484]])
    assert peak[6] > hollow[7]
    assert len(ph.gaps()) == 2


@pytest.mark.parametrize(
    ("side", "force"), [(2, 0.5), pytest.param(3, 2.0, marks=pytest.mark.slow)]
)
def test_no_frequency_is_within_a_gap_of_a_disordered_sample(side, force):
    """Also near the threshold of rigidity, where a cell of nine balls has many gaps."""
    ball = gp.Ball(STEEL, 8e-3, spread=gp.Uniform(8e-6))
    sample = gp.Crystal.on("triangular", [ball]).sample((side, side), seed=0)
    ph = gp.Phonons(sample.at_force(force))
    gaps = ph.gaps()
    assert len(gaps)
    values = ph.frequencies(np.random.default_rng(0).uniform(-0.5, 0.5, (500, 2)))
    for low, high in gaps:
        assert not np.any((values > low * (1.0 + 1e-9)) & (values < high * (1.0 - 1e-9)))


def test_held_balls_have_a_gap_below_their_lowest_branch():
    held = hold(random_network("square", (1, 2)), [0])
    low, high = gp.Phonons(held).gaps(mesh=(9, 9))[0]
    assert low == 0.0
    assert 0.0 < high < gp.Phonons(held).frequencies([[0.3, 0.2]]).min()


# -- atoms and files -------------------------------------------------------------------------------


def test_atoms_and_files_have_masses_and_kinds(tmp_path):
    salt = rock_salt(2.0, 1.4, (1.0, 3.0))
    atoms = gp.atoms(salt)
    assert atoms.get_chemical_symbols() == ["Fe", "Al"]
    assert_allclose(atoms.get_masses(), [0.5, 1.5])  # of the mean mass
    gp.write_extxyz(tmp_path / "salt.extxyz", atoms)
    again = ase.io.read(tmp_path / "salt.extxyz")
    assert again.get_chemical_symbols() == ["Fe", "Al"]
    assert_allclose(again.arrays["radius"], [0.5, 0.5])
    ph = gp.Phonons(salt)
    assert ph.phonopy.unitcell.symbols == ["Fe", "Sn", "Al", "Sn"]
    bands = ph.bands("GX", npoints=4)
    bands.write(tmp_path / "band.yaml")
    again = gp.Bands.read(tmp_path / "band.yaml")
    assert_allclose(again.masses, bands.masses, rtol=1e-14)
    assert_allclose(again.frequencies, bands.frequencies, rtol=1e-14)
    ph.save(tmp_path / "phonopy_params.yaml")
    bridge, scales = gp.load_phonopy(tmp_path / "phonopy_params.yaml")
    assert scales == salt.scales
    q = np.array([0.1, 0.3, -0.2])
    found = np.linalg.eigvalsh(_matrix(bridge, q))
    assert_allclose(np.sqrt(found) * scales.frequency, ph.frequencies([q])[0], rtol=1e-10)


def _matrix(bridge, q):
    bridge.dynamical_matrix.run(np.pad(q, (0, 3 - len(q))))
    return bridge.dynamical_matrix.dynamical_matrix


@pytest.mark.parametrize("case", CASES)
def test_phonopys_force_constants_have_the_frequencies(case):
    ph = gp.Phonons(CASES[case]())
    for q, wanted in zip(points := random_points(ph, 3), ph.frequencies(points), strict=True):
        found = np.linalg.eigvalsh(_matrix(ph.phonopy, q))
        own = np.sqrt(np.maximum(found, 0.0))[-len(wanted) :] * ph.scales.frequency
        assert_allclose(own, wanted, atol=1e-7 * wanted[-1])
        squares = np.maximum(found, 0.0)[-len(wanted) :] * ph.scales.frequency**2
        assert_allclose(squares, wanted**2, atol=1e-12 * wanted[-1] ** 2)


def test_densities_of_states_count_the_motions():
    for network in (CASES["plane"](), CASES["ribbon along x"](), CASES["held"]()):
        dos = gp.Phonons(network).dos(mesh=(12,) * sum(network.pbc))
        assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(3.0, rel=1e-9)


def test_dispersion_of_a_pulse_in_a_chain_of_two_masses():
    """cos 2q d from the dispersion relation of the diatomic chain."""
    k = 3.0
    m1 = 1.0
    m2 = 2.5
    chain = diatomic_chain()
    omega = 0.9
    found = gp.pulse_velocities(chain, omega / (2 * np.pi), branches="longitudinal")
    cosine = ((2 * k - m1 * omega**2) * (2 * k - m2 * omega**2)) / (2 * k**2) - 1.0
    assert_allclose(found.wavenumber[0], np.arccos(cosine) / 2.0, rtol=1e-12)


# -- what is refused -------------------------------------------------------------------------------


def test_what_has_no_bands_is_one_error():
    state = at_overlap(1e-3)
    for wrong in (None, 3.0, "state", gp.Packing(STEEL, 8e-3)):
        for ask in (
            gp.Phonons,
            gp.sound_velocities,
            gp.moduli,
            gp.atoms,
            lambda x: gp.pulse_velocities(x, 1.0),
        ):
            with pytest.raises(InputError, match="no network of contacts"):
                ask(wrong)
    network = state.network.repeat((3, 3))
    with pytest.raises(InputError, match="repeats along no axis"):
        gp.Phonons(ribbon(network))
    with pytest.raises(InputError, match="holds 2 loads"):
        gp.Phonons(gp.AveragedLattice(state.packing).at_force([1.0, 2.0]))
    for ask in (gp.sound_velocities, gp.moduli, lambda x: gp.pulse_velocities(x, 1.0)):
        with pytest.raises(InputError, match="do not move"):
            ask(hold(network, [0]))
    with pytest.raises(InputError, match="contact law"):
        gp.HertzMindlin(network)
    with pytest.raises(InputError, match="contact law"):
        gp.Phonons(network, gp.atoms(state))


def test_cells_too_large_are_refused_with_an_estimate():
    network = at_overlap(1e-3).network.repeat((75, 75))
    with pytest.raises(InputError, match=r"16875 .*GiB.*gp\.Waves"):
        gp.Phonons(network).frequencies([[0.1, 0.2]])
    some = gp.Phonons(replace(network.select(np.arange(600)), pbc=(False, True, False)))
    with pytest.raises(InputError, match=r"1800 .* 303 .* 14\.6 GiB"):
        some.bands([[0], [0.5]], npoints=303)


@pytest.mark.parametrize("crystal", ["chain of two masses", "kagome", "chain that is held"])
def test_cutoffs_have_the_gaps_among_them(crystal):
    """One search serves both: also the gap below balls that are held, and where the lowest branch
    above a gap overlaps with others.
    """
    if crystal == "kagome":
        balls = [gp.Ball(STEEL, 6e-3, mass=mass) for mass in (0.4e-3, 0.6e-3, 9e-3)]
        network = gp.Crystal.on("kagome", balls).at_force(1.0)
    else:
        network = diatomic_chain()
    if crystal == "chain that is held":
        network = hold(network.repeat((2,)), [0])
    phonons = gp.Phonons(network)
    below, gaps = phonons.find_gaps()
    assert len(gaps)
    among, between = find_gaps_between(phonons.cutoffs())
    assert among.tolist() == below.tolist()
    assert_allclose(between, gaps, rtol=1e-9, atol=1e-12 * gaps.max())


@pytest.mark.claim("cutoffs")
@pytest.mark.parametrize(
    ("lattice", "points"),
    [
        ("chain", 101),
        ("triangular", 41),
        pytest.param("honeycomb", 41, marks=pytest.mark.slow),
        pytest.param("fcc", 15, marks=pytest.mark.slow),
        pytest.param("diamond", 13, marks=pytest.mark.slow),
    ],
)
def test_cutoffs_hold_all_frequencies_of_the_zone(lattice, points):
    """Also where branches cross in cones, as in the honeycomb, of which no point is on a mesh."""
    phonons = gp.Phonons(gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=lattice)).at_force(1.0))
    periods = phonons.lattice.periods
    axes = [np.linspace(0.0, 1.0, points)] * periods
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, periods)
    frequencies = phonons.frequencies(q)
    lower, upper = phonons.cutoffs().T
    rounding = 1e-9 * upper.max()
    assert np.all(frequencies.min(axis=0) >= lower - rounding)
    assert np.all(frequencies.max(axis=0) <= upper + rounding)
    # and they are reached, as near as this mesh comes to them
    assert_allclose(lower, frequencies.min(axis=0), atol=2e-2 * upper.max())
    assert_allclose(upper, frequencies.max(axis=0), atol=2e-2 * upper.max())
