"""Waves at an edge: closed forms, thick ribbons, the sum rule of spectra, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import granphon as gp
from granphon.base.errors import InputError, InstabilityError, PrecisionError
from tests.networks.test_cuts import BALL, bulk, chain, squares

ETA = 0.84


def balls(lattice, motions=None):
    """The network of equal balls of eta = 0.84."""
    network = bulk(lattice, motions)
    return replace(network, shear_stiffness=ETA * network.normal_stiffness)


def ratio(surface, qd):
    """omega/q of the lowest wave along x over d (k/m)^1/2."""
    along = surface.cell[:, 0] / BALL.diameter * qd / (2.0 * np.pi)
    lowest = surface.branches([along])[0][0]
    return 2.0 * np.pi * lowest / (qd / BALL.diameter) / surface.network.scales.velocity


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.claim("edge-chain")
@pytest.mark.parametrize("edge", ["clamped", "floor"])
def test_the_state_at_the_end_of_an_alternating_chain(edge):
    weak = 1e6
    strong = 3e6
    mass = BALL.mass
    found = gp.Surface(chain([mass, mass], (weak, strong)), 0, edge).branches()
    assert_allclose((2.0 * np.pi * found[0]) ** 2, (weak + strong) / mass, rtol=1e-12)
    # it decays as weak/strong from cell to cell
    assert_allclose(found.weight, 1.0 - (weak / strong) ** 2, rtol=1e-7)
    assert len(gp.Surface(chain([mass, mass], (strong, weak)), 0, edge).branches()[0]) == 0


@pytest.mark.claim("edge-chain")
def test_the_state_at_the_light_end_of_a_chain():
    light = 9.75e-3
    heavy = 28.84e-3
    k = 2e7
    found = gp.Surface(chain([light, heavy], (k, k)), 0).branches()[0]
    assert_allclose((2.0 * np.pi * found) ** 2, k * (1.0 / light + 1.0 / heavy), rtol=1e-12)
    assert not len(gp.Surface(chain([heavy, light], (k, k)), 0).branches()[0])


@pytest.mark.claim("rayleigh")
def test_the_velocity_along_a_free_edge_of_the_triangular_lattice():
    surface = gp.Surface(balls("triangular"), 1)
    limit = surface.velocity() / surface.network.scales.velocity
    assert_allclose(limit, 0.7324621, atol=5e-8)
    # isotropic: Rayleigh's equation with the plane's two velocities
    sound = gp.sound_velocities(surface.network)
    ratio_squared = (sound.transverse / sound.longitudinal) ** 2

    def rayleigh(x):
        return (2.0 - x) ** 2 - 4.0 * np.sqrt((1.0 - x) * (1.0 - ratio_squared * x))

    assert_allclose(
        surface.velocity(),
        sound.transverse * np.sqrt(brentq(rayleigh, 0.1, 1.0 - 1e-12, xtol=1e-15)),
        rtol=1e-11,
    )
    # the lattice's own correction is of first order in q
    slopes = [(ratio(surface, qd) - limit) / qd for qd in (4e-2, 2e-2, 1e-2)]
    assert_allclose(slopes[2] - slopes[1], 0.5 * (slopes[1] - slopes[0]), atol=2e-5)
    assert_allclose(slopes[2], -0.0321, atol=2e-4)


@pytest.mark.claim("rayleigh")
@pytest.mark.parametrize(
    ("lattice", "axis", "value"), [("sc", 2, 0.5866445), ("fcc", (1, 1, 0), 0.8379032)]
)
def test_the_velocity_on_a_cube_face_along_its_edge(lattice, axis, value):
    surface = gp.Surface(balls(lattice), axis)
    tensor = gp.moduli(surface.network).tensor
    c11 = tensor[0, 0]
    c12 = tensor[0, 1]
    c44 = tensor[3, 3]
    density = np.sum(surface.network.masses) / abs(np.linalg.det(surface.network.cell))

    def stoneley(x):  # R. Stoneley, Proc. R. Soc. A 232, 447 (1955)
        return c11 * (c44 - x) * (c11 - c12**2 / c11 - x) ** 2 - c44 * (c11 - x) * x**2

    expected = np.sqrt(brentq(stoneley, 1e-6 * c44, c44, xtol=1e-15 * c44) / density)
    assert_allclose(surface.velocity([1.0, 0.0, 0.0]), expected, rtol=1e-11)
    assert_allclose(expected / surface.network.scales.velocity, value, atol=5e-8)
    assert_allclose(ratio(surface, 1e-3), value, rtol=1e-4)


# -- a thick ribbon --------------------------------------------------------------------------------


@pytest.mark.claim("edge-ribbon")
@pytest.mark.parametrize(
    ("lattice", "axis", "layers", "q"),
    [
        ("triangular", 1, 60, 0.5 / np.pi),
        ("honeycomb", 1, 26, 0.35),
        ("honeycomb", (1, 1), 26, 0.35),
        ("square", (1, 1), 60, 0.2),
    ],
)
def test_waves_outside_the_bands_are_those_of_a_thick_ribbon(lattice, axis, layers, q):
    network = balls(lattice)
    surface = gp.Surface(network, axis)
    ribbon = gp.Phonons(network.cut(axis, layers)).frequencies([[q]])[0]
    bands = surface.continuum([[q]])[0]
    outside = ~np.any((bands[:, :1] - 1.0 <= ribbon) & (ribbon <= bands[:, 1:] + 1.0), axis=0)
    found = surface.branches([[q]])
    lone = found.frequencies[found.weight > 0.3]
    assert lone.size
    for one in lone:
        # both edges of the ribbon have it, and part it in two by how far they feel each other
        pair = np.sort(np.abs(ribbon / one - 1.0))[:2]
        nearest = ribbon[np.argsort(np.abs(ribbon - one))[:2]]
        assert pair[1] < (1e-9 if lattice == "triangular" else 1e-6)
        assert_allclose(nearest.mean(), one, rtol=1e-9)
    assert np.sum(outside & (ribbon > 1.0)) <= 2 * len(found[0])


def test_motions_that_cost_nothing_are_no_waves():
    # kagome on a floor has free motions at its edge and in the bulk: rounding does not lift them to
    # a few tenths of a hertz
    network = bulk("kagome", "out_of_plane")
    q = np.array([[0.005], [0.014]])
    found = gp.Surface(network, 0, "floor").branches(q)
    ribbon = gp.Phonons(network.cut(0, 20, ("floor", "free"))).frequencies(q)
    assert np.min(found.frequencies) > 0.9 * np.min(ribbon[ribbon > 1.0])
    assert np.all(found.weight > 0.0)


def test_the_energy_on_top_is_that_of_a_ribbon():
    network = balls("triangular")
    found = gp.Surface(network, 1).branches([[0.4]])
    bands = gp.Phonons(network.cut(1, 20)).modes([[0.4]])
    at = int(np.argmin(np.abs(bands.frequencies[0] - found[0][0])))
    kinetic = np.sum(np.abs(bands.eigenvectors[0, :, at].reshape(20, 3)) ** 2, axis=1)
    assert_allclose(found.weight[0], kinetic[0] + kinetic[-1], rtol=1e-5)


def test_leaky_waves_are_peaks_of_the_spectrum():
    surface = gp.Surface(balls("fcc"), (1, 1, 0))
    q = [[0.3, 0.0]]
    found = surface.branches(q, leaky=True)
    narrow = int(np.argmin(np.where(found.widths > 1.0, found.widths, np.inf)))
    centre = found.frequencies[narrow]
    width = found.widths[narrow]
    f = np.linspace(centre - 3.0 * width, centre + 3.0 * width, 301)
    values = surface.spectrum(q, f, damping=1e-3 * width).by_motion[0].max(axis=1)
    assert abs(f[np.argmax(values)] - centre) < 0.3 * width


# -- spectra ---------------------------------------------------------------------------------------


@pytest.mark.claim("edge-weight")
@pytest.mark.parametrize(
    ("lattice", "axis", "q"), [("fcc", (1, 1, 1), [[0.2, 0.1]]), ("honeycomb", 1, [[0.3]])]
)
def test_the_weight_of_the_outer_layer_integrates_to_one(lattice, axis, q):
    surface = gp.Surface(balls(lattice), axis)
    top = surface.continuum(q).max()
    x, weight = np.polynomial.legendre.leggauss(400)
    angle = 0.25 * np.pi * (x + 1.0)
    spectrum = surface.spectrum(q, top * np.tan(angle), damping=0.08 * top)
    measure = 0.25 * np.pi * weight * top / np.cos(angle) ** 2
    assert_allclose(spectrum.by_motion[0].T @ measure, 1.0, atol=1e-6)
    assert_allclose(np.asarray(spectrum)[0] @ measure, 1.0, atol=1e-6)


def follow_pole(own, inner, hop, w):
    """Return the root near w of the outgoing waves of a half space, which are followed below the
    real axis.
    """
    import scipy.linalg
    from scipy.optimize import linear_sum_assignment

    m = len(own)

    def waves(w):
        zero, one = np.zeros((m, m)), np.eye(m)
        left = np.block([[zero, one], [-hop.conj().T, w * one - inner]])
        values, vectors = scipy.linalg.eig(left, np.block([[one, zero], [zero, hop]]))
        return values, vectors[:m]

    values, _ = waves(w.real + 1e-9j * w.real)
    kept = values[np.argsort(np.abs(values))[:m]]

    def mismatch(w, kept):
        values, vectors = waves(w)
        picked = linear_sum_assignment(np.minimum(np.abs(values - kept[:, None]), 10.0))[1]
        matrix = (own - w * np.eye(m)) @ vectors[:, picked] + hop @ vectors[:, picked] * values[
            picked
        ]
        return np.linalg.det(matrix / np.linalg.norm(vectors[:, picked], axis=0)), values[picked]

    for step in np.linspace(0.0, 1.0, 17)[1:]:
        _, kept = mismatch(w.real + 1j * step * w.imag, kept)
    points = [w, w * (1.0 + 1e-6)]
    for _ in range(20):  # secants
        (f, _), (g, _) = (mismatch(one, kept) for one in points)
        if f == g or abs(points[1] - points[0]) < 1e-14 * abs(w):
            break
        points = [points[1], points[1] - g * (points[1] - points[0]) / (g - f)]
    return points[1]


@pytest.mark.claim("leaky")
@pytest.mark.parametrize(
    ("lattice", "axis", "q"),
    [
        ("fcc", (1, 1, 0), [0.3, 0.0]),
        pytest.param("triangular", (1, 1), [0.2], marks=pytest.mark.slow),
        ("square", (1, 1), [0.3]),
    ],
)
def test_leaky_waves_are_roots_of_outgoing_waves(lattice, axis, q):
    surface = gp.Surface(balls(lattice), axis)
    found = surface.branches([q], leaky=True)
    first = np.flatnonzero(found.widths > 0.0)[0]
    frequency = found.frequencies[first]
    width = found.widths[first]
    unit = surface.half_space.units.frequency
    blocks = surface.half_space.blocks(np.array([q]))
    root = follow_pole(*(one[0] for one in blocks), ((frequency - 0.5j * width) / unit) ** 2)
    expected = np.sqrt(root) * unit
    assert_allclose(
        [frequency, 0.5 * width], [expected.real, -expected.imag], rtol=0.0, atol=1e-5 * width
    )


@pytest.mark.claim("leaky")
@pytest.mark.parametrize("q", [pytest.param(0.02, marks=pytest.mark.slow), 0.33])
def test_leaky_waves_near_extremes_inside_of_bands(q):
    # two kinds of balls, whose bands have extremes between their ends: a polynomial across one of
    # them tells no width
    light = gp.Ball(gp.Material(70e9, 0.33, 2700.0), 8e-3)
    crystal = (
        gp.Crystal.on("triangular", [gp.Ball(gp.Material(193e9, 0.3, 8000.0), 8e-3)])
        .repeat((2, 1))
        .replace(0, light)
    )
    surface = gp.Surface(crystal.at_overlap(1e-6), 1)
    found = surface.branches([[q]], leaky=True)
    unit = surface.half_space.units.frequency
    blocks = surface.half_space.blocks(np.array([[q]]))
    leaks = np.flatnonzero(found.widths > 0.0)
    assert len(leaks) == 3
    for at in leaks:
        frequency = found.frequencies[at]
        width = found.widths[at]
        root = follow_pole(*(one[0] for one in blocks), ((frequency - 0.5j * width) / unit) ** 2)
        expected = np.sqrt(root) * unit
        assert_allclose(
            [frequency, 0.5 * width], [expected.real, -expected.imag], rtol=0.0, atol=1e-5 * width
        )


def test_a_spectrum_is_that_of_a_long_column():
    # of the end of a chain: the response of the first ball of many, damped in the same way
    network = gp.Crystal.on("chain", [BALL]).at_force(10.0).network
    surface = gp.Surface(network, 0)
    f = np.linspace(300.0, 3e4, 50)
    count = 700
    unit = network.scales.frequency
    width = 2e3
    matrix = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    matrix[0, 0] = 1.0
    values, vectors = np.linalg.eigh(matrix)
    w = (f / unit) ** 2 + 1j * f * width / unit**2
    green = np.sum(vectors[0] ** 2 / (w[:, None] - values), axis=1)
    assert_allclose(
        surface.spectrum(None, f, width).values[0],
        -2.0 / np.pi * f / unit**2 * green.imag,
        rtol=1e-9,
    )


def test_bands_of_a_cut_say_how_much_is_at_each_edge():
    network = balls("triangular")
    bands = gp.Phonons(network.cut(1, 16)).bands(npoints=11)
    assert bands.edge_weight.shape == (1, 11, 48, 2)
    for kept in (bands.edge_weight, bands.connection, gp.Surface(network, 1).cell):
        assert not kept.flags.writeable
    lowest = bands.edge_weight[0, 8, :2]
    assert_allclose(np.sort(lowest, axis=0)[1], 1.0, atol=1e-2)  # one at each edge
    assert_allclose(np.sort(lowest, axis=0)[0], 0.0, atol=1e-6)
    # eight of sixteen layers
    assert_allclose(bands.edge_weight.sum(axis=(2, 3)), 2 * 4 * 3, rtol=1e-9)
    for crystal in (network, balls("hcp")):  # of hcp a cell has balls at two heights
        with pytest.raises(InputError, match="no edges"):
            gp.Phonons(crystal).bands(npoints=2).edge_weight  # noqa: B018


def test_motions_that_cost_nothing_are_counted():
    bands = gp.Phonons(balls("honeycomb", "out_of_plane").cut(1, 10)).bands(npoints=5)
    assert bands.warnings[0].startswith("31 of 60 branches")


def test_a_branch_is_followed():
    surface = gp.Surface(balls("triangular"), 1)
    q = np.linspace(0.1, 0.5, 9)[:, None]
    found = surface.branches(q)
    assert_allclose(
        surface.follow(q, 1.01 * found[0][0]), [found[at][0] for at in range(9)], rtol=1e-12
    )


# -- topology --------------------------------------------------------------------------------------


@pytest.mark.claim("zak")
def test_the_zak_phase_counts_the_states_at_the_end_of_a_chain():
    mass = BALL.mass
    cases = [
        (gp.Surface(chain([mass, mass], springs), 0, edge), waves)
        for edge in ("clamped", "floor")
        for springs, waves in (((1e6, 3e6), 1), ((3e6, 1e6), 0))
    ]
    cases += [
        (gp.Surface(chain(masses, (2e7, 2e7)), 0), waves)
        for masses, waves in (([1e-2, 3e-2], 1), ([3e-2, 1e-2], 0))
    ]
    for surface, waves in cases:
        assert_allclose(surface.zak_phase(), np.pi * waves, atol=1e-10)
        assert len(surface.branches()[0]) == waves
    # rounding makes no 2 pi of a phase of zero
    assert_allclose(
        gp.Surface(balls("triangular"), 1, "clamped").zak_phase(np.linspace(0.2, 0.4, 21)[:, None]),
        0.0,
    )


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_the_zak_phase_is_that_of_the_motions_under_static_forces_too(finite_overlap):
    light, heavy = (
        gp.Ball(gp.Material(70e9, 0.33, density), 8e-3) for density in (2700.0, 12000.0)
    )
    crystal = (
        gp.Crystal.on("triangular", [light])
        .repeat((1, 3))
        .replace(1, heavy)
        .replace(2, gp.Ball(BALL.material, 8e-3))
    )
    surface = gp.Surface(crystal.at_overlap(4e-4, finite_overlap=finite_overlap), 1, "clamped")
    assert surface.network.prestress == finite_overlap
    _, inner, hop = (one[0] for one in surface.half_space.blocks(np.array([[0.2]])))
    below = 6
    turns = np.exp(2j * np.pi * np.arange(256) / 256)[:, None, None]
    _, vectors = np.linalg.eigh(inner + turns * hop + turns.conj() * hop.conj().T)
    above = vectors[:, :, below:]
    steps = np.linalg.det(above.conj().swapaxes(1, 2) @ np.roll(above, -1, axis=0))
    expected = -np.angle(np.prod(steps / np.abs(steps))) % (2.0 * np.pi)
    assert_allclose(surface.zak_phase([[0.2]], below), expected, atol=1e-9)
    assert 0.1 < expected < 6.2


def pressed_square():
    """Equal balls under static forces that act."""
    packing = gp.Packing(BALL.material, 8e-3, lattice="square", friction=True)
    return gp.AveragedLattice(packing).at_overlap(1e-6, finite_overlap=True)


def listed_size(network, axis):
    """Motions of the outer layers, as many as contacts reach across."""
    return gp.Surface(network, axis).half_space.size


def twisted_kagome(angle):
    """Kagome whose triangles are turned against each other: isostatic without friction."""
    cell = 2.0 * np.cos(angle) * np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)]])
    turns = 0.5 * np.pi + angle + 2.0 * np.pi / 3.0 * np.arange(3)
    sites = np.stack([np.cos(turns), np.sin(turns)], axis=1) / np.sqrt(3.0)
    contacts = gp.Crystal([gp.Ball(BALL.material, 1.0)] * 3, cell, sites).contacts
    return gp.ContactLattice(cell, sites, contacts, 0.0).contact_network(
        gp.Units(8e-3, 1e6, 1e-3), 1.0
    )


@pytest.mark.claim("zak")
@pytest.mark.parametrize(
    "axis",
    [
        (0, 1),
        pytest.param((1, 1), marks=pytest.mark.slow),
        pytest.param((2, 1), marks=pytest.mark.slow),
    ],
)
def test_the_winding_counts_the_motions_at_the_edges_that_cost_nothing(axis):
    network = twisted_kagome(0.3)
    winding = (
        gp.Surface(network, axis).winding([[0.13], [0.31]]),
        gp.Surface(network, [-one for one in axis]).winding([[0.13]]),
    )
    free = np.sum(gp.Phonons(network.cut(axis, 6)).frequencies([[0.13]]) < 1.0)
    assert winding[0][0] == winding[0][1]
    assert winding[0][0] + winding[1][0] == free
    listed = gp.Surface(network, axis).branches([[0.13], [0.31]], free=True)
    assert [np.sum(listed[at] == 0.0) for at in range(2)] == winding[0].tolist()
    # a motion that decays from layer to layer, as the ribbon has it
    ribbon = gp.ContactLattice.from_network(network.cut(axis, 40))
    values, vectors = np.linalg.eigh(ribbon.dynamical_matrix(ribbon.wavevectors([[0.13]]))[0])
    still = vectors[:, values < 1e-12 * values[-1]]
    top = still[: listed_size(network, axis)]
    parts = np.linalg.eigvalsh(top @ top.conj().T)[::-1]
    mine = np.sort(listed.weight[(listed.place == 0) & (listed.frequencies == 0.0)])[::-1]
    assert_allclose(parts[: len(mine)], mine, atol=5e-5)
    assert winding[0][0] > 0


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gp.Surface(bulk("square"), 2), "axis is 2"),
        (lambda: gp.Surface(bulk("square").cut(0, 3).cut(0, 3), 0), "no period"),
        (lambda: gp.Surface(bulk("square"), 0, "glued"), "allowed: free, clamped, floor"),
        (
            lambda: gp.Surface(
                replace(bulk("square", "out_of_plane"), shear_stiffness=np.zeros(2)), 0
            ),
            "deform no contact",
        ),
        (lambda: gp.Surface(3, 0), "no network of contacts"),
        (lambda: gp.Surface(bulk("square"), 0).branches([[0.1, 0.1]]), "shape (1, 2)"),
        (lambda: gp.Surface(bulk("square"), 0).branches([[0.1, 0.1, 0.0]]), "leaves the edge"),
        (
            lambda: gp.Surface(bulk("fcc"), 2).follow([[0.2, 0.0]], 3e4),
            "lies inside of",
        ),
        (lambda: gp.Surface(bulk("triangular"), 1).follow([[0.2]], 1e6), "no wave"),
        (lambda: gp.Surface(bulk("triangular"), 1, "clamped").velocity(), "held"),
        (lambda: gp.Surface(bulk("triangular", "out_of_plane"), 1).velocity(), "do not move along"),
        (lambda: gp.Surface(bulk("chain"), 0).velocity(), "edge of a chain"),
        (lambda: gp.Surface(bulk("square"), 0).branches([[0.1]], leaky="no"), "true or false"),
        (lambda: gp.Surface(bulk("square"), 0).map(2, leaky=0), "true or false"),
        (lambda: gp.Surface(bulk("fcc"), 2).velocity([0.0, 0.0]), "not both zero"),
        (
            lambda: gp.Surface(bulk("triangular"), 0).winding([[0.1]]),
            "6 deformations of",
        ),
        (lambda: gp.Surface(bulk("honeycomb"), 0).winding([[0.1]]), "det C vanishes"),
        (
            lambda: gp.Surface(bulk("triangular"), 1).zak_phase([[0.0]]),
            "above the lowest branch closes",
        ),
        (
            lambda: gp.Surface(pressed_square(), 0).zak_phase([[0.1]]),
            "static forces",
        ),
        (lambda: gp.Surface(bulk("square"), 0).spectrum([[0.1]], [1.0]), "no step"),
        (lambda: gp.Surface(bulk("square"), 0).spectrum([[0.1]], [-1.0, 1.0]), "frequencies"),
    ],
)
def test_what_is_refused(make, said):
    with pytest.raises(InputError) as caught:
        make()
    assert said in str(caught.value)


def test_layers_that_nothing_joins():
    network = bulk("square")
    rows = replace(
        network,
        **{
            name: getattr(network, name)[network.shift[:, 1] == 0]
            for name in network.contact_fields
        },
    )
    with pytest.raises(InputError, match="joins the layers"):
        gp.Surface(rows, 1)


def test_a_square_lattice_twin_of_a_held_ribbon():
    network = balls("square")
    surface = gp.Surface(network, 1, "floor")
    cut = squares(network.cut(1, 120, "floor"), [[0.45]])[0]
    found = surface.branches([[0.45]])
    assert np.any(found.weight > 0.1)
    for one in found.frequencies[found.weight > 0.1]:
        assert np.min(np.abs(cut / (2.0 * np.pi * one) ** 2 - 1.0)) < 1e-8


def test_a_sample_with_loose_balls_says_how_to_leave_them_out():
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, spread=gp.Uniform(2e-6))
    network = gp.DirectSimulation(packing, shape=(6, 6), seed=0).at_force(0.2).sample.network
    with pytest.raises(
        InputError, match=r"pieces .*clusters, .* 1 in each cell .*without_rattlers"
    ):
        gp.Surface(network, 1)
    assert gp.Surface(network.without_rattlers(), 1).half_space is not None


def test_wave_vectors_that_are_not_finite_are_named():
    surface = gp.Surface(balls("square"), 1)
    with pytest.raises(InputError, match="not finite"):
        surface.branches([[np.nan]])
    with pytest.raises(InputError, match=r"have the shape \(1, 4\)"):
        surface.branches([[0.1, 0.0, 0.0, 0.0]])


def test_a_surface_refuses_errors_of_other_waves_and_frequencies_without_a_step(tmp_path):
    surface = gp.Surface(bulk("square"), 1)
    waves = surface.map(npoints=3, frequencies=np.linspace(0.0, 1e4, 4))
    for name in ("errors", "weight_errors"):
        with pytest.raises(InputError, match=name):
            waves.write_csv(tmp_path / "waves.csv", **{name: np.ones(99)})
    assert not list(tmp_path.iterdir())
    for frequencies in ([5.0], [5.0, 5.0]):
        with pytest.raises(InputError, match="no step"):
            surface.spectrum([[0.1]], frequencies)


# -- refusals at the edges of what is allowed ------------------------------------------------------


def test_wave_vectors_without_digits_are_refused():
    surface = gp.Surface(balls("triangular"), 1)
    with pytest.raises(PrecisionError, match="reciprocal"):
        surface.branches([[1e300]])
    with pytest.raises(PrecisionError, match="reciprocal"):
        surface.continuum([[1.7e308]])


def test_a_crystal_that_buckles_has_no_spectrum():
    network = bulk("triangular")
    pushed = replace(
        network,
        normal_force=0.9 * network.normal_stiffness * network.distance,
        prestress=True,
    )
    surface = gp.Surface(pushed, 1)
    for find in (surface.continuum, surface.branches, lambda q: surface.spectrum(q, [1.0, 2.0])):
        with pytest.raises(InstabilityError, match="buckles"):
            find([[0.25]])
    assert np.all(surface.continuum([[0.5]]) > 0.0)


def test_messages_count_what_there_is_one_of():
    surface = gp.Surface(balls("triangular"), 1)
    assert "1 ball in" in repr(surface)
    with pytest.raises(InputError, match="1 period"):
        surface.branches([[0.1, 0.1]])
    one_ball = gp.Crystal.on("chain", [BALL], law=gp.PowerLaw(1.0, 1e6)).at_force(10.0)
    with pytest.raises(InputError, match="one branch"):
        gp.Surface(one_ball, 0).zak_phase()


def test_numbers_of_waves_and_of_points_are_whole():
    surface = gp.Surface(balls("triangular"), 1)
    waves = surface.along_path(2)
    with pytest.raises(TypeError):
        waves[0:2]
    for npoints in ([2], 2.0):
        with pytest.raises(InputError, match="npoints"):
            surface.along_path(npoints)
