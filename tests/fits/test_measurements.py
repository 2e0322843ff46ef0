"""Measured velocities as experiments give them: forces or side forces, velocities or times of
flight.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.loads import force_of_frame
from granphon.base.errors import InputError
from granphon.base.tables import Table
from granphon.fits.fit import convert_cutoff
from granphon.fits.measurements import Measurements, read_sigma


def read(tmp_path, text, **options):
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="utf-8")
    return Measurements.read(path, **options)


def test_force_and_velocity(tmp_path):
    data = read(tmp_path, "force (kN),velocity (km/s),note\n0.002,0.5,a\n0.004,0.625,b\n")
    assert_array_equal([data.force, data.velocity], [[2.0, 4.0], [500.0, 625.0]])
    assert (data.sigma, data.frequency) == (None, None)


def test_everything_by_its_own_name(tmp_path):
    data = read(
        tmp_path, "Force (N),Velocity (m/s),Sigma (mm/us),Frequency (kHz)\n2,500,0.004,6.5\n"
    )
    assert_array_equal(
        [data.force, data.velocity, data.sigma, data.frequency], [[2.0], [500.0], [4.0], [6500.0]]
    )


def test_side_force_and_time_of_flight(tmp_path):
    text = "F (N);t (ms);length (cm);error of t (us)\n990;0.8;40;8\n500;1;50;10\n"
    columns = {"side_force": "F", "time": "t", "distance": "length", "time_sigma": "error of t"}
    data = read(tmp_path, text, columns=columns, frame=partial(force_of_frame, balls_per_side=31))
    assert_allclose(data.force, np.array([990.0, 500.0]) / (31 * np.sqrt(3.0)), rtol=1e-15)
    assert_allclose(data.velocity, [500.0, 500.0], rtol=1e-15)
    assert_allclose(data.sigma, [5.0, 5.0], rtol=1e-14)  # 1 % of each


@pytest.mark.parametrize("unit", ["%", "percent"])
def test_errors_in_per_cent_are_those_of_each_row(tmp_path, unit):
    data = read(tmp_path, f"force (N),velocity (m/s),sigma ({unit})\n2,500,1\n4,600,0.5\n")
    assert_allclose(data.sigma, [5.0, 3.0], rtol=1e-15)
    flight = read(
        tmp_path, f"force (N),time (ms),distance (m),time_sigma ({unit})\n2,1,0.5,1\n4,1,0.6,0.5\n"
    )
    assert_allclose(flight.sigma, [5.0, 3.0], rtol=1e-15)
    named = read(
        tmp_path, "force (N),velocity (m/s),err\n2,500,1\n", columns={"sigma": f"err ({unit})"}
    )
    assert_allclose(named.sigma, [5.0], rtol=1e-15)
    assert_allclose(read_sigma(f"0.5 {unit}", data.velocity), [2.5, 3.0], rtol=1e-15)
    assert read_sigma("5 m/s", data.velocity) == 5.0
    for wrong in (f"-1 {unit}", f"0{unit}", "x %", "1 N"):
        with pytest.raises(ValueError, match="found"):
            read_sigma(wrong, data.velocity)


def test_pressures_become_contact_forces(tmp_path):
    data = read(
        tmp_path,
        "pressure (kN/m),velocity (ft/s)\n2,1000\n4,2000\n",
        pressed=lambda p: 8e-3 * p / np.sqrt(3.0),
    )
    assert_allclose(data.force, np.array([16.0, 32.0]) / np.sqrt(3.0), rtol=1e-15)
    assert_array_equal(data.velocity, [304.8, 609.6])


@pytest.mark.parametrize(
    ("unit", "metres"), [("ft/s", 0.3048), ("mph", 0.44704), ("km/h", 1 / 3.6), ("fps", 0.3048)]
)
def test_units_of_velocity(tmp_path, unit, metres):
    assert_allclose(
        read(tmp_path, f"force (N),velocity ({unit})\n2,1000\n").velocity,
        1000.0 * metres,
        rtol=1e-15,
    )


def test_one_distance_for_all_and_units_by_option(tmp_path):
    data = read(tmp_path, "f,t\n2,1\n", columns={"force": "f (kN)", "time": "t (ms)"}, distance=0.5)
    assert_array_equal([data.force, data.velocity], [[2000.0], [500.0]])


def test_a_distance_goes_with_the_times_that_are_named(tmp_path):
    text = "force (N),velocity (m/s),time (s),distance (m)\n2,3,4,5\n"
    assert read(tmp_path, text, columns={"time": "time"}).velocity == [1.25]
    assert read(tmp_path, text, columns={"velocity": "velocity"}).velocity == [3.0]
    without = text.replace("distance", "length")
    assert read(tmp_path, without, columns={"time": "time"}, distance=0.5).velocity == [0.125]


def test_a_named_column_goes_before_one_found(tmp_path):
    text = "force (N),side_force (N),velocity (m/s),time (s)\n2,100,500,1\n"
    assert read(tmp_path, text, columns={"force": "force", "velocity": "velocity"}).velocity == [
        500.0
    ]


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (
            "force (N),v (m/s)\n2,5\n",
            {},
            "columns={'velocity':",
        ),
        (
            "force,velocity\n2,5\n",
            {},
            "no unit for 'force'",
        ),
        (
            "v (m/s),F\n2,5\n",
            {},
            "columns are 'v (m/s)', 'F'",
        ),
        ("F,time (s)\n2,5\n", {}, "none named 'distance'"),
        (
            "pressure,time\n2,5\n",
            {"distance": 1.0, "pressed": float},
            "'pressure' and 'time'",
        ),
        ("force,time (s)\n2,5\n", {}, "no column named 'distance'"),
        ("force (N),velocity (m/s),sigma\n2,5,1\n", {}, "no unit for 'sigma'"),
        (
            "force (N),side_force (N),velocity (m/s)\n2,3,5\n",
            {},
            "force and side_force",
        ),
        (
            "pressure (N/m),side_force (N),velocity (m/s)\n2,3,5\n",
            {},
            "side_force and pressure",
        ),
        (
            "pressure (N/m),velocity (m/s)\n2,3\n",
            {},
            "gives pressures",
        ),
        ("pressure (N/m),velocity (m/s)\n2,3\n", {"pressed": 3.0}, "gives pressures"),
        (
            "pressure (Pa),velocity (m/s)\n2,3\n",
            {"pressed": float},
            "force per length",
        ),
        (
            "force (N),velocity (m/s),sigma (%)\n2,3,-1\n",
            {},
            "data.csv:2: sigma",
        ),
        ("force (N),velocity (m/s),time (s)\n2,3,5\n", {}, "velocity and time"),
        (
            "force (N),velocity (m/s),sigma (m/s),time_sigma (s)\n2,3,5,1\n",
            {},
            "sigma and time_sigma",
        ),
        (
            "side_force (N),velocity (m/s)\n2,3\n",
            {},
            "gives side forces",
        ),
        (
            "force (N),velocity (m/s)\n2,3\n",
            {"columns": {"velocty": "v"}},
            "mean velocity",
        ),
        (
            "force (N),velocity (m/s)\n2,3\n",
            {"columns": {"x": "v"}},
            "side_force, pressure",
        ),
        ("force (N),time (s)\n2,3\n", {"distance": -1.0}, "distance: found -1.0"),
        ("force (N),time (s)\n2,3\n", {"distance": (1.0,)}, "(distance, standard error)"),
        ("force (N),time (s)\n2,3\n", {"distance": (1.0, -0.1)}, "error of distance"),
        (
            "force (N),time (s),distance (m)\n2,3,4\n",
            {"distance": 0.5},
            "a distance column",
        ),
        (
            "force (N),t (s),L (m)\n2,3,4\n",
            {"columns": {"time": "t", "distance": "L"}, "distance": 4.0},
            "Leave it out",
        ),
        (
            "force (N),velocity (m/s)\n2,3\n",
            {"distance": 0.5},
            "a velocity column",
        ),
        (
            "force (N),cutoff (Hz)\n2,3\n",
            {"distance": (0.5, 0.01), "carried": lambda _force, cutoff: cutoff},
            "a cutoff column",
        ),
        (
            "force (N),v (m/s)\n2,3\n",
            {"columns": {"velocity": "v"}, "distance": 0.5},
            "Leave it out, or name",
        ),
        ("force (N),v (m/s)\n2,3\n", {"distance": 0.5}, "no column named 'velocity'"),
        ("force (N),velocity (m/s),time_sigma (s)\n2,3,1\n", {}, "no column named 'time'"),
        (
            "force (N),velocity (N)\n2,3\n",
            {},
            "data.csv:2: velocity",
        ),
        (
            "force (N),velocity (m/s)\n2,1e300\n",
            {},
            "1e+300 m/s",
        ),
    ],
)
def test_what_is_missing_or_said_twice_is_named(tmp_path, text, options, words):
    with pytest.raises(InputError, match=re.escape(words)):
        read(tmp_path, text, **options)


def test_arrays_are_checked_and_frozen():
    data = Measurements([2, 4], [500.0, 600.0], 5, np.array([6500.0, 6500.0]))
    assert (data.sigma, data.force.dtype) == (5.0, float)
    with pytest.raises(ValueError, match="read-only"):
        data.force[0] = 1.0
    assert Measurements.from_dict(data.to_dict()) == data
    for wrong in (
        ([1.0], [1.0, 2.0]),
        ([1.0, 2.0], [1.0, 2.0], [1.0]),
        ([1.0, 2.0], [1.0, 2.0], None, [1.0] * 3),
    ):
        with pytest.raises(InputError, match="same number"):
            Measurements(*wrong)
    for wrong in (
        ([np.inf], [1.0]),
        ([1.0], [-1.0]),
        ([1.0], [1.0], 0.0),
        ([True], [1.0]),
        ([None], [1.0]),
    ):
        with pytest.raises(InputError):
            Measurements(*wrong)


@pytest.mark.parametrize(
    ("lattice", "length"), [("chain", np.pi), ("triangular", 2.0 * np.pi * 3.0**0.5 / 4.0)]
)
def test_cutoffs_become_velocities_of_long_waves(tmp_path, steel, lattice, length):
    """2 (k/M)^(1/2) on a chain, 6^(1/2) (k/M)^(1/2) from row to row of a triangular lattice without
    friction.
    """
    packing = gp.Packing(steel, 8e-3, gp.Uniform(2e-6), lattice=lattice, friction=False)
    carried = partial(convert_cutoff, packing, "longitudinal", None, False, ("width",))
    data = read(
        tmp_path, "force (N),cutoff (kHz),cutoff_sigma (Hz)\n5,20,200\n10,24,120\n", carried=carried
    )
    assert_allclose(data.velocity, length * 8e-3 * np.array([20e3, 24e3]), rtol=1e-9)
    assert_allclose(data.sigma / data.velocity, [0.01, 0.005], rtol=1e-12)


def test_the_cutoffs_of_a_medium_give_its_width(steel):
    packing = gp.Packing(steel, 8e-3, gp.Uniform(2e-6))
    force = np.geomspace(2.0, 20.0, 6)
    states = gp.EffectiveMedium(packing).at_force(force)
    # M, where the longitudinal branch ends; bands of Phonons share no code with the fit
    edge = np.array([[0.5, 0.0]])
    cutoffs = np.array([gp.Phonons(states[i]).modes(edge) for i in range(6)], object)
    tops = [float(one.frequencies[0][np.argmax(one.longitudinal_fraction[0])]) for one in cutoffs]
    velocity = convert_cutoff(
        packing, "longitudinal", (0, 1), False, ("width",), force, np.array(tops)
    )
    assert_allclose(gp.fit_width(packing, force, velocity, sigma=1.0).width, 2e-6, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "fitted", "words"),
    [
        ("force (N),cutoff (kHz)\n5,20\n", ("diameter",), "the diameter is fitted"),
        ("force (N),cutoff (kHz),frequency (kHz)\n5,20,6.5\n", (), "Leave the frequency out"),
        ("force (N),cutoff (kHz),velocity (m/s)\n5,20,500\n", (), "both velocity and cutoff"),
        ("force (N),cutoff (kHz)\n5,20\n", None, "Give carried"),
    ],
)
def test_cutoffs_that_cannot_be_converted_are_refused(tmp_path, steel, text, fitted, words):
    packing = gp.Packing(steel, 8e-3)
    carried = (
        None
        if fitted is None
        else partial(convert_cutoff, packing, "longitudinal", None, False, fitted)
    )
    with pytest.raises(InputError, match=words):
        read(tmp_path, text, carried=carried)
    if fitted == ():
        with pytest.raises(InputError, match="no transverse wave"):
            convert_cutoff(
                gp.Packing(steel, 8e-3, lattice="chain"),
                "transverse",
                None,
                False,
                (),
                np.ones(1),
                np.ones(1),
            )


MEASURED = sorted((Path(__file__).parents[2] / "examples" / "measured").glob("*.csv"))


@pytest.mark.parametrize("table", MEASURED, ids=lambda path: path.stem)
def test_measured_data_have_a_source_and_a_scene(table):
    assert re.search(r"^# Source: \w", table.read_text(encoding="utf-8"), re.MULTILINE)
    scene = gp.Scene.from_yaml(table.with_suffix(".yaml"))
    if "magnitude" in Table.read(table):
        assert scene.response is not None
        assert np.all(gp.TransferFunction.read(table).frequencies > 0.0)
        return
    frame = partial(force_of_frame, balls_per_side=scene.load.balls_per_side or 1)
    carried = partial(convert_cutoff, scene.packing, "longitudinal", None, False, ())
    data = Measurements.read(table, frame=frame, carried=carried)
    sigma = 0.01 * data.velocity if data.sigma is None else data.sigma
    fit = gp.fit_width(
        scene.packing,
        data.force,
        data.velocity,
        sigma,
        data.frequency,
        parameters=("young_modulus",),
        direction=None if scene.direction is None else scene.directions[0],
    )
    assert 0.5 < fit.values[0] / scene.packing.material.young_modulus < 2.0


def test_columns_and_periods_that_are_none_are_refused(tmp_path):
    table = tmp_path / "data.csv"
    table.write_text("force (N),velocity (m/s)\n1,500\n2,600\n")
    for columns in (5, [("velocity", "v")], {"velocity": 5}):
        with pytest.raises(InputError, match="columns"):
            gp.Measurements.read(table, columns)
        with pytest.raises(InputError, match="columns"):
            gp.TransferFunction.read(table, columns)
    with pytest.raises(InputError, match="periods"):
        gp.Measurements.read(table, periods=0)
