"""From a load to the state of the contacts, and back."""

from __future__ import annotations

import itertools
import json
import math
import pickle
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.loads import Load, force_of_frame
from granphon.base.errors import InputError, PrecisionError
from granphon.base.scales import write_quantity
from granphon.media.choice import find_medium
from granphon.observables.velocities import local_exponent

SI = ("force", "pressure", "overlap", "normal_stiffness", "shear_stiffness")
REDUCED = (
    "relative_overlap",
    "reduced_force",
    "reduced_spacing",
    "force_fluctuation",
    "contact_fraction",
    "valid",
    "regime",
)
NAMED = ("force", "pressure", "overlap")

diameters = st.floats(-9.0, 2.0).map(lambda x: 10.0**x)
loads = st.floats(-30.0, -3.0).map(lambda x: 10.0**x)


@given(
    diameter=diameters,
    load=loads,
    lattice=st.sampled_from(["triangular", "square", "kagome"]),
    friction=st.booleans(),
)
def test_round_trips(diameter, load, lattice, friction):
    material = gp.Material(7e10, 0.2, 2500.0)
    medium = gp.AveragedLattice(gp.Packing(material, diameter, lattice=lattice, friction=friction))
    state = medium.at_force(load * 7e10 * diameter**2)
    for name in NAMED:
        again = getattr(medium, f"at_{name}")(getattr(state, name))
        for other in SI:
            assert_allclose(getattr(again, other), getattr(state, other), rtol=3e-15)
        assert_allclose(getattr(again, name), getattr(state, name), rtol=5e-16)


# -- shapes ----------------------------------------------------------------------------------------


def test_scalar_in_float_out(packing):
    medium = gp.AveragedLattice(packing)
    for given_load in (1.0, np.float64(1.0), np.array(1.0), 1):
        state = medium.at_force(given_load)
        for name in (
            *SI,
            "relative_overlap",
            "reduced_force",
            "reduced_spacing",
            "force_fluctuation",
            "contact_fraction",
        ):
            assert type(getattr(state, name)) is float
        assert state.valid is True
        assert state.shape == ()
        assert state.is_single


@pytest.mark.parametrize("shape", [(1,), (3,), (2, 3), (2, 1, 2)])
@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize(
    ("make", "width"),
    [(gp.AveragedLattice, 0.0), (gp.AveragedForce, 2e-6), (gp.EffectiveMedium, 2e-6)],
)
def test_attributes_have_the_shape_of_the_load(steel, shape, name, make, width):
    medium = make(gp.Packing(steel, 8e-3, gp.Uniform(width)))
    values = getattr(medium.at_force(2.0), name) * (1 + np.arange(math.prod(shape))).reshape(shape)
    state = getattr(medium, f"at_{name}")(values)
    for attribute in (*SI, *REDUCED):
        assert getattr(state, attribute).shape == shape
    assert state.shape == shape
    assert not state.is_single
    for index in np.ndindex(shape):
        alone = getattr(medium, f"at_{name}")(values[index])
        for attribute in SI:
            assert getattr(state, attribute)[index] == pytest.approx(
                getattr(alone, attribute), rel=1e-12
            )
        part = state[index]
        assert part.is_single
        assert part.force == pytest.approx(alone.force, rel=1e-12)
    if name == "pressure":
        assert medium.at_pressure(values, finite_overlap=True).force.shape == shape


def test_equal_balls(packing, smooth):
    state = gp.AveragedLattice(packing).at_force(18.446)
    assert state.reduced_force == state.reduced_spacing == math.inf
    assert state.force_fluctuation == 0.0
    assert state.contact_fraction == 1.0
    assert state.valid is True
    assert state.regime == "high"
    many = gp.AveragedLattice(packing).at_force([1.0, 2.0])
    assert np.all(np.isinf(many.reduced_force))
    assert np.all(np.isinf(many.reduced_spacing))
    assert np.array_equal(many.force_fluctuation, [0, 0])
    assert np.array_equal(many.contact_fraction, [1, 1])
    assert np.array_equal(many.valid, [True, True])
    assert many.regime.tolist() == ["high", "high"]
    assert gp.AveragedLattice(smooth).at_force(1.0).shear_stiffness == 0.0


def test_scales_belong_to_one_load(packing):
    state = gp.AveragedLattice(packing).at_force(18.446)
    scales = state.scales
    assert (scales.length, scales.stiffness, scales.mass) == (
        packing.diameter,
        state.normal_stiffness,
        packing.mass,
    )
    assert_allclose(
        scales.frequency,
        math.sqrt(state.normal_stiffness / packing.mass) / (2 * math.pi),
        rtol=1e-15,
    )
    assert_allclose(scales.velocity, 2 * math.pi * scales.frequency * 8e-3, rtol=1e-15)
    with pytest.raises(InputError, match="2 loads"):
        _ = gp.AveragedLattice(packing).at_force([1.0, 2.0]).scales


# -- what cannot be --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([1e-6, math.nan], "finite"),
        ([1e-6, 0.0], "zero"),
        (-0.0, "zero"),
        ([1e-6, -1e-300], "tensile"),
        ([], "finite"),
        (np.empty((0, 3)), "finite"),
        ("10 N", "number"),
    ],
)
def test_impossible_loads(packing, name, value, text):
    at = getattr(gp.AveragedLattice(packing), f"at_{name}")
    with pytest.raises(InputError, match=text) as caught:
        at(value)
    assert isinstance(caught.value, ValueError)
    assert name in str(caught.value)
    if name == "pressure":
        with pytest.raises(InputError, match=text):
            at(value, finite_overlap=True)


def test_balls_cannot_overlap_by_their_diameter(packing):
    medium = gp.AveragedLattice(packing)
    just = np.nextafter(8e-3, 0.0)
    assert medium.at_overlap(just).overlap == just
    for value in (8e-3, [1e-6, 9e-3]):
        with pytest.raises(InputError, match="diameter"):
            medium.at_overlap(value)
    limit = medium.at_overlap(just)
    with pytest.raises(InputError, match="diameter"):
        medium.at_force(1.001 * limit.force)
    with pytest.raises(InputError, match="diameter"):
        medium.at_pressure(1.001 * limit.pressure)


def test_a_state_does_not_share_the_callers_memory(packing):
    load = np.array([1.0, 2.0])
    view = load.view()
    view.flags.writeable = False
    state = gp.AveragedLattice(packing).at_force(view)
    load[0] = -5.0
    assert_allclose(state.force, [1.0, 2.0])


# -- balls that differ -----------------------------------------------------------------------------

SPREADS = {
    "uniform": lambda w: gp.Uniform(w),
    "normal": lambda w: gp.Normal(w / math.sqrt(12.0)),
    "discrete": lambda w: gp.Discrete((8e-3 - w / 3.0, 8e-3 + w / 3.0), (0.5, 0.5)),
    "measured": lambda w: gp.Measured((8e-3 - w, 8e-3, 8e-3 + w)),
}
LAW_MEDIA = (gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium)
every_law = pytest.mark.parametrize("make", LAW_MEDIA)


def differing(steel, width=2.04e-6, spread="uniform", **options):
    return gp.Packing(steel, 8e-3, spread=SPREADS[spread](width), **options)


def unit_of_force(packing):
    return packing.law.coefficient * math.sqrt(packing.width) ** 3


@given(
    part=st.floats(-3.0, 17.0),
    width=st.floats(-16.0, -1.0),
    name=st.sampled_from(NAMED),
    finite=st.booleans(),
    make=st.sampled_from(LAW_MEDIA),
    spread=st.sampled_from(["uniform", "normal"]),
)
def test_round_trips_of_balls_that_differ(steel, part, width, name, finite, make, spread):
    packing = differing(steel, 8e-3 * 10.0**width, spread)
    # twenty decades up from f* = 1e-3, as long as balls are not pressed flat
    load = min(unit_of_force(packing) * 10.0**part, 0.1 * packing.law.force(8e-3))
    state = make(packing).at_force(load, finite_overlap=finite)
    again = getattr(make(packing), f"at_{name}")(getattr(state, name), finite_overlap=finite)
    # an overlap near zero comes back to rounding of W, and the force to what that is worth
    size = abs(state.overlap) + packing.width
    assert again.overlap == pytest.approx(state.overlap, rel=0.0, abs=1e-14 * size)
    room = 1e-14 * (1.0 + size * state.normal_stiffness / state.force)
    assert again.force == pytest.approx(state.force, rel=room)
    assert again.pressure == pytest.approx(state.pressure, rel=room)


@every_law
@pytest.mark.parametrize("spread", ["uniform", "normal"])
def test_equal_balls_are_the_limit_of_width_zero(steel, make, spread):
    equal = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(18.446)
    widths = 8e-3 * 10.0 ** np.arange(-16.0, -4.0)
    for width in widths:
        state = make(differing(steel, width, spread)).at_force(18.446)
        # k/k_ala - 1 = -r/96 (W/delta)^2, at most 1/96
        room = 4e-15 + 1.1 / 96.0 * (state.packing.width / equal.overlap) ** 2
        assert abs(state.normal_stiffness / equal.normal_stiffness - 1.0) < room
        assert (
            abs(state.overlap / equal.overlap - 1.0)
            < 4e-15 + (state.packing.width / equal.overlap) ** 2
        )
    far = [
        make(differing(steel, w, spread)).at_force(18.446).stiffness_ratio - 1.0
        for w in (4e-7, 2e-7)
    ]
    if make is not gp.AveragedLattice:
        assert math.log2(far[0] / far[1]) == pytest.approx(2.0, abs=0.01)


@every_law
def test_a_reduced_force_near_the_end_of_the_floating_range(steel, make):
    # c W^(3/2) is a normal number for the first width, but W^(3/2) is not; for the second neither
    # is
    for width, forces in ((1e-210, [1e-304, 1.0]), (1e-218, [1e-100, 1e-30])):
        packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(width))
        state = make(packing).at_force(forces)
        unit = Decimal(packing.law.coefficient) * Decimal(width).sqrt() ** 3
        assert_allclose(
            state.reduced_force, [float(Decimal(force) / unit) for force in forces], rtol=2e-15
        )


@pytest.mark.parametrize("make", LAW_MEDIA[1:])
def test_mean_overlaps_below_zero(steel, make):
    medium = make(differing(steel))
    width = medium.packing.width
    state = medium.at_overlap(-0.1 * width)
    assert state.force > 0.0
    assert state.reduced_spacing == pytest.approx(0.4, rel=1e-14)
    assert state.regime == "low"
    assert state.pressure > 0.0
    assert gp.sound_velocities(state).longitudinal > 0.0
    with pytest.raises(InputError, match="no balls touch"):
        medium.at_overlap([0.0, -0.5 * width])


@pytest.mark.parametrize("make", LAW_MEDIA[1:])
def test_loads_too_low_for_the_medium(steel, make):
    medium = make(differing(steel))
    unit = unit_of_force(medium.packing)
    for load in (1e-45 * unit, [unit, 1e-45 * unit]):
        with pytest.raises(PrecisionError, match="load"):
            medium.at_force(load)
    for load, text in ((0.0, "zero"), (-1.0, "tensile"), (math.nan, "finite")):
        with pytest.raises(InputError, match=text):
            medium.at_force(load)
    if make is gp.EffectiveMedium:
        assert medium.at_force(1.001e-6 * unit).valid is False
        with pytest.raises(PrecisionError, match=f"is below {write_quantity(1e-6 * unit, 'N', 4)}"):
            medium.at_force(0.999e-6 * unit)


def test_validity_and_regime_at_their_borders(steel):
    packing = differing(steel)
    medium = gp.EffectiveMedium(packing)
    unit = unit_of_force(packing)
    state = medium.at_force(unit * np.array([0.0799999, 0.0800001, 100.0]))
    assert state.valid.tolist() == [False, True, True]
    rms = packing.width / math.sqrt(12.0)
    root = math.sqrt(10.0)
    for make in LAW_MEDIA[:2]:
        overlaps = rms * np.array(
            [1.0 / root * (1 - 1e-9), 1.0 / root * (1 + 1e-9), root * (1 - 1e-9), root * (1 + 1e-9)]
        )
        state = make(packing).at_overlap(overlaps)
        assert state.regime.tolist() == ["low", "intermediate", "intermediate", "high"]
        assert state.valid.tolist() == [False, False, False, True]


def test_states_of_every_medium_and_spread_come_back(steel):
    for spread, make in itertools.product(SPREADS, LAW_MEDIA):
        state = make(differing(steel, spread=spread)).at_force([5.0, 18.446])
        for again in (
            gp.ContactState.from_dict(json.loads(json.dumps(state.to_dict()))),
            pickle.loads(pickle.dumps(state)),
        ):
            assert again == state
            assert np.array_equal(again.contact_fraction, state.contact_fraction)
            assert np.array_equal(again.law.force(again.overlap), state.law.force(state.overlap))


@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
@pytest.mark.parametrize("name", ["overlap", "force", "normal_stiffness"])
def test_a_state_without_digest_has_the_numbers_of_its_law(steel, name):
    """Also of samples, whose mean it is; and an overlap is no more than a diameter, nor less than
    that of balls apart.
    """
    states = [make(differing(steel)).at_force([5.0, 18.446]) for make in LAW_MEDIA[:3]]
    samples = gp.DirectSimulation(differing(steel), shape=(4, 4)).at_force([5.0, 18.446])
    for state in [*states, *([samples] if name != "normal_stiffness" else [])]:
        data = json.loads(json.dumps(state.to_dict()))
        del data["digest"]
        assert type(state).from_dict(data) == state
        values = data[name]
        odd = [1.00001 * values[1], *((-1.0, 1.0) if name == "overlap" else ())]
        for value in odd:
            with pytest.raises(InputError, match=f"({name}|force) .*{type(state).__name__}"):
                type(state).from_dict(data | {name: [values[0], value]})


# -- macroscopic properties (47)-(49) --------------------------------------------------------------


@every_law
@pytest.mark.parametrize("spread", ["uniform", "normal"])
def test_local_exponent_is_the_slope_of_log_velocity(steel, make, spread):
    packing = differing(steel, spread=spread)
    medium = make(packing)
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    steps = 0.02 * np.array([-4, -3, -2, -1, 1, 2, 3, 4])
    for reduced in (0.12, 1.0, 30.0):
        pressure = medium.at_force(reduced * unit_of_force(packing)).pressure
        velocities = gp.sound_velocities(medium.at_pressure(pressure * np.exp(steps))).longitudinal
        slope = weights @ np.log(velocities) / 0.02
        assert local_exponent(medium.at_pressure(pressure)) == pytest.approx(slope, rel=1e-8)
    high = medium.at_force(unit_of_force(packing) * 10.0 ** np.array([3.0, 5.0]))
    # 1/6 (1 + r/12 (W/delta)^2 ...): W/delta = f*^(-2/3)
    departure = np.abs(6.0 * local_exponent(high) - 1.0)
    assert np.all(departure < 0.2 * 10.0 ** (-4.0 / 3.0 * np.array([3.0, 5.0])) + 4e-15)


def test_the_media_are_ordered(steel):
    # "They frame the exact and the EMA results from below and from above"
    packing = differing(steel)
    overlaps = packing.width * np.linspace(0.05, 20.0, 200)
    lattice, average, effective = (make(packing).at_overlap(overlaps).force for make in LAW_MEDIA)
    assert np.all(lattice < effective)
    assert np.all(effective < average)
    forces = unit_of_force(packing) * np.logspace(-1.0, 5.0, 100)
    for make in LAW_MEDIA[1:]:
        ratio = make(packing).at_force(forces).stiffness_ratio
        assert np.all(ratio < 1.0)
        assert np.all(np.diff(ratio) > 0.0)


# -- the terms of finite overlap, which the state owns ---------------------------------------------


#: what each function of a state finds, as numbers
FOUND = {
    "sound": lambda state: gp.sound_velocities(state).longitudinal,
    "pulses": lambda state: gp.pulse_velocities(state, 6500.0, (0.3, 0.7)).group,
    "moduli": lambda state: gp.moduli(state).tensor,
    "validity": lambda state: gp.validity(state)["velocity"].value,
    "atoms": lambda state: gp.atoms(state).cell[0, 0],
    "calculator": lambda state: gp.HertzMindlin(state).finite_overlap,
    "phonons": lambda state: gp.Phonons(state).frequencies([[0.1, 0.2]]),
}
every_function = pytest.mark.parametrize("name", FOUND)


@every_law
@every_function
def test_a_function_reads_finite_overlap_from_the_state(steel, make, name):
    medium = make(differing(steel, 2.04e-5))
    unset, limit, finite = (
        medium.at_force(200.0, finite_overlap=given) for given in (None, False, True)
    )
    assert (unset.finite_overlap, limit.finite_overlap, finite.finite_overlap) == (
        False,
        False,
        True,
    )
    assert unset == limit
    find = FOUND[name]
    np.testing.assert_array_equal(find(unset), find(limit))
    assert np.any(np.asarray(find(finite)) != find(limit))


@every_law
@pytest.mark.parametrize("finite", [False, True])
@pytest.mark.parametrize("kind", ["force", "pressure", "overlap"])
def test_equation_16_holds_to_rounding(steel, make, finite, kind):
    medium = make(differing(steel, 2.04e-5))
    loads = np.array([getattr(medium.at_overlap(part * 8e-3), kind) for part in (1e-3, 0.01, 0.1)])
    state = getattr(medium, f"at_{kind}")(loads, finite_overlap=finite)
    v = gp.sound_velocities(state)
    m = gp.moduli(state)
    assert_allclose(state.effective_density * v.longitudinal**2, m.bulk + m.shear, rtol=1e-12)
    assert_allclose(state.effective_density * v.transverse**2, m.shear, rtol=1e-12)
    one = state[1]
    assert one.finite_overlap == finite
    assert_allclose(gp.sound_velocities(one).longitudinal, v.longitudinal[1], rtol=1e-14)


@every_law
def test_a_second_load_is_no_flag(packing, make):
    for kind in ("force", "pressure", "overlap"):
        with pytest.raises(TypeError, match="positional"):
            getattr(make(packing), f"at_{kind}")(2.0e-6, 18.446e-6)


@every_law
@pytest.mark.parametrize("flag", [1, 0, "yes", 18.446, [True]])
def test_finite_overlap_is_true_or_false(packing, make, flag):
    for kind in ("force", "pressure", "overlap"):
        with pytest.raises(InputError, match=r"finite_overlap: .*true"):
            getattr(make(packing), f"at_{kind}")(1e-6, finite_overlap=flag)
    assert make(packing).at_force(1.0, finite_overlap=np.True_).finite_overlap is True


MEDIA = [
    lambda packing: gp.AveragedLattice(packing),
    lambda packing: gp.AveragedForce(packing),
    lambda packing: gp.EffectiveMedium(packing),
    lambda packing: gp.DirectSimulation(packing, (6, 6)),
    lambda packing: gp.AutoMedium(packing, 0.3),
]


@pytest.mark.parametrize("medium", MEDIA)
@pytest.mark.parametrize(
    "value", [{"force": 18.0}, {"pressure": [[4e3, 2e3]]}, {"overlap": [2e-6, 3e-6, 4e-6]}]
)
def test_a_load_of_any_kind_is_what_names_it(steel, medium, value):
    """The state at a load is that of the method of its kind, and has its shape; a frame's load is
    that of its contacts.
    """
    medium = medium(differing(steel))
    ((kind, given),) = value.items()
    assert isinstance(medium, gp.Medium)
    state = medium.at(Load(kind, given))
    assert state == getattr(medium, f"at_{kind}")(given)
    assert state.shape == np.shape(given)
    assert medium.at(Load("side_force", 990.0, 31)) == medium.at_force(force_of_frame(990.0, 31))


def test_loads_are_compared_indexed_and_kept():
    load = Load("force", [[1.0, 2.0], [3.0, 4.0]])
    assert (load.shape, load.size, load.values) == ((2, 2), 4, (1.0, 2.0, 3.0, 4.0))
    assert load[1] == Load("force", [3.0, 4.0]) == load.flat[2:]
    assert load != load.flat
    assert load != Load("pressure", load.array)
    assert Load("force", 3.0) == Load("force", [3.0])
    assert len({load, pickle.loads(pickle.dumps(load)), load.flat}) == 2
    assert str(load[1, 0]) == "force = 3.0"
    # the unit of a pressure is that of the dimension
    assert [Load("pressure", 2.0).describe(p) for p in (1, 2, 3)] == [
        f"pressure = 2.0 {unit}" for unit in ("N", "N/m", "Pa")
    ]
    assert [Load("overlap", 2e-6).describe(p) for p in (1, 2, 3)] == ["overlap = 2e-06 m"] * 3
    with pytest.raises(ValueError, match="read-only"):
        load.array[0, 0] = 5.0
    assert Load.only(force=None, overlap=-1e-6, pressure=None) == Load("overlap", -1e-6)
    for wrong in (
        {"force": None},
        {"force": 1.0, "pressure": 2.0},
        {"force": [[1.0]]},
        {"force": [1.0, 0.0]},
    ):
        with pytest.raises(InputError):
            Load.only(**wrong)


@pytest.mark.parametrize("name", ["ala", "afa", "ema", "simulation", "auto"])
def test_loads_of_crystals_are_refused_for_packings(name):
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2e-6))
    medium = find_medium(name)(packing)
    for load, told in (
        (Load("stress", 10.0, tensor=(-1.0, -1.0, 0.0)), "by a stress"),
        (Load("pressure", 1e3, gravity=9.81), "no gravity"),
    ):
        with pytest.raises(InputError, match=told):
            medium.at(load)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"gravity": "down"}, "gravity: .*down"),
        ({"gravity": np.nan}, "gravity: .*nan"),
        ({"gravity": [0.0, -9.81]}, "one number"),
        ({"kind": "stress", "tensor": "xx"}, "tensor: .*xx"),
        ({"kind": "stress", "tensor": (1.0, 2.0)}, "2 components"),
    ],
)
def test_a_load_without_numbers_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        Load(**({"kind": "pressure", "array": 1.0} | options))


def test_a_load_keeps_plain_numbers():
    load = Load("stress", [1.0, 2.0], tensor=np.array([-1.0, 0.0, -1.0]), gravity=np.float32(1.5))
    assert load == Load("stress", [1.0, 2.0], tensor=(-1.0, 0.0, -1.0), gravity=1.5)
    assert hash(load) == hash(Load("stress", [1.0, 2.0], tensor=[-1, 0, -1], gravity=1.5))


@pytest.mark.parametrize(
    ("lattice", "cut", "tensor"),
    [
        ("chain", (), (-1.0,)),
        ("square", ((1, 3, ("free", "free")),), (-1.0,)),
        ("fcc", (), (-1.0, -1.0, -1.0, 0.0, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize(("kind", "size"), [("stress", 10.0), ("strain", 1e-4)])
def test_states_under_a_tensor_have_the_shape_of_the_load(steel, lattice, cut, tensor, kind, size):
    """The components (1,) of one period are no matrix (1, 1), and as few sizes change nothing."""
    ball = gp.Ball(steel, 8e-3)
    packing = gp.Arrangement((("A", ball),), lattice, cut=cut)
    for sizes in (size, [size], [[size], [2.0 * size]]):
        load = Load(kind, sizes, tensor=tensor)
        state = find_medium("crystal")(packing).at(load)
        assert state.force.shape == state.shape == load.shape
        methods = {"stress": packing.crystal.at_stress, "strain": packing.crystal.at_strain}
        last = methods[kind](float(np.ravel(sizes)[-1]) * np.array(tensor))
        forces = state.source.normal_force.reshape(-1, packing.crystal.n_contacts)
        assert_allclose(forces[-1], last.normal_force, rtol=1e-12)


def test_three_sizes_of_three_components_are_no_matrix_of_a_crystal_in_space(steel):
    packing = gp.Arrangement((("A", gp.Ball(steel, 8e-3)),), "fcc")
    load = Load("stress", [10.0, 10.0, 10.0], tensor=(-1.0, -1.0, -1.0))
    with pytest.raises(InputError, match="Voigt order"):
        find_medium("crystal")(packing).at(load)


@pytest.mark.parametrize("name", ["ala", "simulation"])
def test_an_index_of_no_load_is_refused(name):
    packing = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2e-6))
    options = {"shape": (4, 4)} if name == "simulation" else {}
    state = find_medium(name)(packing, **options).at_force([10.0, 20.0])
    for index in ([], slice(2, None)):
        with pytest.raises(InputError, match="none of the loads"):
            _ = state[index]
    assert state[-1].force == 20.0
    assert [one.force for one in state] == [10.0, 20.0]
    assert state[0][...].force == 10.0
    with pytest.raises(InputError, match="one load"):
        _ = state[0][0]


@pytest.mark.parametrize("name", ["triangular", "fcc"])
def test_a_huge_pressure_on_a_boundary_that_shrinks_has_one_overlap(steel, name):
    """Without the shrinking the balls would overlap by several diameters; it is found by bisection
    of c s^(3/2) = f(P, d - s).
    """
    d = 8e-3
    packing = gp.Packing(steel, d, lattice=name)
    state = gp.AveragedLattice(packing).at_pressure(1e12, finite_overlap=True)
    lower, upper = 0.0, d
    for _ in range(60):
        middle = 0.5 * (lower + upper)
        wanted_force = 1e12 / packing.structure.pressure_per_force(d - middle)
        is_below = packing.law.force(middle) < wanted_force
        lower, upper = (middle, upper) if is_below else (lower, middle)
    assert_allclose(state.overlap, lower, rtol=1e-9)
    with pytest.raises(InputError, match="diameter"):
        gp.AveragedLattice(packing).at_pressure(1e100, finite_overlap=True)
