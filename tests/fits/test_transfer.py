"""Fits of damping to transfer functions: synthetic data, the closed form of a chain fitted by
SciPy, and bad tables.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import curve_fit

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.text import read_yaml
from granphon.figures.waves import transfer_fit_figure
from granphon.fits.pressed import PressedCrystal
from granphon.scene.redraw import redraw

UNITS = gp.Units(8e-3, 3e6, 2e-3)
OMEGA = UNITS.angular_frequency
HERTZ = np.linspace(0.1, 2.2, 20) * OMEGA / (2.0 * math.pi)
#: of them the nearest to each resonance
FEW = HERTZ[[1, 6, 9, 13, 15, 17]]
#: of these four
FOUR = FEW[[1, 2, 3, 5]]
TAU = 0.05 / OMEGA
ETA = 0.02
COUNT = 6


def chain(stiffer=1.0):
    """A chain of six balls on a clamped one, ball 0."""
    network = (
        gp.ContactLattice.of("chain", 0.0)
        .contact_network(UNITS)
        .cut(0, COUNT + 1, ("clamped", "free"))
    )
    return replace(network, normal_stiffness=stiffer * network.normal_stiffness)


def closed_form(tau, eta, stiffer=1.0, gain=1.0, hertz=HERTZ):
    """u_N/u_0 = cos(t/2)/cos((N + 1/2) t), where omega^2 = 4 sin^2(t/2) of complex springs."""
    omega = 2.0 * math.pi * hertz / OMEGA
    t = 2.0 * np.arcsin(omega / 2.0 / np.sqrt(stiffer * (1.0 + 1j * (eta + omega * tau * OMEGA))))
    return gain * np.cos(t / 2.0) / np.cos((COUNT + 0.5) * t)


def measure(values, part=0.02, seed=0):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(2, values.size)) * part
    return values * (1.0 + noise[0]) * np.exp(1j * noise[1])


def fit(measured, network=None, **more):
    wall = {"quantity": "transmissibility"} | more
    return gp.fit_damping(network or chain(), measured, (0, "x"), (COUNT, "x"), **wall)


@pytest.mark.claim("fit-damping")
@pytest.mark.parametrize(
    "known", ["magnitude and phase", pytest.param("magnitude", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "hertz", [FOUR, pytest.param(HERTZ, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_fit_is_that_of_scipy_to_the_closed_form(known, hertz):
    data = measure(closed_form(TAU, ETA, hertz=hertz))
    phase = known != "magnitude"
    size = np.abs(data)
    found = fit(
        gp.TransferFunction(hertz, size, np.angle(data) if phase else None, 0.02 * size),
        parameters=("damping", "loss_factor"),
    )

    def model(_, tau, eta):
        values = closed_form(tau * TAU, eta * ETA, hertz=hertz)
        return np.concatenate([np.abs(values) / size, np.angle(values / data)][: 1 + phase])

    wanted = np.concatenate([np.ones(size.size), np.zeros(size.size)][: 1 + phase])
    # scipy stops at 1e-8 of the cost by default, 1e-4 of the parameters
    best, covariance = curve_fit(
        model,
        None,
        wanted,
        (1.0, 1.0),
        0.02 * np.ones(wanted.size),
        absolute_sigma=True,
        ftol=1e-14,
        xtol=1e-12,
    )
    unit = np.array([TAU, ETA])
    assert_allclose(found.values, best * unit, rtol=1e-6)
    assert_allclose(found.covariance, covariance * np.outer(unit, unit), rtol=1e-3)
    assert np.all(np.abs(found.values - unit) < 3.0 * found.stderrs)
    assert found.chi2 == pytest.approx(np.sum((model(None, *best) - wanted) ** 2) / 0.02**2)
    assert found.dof == wanted.size - 2
    assert 1e-3 < found.p < 1.0 - 1e-3
    assert not found.warnings
    assert_allclose(found.damping, found.values[0])
    best_form = closed_form(*found.values, hertz=hertz)
    assert_allclose(found.magnitude, np.abs(best_form), rtol=1e-9)
    assert_allclose(np.exp(1j * found.phase), np.exp(1j * np.angle(best_form)), rtol=1e-9)


MASS = UNITS.mass
STIFFNESS = UNITS.stiffness
SOME = HERTZ[1::2]
#: losses of a few percent
TRUTH = {"drag": 0.04 * OMEGA, "dashpot": 0.05 * STIFFNESS / OMEGA, "restitution": 0.9}


def respond(values):
    """The closed form with drag, dashpots and a restitution: omega^2 - i omega gamma in place of
    omega^2, and k + i omega c in place of k. The first contact is one with a ball that is held.
    """
    omega = 2.0 * math.pi * SOME
    logarithm = -math.log(values.get("restitution", 1.0))
    alpha = math.sqrt(10.0 / 3.0) * logarithm / math.hypot(math.pi, logarithm)
    viscosity = values.get("dashpot", 0.0) + alpha * np.sqrt(
        STIFFNESS * MASS * np.array([1.0, 0.5])
    )
    wall, between = STIFFNESS + 1j * omega * viscosity[:, None]
    matrix = np.zeros((omega.size, COUNT, COUNT), complex)
    alone = MASS * (omega**2 - 1j * omega * values.get("drag", 0.0))
    for ball in range(COUNT):
        below = wall if ball == 0 else between
        above = between if ball < COUNT - 1 else 0.0
        matrix[:, ball, ball] = below + above - alone
        if ball:
            matrix[:, ball, ball - 1] = matrix[:, ball - 1, ball] = -between
    source = np.zeros((omega.size, COUNT, 1), complex)
    source[:, 0, 0] = wall
    return np.linalg.solve(matrix, source)[:, -1, 0]


@pytest.mark.claim("losses-fit")
@pytest.mark.parametrize(
    "names",
    [
        pytest.param(("drag",), marks=pytest.mark.slow),
        pytest.param(("dashpot",), marks=pytest.mark.slow),
        pytest.param(("restitution",), marks=pytest.mark.slow),
        ("drag", "dashpot"),
    ],
    ids="-".join,
)
def test_drag_and_dashpots_are_found_alone_and_two_at_once(names):
    """By the equations of the balls, fitted by SciPy: values, errors and their correlation."""
    truth = np.array([TRUTH[name] for name in names])
    data = measure(respond(dict(zip(names, truth, strict=True))))
    size = np.abs(data)
    found = fit(gp.TransferFunction(SOME, size, np.angle(data), 0.02 * size), parameters=names)

    def model(_, *scaled):
        values = respond(dict(zip(names, scaled * truth, strict=True)))
        return np.concatenate([np.abs(values) / size, np.angle(values / data)])

    wanted = np.concatenate([np.ones(size.size), np.zeros(size.size)])
    best, covariance = curve_fit(
        model, None, wanted, np.ones(len(names)), 0.02 * np.ones(wanted.size), absolute_sigma=True
    )
    assert_allclose(found.values, best * truth, rtol=1e-4)
    assert_allclose(found.stderrs, np.sqrt(np.diag(covariance)) * truth, rtol=1e-2)
    assert np.all(np.abs(found.values - truth) < 3.0 * found.stderrs)
    scale = np.sqrt(np.diag(covariance))
    assert_allclose(found.correlation, covariance / np.outer(scale, scale), atol=1e-3)
    assert_allclose(
        found.restitution, TRUTH["restitution"] if "restitution" in names else 1.0, rtol=0.02
    )
    assert gp.DampingFit.from_dict(found.to_dict()) == found


@pytest.mark.parametrize("name", ["on_site", "wall_modulus"])
def test_springs_and_a_wall_that_are_not_there_are_refused(name):
    measured = gp.TransferFunction(HERTZ, np.abs(closed_form(TAU, 0.0)))
    with pytest.raises(InputError, match={"on_site": "springs", "wall_modulus": "wall"}[name]):
        fit(measured, parameters=(name,))


@pytest.mark.slow
@pytest.mark.claim("fit-springs-and-walls")
@pytest.mark.parametrize("name", ["on_site", "wall_modulus"])
def test_springs_and_the_modulus_of_a_wall_are_those_of_the_closed_form(name):
    """A ball of steel on a wall, over a spring to the ground or none."""
    ball = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 8e-3)
    springs = {"on_site": 1e6, "wall_modulus": 0.0}[name]
    row = gp.Crystal.on("chain", [ball], on_site=springs)
    network = (
        row.cut(0, 1, (gp.Wall(gp.Material(3e9, 0.35, 1200.0)), "free")).at_force(20.0).network
    )
    true_modulus = {"on_site": 3e9, "wall_modulus": 9e9}[name]
    compliance = (1.0 - 0.30**2) / 193e9 + (1.0 - 0.35**2) / true_modulus
    # k = 2 E* a, with a^3 = (3/4) f R / E*
    stiffness = 2.0 / compliance * (0.75 * 20.0 * ball.radius * compliance) ** (1.0 / 3.0)
    stiffness += 1.7 * springs
    resonance = math.sqrt(stiffness / ball.mass)
    hertz = resonance * np.array([0.97, 1.0, 1.03]) / (2.0 * math.pi)
    omega = 2.0 * math.pi * hertz
    drag = 0.05 * resonance
    values = 1.0 / (stiffness - ball.mass * omega**2 + 1j * omega * ball.mass * drag)
    measured = gp.TransferFunction(hertz, np.abs(values), np.angle(values), 0.02 * np.abs(values))
    names = ("drag", name)
    found = gp.fit_damping(network, measured, (0, "x"), (0, "x"), parameters=names)
    expected = {"on_site": 1.7, "wall_modulus": true_modulus}[name]
    assert_allclose(found.values, [drag, expected], rtol=1e-6)
    assert np.all(found.stderrs > 0.0)


SPRING = 4e6  # N/m


def ball_on_wall(spring, modulus=3e9):
    """A ball of steel on a wall of this modulus, over a spring to the ground."""
    ball = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 8e-3)
    wall = gp.Wall(gp.Material(modulus, 0.35, 1200.0))
    return gp.Crystal.on("chain", [ball], on_site=spring).cut(0, 1, (wall, "free"))


def measure_ball_on_wall(spring, modulus, pressure, drag):
    """The closed form: a wall and a spring share the load, P = (4/3) E* R^(1/2) d^(3/2) + k_g d."""
    radius, mass = 4e-3, gp.Ball(gp.Material(193e9, 0.30, 8000.0), 8e-3).mass
    contact_modulus = 1.0 / ((1.0 - 0.30**2) / 193e9 + (1.0 - 0.35**2) / modulus)
    hertz = 4.0 / 3.0 * contact_modulus * math.sqrt(radius)
    roots = np.roots([hertz, spring, 0.0, -pressure])  # of d^(1/2)
    (root,) = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0)].real
    stiffness = 2.0 * contact_modulus * math.sqrt(radius) * root + spring
    resonance = math.sqrt(stiffness / mass)
    omega = resonance * np.array([0.97, 1.0, 1.03])
    values = 1.0 / (stiffness - mass * omega**2 + 1j * omega * mass * drag)
    errors = 0.02 * np.abs(values)
    return gp.TransferFunction(omega / 2.0 / math.pi, np.abs(values), np.angle(values), errors)


@pytest.mark.claim("fit-springs-at-rest")
@pytest.mark.parametrize(("ratio", "modulus"), [(1.7, None), (1.0, 9e9), (0.3, 20e9)])
def test_the_network_of_a_fit_is_at_rest_over_its_springs_and_on_its_wall(ratio, modulus):
    pressed = PressedCrystal.of(ball_on_wall(SPRING), {"pressure": 20.0})
    network = pressed.find_network(ratio, modulus)
    expected = measure_ball_on_wall(ratio * SPRING, modulus or 3e9, 20.0, 4e3)
    found = gp.Waves(network).response(expected.frequencies, (0, "x"), (0, "x"), drag=4e3)
    assert_allclose(np.abs(found.coherent), expected.magnitude, rtol=1e-9)
    assert_allclose(pressed.network.on_site, [[SPRING], [0.0]])


@pytest.mark.slow
@pytest.mark.claim("fit-springs-at-rest")
@pytest.mark.parametrize(("name", "value"), [("on_site", 1.7), ("wall_modulus", 9e9)])
def test_a_crystal_comes_to_rest_anew_over_the_springs_that_are_fitted(name, value):
    ratio, modulus = {"on_site": (1.7, 3e9), "wall_modulus": (1.0, 9e9)}[name]
    measured = measure_ball_on_wall(ratio * SPRING, modulus, 20.0, 4e3)
    call = {"source": (0, "x"), "receiver": (0, "x"), "parameters": ("drag", name)}
    found = gp.fit_damping(ball_on_wall(SPRING), measured, **call, pressure=20.0)
    assert_allclose(found.values, [4e3, value], rtol=1e-6)
    assert not any("keep" in warning for warning in found.warnings)


@pytest.mark.slow
@pytest.mark.claim("fit-springs-at-rest")
def test_a_state_keeps_its_forces_over_springs_that_are_fitted_and_says_so():
    measured = measure_ball_on_wall(1.7 * SPRING, 3e9, 20.0, 4e3)
    state = ball_on_wall(SPRING).at_pressure(20.0)
    call = {"source": (0, "x"), "receiver": (0, "x"), "parameters": ("drag", "on_site")}
    found = gp.fit_damping(state, measured, **call)
    assert any("keep" in warning for warning in found.warnings)
    # the spring is too soft by the stiffness that its contact loses in truth
    network = ball_on_wall(1.7 * SPRING).at_pressure(20.0).network
    lost = float(state.network.normal_stiffness[0] - network.normal_stiffness[0])
    assert_allclose(found.values[1], 1.7 - lost / SPRING, rtol=1e-6)


@pytest.mark.parametrize(
    ("x", "load", "word"),
    [
        ("crystal", {}, "at_force"),
        ("crystal", {"presure": 20.0}, "Did you mean 'pressure'"),
        ("crystal", {"pressure": [1.0, 2.0]}, "2 values"),
        ("crystal", {"pressure": 1.0, "force": 1.0}, "one of"),
        ("state", {"pressure": 20.0}, "its load"),
    ],
)
def test_loads_of_a_crystal_that_are_refused(x, load, word):
    measured = measure_ball_on_wall(SPRING, 3e9, 20.0, 4e3)
    crystal = ball_on_wall(SPRING)
    given = {"crystal": crystal, "state": crystal.at_pressure(20.0)}[x]
    with pytest.raises(InputError, match=word):
        gp.fit_damping(given, measured, (0, "x"), (0, "x"), **load)


def test_stiffness_and_gain_are_found_with_the_damping_and_errors_follow_from_the_scatter():
    truth = {"damping": TAU, "stiffness": 1.2, "gain": 3.0}
    hertz = HERTZ[::2]
    data = measure(closed_form(TAU, 0.0, 1.2, 3.0, hertz))
    # a viscosity over a stiffness that is larger: the same time
    found = fit(gp.TransferFunction(hertz, np.abs(data), np.angle(data)), parameters=tuple(truth))
    assert np.all(np.abs(found.values - list(truth.values())) < 3.5 * found.stderrs)
    assert np.all(found.stderrs < 0.05 * found.values)
    assert_allclose(found.measured.phase_sigma, 0.02, rtol=0.3)
    assert math.isnan(found.p)
    assert found.chi2 == found.dof
    assert gp.DampingFit.from_dict(found.to_dict()) == found


@pytest.mark.claim("fit-damping")
@pytest.mark.parametrize("volts", [pytest.param(1e-7, marks=pytest.mark.slow), 1.0])
def test_a_sensor_in_a_ball_that_is_not_calibrated(volts):
    """The wall is moved; volts over volts of a disc in ball 3, by the closed form of the chain."""
    t = 2.0 * np.arcsin(np.pi * FEW / OMEGA / np.sqrt(1.0 + 2j * np.pi * FEW * TAU))
    places = [np.cos((COUNT - n + 0.5) * t) / np.cos((COUNT + 0.5) * t) for n in (2, 4)]
    springs = UNITS.stiffness * (1.0 + 2j * np.pi * FEW * TAU)
    force = 0.5 * springs * (places[0] - places[1])  # the mean of both contacts of ball 3
    data = measure(volts * force / UNITS.stiffness)
    raw = gp.TransferFunction(FEW, np.abs(data), np.angle(data), calibrated=False)
    call = {"quantity": "force", "parameters": ("damping", "gain")}
    found = gp.fit_damping(chain(), raw, (0, "x"), (3, "x"), **call)
    truth = [TAU, volts / UNITS.stiffness]
    assert np.all(np.abs(found.values - truth) < 4.0 * found.stderrs)
    assert np.all(found.stderrs < 0.1 * found.values)
    assert (found.quantity, found.unit) == ("stiffness", "1")
    assert gp.DampingFit.from_dict(found.to_dict()) == found
    with pytest.raises(InputError, match="not calibrated"):
        gp.fit_damping(chain(), raw, (0, "x"), (3, "x"), quantity="force")


@pytest.mark.slow
def test_a_load_goes_with_the_third_power_of_the_stiffness():
    data = measure(closed_form(TAU, 0.0, 1.2))
    measured = gp.TransferFunction(HERTZ, np.abs(data), np.angle(data))
    stiff, loaded = (fit(measured, parameters=("damping", name)) for name in ("stiffness", "load"))
    assert loaded.values[1] == pytest.approx(stiff.values[1] ** 3, rel=0.01)


def test_a_load_multiplies_all_static_forces():
    """By 1.5, and stiffnesses by its cubic root: static forces of 3 % of k d, across contacts
    too.
    """
    network = (
        gp.ContactLattice.of("triangular", 0.8)
        .contact_network(UNITS)
        .repeat((2, 1))
        .cut(1, 2, ("clamped", "free"))
    )
    force = np.full(network.n_contacts, 0.03 * UNITS.force)
    aside = 0.5 * force[:, None] * np.cross([0.0, 0.0, 1.0], network.normal)
    places = {
        "source": (0, "x"),
        "receiver": (network.n_balls - 1, "y"),
        "quantity": "transmissibility",
    }
    held, loaded = (
        replace(
            network,
            prestress=True,
            normal_force=load * force,
            tangential_force=load * aside,
            **{
                name: load ** (1.0 / 3.0) * getattr(network, name)
                for name in ("normal_stiffness", "shear_stiffness")
            },
        )
        for load in (1.0, 1.5)
    )
    hertz = HERTZ[::9]
    data = gp.Waves(loaded).response(hertz, damping=TAU, **places).coherent
    measured = gp.TransferFunction(hertz, np.abs(data), np.angle(data))
    found = gp.fit_damping(held, measured, **places, parameters=("load",), damping=TAU)
    assert_allclose(found.values, 1.5, rtol=1e-8)


def test_damping_of_normal_and_other_motion_are_told_apart_in_the_plane():
    network = (
        gp.ContactLattice.of("triangular", 0.7)
        .contact_network(UNITS)
        .repeat((2, 1))
        .cut(1, 3, ("clamped", "free"))
    )
    hertz = np.linspace(0.1, 2.0, 8) * OMEGA / (2.0 * math.pi)
    places = ((2, "x"), (5, "x"))
    values = gp.Waves(network).response(hertz, *places, damping=(TAU, 3.0 * TAU)).values[:, 0]
    found = gp.fit_damping(
        network,
        gp.TransferFunction(hertz[::-1], np.abs(values)[::-1]),
        *places,
        parameters=("damping", "tangential_damping"),
    )
    assert_allclose(found.damping, [TAU, 3.0 * TAU], rtol=1e-4)


@pytest.fixture(scope="module")
def without_loss():
    """A loss factor fitted to data without one."""
    data = measure(closed_form(TAU, 0.0, hertz=FOUR))
    measured = gp.TransferFunction(FOUR, np.abs(data), np.angle(data))
    return fit(measured, parameters=("loss_factor",), damping=TAU)


def test_what_does_not_matter_is_told(without_loss):
    assert any("loss_factor" in text and "from zero" in text for text in without_loss.warnings)


def test_a_written_fit_holds_its_data(without_loss, tmp_path):
    without_loss.write(tmp_path)
    table = gp.TransferFunction.read(tmp_path / "fit.csv", quantity="transmissibility")
    assert_allclose(table.magnitude, without_loss.measured.magnitude)
    assert_allclose(table.phase_sigma, without_loss.measured.phase_sigma)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_error_of_a_damping_that_is_nearly_zero(seed):
    """Magnitudes depend on its square, so that their derivative is nothing at zero, and says
    nothing of the error: the misfit rises by one up to it.
    """
    size = np.abs(measure(closed_form(0.0, 0.0, hertz=FEW), seed=seed))
    found = fit(gp.TransferFunction(FEW, size, None, 0.02 * size))
    best = found.values[0]
    error = found.stderrs[0]
    assert best < error < TAU

    def misfit(tau):
        return (size - np.abs(closed_form(tau, 0.0, hertz=FEW))) / (0.02 * size)

    assert_allclose(np.linalg.norm(misfit(best + error) - misfit(best)), 1.0, rtol=2e-3)
    assert misfit(best + 2.0 * error) @ misfit(best + 2.0 * error) > found.chi2 + 1.0
    assert any("damping" in text and "from zero" in text for text in found.warnings)


def test_data_that_say_nothing_of_a_damping_are_refused():
    """Far below the first resonance the balls follow the first one, whatever the losses."""
    data = gp.TransferFunction(1e-4 * FOUR, np.ones(FOUR.size), None, np.full(FOUR.size, 0.5))
    with pytest.raises(InputError, match="damping"):
        fit(data)


def test_data_of_which_squares_overflow_are_refused():
    with pytest.raises(InputError, match="units"):
        fit(gp.TransferFunction(FEW, np.full(FEW.size, 1e-300)))


def test_a_sigma_that_is_too_small_is_told():
    data = measure(closed_form(TAU, 0.0, hertz=FEW))
    wrong = fit(gp.TransferFunction(FEW, np.abs(data), np.angle(data), 1e-3 * np.abs(data)))
    assert any("sigma is too small" in text for text in wrong.warnings)


# -- tables ----------------------------------------------------------------------------------------


def read(tmp_path, text, **options):
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="utf-8")
    return gp.TransferFunction.read(path, **options)


def test_table_with_units(tmp_path):
    data = read(
        tmp_path,
        "Frequency (kHz),H1 (um/N),phase (deg),sigma (%)\n2,5,-90,10\n1,4,0,5\n",
        columns={"magnitude": "H1"},
    )
    assert_allclose(data.frequencies, [2000.0, 1000.0])
    assert_allclose(data.magnitude, [5e-6, 4e-6])
    assert_allclose(data.phase, [-0.5 * math.pi, 0.0])
    assert_allclose(data.sigma, [5e-7, 2e-7])
    loud = read(
        tmp_path, "frequency (Hz),magnitude (dB),sigma (dB)\n2,20,1\n", quantity="transmissibility"
    )
    assert_allclose([loud.magnitude[0], loud.sigma[0]], [10.0, math.log(10.0) / 2.0])
    plain = read(tmp_path, "frequency (Hz),magnitude\n2,20\n", quantity="transmissibility")
    assert plain.magnitude.tolist() == [20.0]


@pytest.mark.parametrize(
    ("quantity", "heading", "factor"),
    [
        ("displacement", "real (um/N),imag (um/N)", 1e-6),
        ("velocity", "Real (mm/s/N),Imag (mm/s/N)", 1e-3),
        ("acceleration", "real (m/s^2/N),imag (1/kg)", 1.0),
        ("force", "real (N/N),imag", 1.0),
        ("force", "real (N/um),imag (N/um)", 1e6),
        ("stiffness", "real (N/um),imag (N/um)", 1e6),
        ("transmissibility", "real,imag", 1.0),
    ],
)
def test_table_of_real_and_imaginary_parts(tmp_path, quantity, heading, factor):
    text = f"frequency (Hz),{heading}\n100,3,-4\n200,-2,0\n"
    data = read(tmp_path, text, quantity=quantity)
    assert_allclose(data.magnitude, [5.0 * factor, 2.0 * factor], rtol=1e-14)
    assert_allclose(data.phase, [math.atan2(-4.0, 3.0), math.pi])
    assert data.calibrated


@pytest.mark.parametrize(
    ("quantity", "heading", "value", "calibrated"),
    [
        ("transmissibility", "H (dB)", 10.0, True),
        ("displacement", "H (um/N)", 20e-6, True),
        ("acceleration", "magnitude (m/s^2/N)", 20.0, True),
        ("force", "force (N/N)", 20.0, True),
        ("force", "force (N/um)", 20e6, True),
        ("force", "force (N)", 20.0, False),
        ("stiffness", "H (N/mm)", 20e3, True),
        ("displacement", "H (V/V)", 20.0, False),
        ("transmissibility", "magnitude (mV)", 20.0, False),
    ],
)
def test_headings_and_units_of_magnitudes(tmp_path, quantity, heading, value, calibrated):
    data = read(tmp_path, f"frequency (Hz),{heading}\n100,20\n", quantity=quantity)
    assert_allclose(data.magnitude, value)
    assert data.calibrated == calibrated


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("frequency (Hz),real (m/N)\n1,2\n", {}, "no column named 'imag'"),
        ("f (Hz),H (um/N)\n1,2\n", {}, "Its columns are 'f (Hz)', 'H (um/N)'"),
        ("frequency (Hz),G (um/N)\n1,2\n", {}, "'real' and 'imag'"),
        ("frequency (Hz),H (kg)\n1,2\n", {"quantity": "force"}, "V/V"),
        ("frequency (Hz),H (m/N)\n1,2\n", {"quantity": "speed"}, "accelera"),
        ("frequency (Hz),H\n1,2\n", {"quantity": "speed"}, "accelera"),
        ("frequency (Hz),real (um/N),imag\n1,2,3\n", {}, "no unit of receptance"),
        ("frequency (Hz),real (um/N),imag (V/V)\n1,2,3\n", {}, "'um/N' and 'V/V'"),
    ],
)
def test_what_a_table_lacks_is_said_with_what_it_has(tmp_path, text, options, said):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, **options)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency (Hz),magnitud (m/N)\n1,2\n", "'magnitude'"),
        ("frequency,magnitude (m/N)\n1,2\n", "has no unit"),
        ("frequency (Hz),magnitude (mm)\n1,2\n", "mm"),
        ("frequency (Hz),magnitude (m/N)\n1,x\n", "found 'x'"),
        ("frequency (Hz),magnitude (m/N)\n1,-2\n", "'-2 m/N'"),
        ("frequency (Hz),magnitude (m/N)\n0,2\n", "'0 Hz'"),
        ("frequency (Hz),magnitude (m/N),phase (s)\n1,2,3\n", "rad or deg"),
        ("frequency (Hz),magnitude (m/N),phase (rad)\n1,2,nan\n", "phase"),
        ("frequency (Hz),magnitude (m/N),phase (rad)\n1,2,up\n", "line 2, phase"),
        (
            "frequency (Hz),magnitude (m/N),phase (rad),phase_sigma (rad)\n1,2,1,1\n",
            "no sigma",
        ),
        ("frequency (Hz),magnitude (m/N),sigma (m/N)\n1,2,0\n", "sigma"),
        ("frequency (Hz),magnitude (m/N)\n", "no rows"),
        ("", "is empty"),
    ],
)
def test_bad_table_is_one_error(tmp_path, text, said):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert said in str(caught.value)
    assert "data.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"parameters": ("dampin",)}, "damping"),
        ({"parameters": ()}, "one or more"),
        ({"parameters": ("damping", "damping")}, "at most once"),
        ({"parameters": ("stiffness", "load")}, "stiffness and load"),
        ({"damping": -1.0, "parameters": ("loss_factor",)}, "damping: found -1"),
        ({"measured": [1.0]}, "no transfer function"),
        ({"finite_overlap": True}, "no load"),
        ({"measured": gp.TransferFunction([100.0], [1.0])}, "one more is needed"),
    ],
)
def test_bad_input_is_one_error(arguments, said):
    data = closed_form(TAU, ETA)
    given = {"measured": gp.TransferFunction(HERTZ, np.abs(data), np.angle(data))} | arguments
    with pytest.raises(InputError, match=said):
        fit(given.pop("measured"), **given)
    with pytest.raises(InputError, match=r"2 .*magnitude.* 1 "):
        gp.TransferFunction([1.0], [1.0, 2.0])


def test_a_fit_at_one_frequency_has_a_figure():
    data = closed_form(TAU, 0.0, hertz=FOUR[:1])
    found = fit(gp.TransferFunction(FOUR[:1], np.abs(data), np.angle(data)))
    for ax in transfer_fit_figure(found).axes:
        low, high = ax.get_xlim()
        (place,) = ax.lines[-1].get_xdata()
        assert low < place < high


@pytest.mark.parametrize("phase", [True, False])
def test_a_receiver_that_no_wave_reaches_is_refused(phase):
    """Two chains that do not touch: the response is zero, of which a phase is not defined."""
    whole = chain()
    contacts = {name: np.delete(getattr(whole, name), 2, axis=0) for name in whole.contact_fields}
    network = replace(whole, **contacts)
    data = closed_form(TAU, ETA, hertz=FOUR)
    measured = gp.TransferFunction(FOUR, np.abs(data), np.angle(data) if phase else None)
    with pytest.raises(InputError, match="no response at the receiver"):
        fit(measured, network)


# -- the command -----------------------------------------------------------------------------------

SCENE = """schema: 1
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19.05 mm}
crystal: {lattice: chain}
load: {force: 20 N}
observe: [response]
response:
  frequencies: [1 kHz]
  source: plane
  receiver: 0 x
  quantity: transmissibility
  loss_factor: 0.01
  cut: {axis: 0, layers: 6, edges: floor free}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    state = gp.Crystal.on("chain", [gp.Ball(gp.Material(193e9, 0.30, 8000.0), 19.05e-3)]).at_force(
        20.0
    )
    hertz = np.linspace(400.0, 14000.0, 6)
    values = gp.Waves(state.network.cut(0, 6, ("floor", "free"))).response(
        hertz, "plane", (0, "x"), 2e-6, 0.01, quantity="transmissibility"
    )
    rows = zip(hertz, values.magnitude[:, 0], np.degrees(values.phase[:, 0]), strict=True)
    text = "\n".join(
        ["frequency (Hz),H,phase (deg),sigma (%)", *(f"{f},{m},{p},2" for f, m, p in rows)]
    )
    (tmp_path / "data.csv").write_text(text, encoding="utf-8")
    return tmp_path


def command(*words):
    from granphon.cli.main import main

    return main(["fit", "scene.yaml", "data.csv", "--column", "magnitude=H", *words])


def test_the_command_fits_the_response_of_a_scene(folder, capsys):
    assert command("-o", "out") == 0
    printed = capsys.readouterr().out
    assert "damping               2.000 +/- " in printed
    assert "6 magnitudes and phases" in printed
    fit = gp.DampingFit.from_dict(read_yaml(folder / "out" / "fit.yaml"))
    assert_allclose(fit.damping, 2e-6, rtol=1e-6)
    assert_allclose(fit.loss_factor, 0.01)
    assert (folder / "out" / "fit.png").stat().st_size > 10_000
    assert redraw(folder / "out", folder / "again.png").is_file()


@pytest.mark.slow
def test_the_command_fits_two_losses_and_prints_their_correlation(folder, capsys):
    """The data are those of a damping alone, so that nothing is left for drag."""
    names = ["--parameter", "damping", "--parameter", "drag"]
    assert command("-o", "out", *names) == 0
    fit = gp.DampingFit.from_dict(read_yaml(folder / "out" / "fit.yaml"))
    assert_allclose(fit.values[0], 2e-6, rtol=1e-4)
    assert fit.drag[0] < 3.0 * fit.stderrs[1] + 1.0
    printed = " ".join(capsys.readouterr().out.split())
    assert f"correlation of damping and drag {fit.correlation[0, 1]:.2f}" in printed
    assert -1.0 < fit.correlation[0, 1] < -0.5


@pytest.mark.parametrize(
    ("words", "change", "said"),
    [
        (["--sigma", "2 %"], {}, "--sigma"),
        (["--parameter", "young_modulus"], {}, "'young_modulus' cannot"),
        ([], {"20 N": "[20 N, 30 N]"}, "has 2 states"),
        ([], {SCENE[SCENE.index("observe") :]: ""}, "has no block response"),
    ],
)
def test_the_command_refuses(folder, capsys, words, change, said):
    text = SCENE
    for old, new in change.items():
        text = text.replace(old, new)
    (folder / "scene.yaml").write_text(text, encoding="utf-8")
    assert command(*words) == 2
    assert said in capsys.readouterr().err


def test_a_column_named_h_is_a_response_also_for_a_scene_that_expects_none(folder, capsys):
    from granphon.cli.main import main

    (folder / "scene.yaml").write_text(SCENE[: SCENE.index("observe")], encoding="utf-8")
    (folder / "data.csv").write_text("frequency (Hz),H (um/N)\n400,1.1\n500,1.2\n")
    assert main(["fit", "scene.yaml", "data.csv"]) == 2
    assert "has no block response" in capsys.readouterr().err


@pytest.mark.parametrize("observed", [True, False])
def test_a_table_without_magnitudes_is_told_so(folder, capsys, observed):
    """Not that the scene has balls of several kinds, which a transfer function may have."""
    from granphon.cli.main import main

    (folder / "scene.yaml").write_text(
        SCENE if observed else SCENE[: SCENE.index("observe")], encoding="utf-8"
    )
    (folder / "data.csv").write_text(
        "frequency (Hz),G\n400,1.1\n500,1.2\n600,1.3\n", encoding="utf-8"
    )
    assert main(["fit", "scene.yaml", "data.csv"]) == 2
    said = capsys.readouterr().err
    assert "'magnitude'" in said
    assert "kinds" not in said


@pytest.mark.parametrize("heading", ["magnitude", "magnitude (1)"])
def test_numbers_are_read_as_a_transmissibility_if_it_is_named(tmp_path, heading):
    path = tmp_path / "data.csv"
    path.write_text(f"frequency (Hz),{heading}\n100,1.03\n200,1.1\n")
    with pytest.raises(InputError, match="transmissibility"):
        gp.TransferFunction.read(path)
    assert gp.TransferFunction.read(path, quantity="transmissibility").magnitude.tolist() == [
        1.03,
        1.1,
    ]


def test_one_frequency_is_a_number_too_and_none_is_refused():
    one = gp.TransferFunction(100.0, 1e-6)
    assert one.frequencies.shape == one.magnitude.shape == (1,)
    with pytest.raises(InputError, match="frequencies"):
        gp.TransferFunction(None, [1e-6])
    with pytest.raises(InputError, match="1 number of magnitude"):
        gp.TransferFunction([1.0, 2.0], 1e-6)
    with pytest.raises(InputError, match="calibrated"):
        gp.TransferFunction([1.0], [1e-6], calibrated=1)
