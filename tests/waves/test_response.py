"""The response in frequency: against closed forms of chains, matrices made contact by contact,
pulses, and LAMMPS.
"""

import math
import pickle
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq, minimize_scalar

import granphon as gp
from granphon.balls.contact_model import ContactModel
from granphon.base.errors import ConvergenceError, InputError, PrecisionError
from granphon.waves.response import _KrylovProcess, _Space
from tests import packings

UNITS = gp.Units(8e-3, 3e6, 2e-3)
D = UNITS.length
OMEGA = UNITS.angular_frequency
#: (k/M)^1/2 / 2 pi, Hz, and (k M)^1/2, N s/m
HERTZ = OMEGA / (2.0 * np.pi)
VISCOSITY = UNITS.stiffness / OMEGA


def times(network, c_n, c_t=None):
    """The damping of dashpots of these viscosities, N s/m: of normal motion, and of slip."""
    normal = c_n / network.normal_stiffness
    return normal if c_t is None else (normal, c_t / network.shear_stiffness)


def ideal(name, mindlin_ratio=0.8, **more):
    return gp.ContactLattice.of(name, mindlin_ratio, **more).contact_network(UNITS)


def springs(network):
    """The network, pressed, with a floor of its own stiffness: that of springs which are the same
    whatever they join.
    """
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), D)
    model = ContactModel((ball,), law=gp.PowerLaw(1.0, UNITS.stiffness))
    return replace(network, contact_model=model, normal_force=np.ones(network.n_contacts))


def chain(count, edges="free"):
    return springs(ideal("chain", 0.0)).cut(0, count, edges)


@pytest.fixture(scope="module")
def strip():
    """A triangular strip on a floor, under static forces, whose contacts differ."""
    network = springs(ideal("triangular")).repeat((4, 1)).cut(1, 5, ("floor", "free"))
    rng = np.random.default_rng(3)
    normal = rng.uniform(0.5, 1.5, network.n_contacts) * UNITS.stiffness
    return replace(
        network,
        normal_stiffness=normal,
        shear_stiffness=rng.uniform(0.5, 0.9, normal.size) * normal,
        prestress=True,
        normal_force=rng.uniform(0.0, 0.02, normal.size) * UNITS.stiffness * D,
    )


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.claim("response-chain")
@pytest.mark.parametrize("edge", ["clamped", "floor"])
def test_chain_on_a_moved_wall_inside_and_above_its_band(edge):
    # u_n = (cos((N - n + 1/2) t)/cos((N + 1/2) t)) u_0 with omega = 2 sin(t/2), complex above the
    # band
    count = 14
    network = chain(count + 1, (edge, "free"))
    wall = int(np.flatnonzero(~network.moving)[0])
    balls = count if edge == "clamped" else count + 1
    omega = np.array([0.0, 0.21, 0.8, 1.43, 1.99, 2.03, 2.4, 3.1])
    found = gp.Waves(network).response(
        omega * HERTZ,
        (wall, "x"),
        (np.flatnonzero(network.moving), (1.0,)),
        quantity="transmissibility",
    )
    t = 2.0 * np.arcsin(omega[:, None] / 2.0 + 0j)
    places = 1 + np.arange(balls)
    expected = np.cos((balls - places + 0.5) * t) / np.cos((balls + 0.5) * t)
    assert found.values.shape == (omega.size, balls)
    assert_allclose(found.values, expected, rtol=1e-10)
    assert np.max(found.error) < 1e-11
    assert not found.warnings
    by_plane = gp.Waves(network).response(
        omega * HERTZ, "plane", "plane", quantity="transmissibility"
    )
    assert_allclose(by_plane.coherent, expected[:, -1], rtol=1e-10)


@pytest.mark.claim("response-peaks")
@pytest.mark.parametrize(
    ("points", "method"),
    [
        (90, "direct"),
        pytest.param(400, "direct", marks=pytest.mark.slow),
        pytest.param(90, "krylov", marks=pytest.mark.slow),
        (400, "krylov"),
    ],
)
def test_peaks_do_not_depend_on_the_grid(points, method):
    """Lines narrower than the step are solved for between its points: heights and Q are those of
    the damped modes.
    """
    waves = gp.Waves(chain(9, ("clamped", "free")))
    receivers = [(8, "x"), (5, "x")]
    top = 2.0 * HERTZ
    damping = 4e-5 / OMEGA
    coarse = waves.response(
        np.linspace(0.04, 1.02, points) * top, (8, "x"), receivers, damping=damping, method=method
    )
    modes = waves.damped_modes(8, damping=damping)
    assert np.max(modes.frequencies.real / modes.quality) < 0.1 * np.diff(coarse.frequencies)[0]
    for receiver, peaks in enumerate(coarse.peaks):
        assert peaks.frequencies.size == 8
        assert_allclose(peaks.frequencies, modes.frequencies.real, rtol=1e-6)
        assert_allclose(peaks.quality, modes.quality, rtol=1e-3)
        at_peaks = waves.response(peaks.frequencies, (8, "x"), receivers[receiver], damping=damping)
        assert_allclose(peaks.heights, at_peaks.magnitude[:, 0], rtol=1e-5)
    # a copy has no network to solve for what lies between its frequencies
    copied = pickle.loads(pickle.dumps(coarse))
    assert copied == coarse
    assert np.all(np.isnan(copied.peaks[0].heights))


@pytest.mark.parametrize(
    "losses",
    [
        pytest.param({"dashpot": 1e30}, marks=pytest.mark.slow),
        {"dashpot": 1e6},
        pytest.param({"damping": 1e30}, marks=pytest.mark.slow),
        {"loss_factor": 1e6},
    ],
)
def test_the_magnitude_of_a_rigid_row_has_no_lines(losses):
    """Contacts far stiffer than their springs pass on the force whole: the magnitude has highest
    values that are rounding, or a peak that is flat.
    """
    waves = gp.Waves(chain(9, ("clamped", "free")))
    frequencies = np.linspace(0.0, 2.0, 10) * HERTZ
    force = waves.response(frequencies, (8, "x"), [(3, 4), (5, 6)], quantity="force", **losses)
    for peaks in force.peaks:
        heights = peaks.heights[np.isfinite(peaks.heights)]
        assert_allclose(heights, 1.0, rtol=1e-4)
        assert not np.any(peaks.quality > 1e-3)


@pytest.mark.claim("response-peaks")
@pytest.mark.parametrize(
    "tau", [0.005, 0.03, pytest.param(0.1, marks=pytest.mark.slow), 0.5], ids=str
)
def test_broad_peaks_are_those_of_the_closed_form(tau):
    """The transmissibility of a chain, of which a hundred frequencies see each peak: its maximum
    and its width at half the square by SciPy. Q is that of the modes where these are apart.
    """
    count = 5
    waves = gp.Waves(chain(count + 1, ("clamped", "free")))
    omega = np.linspace(0.1, 2.2, 100)
    found = waves.response(
        omega * HERTZ, "plane", (count, "x"), tau / OMEGA, quantity="transmissibility"
    )

    def magnitude(w):
        t = 2.0 * np.arcsin(w / 2.0 / np.sqrt(1.0 + 1j * w * tau))
        return np.abs(np.cos(t / 2.0) / np.cos((count + 0.5) * t))

    assert_allclose(found.magnitude[:, 0], magnitude(omega), rtol=1e-9)
    dense = np.linspace(0.1, 2.2, 100_001)
    heights = magnitude(dense)
    tops = 1 + np.flatnonzero((heights[1:-1] > heights[:-2]) & (heights[1:-1] > heights[2:]))
    peaks = found.peaks[0]
    assert peaks.frequencies.size == tops.size
    for number, top in enumerate(tops.tolist()):
        bounds = dense[top - 1], dense[top + 1]
        best = minimize_scalar(
            lambda w: -magnitude(w), bounds=bounds, method="bounded", options={"xatol": 1e-10}
        )
        assert_allclose(peaks.frequencies[number], best.x * HERTZ, rtol=1e-6)
        assert_allclose(peaks.heights[number], -best.fun, rtol=1e-8)
        half = -best.fun * math.sqrt(0.5)
        ends = []

        def exceed(w, half=half):
            return magnitude(w) - half

        for side in (-1, 1):
            fall = heights[top::side]
            low = np.argmax((fall < half) | np.append(np.diff(fall) > 0.0, True))
            at = top + side * int(low)
            if heights[at] < half:
                ends.append(brentq(exceed, dense[at - side], dense[at]))
        quality = best.x / (ends[1] - ends[0]) if len(ends) == 2 else np.nan
        assert_allclose(peaks.quality[number], quality, rtol=1e-6)
    modes = waves.damped_modes(1, damping=tau / OMEGA)
    if modes.quality[0] > 100.0:
        assert_allclose(peaks.quality[0], modes.quality[0], rtol=1e-3)


def test_one_ball_on_a_spring_and_a_dashpot():
    network = chain(2, ("clamped", "free"))
    omega = np.array([0.0, 0.3, 1.0, 4.0])
    c = 0.3
    eta = 0.1
    found = [
        gp.Waves(network).response(
            omega * HERTZ, (source, "x"), (1, "x"), c / OMEGA, eta, quantity=name
        )
        for source, name in ((1, "displacement"), (1, "velocity"), (0, "transmissibility"))
    ]
    spring = 1.0 + 1j * (eta + omega * c)
    receptance = 1.0 / (spring - omega**2)
    assert_allclose(found[0].values[:, 0] * UNITS.stiffness, receptance, rtol=1e-13)
    assert_allclose(found[1].values[:, 0] * VISCOSITY, 1j * omega * receptance, rtol=1e-13)
    assert_allclose(found[2].values[:, 0], spring * receptance, rtol=1e-13)
    steps = gp.Waves(network).response(
        omega[1:] * HERTZ, (1, "x"), (1, "x"), c / OMEGA, eta, method="krylov"
    )
    assert steps.steps == 1
    assert_allclose(steps.values, found[0].values[1:], rtol=1e-13)
    assert_allclose(found[0].phase[:, 0], np.angle(receptance))
    assert [one.to_dict()["units"]["values"] for one in found] == ["m/N", "m/(N s)", "1"]
    again = gp.Response.from_dict(found[0].to_dict())
    assert again == found[0]
    assert np.array_equal(np.asarray(again), found[0].values)


@pytest.mark.parametrize("method", ["direct", "krylov"])
def test_error_next_to_a_mode_has_the_rounding_of_the_frequency(method):
    network = chain(2, ("clamped", "free"))
    eta = 2.0**-41
    stiffness = Fraction(network.normal_stiffness[0])
    mass = Fraction(network.masses[1])
    hertz = HERTZ * (1.0 + np.geomspace(1e-12, 1e-6, 7))
    found = gp.Waves(network).response(hertz, (1, "x"), (1, "x"), loss_factor=eta, method=method)
    two_pi = 2 * Fraction("3.14159265358979323846264338327950288")
    lost = stiffness * Fraction(eta)
    rest = [stiffness - mass * (two_pi * Fraction(one)) ** 2 for one in hertz.tolist()]
    exact = np.array(
        [complex(one / (one**2 + lost**2), -lost / (one**2 + lost**2)) for one in rest]
    )
    assert np.all(np.abs(found.values[:, 0] / exact - 1.0) <= 2.0 * found.error)
    rounding = found.error * np.hypot(2.0 * (hertz / HERTZ - 1.0), eta)
    assert np.all((rounding > 1e-16) & (rounding < 2e-15))
    assert "hardly loses" in found.warnings[0]


@pytest.mark.claim("local-dos-chain")
def test_local_density_at_the_free_end_of_a_chain_to_second_order_of_the_resolution():
    # (2/pi)(1 - omega^2/4)^1/2 of a half-infinite chain; the echo of the other end comes after as
    # many moments as balls
    waves = gp.Waves(chain(800))
    omega = np.linspace(0.05, 1.95, 20)
    errors = []
    for moments in (200, 400, 800):
        density = waves.local_dos(0, omega * HERTZ, moments=moments)
        errors.append(
            np.max(
                np.abs(density.values[:, 0] * HERTZ - 2.0 / np.pi * np.sqrt(1.0 - omega**2 / 4.0))
            )
        )
    assert errors[-1] < 1e-5
    assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.02)
    assert density.letters == ("x",)


@pytest.mark.parametrize("damping", [0.3, 1.9, 2.1])
def test_modes_of_one_ball_swing_or_creep(damping):
    network = chain(2, ("clamped", "free"))
    even = gp.Waves(network).damped_modes(1, damping=damping / OMEGA)
    # a loss factor of one contact and of no deformation else is uneven, and here the same
    uneven = gp.Waves(replace(network, prestress=True)).damped_modes(1, damping=damping / OMEGA)
    roots = np.roots([-1.0, 1j * damping, 1.0])
    expected = roots[np.argmax(roots.real)] if damping < 2.0 else roots[np.argmin(roots.imag)]
    for found in (even, uneven):
        assert_allclose(found.frequencies, [expected * HERTZ], rtol=1e-12)
        assert_allclose(found.quality, [expected.real / (2.0 * expected.imag)], atol=1e-12)


@pytest.mark.parametrize("damping", [0.9, 1.6])
def test_strongly_damped_modes_ascend_in_their_real_part(damping):
    # 2 sin(t/2) of bands and of a chain between walls, damped beyond 2^1/2 over the highest
    # frequency; some creep in the end
    network = ideal("chain", 0.0)
    q = np.linspace(0.1, 0.5, 5)[:, None]
    tau = damping / OMEGA
    walls = network.cut(0, 12, "clamped")
    modes = gp.Waves(walls).damped_modes(10, damping=tau)
    free = 2.0 * np.sin(0.5 * np.pi * np.arange(1, 11) / 11)
    creep = 0.5 * damping * free**2
    roots = 1j * creep + np.sqrt(free**2 - creep**2 + 0j)
    expected = np.where(
        creep > free, 1j * (creep - np.sqrt(np.maximum(creep**2 - free**2, 0.0))), roots
    )
    assert_allclose(modes.frequencies / HERTZ, np.sort(expected), rtol=1e-9)
    for frequency, vector in zip(modes.frequencies / HERTZ, modes.vectors[:, 1:-1, 0], strict=True):
        left = (1.0 + 1j * frequency * damping) * np.convolve(
            vector, [-1.0, 2.0, -1.0], "same"
        ) - frequency**2 * vector
        assert np.linalg.norm(left) < 1e-9
    two = gp.Phonons(network.repeat((2,))).damped(q, tau)
    assert np.all(np.diff(two.frequencies.real, axis=1) >= 0.0)


def test_modes_that_creep_have_digits_or_are_refused():
    """Of a chain on a wall each contact creeps by itself, by exp(-t/tau) of its own tau, but for
    inertia.
    """
    network = chain(12, ("clamped", "free"))
    for strength in (1e2, 3e3):
        modes = gp.Waves(network).damped_modes(
            11, damping=strength / OMEGA * np.linspace(1.0, 2.0, network.n_contacts)
        )
        creep = 2.0 * np.pi * modes.frequencies.imag * strength / OMEGA
        slowest = 1.0 / np.linspace(2.0, 1.0, 11)
        assert_allclose(creep, slowest, rtol=max(20.0 / strength**2, 1e-8))
        assert np.all(modes.frequencies.real == 0.0)
    with pytest.raises(PrecisionError, match="have no digit"):
        gp.Waves(network).damped_modes(
            11, damping=1e6 / OMEGA * np.linspace(1.0, 2.0, network.n_contacts)
        )


def test_a_damping_that_was_meant_as_a_loss_factor(monkeypatch):
    """Responses and modes tell that contacts are more viscous than stiff: modes by their frequency
    without losses.
    """
    from granphon.waves import modes

    network = chain(30, ("clamped", "free"))
    waves = gp.Waves(network)
    third = 2.0 * np.pi * waves.modes(3).frequencies[-1]
    assert " 8 times" in waves.damped_modes(3, damping=8.0 / third).warnings[0]
    assert not waves.damped_modes(3, damping=0.8 / third).warnings
    assert not waves.damped_modes(3, loss_factor=9.0).warnings
    uneven = np.linspace(8.0, 9.0, network.n_contacts) / third
    for dense in (600, 1):
        monkeypatch.setattr(modes, "MOST_DENSE_MOTIONS", dense)
        # of modes that creep, which come first
        assert len(waves.damped_modes(3, damping=uneven).warnings) == 1
        assert not waves.damped_modes(3, damping=0.01 * uneven).warnings
    # of one ball on a spring, however it is found
    ball = replace(chain(2, ("clamped", "free")), prestress=True)
    assert " 3 times" in gp.Waves(ball).damped_modes(1, damping=3.0 / OMEGA).warnings[0]
    response = waves.response([0.5 * HERTZ, HERTZ], (9, "x"), (5, "x"), damping=7.0 / OMEGA)
    assert " 7 times" in response.warnings[0]
    assert not waves.response(
        [0.5 * HERTZ, HERTZ], (9, "x"), (5, "x"), damping=0.9 / OMEGA
    ).warnings


# -- matrices made contact by contact --------------------------------------------------------------


def assemble(network, normal, shear):
    """Stiffness (6 n, 6 n) of u and phi of all balls, walls too, with springs ``normal``, ``shear``
    (n_c,) of any kind.
    """
    whole = np.zeros((6 * network.n_balls,) * 2, complex)
    for c in range(network.n_contacts):
        i = network.i[c]
        j = network.j[c]
        n = network.normal[c]
        across = np.eye(3) - np.outer(n, n)
        cross = np.cross(np.eye(3), n)  # rows e x n
        apart = np.hstack([-np.eye(3), np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))])
        turned = np.hstack(
            [
                np.zeros((3, 3)),
                network.arm_i[c] * cross.T,
                np.zeros((3, 3)),
                network.arm_j[c] * cross.T,
            ]
        )
        slip = across @ apart - turned
        along = n @ apart
        places = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        push = network.normal_force[c] / network.distance[c] if network.prestress else 0.0
        own = (
            normal[c] * np.outer(along, along)
            + shear[c] * slip.T @ slip
            - push * apart.T @ across @ apart
        )
        np.add.at(whole, np.ix_(places, places), own)
    return whole


@pytest.mark.parametrize("forces", ["none", "pressed", "some pull"])
def test_response_is_that_of_matrices_made_contact_by_contact(strip, forces):
    network = replace(strip, prestress=forces != "none")
    rng = np.random.default_rng(1)
    if forces == "some pull":
        signs = np.resize([1.0, -1.0, -1.0], network.n_contacts)
        network = replace(network, normal_force=signs * network.normal_force, adhesive=True)
    c_n, c_t, eta = (
        size * rng.uniform(0.0, 1.0, network.n_contacts)
        for size in (0.2 * VISCOSITY, 0.3 * VISCOSITY, 0.1)
    )
    free = np.flatnonzero(network.moving)
    places = (6 * free[:, None] + [0, 1, 5]).ravel()
    mass = np.column_stack([network.masses[free]] * 2 + [network.inertias[free]]).ravel()
    wall = int(np.flatnonzero(~network.moving)[0])
    hertz = np.array([0.2, 0.9, 1.7, 2.6]) * HERTZ
    waves = gp.Waves(network)
    slanted = (0.6, -0.8)
    pushed = waves.response(
        hertz, [(3, slanted), (9, "y")], [(5, "x"), ((7, 8), "y")], times(network, c_n, c_t), eta
    )
    moved = waves.response(
        hertz,
        (wall, slanted),
        (free[-1], "x"),
        times(network, c_n, c_t),
        eta,
        quantity="transmissibility",
    )
    for row, omega in enumerate(2.0 * np.pi * hertz):
        loss = 1j * eta
        whole = assemble(
            network,
            network.normal_stiffness * (1.0 + loss) + 1j * omega * c_n,
            network.shear_stiffness * (1.0 + loss) + 1j * omega * c_t,
        )
        inner = whole[np.ix_(places, places)] - omega**2 * np.diag(mass)
        force = np.zeros(6 * network.n_balls)
        force[[18, 19, 55]] = 0.6, -0.8, 1.0
        answer = np.zeros(force.size, complex)
        answer[places] = np.linalg.solve(inner, force[places])
        assert_allclose(pushed.values[row], answer[[30, 43, 49]], rtol=1e-10)
        pull = -whole[places, 6 * wall] * 0.6 + whole[places, 6 * wall + 1] * 0.8
        answer[places] = np.linalg.solve(inner, pull)
        assert_allclose(moved.values[row, 0], answer[6 * free[-1]], rtol=1e-10)


def test_damped_modes_are_roots_of_matrices_made_contact_by_contact(strip):
    c_n = 0.2 * VISCOSITY
    c_t = 0.05 * VISCOSITY
    eta = 0.03
    network = strip
    free = np.flatnonzero(strip.moving)
    places = (6 * free[:, None] + [0, 1, 5]).ravel()
    root = np.sqrt(np.column_stack([network.masses[free]] * 2 + [network.inertias[free]]).ravel())
    every = np.ones(network.n_contacts)
    stiff = assemble(
        network,
        network.normal_stiffness * (1.0 + 1j * eta),
        network.shear_stiffness * (1.0 + 1j * eta),
    )
    lossy = assemble(replace(network, prestress=False), c_n * every, c_t * every)
    stiff, lossy = (one[np.ix_(places, places)] / root / root[:, None] for one in (stiff, lossy))
    modes = gp.Waves(network).damped_modes(
        places.size, damping=times(network, c_n, c_t), loss_factor=eta
    )
    assert np.all(np.diff(modes.frequencies.real) >= 0.0)
    for frequency, vector in zip(modes.frequencies, modes.vectors, strict=True):
        omega = 2.0 * np.pi * frequency
        x = vector[free].ravel()
        left = stiff @ x + 1j * omega * (lossy @ x) - omega**2 * x
        assert np.linalg.norm(left) < 1e-10 * (2.0 * OMEGA) ** 2
        assert np.linalg.norm(x) == pytest.approx(1.0)


def test_damped_modes_of_a_large_network_are_those_of_all():
    network = ideal("chain", 0.0).cut(0, 700)
    c = np.linspace(0.0, 0.1, network.n_contacts) * VISCOSITY
    found = gp.Waves(network).damped_modes(6, nearest=0.9 * HERTZ, damping=times(network, c))
    stiff = 2.0 * np.eye(700) - np.eye(700, k=1) - np.eye(700, k=-1)
    difference = np.diff(np.eye(700), axis=0)
    lossy = difference.T @ (c[:, None] / VISCOSITY * difference)
    stiff = difference.T @ difference
    for frequency, vector in zip(found.frequencies / HERTZ, found.vectors[:, :, 0], strict=True):
        left = stiff @ vector + 1j * frequency * (lossy @ vector) - frequency**2 * vector
        assert np.linalg.norm(left) < 1e-10
    # so weakly damped, modes are near those without damping, and none of these is missing
    free = 2.0 * np.sin(0.5 * np.pi * np.arange(700) / 700)
    near = np.sort(free[np.argsort(np.abs(free - 0.9))[:6]])
    assert_allclose(found.frequencies.real / HERTZ, near, atol=1e-3)


@pytest.mark.parametrize("count", [3, 8])
def test_of_modes_that_creep_the_slowest_come_first(count, monkeypatch):
    """In a chain whose dashpots differ, by all modes at once, and in a large one by those near
    zero.
    """
    from granphon.waves import modes

    network = chain(30, ("clamped", "free"))
    tau = np.linspace(1.9, 2.1, network.n_contacts) * 40.0 / OMEGA
    squares, lossy = (
        gp.Waves(network).operator.weigh(one).toarray() for one in (None, np.stack([tau, tau]))
    )
    rates = np.linalg.eigvals(
        np.block(
            [[np.zeros_like(lossy), np.eye(len(lossy))], [-squares / OMEGA**2, -lossy / OMEGA]]
        )
    )
    assert np.all(np.abs(rates.imag) < 1e-6)
    expected = np.sort(-rates.real)[:count] * HERTZ
    for dense in (600, 1):
        monkeypatch.setattr(modes, "MOST_DENSE_MOTIONS", dense)
        found = gp.Waves(network).damped_modes(count, damping=tau).frequencies
        assert np.all(found.real == 0.0)
        assert_allclose(found.imag, expected, rtol=1e-8)


def make_loose(kind):
    """A network of which many motions cost no energy, and the time of the dashpots of its contacts,
    which differ.
    """
    if kind == "balls that nothing holds":
        whole = ideal("triangular").repeat((7, 7))
        open_ones = np.isin(whole.i, [0, 13, 30, 41]) | np.isin(whole.j, [0, 13, 30, 41])
        network = replace(
            whole,
            **{name: getattr(whole, name)[~open_ones] for name in whole.contact_fields},
            lattice=None,
            shape=None,
        )
    elif kind == "a chain with six motions":
        packing = gp.Packing(
            gp.Material(200e9, 0.3, 7800.0), D, lattice="chain", friction=True, motions="all"
        )
        network = gp.AveragedLattice(packing).at_force(10.0).network.cut(0, 25)
    else:
        motions = "out_of_plane" if kind == "a free membrane" else "in_plane"
        packing = gp.Packing(gp.Material(200e9, 0.3, 7800.0), D, friction=True, motions=motions)
        network = gp.AveragedLattice(packing).at_force(10.0).network.repeat((7, 1)).cut(1, 7)
        across = np.any(network.shift != 0, axis=1)
        network = replace(
            network,
            pbc=(False,) * 3,
            cell=np.zeros((3, 3)),
            **{name: getattr(network, name)[~across] for name in network.contact_fields},
        )
        if kind == "a flake under static forces":
            network = replace(
                network, prestress=True, normal_force=np.full(network.n_contacts, 1e-9)
            )
    omega = np.sqrt(network.normal_stiffness[0] / network.masses[0])
    return network, 1e-3 / omega * np.where(np.arange(network.n_contacts) == 5, 1.1, 1.0)


@pytest.mark.parametrize(
    "kind",
    [
        "balls that nothing holds",
        "a chain with six motions",
        *(pytest.param(one, marks=pytest.mark.slow) for one in ("a free membrane", "a free flake")),
        "a flake under static forces",
    ],
)
def test_damped_modes_leave_out_what_costs_no_energy(kind, monkeypatch):
    from granphon.waves import modes

    network, tau = make_loose(kind)
    waves = gp.Waves(network)
    top = waves.operator.top
    zeros = waves.modes(1).zero_modes
    assert zeros >= 3
    stiff = waves.operator.matrix.toarray() / top**2
    lossy = waves.operator.weigh(np.stack([tau, tau])).toarray() / top
    rates = np.linalg.eigvals(
        np.block([[np.zeros_like(stiff), np.eye(len(stiff))], [-stiff, -lossy]])
    )
    exact = np.sort((-1j * rates)[rates.imag > 1e-5])
    assert exact.size + zeros == len(stiff)
    monkeypatch.setattr(modes, "MOST_DENSE_MOTIONS", 1)  # as large networks are solved
    for target in (0.0, 0.3):
        found = waves.damped_modes(5, target * top / (2.0 * np.pi), damping=tau)
        omega = 2.0 * np.pi * found.frequencies / top
        near = np.sort(exact[np.argsort(np.abs(exact.real - target))[:5]])
        assert_allclose(omega, near, atol=1e-9)
        for one, vector in zip(
            omega,
            waves.operator.vector(np.moveaxis(found.vectors[:, waves.operator.balls], 0, -1)).T,
            strict=True,
        ):
            assert (
                np.linalg.norm(stiff @ vector + 1j * one * (lossy @ vector) - one**2 * vector)
                < 1e-9
            )
    with pytest.raises(InputError, match=f"only {exact.size} cost energy"):
        waves.damped_modes(exact.size + 1, damping=tau)


# -- other ways ------------------------------------------------------------------------------------


@pytest.mark.claim("response-krylov")
@pytest.mark.parametrize(
    "damping",
    [
        pytest.param({"loss_factor": 0.05}, marks=pytest.mark.slow),
        pytest.param({"damping": 0.04 / OMEGA}, marks=pytest.mark.slow),
        {"damping": (0.02 / OMEGA, 0.02 / OMEGA), "loss_factor": 0.02},
    ],
)
def test_krylov_space_gives_what_factors_give(damping):
    network = ideal("triangular", 0.5).repeat((20, 1)).cut(1, 20, ("clamped", "free"))
    waves = gp.Waves(network)
    hertz = np.linspace(0.2, 2.3, 7) * HERTZ
    for source, quantity in (((40, "x"), "velocity"), ("plane", "transmissibility")):
        one, other = (
            waves.response(
                hertz, source, ([70, 350], "y"), **damping, quantity=quantity, method=method
            )
            for method in ("direct", "krylov")
        )
        assert (one.factorisations, other.factorisations, one.steps) == (7, 0, 0)
        assert 20 <= other.steps < 2000
        assert "Krylov" in other.method
        off = np.max(np.abs(one.values - other.values), axis=1)
        assert np.all(off <= np.maximum(other.error, 1e-11) * np.max(np.abs(one.values), axis=1))
        assert np.max(other.error) < 2e-9


@pytest.mark.claim("response-krylov")
@pytest.mark.parametrize(
    "kind",
    [
        "losses",
        "pressed losses",
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("dashpots", "both", "pressed")),
    ],
)
def test_krylov_space_of_unevenly_damped_contacts_gives_what_factors_give(kind):
    network = ideal("triangular", 0.5).repeat((2, 1)).cut(1, 3, ("clamped", "free"))
    rng = np.random.default_rng(0)
    factor, eta = rng.uniform(0.4, 1.0, (2, network.n_contacts))
    network = replace(network, normal_stiffness=factor * network.normal_stiffness)
    if "pressed" in kind:
        network = replace(network, prestress=True, normal_force=0.02 * UNITS.stiffness * D * eta)
    damping = {} if "losses" in kind else {"damping": (0.1 / OMEGA, 0.2 / OMEGA)}
    loss = {} if kind == "dashpots" else {"loss_factor": 0.1 * eta}
    waves = gp.Waves(network)
    hertz = np.linspace(0.2, 2.6, 3) * HERTZ
    sources = [((3, "x"), "displacement")]
    if kind == "losses":
        sources.append(("plane", "transmissibility"))
    for source, quantity in sources:
        one, other = (
            waves.response(
                hertz, source, ([2, 5], "y"), **damping, **loss, quantity=quantity, method=method
            )
            for method in ("direct", "krylov")
        )
        assert (one.factorisations, other.factorisations) == (3, 0)
        off = np.max(np.abs(one.values - other.values), axis=1)
        assert np.all(off <= np.maximum(other.error, 1e-11) * np.max(np.abs(one.values), axis=1))
        assert np.max(other.error) < 1e-8
    rough = waves.response(
        hertz, (3, "x"), (2, "y"), **damping, **loss, method="krylov", tolerance=1e-3
    )
    exact = waves.response(hertz, (3, "x"), (2, "y"), **damping, **loss)
    assert np.max(np.abs(rough.values / exact.values - 1.0)) < 2e-3
    assert rough.steps < other.steps


@pytest.mark.claim("response-krylov")
@pytest.mark.parametrize(
    "damping",
    [
        pytest.param({"loss_factor": (0.1, 0.05)}, marks=pytest.mark.slow),
        pytest.param({"damping": (0.2 / OMEGA, 0.1 / OMEGA)}, marks=pytest.mark.slow),
        {"damping": (0.05 / OMEGA, 0.1 / OMEGA), "loss_factor": (0.05, 0.1)},
    ],
)
def test_frequencies_that_cost_most_by_a_krylov_space_are_left_to_factors(damping):
    """Which frequencies these are is known beforehand; where contacts of a large network are damped
    unevenly.
    """
    waves = gp.Waves(ideal("triangular", 0.8).repeat((26, 26)))
    hertz = np.geomspace(0.1, 2.0, 4) * HERTZ
    direct, chosen = (
        waves.response(hertz, (0, "x"), (400, "y"), **damping, method=one)
        for one in ("direct", None)
    )
    assert_allclose(chosen.values, direct.values, rtol=1e-8)
    assert 0 < chosen.factorisations <= 4
    assert np.max(chosen.error) < 2e-9


def test_large_network_takes_a_krylov_space_and_factors_where_nothing_is_lost():
    network = ideal("triangular", 0.8).repeat((30, 30))
    waves = gp.Waves(network)
    hertz = np.geomspace(0.01, 1.5, 5) * HERTZ
    places = [(0, "x"), (620, (-1, 0))], (20, "y")
    found = waves.response(hertz, *places, loss_factor=0.1)
    assert found.factorisations == 0
    assert 64 <= found.steps < 2000
    assert np.max(found.error) < 2e-9
    direct = waves.response(hertz, *places, loss_factor=0.1, method="direct")
    assert_allclose(found.values, direct.values, rtol=1e-8)
    bare = waves.response(hertz[-1:], *places)
    assert (bare.factorisations, bare.steps) == (1, 0)
    with pytest.raises(ConvergenceError, match="Krylov"):
        waves.response(hertz[-1:], *places, method="krylov")


def test_a_krylov_space_that_grows_without_bound_is_one_error():
    waves = gp.Waves(ideal("triangular", 0.5).repeat((3, 1)).cut(1, 3, ("clamped", "free")))
    times, losses = np.random.default_rng(1).random((2, waves.network.n_contacts))
    loss = {"damping": (times / OMEGA, 0.0), "loss_factor": (0.5 * losses, 0.1)}
    hertz = np.linspace(0.1, 1.0, 4) * HERTZ
    with pytest.raises(ConvergenceError, match="Krylov"):
        waves.response(hertz, (4, "x"), (7, "y"), **loss, method="krylov")


def test_a_loss_factor_given_as_damping_is_told():
    """0.02 s, where a loss factor of 0.02 is meant, is a dashpot that resists a dozen times as much
    as its spring.
    """
    waves = gp.Waves(ideal("chain").repeat((5,)))
    for name, count in (("damping", 1), ("loss_factor", 0)):
        response = waves.response([50.0, 100.0], (0, (1, 0, 0)), (2, (1, 0, 0)), **{name: 0.02})
        told = [line for line in response.warnings if "12.6" in line]
        assert len(told) == count


def test_receiver_that_hears_nothing_is_no_resonance():
    # across a line of balls that is pushed along itself nothing moves; and far above the band less
    # than the least number
    network = ideal("square", 0.5).repeat((1, 1)).cut(1, 8)
    found = gp.Waves(network).response([0.3 * HERTZ], (0, "y"), (5, "x"))
    assert np.abs(found.values[0, 0]) < 1e-20
    far = gp.Waves(chain(400, ("clamped", "free"))).response([6.0 * HERTZ], (1, "x"), (399, "x"))
    assert far.values[0, 0] == 0.0


@pytest.mark.claim("response-gap")
def test_factors_have_all_digits_deep_in_a_gap():
    # above all modes 1/(omega^2 - D) is a sum of powers of D, of which each loses no digit
    waves = gp.Waves(ideal("triangular", 0.5).repeat((10, 1)).cut(1, 60))
    network = waves.network
    matrix = waves.operator.matrix
    hertz = 4.0 * HERTZ * np.array([1.5, 2.5])
    found = waves.response(hertz, (0, "x"), ([3, 350, 595], "x"), method="direct")
    assert np.max(np.abs(found.values[:, 2])) < 1e-60 * np.max(np.abs(found.values[:, 0]))
    for row, omega in zip(found.values, 2.0 * np.pi * hertz, strict=True):
        term = np.zeros(waves.operator.size)
        term[0] = -1.0 / (network.masses[0] * omega**2)
        total = np.zeros(term.size)
        for _ in range(400):
            total = total + term
            term = matrix @ term / omega**2
        assert_allclose(row, waves.operator.values(total)[[3, 350, 595], 0], rtol=1e-10)
    far = waves.response(hertz, (0, "x"), (595, "x"), method="krylov")
    assert "below" in far.warnings[0]
    assert waves.response(hertz, (0, "x"), (595, "x")).factorisations == 2
    assert np.all(far.error > 1.0)
    assert np.all(
        np.abs(far.values[:, 0] - found.values[:, 2]) < far.error * np.abs(far.values[:, 0])
    )


@pytest.mark.claim("response-pulse")
@pytest.mark.parametrize("tangential", [None, pytest.param(0.3, marks=pytest.mark.slow)])
def test_fourier_transform_of_a_pulse_is_the_response(tangential):
    network = ideal("triangular", 0.6).repeat((2, 1)).cut(1, 6) if tangential else chain(8)
    tau = 0.4 / OMEGA
    frequency = 0.7 * HERTZ
    more = {} if tangential is None else {"tangential_damping": tangential / OMEGA}
    pulse = gp.Waves(network).transmit(
        frequency,
        (0, 1) if tangential else (1,),
        4.0 * D,
        2,
        polarisation="longitudinal",
        damping=tau,
        duration=(150.0 if tangential else 300.0) / OMEGA,
        **more,
    )
    hertz = np.array([0.5, 0.7, 0.9]) * HERTZ
    axis = "y" if tangential else "x"
    damping = tau if tangential is None else (tau, tangential / OMEGA)
    found = gp.Waves(network).response(
        hertz, (pulse.sources, axis), (pulse.receivers, axis), damping, quantity="velocity"
    )
    turn = np.exp(-2j * np.pi * np.multiply.outer(hertz, pulse.times))
    assert_allclose(
        (turn @ pulse.signals.T) / (turn @ pulse.sent)[:, None], found.values, rtol=1e-3
    )


@pytest.mark.claim("damped-perturbation")
@pytest.mark.parametrize("kind", ["loss", "viscous"])
def test_small_losses_are_those_of_the_real_bands_to_second_order(kind):
    balls = [gp.Ball(packings.MATERIAL, D), gp.Ball(packings.MATERIAL, D, mass=3e-3)]
    state = gp.Crystal(
        balls, D * np.array([[1.0, 1.0], [1.0, -1.0]]), [[0.0, 0.0], [D, 0.0]]
    ).at_force(10.0)
    phonons = gp.Phonons(state)
    network = state.network
    q = np.array([[0.31, 0.17], [0.44, 0.05]])
    bands = phonons.frequencies(q)
    errors = []
    # the energy of each mode in the two kinds of deformations: by Hellmann and Feynman, from
    # stiffer springs
    step = 1e-4
    shares = []
    for name in ("normal_stiffness", "shear_stiffness"):
        ends = [
            gp.Phonons(replace(network, **{name: getattr(network, name) * (1.0 + x)})).frequencies(
                q
            )
            for x in (step, -step)
        ]
        shares.append((ends[0] - ends[1]) / bands / step)
    for size in (0.02, 0.01, 0.005):
        if kind == "loss":
            found = phonons.damped(q, loss_factor=(size, 3.0 * size))
            expected = 0.5 * size * bands * (shares[0] + 3.0 * shares[1])
        else:
            tau = size / OMEGA
            found = phonons.damped(q, damping=(tau, 2.0 * tau))
            expected = np.pi * tau * bands**2 * (shares[0] + 2.0 * shares[1])
        errors.append(np.max(np.abs(found.frequencies - bands - 1j * expected) / bands))
    assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.1)
    assert np.array_equal(phonons.damped(q).frequencies, bands)
    assert np.all(np.isinf(phonons.damped(q).quality))


def test_evenly_and_unevenly_damped_bands_are_one_where_they_meet():
    network = ideal("triangular", 0.7)
    q = np.array([[0.0, 0.0], [0.2, 0.1], [1 / 3, 1 / 3]])
    c = 0.3 / OMEGA
    even = gp.Phonons(network).damped(q, c, 0.02)
    nearly = gp.Phonons(network).damped(q, (c, c * (1.0 + 1e-9)), 0.02)
    assert_allclose(even.frequencies, nearly.frequencies, atol=1e-6 * HERTZ)
    assert even.qpoints.shape == (3, 3)
    waves = gp.Waves(network.repeat((3, 3))).damped_modes(24, damping=c, loss_factor=0.02)
    assert np.min(
        np.abs(waves.frequencies[:, None] - even.frequencies[2]), axis=0
    ) == pytest.approx(0.0, abs=1e-6 * HERTZ)


@pytest.mark.parametrize(("name", "count"), [("honeycomb", 18), ("hcp", 90)])
def test_uneven_damping_where_balls_are_images_of_others(name, count):
    network = ideal(name, 0.7)
    periods = int(np.count_nonzero(network.pbc))
    loss = {"damping": (0.02 / OMEGA, 0.1 / OMEGA), "loss_factor": (0.01, 0.2)}
    bands = gp.Phonons(network).damped([[0.5] * periods], **loss).frequencies[0]
    whole = network.repeat((2,) * periods)
    every = gp.Waves(whole).damped_modes(count, **loss).frequencies  # all that cost energy
    cost = bands[np.abs(bands) > 1e-6 * HERTZ]
    assert np.max(np.min(np.abs(every[:, None] - cost), axis=0)) < 1e-7 * HERTZ


def test_reciprocity_power_and_the_sum_of_modes(strip):
    c = (0.1 / OMEGA, 0.3 / OMEGA)
    hertz = np.linspace(0.1, 3.0, 12) * HERTZ
    waves = gp.Waves(strip)
    one, other = (waves.response(hertz, (a, "x"), (b, "y"), c) for a, b in ((2, 11), (11, 2)))
    swapped = waves.response(hertz, (11, "y"), (2, "x"), c)
    assert_allclose(one.values, swapped.values, rtol=1e-10)
    assert np.max(np.abs(one.values - other.values)) > 1e-3 * np.max(np.abs(one.values))
    own = waves.response(hertz, (2, "x"), (2, "x"), c, quantity="velocity")
    assert np.all(own.values.real > 0.0)
    # local densities of all balls add up to the whole
    whole = waves.dos(moments=128)
    parts = [
        waves.local_dos(ball, whole.frequencies, moments=128)
        for ball in np.flatnonzero(strip.moving)
    ]
    assert_allclose(
        sum(one.values.sum(axis=1) for one in parts) / len(parts),
        whole.total,
        rtol=1e-9,
        atol=1e-12,
    )
    assert waves.local_dos(2, [1e9]).values.tolist() == [[0.0, 0.0, 0.0]]


# -- another engine --------------------------------------------------------------------------------


@pytest.mark.claim("response-lammps")
@pytest.mark.parametrize(
    ("count", "omega", "time", "steps"),
    [
        (6, 1.1, 100.0, 400),
        *(
            pytest.param(10, omega, 300.0, 1000, marks=pytest.mark.slow)
            for omega in (0.5, 1.1, 1.7)
        ),
    ],
)
def test_driven_array_of_lammps_has_the_amplitude_and_the_phase(count, omega, time, steps):
    """An array of so many balls a side, pushed for ``time`` in as many steps a period."""
    lmp = packings.start_or_skip()
    # linear springs and dashpots, pressed by 1e-5 of a diameter, in units of k, M and d
    pulled = 5 * count + 5
    ratio = 0.7
    c_n = 0.4
    c_t = 0.3
    press = 1e-5
    force = 1e-8
    side = count * (1.0 - press)
    grid = np.stack(np.meshgrid(np.arange(count), np.arange(count), indexing="ij"), -1).reshape(
        -1, 2
    ) * (1.0 - press)
    packings.fill(
        lmp, f"block 0 {side!r} 0 {side!r} -1 1", np.pad(grid, ((0, 0), (0, 1))), units="lj"
    )
    lmp.commands_string(f"""
        set group all diameter 1.0
        set group all mass 1.0
        pair_style granular
        pair_coeff * * hooke 1.0 {c_n!r} tangential linear_history {ratio!r} {c_t / c_n!r} 1e9 damping velocity
        neighbor 0.05 bin
        timestep 0.02
        fix flat all enforce2d
        fix move all nve/sphere disc
        thermo 1000000
        group one id 1
        group other id {pulled + 1}
        variable push equal 0
        fix drive one addforce v_push 0 0
        variable pull equal 0
        fix hold other addforce v_pull 0 0""")
    source = [(0, "x"), (pulled, (-1.0, 0.0))]
    heard = [2 * count + 3, count + 4, pulled - 1]
    receivers = list(zip(heard, "xyx", strict=True))
    network = (
        gp.ContactLattice.of("square", ratio)
        .contact_network(gp.Units(1.0, 1.0, 1.0))
        .repeat((count, count))
    )
    disc = replace(network, inertias=np.full(count**2, 0.125))
    found = gp.Waves(disc).response(
        [omega / (2.0 * np.pi)], source, receivers, times(disc, c_n, c_t)
    )
    rest = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3)
    step = 2.0 * np.pi / omega / steps
    lmp.command(f"timestep {step!r}")
    for name, sign in (("push", 1.0), ("pull", -1.0)):
        lmp.command(f"variable {name} equal {sign * force!r}*sin({omega!r}*step*{step!r})")
    periods = max(8, math.ceil(time * omega / (2.0 * np.pi)))
    lmp.command(f"run {steps * periods} post no")
    moved = []
    clock = []
    for _ in range(8):
        lmp.command(f"run {steps // 8} post no")
        shift = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3) - rest
        moved.append(shift[heard, [0, 1, 0]])
        clock.append(lmp.extract_global("ntimestep") * step)
    lmp.close()
    wave = np.exp(-1j * omega * np.array(clock)) @ np.array(moved) * 2j / 8 / force
    values = found.values[0]
    assert_allclose(wave, values, rtol=0.01, atol=0.01 * np.max(np.abs(values)))
    assert abs(wave[0] / values[0] - 1.0) < 0.01


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"source": (0, "x")}, "ball 0 of the source"),
        ({"receiver": (0, "x")}, "ball 0 of the receiver"),
        ({"source": (3, "x"), "quantity": "transmissibility"}, "ball 3 .*moves"),
        ({"receiver": []}, "there is no receiver"),
        ({"source": []}, "there is no source"),
        ({"source": (9, "x")}, "balls, 0 to 5"),
        ({"source": (3, "y")}, "along x only"),
        ({"source": 3}, "the source is 3"),
        ({"source": (3, "r")}, "Use x, y, z, or a vector"),
        ({"distance": 2.0 * D}, "distance is given"),
        ({"direction": (1,)}, "direction is given"),
        ({"polarisation": "transverse"}, "polarisation is given"),
        ({"source": "plane", "distance": 2.0 * D}, "distance is given, and the receiver"),
        ({"frequencies": [2.0, 1.0]}, "ascending"),
        ({"frequencies": [1e200]}, "up to"),
        ({"loss_factor": 1e300}, "loss_factor up to"),
        ({"damping": 1e300}, "damping up to"),
        ({"frequencies": [1.0, 1.0]}, "ascending"),
        ({"frequencies": [1.0 + 1j]}, "complex"),
        ({"frequencies": [-1.0]}, "zero or above"),
        ({"frequencies": []}, "frequencies"),
        ({"damping": -1.0}, "damping: found -1"),
        ({"damping": [0.1, 0.2]}, "damping has the shape"),
        ({"damping": (0.1, 0.2, 0.3)}, r"\(normal, tangential\)"),
        ({"loss_factor": -0.1}, "loss_factor: found -0.1"),
        ({"quantity": "forces"}, "force, transmissibility"),
        ({"method": "fast"}, "allowed: direct, krylov"),
        ({"tolerance": 0.0}, "tolerance: found 0"),
        ({"tolerance": 1.0}, "tolerance is 1"),
        ({"method": "krylov", "loss_factor": [0.1, 0.1, 0.1, 0.1, 0.0]}, "others lose none"),
        ({"frequencies": [2.0 * math.sin(0.5 * math.pi / 11) * HERTZ]}, "has no bound"),
    ],
)
def test_bad_input_is_one_error(arguments, text):
    given = {"frequencies": [HERTZ], "source": (3, "x"), "receiver": (5, "x")} | arguments
    with pytest.raises(InputError, match=text):
        gp.Waves(chain(6, ("clamped", "free"))).response(**given)


def test_direction_and_polarisation_are_those_of_a_plane_that_is_driven_or_heard():
    waves = gp.Waves(ideal("triangular").repeat((3, 1)).cut(1, 5))
    across = {"direction": (0, 1), "polarisation": "transverse"}
    driven = waves.response([0.3 * HERTZ], "plane", (4, "x"), 1e-6, **across)
    assert np.array_equal(np.abs(driven.pushes), np.tile([1.0, 0.0, 0.0], (3, 1)))
    heard = waves.response([0.3 * HERTZ], (4, "x"), "plane", 1e-6, distance=D, **across)
    assert np.array_equal(np.abs(heard.directions), np.tile([1.0, 0.0, 0.0], (3, 1)))


def test_other_calls_refuse_what_they_cannot_find():
    held = gp.Waves(chain(6, ("clamped", "free")))
    with pytest.raises(InputError, match="ball 0 does not move"):
        held.local_dos(0, [1.0])
    with pytest.raises(InputError, match="5 motions"):
        held.damped_modes(6, damping=np.linspace(0.0, 1e-6, 5))
    with pytest.raises(InputError, match="damping: found -1"):
        gp.Phonons(ideal("chain", 0.0)).damped([[0.1]], damping=-1.0)
    with pytest.raises(InputError, match=r"no body .*held"):
        gp.Waves(chain(6)).response([1.0], "plane", (5, "x"), quantity="transmissibility")
    # the outer plane of a wall of two planes touches the inner one alone
    ball = gp.Ball(gp.Material(70e9, 0.2, 2500.0), 1e-3)
    slab = gp.Crystal.on("NaCl", [ball, ball]).at_force(1.0).network.cut(2, 5, "clamped")
    with pytest.raises(InputError, match="source touches no ball"):
        gp.Waves(slab).response([1e3], "plane", "plane", quantity="transmissibility")
    with pytest.raises(InputError, match="plane has no distance"):
        gp.Waves(ideal("chain", 0.0).repeat((6,))).response([1.0], "plane", "plane")
    # a chain that nothing holds answers a steady force without bound
    with pytest.raises(InputError, match="has no bound"):
        gp.Waves(chain(6)).response([0.0], (0, "x"), (1, "x"))


def test_a_floor_along_the_direction_is_no_plane_of_held_balls():
    plate = springs(ideal("square")).cut(1, 3, ("floor", "free"))
    network = plate.cut(0, 6, ("clamped", "free"))
    held_balls = np.flatnonzero(~network.moving & np.isfinite(network.radii))
    found = gp.Waves(network).response(
        [0.3 * HERTZ], "plane", "plane", 1e-6, quantity="transmissibility", direction=(1, 0)
    )
    assert np.array_equal(found.sources, held_balls)
    free = plate.cut(0, 6)
    with pytest.raises(InputError, match="held, and has a place"):
        gp.Waves(free).response(
            [0.3 * HERTZ], "plane", "plane", quantity="transmissibility", direction=(1, 0)
        )


def test_reasons_of_what_is_not_found_are_true(monkeypatch):
    waves = gp.Waves(gp.ContactLattice.of("square", 0.8).contact_network(UNITS).repeat((4, 4)))
    place = (0, "x")
    with pytest.raises(ConvergenceError, match="loses energy"):
        waves.response([100.0], place, place, method="krylov")
    monkeypatch.setattr("granphon.waves.operator.estimate_factors", lambda *_: (math.inf, math.inf))
    with pytest.raises(ConvergenceError, match="too large to be factorised"):
        waves.response([100.0], place, place, damping=1e-6, method="direct")


@pytest.mark.parametrize(
    "groups",
    [
        [[]],
        [[2]],
        [[0.5]],
        [slice(2, 4)],
        [["a"]],
        [0],
        ["a"],
        [slice("a")],
        3,
        None,
        {0: [0]},
        np.array(0),
    ],
)
def test_means_over_receivers_that_are_not_there_have_no_peaks(groups):
    network = ideal("chain").repeat((9,))
    response = gp.Waves(network).response([HERTZ], (0, "x"), [(2, "x"), (3, "x")], 0.0, 0.1)
    assert response.peaks_of_means([]) == ()
    assert not any(array.flags.writeable for peaks in response.peaks for array in peaks)
    assert len(response.peaks_of_means([slice(0, 2)])) == 1
    assert len(response.peaks_of_means(np.array([[0, 1], [1, 0]]))) == 2
    with pytest.raises(InputError, match="groups"):
        response.peaks_of_means(groups)


@pytest.mark.filterwarnings("error")
def test_a_shift_on_the_diagonal_of_a_space_does_not_end_its_solution():
    """The first pivot is zero, and yet the last entry of each solution is that of a dense one."""
    matrix = np.diag([2.0, 3.0, 5.0]) + np.diag([1.0, 0.5], 1) + np.diag([1.0, 0.5], -1)
    start = np.array([1.0, 0.0, 0.0])
    shifts = np.array([2.0, 0.7])
    ones = np.ones(shifts.size)
    space = _Space(
        apply=lambda x: matrix @ x,
        product=np.dot,
        start=start,
        shifts=shifts,
        scale=ones,
        bound=ones,
        direct_signals=np.zeros((2, 1)),
    )
    process = _KrylovProcess(space, lambda x: x[:1])
    for size in (1, 2, 3):
        process.advance()
        part = matrix[:size, :size]
        for number, shift in enumerate(shifts):
            if size > 1 or shift != 2.0:  # one equation with the pivot zero has no solution
                y = np.linalg.solve(part - shift * np.eye(size), start[:size])
                assert_allclose(process.last_entry[number], abs(y[-1]), rtol=1e-12)
