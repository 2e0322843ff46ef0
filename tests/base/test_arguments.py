"""Numbers, names and states at every public border, and what Python and NumPy would make of
others.
"""

from __future__ import annotations

import math
import re
import warnings
from decimal import Decimal
from fractions import Fraction
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import granphon as gp
from granphon.balls.hertz import HertzLaw, harmonic_diameter, mindlin_reduction
from granphon.balls.loads import Load
from granphon.base.errors import (
    InputError,
    MissingPackageError,
    Refused,
    brief,
    message,
    needing,
)
from granphon.base.standard_errors import read_errors
from granphon.base.validation import above_zero, each, frequencies, real_array, texts
from granphon.dynamics.local_field import local_field

MASKED = np.ma.array([1.0, 2.0], mask=[False, True])
ENDLESS = [1.0]
ENDLESS.append(ENDLESS)
TWICE = []
TWICE += [TWICE, TWICE]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (2, 2.0),
        ([1, 2.5], [1.0, 2.5]),
        (np.float32(0.1), float(np.float32(0.1))),
        (np.arange(6, dtype=np.uint8).reshape(2, 3), [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]),
        ([10**30, Fraction(1, 4), Decimal("0.1")], [1e30, 0.25, 0.1]),
        (np.longdouble("0.5"), 0.5),
        ([np.inf, -np.inf], [np.inf, -np.inf]),
        (np.ma.array([1.0, 2.0], mask=False), [1.0, 2.0]),
        ([], []),
    ],
)
def test_real_numbers_become_floats(values, expected):
    found = real_array("x", values)
    assert_array_equal(found, expected)
    assert (type(found), found.dtype) == (np.ndarray, np.float64)


def test_an_array_of_floats_is_not_copied():
    values = np.array([1.0, np.nan])
    assert real_array("x", values) is values


#: what is refused, and how the words go on after "x: found "
REFUSED = [
    (1j, "1j, which is complex; allowed: a real number"),
    (np.array([1.0, 2.0 + 0j]), ".*, which is complex"),
    ([1.0, 0.5j], ".*, which is complex"),
    (np.array([1j, 2], object), ".*, which is complex"),
    (MASKED, r"masked_array\(.*, which has masked entries"),
    *(
        (masked, ".*, which has masked entries")
        for masked in (np.ma.masked, [1.0, np.ma.masked], [[1.0, 2.0], MASKED])
    ),
    ("1", "'1'; allowed: a real number"),
    (None, "None"),
    (True, "True"),
    *(
        (wrong, "")
        for wrong in (["1", "2"], [None], np.array([True]), np.array([1.0, True], object))
    ),
    (np.array(["2020"], "M8[Y]"), ""),
    *(
        (mixed, ".*, which has truth values")
        for mixed in ([True, 1], [[1.0, 2.0], [0.0, np.True_]], [1.0, np.array(True)])
    ),
    ([[1.0], [1.0, 2.0]], ""),
    (10**400, ".* 401 digits, .*too large"),
    ([1, 10**5000], "a list .*too large"),
    (Fraction(10**400, 3), "Fraction.*, which is too large"),
    (ENDLESS, "a list .*64 levels"),
    (TWICE, "a list .*64 levels"),
]


@pytest.mark.parametrize(("values", "words"), REFUSED)
def test_what_is_no_real_number_is_refused_and_nothing_else_said(values, words):
    with pytest.raises(InputError, match=f"(?s)^x: found {words}") as error:
        real_array("x", values)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.skipif(np.finfo(np.longdouble).maxexp <= 1024, reason="no wider float here")
def test_wider_floats_that_are_too_large_are_refused():
    with pytest.raises(InputError, match="double precision"):
        real_array("x", np.longdouble("1e4000"))
    assert real_array("x", np.longdouble("inf")) == np.inf


# -- the borders -----------------------------------------------------------------------------------

BALLS = gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
STATE = gp.AveragedLattice(BALLS).at_force(18.0)
LATTICE = gp.ContactLattice.of("triangular", 0.84)
FORCE = [2.0, 18.0]
SPEED = [450.0, 700.0]


@cache
def find_phonons():
    return gp.Phonons(STATE)


@cache
def fit_velocities():
    return gp.fit_width(BALLS, FORCE, SPEED)


#: what is called, and a pair of numbers that it takes
BORDERS = {
    "lattice.frequencies": (lambda pair: LATTICE.frequencies([pair]), (0.1, 0.2)),
    "lattice.modes": (lambda pair: LATTICE.modes([pair]), (0.1, 0.2)),
    "lattice.modes, direction": (lambda pair: LATTICE.modes([[1.0, 0.0]], pair), (0.1, 0.2)),
    "lattice.wavevectors": (lambda pair: LATTICE.wavevectors([pair]), (0.1, 0.2)),
    "lattice.compatibility": (lambda pair: LATTICE.compatibility([pair]), (0.1, 0.2)),
    "lattice.dynamical_matrix": (lambda pair: LATTICE.dynamical_matrix([pair]), (0.1, 0.2)),
    "lattice.sound_velocities": (LATTICE.sound_velocities, (0.1, 0.2)),
    "lattice.elastic_tensor": (lambda pair: LATTICE.elastic_tensor(pair), (0.0, 0.001)),
    "phonons.frequencies": (lambda pair: find_phonons().frequencies([pair]), (0.1, 0.2)),
    "phonons.modes": (lambda pair: find_phonons().modes([pair]), (0.1, 0.2)),
    "phonons.bands": (lambda pair: find_phonons().bands([[0.0, 0.0], pair], 3), (0.1, 0.2)),
    "sound_velocities": (lambda pair: gp.sound_velocities(STATE, pair), (0.1, 0.2)),
    "pulse_velocities": (lambda pair: gp.pulse_velocities(STATE, pair), (500.0, 800.0)),
    "pulse_velocities, direction": (lambda pair: gp.pulse_velocities(STATE, 1e3, pair), (0.1, 0.2)),
    "at_force": (gp.AveragedLattice(BALLS).at_force, FORCE),
    "diameters": (
        lambda pair: gp.DirectSimulation(BALLS, diameters=[pair, pair]),
        (7.9e-3, 8.1e-3),
    ),
    "load": (lambda pair: Load("force", pair), FORCE),
    "measured": (gp.Measured, (7.9e-3, 8.1e-3)),
    "fit, force": (lambda pair: gp.fit_width(BALLS, pair, SPEED), FORCE),
    "fit, velocity": (lambda pair: gp.fit_width(BALLS, FORCE, pair), SPEED),
    "fit, sigma": (lambda pair: gp.fit_width(BALLS, FORCE, SPEED, pair), (2.0, 3.0)),
    "fit, frequency": (lambda pair: gp.fit_width(BALLS, FORCE, SPEED, 5.0, pair), (6e3, 6.5e3)),
    "fit.velocity_at": (lambda pair: fit_velocities().velocity_at(pair), FORCE),
    "harmonic_diameter": (lambda pair: harmonic_diameter(pair, 1.0), (1.0, 2.0)),
    "mindlin_reduction": (lambda pair: mindlin_reduction(pair, 10.0, 0.5), (1.0, 2.0)),
    "law.overlap": (BALLS.law.overlap, FORCE),
    "law.force": (BALLS.law.force, (1e-6, 2e-6)),
    "cell": (lambda pair: gp.Lattice("own", (pair, (0.0, 1.0))), (1.0, 0.0)),
}


@pytest.mark.parametrize(("call", "pair"), BORDERS.values(), ids=BORDERS)
def test_every_border_refuses_what_it_cannot_take(call, pair):
    call(pair)
    call(np.array(pair))
    wrongs = [
        np.array(pair) * (1.0 + 0.1j),
        np.ma.array(pair, mask=[False, True]),
        [pair[0], np.ma.masked],
    ]
    for wrong in (*wrongs, [10**400, pair[1]], [str(number) for number in pair]):
        with (
            warnings.catch_warnings(record=True) as said,
            pytest.raises(InputError, match=r"complex|masked|large|allowed:"),
        ):
            call(wrong)
        assert not said
    for endless in (ENDLESS, TWICE):
        with pytest.raises(InputError):
            call(endless)


@pytest.mark.parametrize("shape", [(3,), (2, 3), (4, 1)])
def test_wave_vectors_are_pairs(shape):
    for find in (LATTICE.frequencies, LATTICE.modes, LATTICE.dynamical_matrix):
        with pytest.raises(InputError, match=r"shape .*\(n_q, 2\)"):
            find(np.ones(shape))
    with pytest.raises(InputError, match="shape"):
        LATTICE.wavevectors(np.ones(4))


# -- single numbers, names, states -----------------------------------------------------------------

#: what is no positive real number, though float() takes some of it, and NumPy's classes of numbers
#: some more
NO_NUMBERS = [
    "1",
    b"1",
    "8e-3",
    True,
    np.True_,
    None,
    1j,
    np.nan,
    np.inf,
    -1.0,
    np.float16(np.inf),
    np.ma.masked,
    10**400,
    np.timedelta64(1, "s"),
    Decimal("inf"),
    Decimal("sNaN"),
    np.array([1.0, 2.0]),
    [1.0],
    ENDLESS,
    object(),
]
MATERIAL = {"young_modulus": 1e9, "poisson_ratio": 0.2, "density": 1e3}
#: what is called, and a number that it takes
SINGLE = {
    **{
        f"material.{name}": (lambda x, name=name: gp.Material(**MATERIAL | {name: x}), 0.25)
        for name in MATERIAL
    },
    "yield_strength": (
        lambda x: gp.Material(**MATERIAL, yield_strength=1.0 if x is None else x),
        1e9,
    ),
    "diameter": (lambda x: gp.Packing(BALLS.material, x), 8e-3),
    "uniform": (gp.Uniform, 1e-6),
    "normal": (gp.Normal, 1e-6),
    "cutoff": (lambda x: gp.Normal(1e-6, x), 2.0),
    "hertz law": (HertzLaw, 1.0),
    "between": (lambda x: HertzLaw.between(BALLS.material, x), 8e-3),
    "friction": (lambda x: mindlin_reduction(0.1, 10.0, x), 0.5),
    "length": (lambda x: gp.Units(x, 1.0, 1.0), 1e-300),
    "stiffness": (lambda x: gp.Units(1.0, x, 1.0), 1e300),
    "mass": (lambda x: gp.Units(1.0, 1.0, x), 5e-324),
    "mindlin_ratio": (lambda x: gp.ContactLattice.of("triangular", x), 0.75),
    "spacing": (lambda x: gp.ContactLattice.of("triangular", 0.75, x), 0.5),
    "prestress": (lambda x: gp.ContactLattice.of("triangular", 0.75, 1.0, x), 0.001),
    "local field": (lambda x: local_field("triangular", x), 0.75),
}


@pytest.mark.parametrize(("call", "number"), SINGLE.values(), ids=SINGLE)
def test_a_number_is_a_real_number(call, number):
    call(number)
    for same in (np.float64(number), np.array(number), Decimal(number), Fraction(number)):
        call(same)
    for wrong in NO_NUMBERS:
        if wrong is None and call is SINGLE["yield_strength"][0]:
            continue  # leaves it out
        with pytest.raises(InputError) as error:
            call(wrong)
        assert "\n" not in str(error.value)


def test_numbers_are_kept_as_floats():
    kept = (gp.Units(1, np.float32(2.0), Fraction(1, 2)), HertzLaw(3), gp.Uniform(Decimal("0.5")))
    numbers = [one for held in kept for one in vars(held).values()]
    assert numbers == [1.0, 2.0, 0.5, 3.0, 0.5]
    assert {type(one) for one in numbers} == {float}


def test_a_law_beyond_double_precision_is_refused():
    with pytest.raises(InputError, match="beyond double precision"):
        HertzLaw.between(gp.Material(1e308, -0.999999, 1.0), 1e300)


TAKES_A_STATE = {
    "sound_velocities": gp.sound_velocities,
    "moduli": gp.moduli,
    "local_exponent": gp.local_exponent,
    "validity": gp.validity,
    "pulse_velocities": lambda state: gp.pulse_velocities(state, 1e3),
    "Phonons": gp.Phonons,
    "atoms": gp.atoms,
    "HertzMindlin": gp.HertzMindlin,
}


@pytest.mark.parametrize("call", TAKES_A_STATE.values(), ids=TAKES_A_STATE)
def test_what_is_no_state_is_refused(call):
    for wrong in (None, 1.0, "state", BALLS, np.array([1.0]), gp.AveragedLattice(BALLS), [STATE]):
        with pytest.raises(InputError, match=r"ContactState|network|medium\.at_force"):
            call(wrong)


NO_NAMES = 1, None, 1.5, object(), {}, np.array(["a", "b"]), [["width"]], [1], b"width", ENDLESS
TAKES_A_NAME = {
    "local_field": lambda name: gp.EffectiveMedium(BALLS, name),
    "branch": lambda name: gp.fit_width(BALLS, FORCE, SPEED, branch=name),
    "parameters": lambda names: gp.fit_width(BALLS, FORCE, SPEED, parameters=names),
    "branches": lambda names: gp.pulse_velocities(
        STATE, 1e3, branches=["one"] if names is None else names
    ),
    "labels": lambda names: find_phonons().bands("GKM", 3, ["one"] if names is None else names),
    "path": lambda path: find_phonons().bands("GX" if path is None else path, 3),
    "method": lambda name: find_phonons().dos((4, 4), method=name),
    "kind of load": lambda name: Load(name, 1.0),
}


@pytest.mark.parametrize("call", TAKES_A_NAME.values(), ids=TAKES_A_NAME)
def test_what_is_no_name_is_refused(call):
    for wrong in NO_NAMES:
        with pytest.raises(InputError):
            call(wrong)


def test_names_come_as_a_text_a_list_or_an_array():
    for names in ("transverse", ["transverse"], ("transverse",), np.array(["transverse"])):
        assert gp.pulse_velocities(STATE, 1e3, branches=names).branches == ("transverse",)
    for labels in ("GKM", ["G", "K", "M"], np.array(["G", "K", "M"])):
        assert find_phonons().bands("GKM", 3, labels).labels == ("G", "K", "M")
    with pytest.raises(InputError, match="labels: found"):
        find_phonons().bands("GKM", 3, np.ma.array(["G", "K", "M"], mask=[0, 1, 0]))


def test_the_name_of_a_lattice_is_a_text():
    for wrong in (None, 1, [], {}, object(), np.array(["a"])):
        with pytest.raises(InputError, match="name of a lattice"):
            gp.Lattice(wrong, ((1.0, 0.0), (0.0, 1.0)))


def test_what_is_no_atoms_is_not_written(tmp_path):
    for wrong in (None, "balls", 1.0, STATE):
        with pytest.raises(InputError, match=r"Give an ase\.Atoms"):
            gp.write_extxyz(tmp_path / "balls.xyz", wrong)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="the path is True"):
        gp.write_extxyz(True, gp.atoms(STATE))


def test_a_whole_number_is_called_too_large_where_no_float_holds_it():
    beyond = 2**1024 - 2**970  # the least that is rounded to 2^1024
    assert math.isfinite(float(beyond - 1))
    with pytest.raises(OverflowError):
        float(beyond)
    for fits in (2**1023, 1 - beyond, [2**1023], beyond - 1):
        assert "too large" not in brief(fits)
    for wrong in (beyond, -beyond, 2**1024):
        assert re.search("309 digits.*too large", brief(wrong))
        assert re.search("list.*too large", brief([1, wrong]))


def test_scalars_of_numpy_are_shown_as_those_of_python():
    for value in (np.float64(-1.5), np.float32(-1.5), np.array(-1.5)):
        assert brief(value) == "-1.5"
    assert [brief(value) for value in (np.int64(3), np.True_, np.str_("a"))] == ["3", "True", "'a'"]
    assert brief(np.array([1.5])) == "array([1.5])"
    with pytest.raises(InputError, match=r"diameter: found -1\.0;"):
        gp.Packing(gp.Material(1e9, 0.2, 1e3), np.float64(-1.0))


def test_a_message_is_one_line():
    for wrong in (np.ones((3, 2)), np.array([["a"], ["b"]])):
        assert "\n" in repr(wrong)
        assert "\n" not in brief(wrong)
        assert len(brief(wrong)) <= 80
        assert (
            message(f"x is {wrong!r}", f"It\nis\r\n{wrong!r}", "No\x0bway\u2028out").count("\n")
            == 0
        )
    assert message("a  b", "c\n   d") == "a  b. c d."  # spaces of a path stay
    # and the dots of what was cut off
    assert message("a is Packing(1, ...", "b. ", "c?") == "a is Packing(1, ... b. c?"
    with pytest.raises(InputError, match=r"Uniform, .*Measured"):
        gp.Packing(gp.Material(1e9, 0.2, 1e3), 1e-3, spread=2e-6)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("ab", ("ab",)),
        (np.array("ab"), ("ab",)),  # as an array of xarray gives for a coordinate of one text
        (["a", "b"], ("a", "b")),
        (np.array(["ab"]), ("ab",)),
    ],
)
def test_a_text_is_never_taken_for_its_letters(value, expected):
    assert texts("labels", value) == expected


def test_a_standard_error_is_not_below_zero():
    assert_array_equal(read_errors("errors", [0, np.nan], (2,)), [0.0, np.nan])
    for wrong in ([-1.0, 1.0], [np.nan, -1e-300], [1.0]):
        with pytest.raises(InputError, match="errors has"):
            read_errors("errors", wrong, (2,))


def test_an_array_where_a_list_is_needed_is_refused():
    for wrong in (np.array([1.0, 2.0]), np.array([]), np.array(1.0), (), [], "ab", None):
        with pytest.raises(Refused, match="a list of one or more masses"):
            each(wrong, above_zero, "masses")
    assert each((1, 2.5), above_zero, "masses") == (1.0, 2.5)


def test_bytes_are_no_texts():
    for wrong in (b"", b"ab", bytearray(b"")):
        with pytest.raises(InputError, match="labels"):
            texts("labels", wrong)


def test_a_module_that_an_installed_package_lacks_is_no_package_that_is_missing():
    with pytest.raises(MissingPackageError, match="needs no_such_package"), needing("It"):
        import_module("no_such_package.part")
    with pytest.raises(ModuleNotFoundError) as caught, needing("It"):
        import_module("json.no_such_module")
    assert caught.type is ModuleNotFoundError


def test_frequencies_of_any_sign_are_limited_in_size():
    assert frequencies([-1e30, 1.0], low="").tolist() == [-1e30, 1.0]
    for wrong in ([-1e31, 1.0], 1e31):
        with pytest.raises(Refused, match="e\\+31 Hz"):
            frequencies(wrong, low="")


def test_a_refusal_keeps_its_attributes_under_a_key():
    refused = Refused("2", "1", path=("a",))
    refused.load_index = 3
    inner = refused.under("b", 0)
    assert (inner.path, inner.load_index, str(inner)) == (("b", 0, "a"), 3, str(refused))
    assert refused.path == ("a",)
