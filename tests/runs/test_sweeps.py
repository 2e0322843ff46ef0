"""Sweeps: the same numbers as direct calls, from any executor, in files, and after an
interruption.
"""

from __future__ import annotations

import csv
import dataclasses
import errno
import itertools
import json
import math
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.diameters import Spread
from granphon.balls.packing import PARAMETERS, Axis, change_packing
from granphon.base.errors import FileExistsInRunError, InputError, OutputError, PrecisionError
from granphon.base.results import restore
from granphon.media.choice import MediumChoice
from granphon.phonons.phonons import Phonons
from granphon.runs import finished_tasks
from granphon.runs.dataset import load_sweep
from granphon.runs.execution import solve_all
from granphon.runs.finished_tasks import Store, decode, encode, read_entries
from granphon.runs.sweep import sweep
from granphon.runs.workers import packages
from tests.conftest import only, without_rights
from tests.runs.conftest import Counted, Meter, connecting, full_disk

FORCES = [18.446, 2.0, 5.0, 2.0]
LADDER = ("ala", "afa", "ema")
WIDTH = 2.04e-6
STATE = [
    "overlap",
    "pressure",
    "relative_overlap",
    "normal_stiffness",
    "shear_stiffness",
    "effective_density",
    "reduced_force",
    "reduced_spacing",
    "force_fluctuation",
    "contact_fraction",
    "stiffness_ratio",
    "valid",
    "regime",
]
OTHERS = ["longitudinal", "transverse", "bulk", "shear", "exponent", "exponent_error"]
BIMODAL = gp.Discrete((7.999e-3, 8.001e-3), (0.5, 0.5))
#: equal forces along its two directions, which are not at right angles, make a stress that is no
#: pressure
CHAINED = gp.Lattice("chained", ((1.0, 0.0), (0.3, math.sqrt(0.91))))


def direct(state):
    """What calls one by one give at a single load."""
    velocities = gp.sound_velocities(state, (1.0, 0.0))
    constants = gp.moduli(state)
    out = {name: getattr(state, name) for name in ["force", *STATE]}
    out |= {"longitudinal": velocities.longitudinal, "transverse": velocities.transverse}
    if constants.isotropic:
        out |= {"bulk": constants.bulk, "shear": constants.shear}
    else:
        out["tensor"] = constants.tensor
    if not state.finite_overlap:
        out |= {"exponent": gp.local_exponent(state), "exponent_error": state.exponent_error}
    return out


def packing_of(dataset):
    """The packing that the attributes of a sweep hold as plain data."""
    return restore(json.loads(dataset.attrs["packing"]), gp.Packing, "packing")


def same(found, expected):
    found = np.asarray(found)[()]
    if isinstance(expected, str | bool):
        assert found == expected
    else:
        assert_allclose(found, expected, rtol=1e-12)


# -- the numbers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("load", "values", "finite_overlap"),
    [
        pytest.param("force", FORCES, False, marks=pytest.mark.slow),
        pytest.param("pressure", [4e3, 500.0], True, marks=pytest.mark.slow),
        ("overlap", [2e-6, 1e-7], False),
    ],
)
def test_every_variable_is_what_direct_calls_give(rough, load, values, finite_overlap):
    widths = [0.0, 1e-6]
    frictions = [True, False]
    ds = sweep(
        rough,
        **{load: values},
        media=LADDER,
        finite_overlap=finite_overlap,
        width=widths,
        friction=frictions,
    )
    assert ds["longitudinal"].dims == ("load", "medium", "width", "friction")
    assert_array_equal(ds[load], values)
    expected_names = (
        {*STATE, *OTHERS, "force"}
        - {load}
        - ({"exponent", "exponent_error"} if finite_overlap else set())
    )
    assert set(ds.data_vars) == expected_names
    for (i, value), name, width, friction in itertools.product(
        enumerate(values), LADDER, widths, frictions
    ):
        packing = gp.Packing(rough.material, 8e-3, gp.Uniform(width), friction=friction)
        state = getattr(MediumChoice(name).of(packing), f"at_{load}")(
            value, finite_overlap=finite_overlap
        )
        point = ds.isel(load=i).sel(medium=name, width=width, friction=friction)
        for variable, expected in direct(state).items():
            same(point[variable], expected)


@pytest.mark.parametrize(
    ("name", "values", "build"),
    [
        (
            "young_modulus",
            [70e9, 2e11],
            lambda p, v: gp.Packing(gp.Material(v, 0.276, 7840.0), 8e-3, p.spread),
        ),
        pytest.param(
            "poisson_ratio",
            [0.0, 0.3, 0.5],
            lambda p, v: gp.Packing(gp.Material(211.65e9, v, 7840.0), 8e-3, p.spread),
            marks=pytest.mark.slow,
        ),
        (
            "density",
            [2500.0, 7840.0],
            lambda p, v: gp.Packing(gp.Material(211.65e9, 0.276, v), 8e-3, p.spread),
        ),
        pytest.param(
            "diameter",
            [4e-3, 8e-3, 16e-3],
            lambda p, v: gp.Packing(p.material, v, p.spread),
            marks=pytest.mark.slow,
        ),
        ("spread", [None, gp.Uniform(1e-6), BIMODAL], lambda p, v: gp.Packing(p.material, 8e-3, v)),
        ("lattice", ["square", "kagome"], lambda p, v: gp.Packing(p.material, 8e-3, p.spread, v)),
    ],
)
def test_each_parameter_changes_the_packing(rough, name, values, build):
    ds = sweep(rough, force=5.0, media="afa", **{name: values})
    assert ds["longitudinal"].sizes == {"load": 1, "medium": 1, name: len(values)}
    assert ds[name].attrs.get("units") == PARAMETERS[name]
    for i, value in enumerate(values):
        expected = direct(gp.AveragedForce(build(rough, value)).at_force(5.0))
        for variable, number in expected.items():
            if variable in ds:
                same(ds.isel({name: i, "load": 0, "medium": 0})[variable], number)


def test_one_number_is_a_sweep_of_one(rough):
    one = sweep(rough, force=5.0, width=1e-6, friction=False)
    many = sweep(rough, force=[5.0], width=[1e-6], friction=[False])
    assert one.identical(many)
    assert one.identical(
        sweep(rough, force=np.float64(5.0), width=np.array(1e-6), friction=np.False_)
    )


def test_every_variable_has_a_meaning_and_numbers_have_units(rough):
    ds = sweep(
        rough, force=FORCES, media=LADDER, bands="GK", npoints=3, width=[1e-6], poisson_ratio=[0.2]
    )
    for name, variable in ds.variables.items():
        if name != "medium":
            assert variable.attrs["long_name"]
            assert ("units" in variable.attrs) == (variable.dtype.kind == "f"), name
    assert ds["valid"].dtype == bool
    units = {
        "force": "N",
        "pressure": "N/m",
        "longitudinal": "m/s",
        "bulk": "Pa",
        "exponent": "1",
        "width": "m",
    }
    assert {name: ds[name].attrs["units"] for name in units} == units


def test_nothing_is_nan_and_equal_balls_are_infinitely_regular(packing):
    ds = sweep(packing, force=FORCES, media=LADDER, lattice=["triangular", "kagome"])
    for name, variable in ds.variables.items():
        assert variable.dtype.kind in "bU" or not np.any(np.isnan(variable)), name
    assert np.all(np.isposinf(ds["reduced_force"]))


def test_options_of_a_medium_show_in_its_label(rough):
    ds = sweep(
        rough, force=FORCES, media=["ema", {"ema": {"local_field": "paper"}}, MediumChoice("ala")]
    )
    assert ds["medium"].values.tolist() == ["ema", "ema(local_field=paper)", "ala"]
    state = gp.EffectiveMedium(rough, local_field="paper").at_force(2.0)
    same(ds["overlap"].sel(medium="ema(local_field=paper)")[1], state.overlap)
    assert [MediumChoice.parse(m).label for m in json.loads(ds.attrs["media"])] == ds[
        "medium"
    ].values.tolist()


@settings(max_examples=8)
@given(st.lists(st.floats(0.5, 50.0), min_size=1, max_size=5), st.randoms())
def test_the_order_of_loads_is_only_an_order(steel, forces, random):
    rough = gp.Packing(steel, 8e-3, gp.Uniform(WIDTH))
    order = list(range(len(forces)))
    random.shuffle(order)
    straight, shuffled = (
        sweep(rough, force=values, media=LADDER) for values in (forces, [forces[i] for i in order])
    )
    assert straight.isel(load=order).identical(shuffled)


# -- simulations -----------------------------------------------------------------------------------

SAMPLES = {"simulation": {"shape": (6, 6), "seed": 2, "samples": 3}}
ERRORS = ["longitudinal_error", "transverse_error", "bulk_error", "shear_error"]


def test_a_sweep_of_samples_warns_as_their_state_does(rough):
    """Of loose balls, whose shear modulus is too small, too."""
    medium = gp.DirectSimulation(rough, (6, 6), 2, 2, geometry="lattice")
    least = 0.01 * rough.law.force(rough.width)  # f* = 0.01
    warnings = gp.validity(medium.at_force([least, 100.0 * least])).warnings
    assert any("shear modulus" in warning for warning in warnings)
    samples = {"simulation": {**SAMPLES["simulation"], "samples": 2, "geometry": "lattice"}}
    ds = sweep(rough, force=[least, 100.0 * least], media=samples)
    told = json.loads(ds.attrs["warnings"])
    assert any("(force " in text for text in told)
    assert [re.sub(r" \(force [^)]*\)", "", text) for text in told] == list(warnings)


def test_media_that_sample_nothing_have_no_error(rough):
    ds = sweep(rough, force=[18.446, 2.0], media=["ema", SAMPLES, "ala"])
    assert ds["medium"].values.tolist() == [
        "ema",
        "simulation(samples=3, seed=2, shape=6 6)",
        "ala",
    ]
    for name in ERRORS:
        assert np.all(ds[name].sel(medium=["ema", "ala"]) == 0.0)
        assert np.all(ds[name][:, 1] > 0.0)
        assert ds[name].attrs["units"] == ("Pa" if name in ("bulk_error", "shear_error") else "m/s")
    assert "contact_force_fluctuation" not in ds
    alone = sweep(rough, force=[18.446, 2.0], media=["ema", "ala"])
    assert (
        ds.sel(medium=["ema", "ala"])
        .drop_vars(ERRORS)
        .drop_attrs(deep=False)
        .identical(alone.drop_attrs(deep=False))
    )
    # one sample has no error at all
    alone = sweep(rough, force=5.0, media=["ema", {"simulation": {"shape": (4, 4)}}])
    assert not set(ERRORS) & set(alone.data_vars)
    assert "ema" in json.loads(ds.attrs["media"])[0]
    assert json.loads(ds.attrs["media"])[1] == {
        "simulation": {"shape": [6, 6], "seed": 2, "samples": 3, "boundary": "isotropic"}
    }


@pytest.mark.slow
def test_an_interrupted_sample_is_not_simulated_again(rough, tmp_path):
    arguments = {"force": [18.446, 5.0], "media": [SAMPLES]}
    with pytest.raises(KeyboardInterrupt):
        sweep(rough, path=tmp_path / "sweep.nc", progress=Meter(stop=3), **arguments)
    assert len(parts_in(tmp_path)) == 2
    # samples that there are serve a sweep of more
    more = arguments | {"media": {"simulation": SAMPLES["simulation"] | {"samples": 4}}}
    assert resumed(rough, tmp_path, sweep(rough, **more), more) == 2 * 4 - 3


@pytest.mark.parametrize(
    ("load", "executor"),
    [
        ({"force": [2.0, 18.446]}, None),
        *(
            pytest.param(load, executor, marks=pytest.mark.slow)
            for load in ({"force": [18.446, 2.0, 5.0]}, {"overlap": [1e-6, -1e-7, 3e-7]})
            for executor in (None, ThreadPoolExecutor, ProcessPoolExecutor)
        ),
    ],
)
def test_each_load_of_a_sample_is_kept(rough, tmp_path, load, executor):
    """What goes on from the middle of a sample has the numbers of what went through, to the last
    bit.
    """
    arguments = {**load, "media": {"simulation": {"shape": (4, 4), "geometry": "lattice"}}}
    whole = sweep(rough, **arguments)
    (values,) = load.values()
    for stop in range(1, len(values)):
        path = tmp_path / str(stop) / "sweep.nc"
        with (
            nullcontext() if executor is None else executor(1) as pool,
            pytest.raises(KeyboardInterrupt),
        ):
            sweep(rough, path=path, executor=pool, progress=Meter(stop=stop), **arguments)
        kept = dict(read_entries(path.parent / PARTIAL)).popitem()[1]
        there = len(kept["force"])
        # a worker does what it can in half a second
        assert there == stop or (executor is not None and there > stop)
        if there < len(values):  # the highest load first
            given = kept[next(iter(load))]
            expected = sorted(values, reverse=True)[:there]
            assert_allclose(given, expected, rtol=1e-9)
            assert kept["rest_balls"].shape == (2, 4, 4)
        assert resumed(rough, path.parent, whole, arguments) == len(values) - there


def test_a_sample_that_carries_no_load_is_named(rough):
    place = r"^simulation\(.*\), friction = True, seed 2, overlap = -6e-07 m: "
    with pytest.raises(InputError, match=place) as caught:
        sweep(rough, overlap=[1e-6, -6e-7], media=["ema", SAMPLES], friction=True)
    assert caught.value.load_index == 1


# -- lattices that are not isotropic ---------------------------------------------------------------


def test_a_lattice_that_is_not_isotropic_has_a_tensor(rough, tmp_path):
    ds = sweep(
        rough, force=[5.0, 7.0], lattice=["square", "triangular"], path=tmp_path / "sweep.nc"
    )
    head = (tmp_path / "sweep.csv").read_text(encoding="utf-8").splitlines()[0]
    assert ("longitudinal (m/s)" in head, "tensor" in head) == (True, False)
    assert ds["tensor"].dims == ("load", "medium", "lattice", "voigt_row", "voigt_column")
    assert "shear" not in ds
    square = gp.AveragedLattice(gp.Packing(rough.material, 8e-3, rough.spread, "square")).at_force(
        7.0
    )
    found = ds.sel(lattice="square").isel(load=1, medium=0)
    same(found["tensor"], gp.moduli(square).tensor)
    same(found["bulk"], gp.moduli(square).bulk)
    same(found["tensor"].sel(voigt_row="xx", voigt_column="yy"), gp.moduli(square).tensor[0, 1])
    same(found["longitudinal"], gp.sound_velocities(square, (1, 0)).longitudinal)
    triangular = gp.AveragedLattice(rough).at_force(5.0)
    same(
        ds["tensor"].sel(lattice="triangular").isel(load=0, medium=0), gp.moduli(triangular).tensor
    )


def test_a_lattice_without_a_pressure_has_none(rough):
    ds = sweep(rough, force=5.0, lattice=[CHAINED, "square"])
    assert ds["lattice"].values.tolist() == ["chained", "square"]
    assert np.isnan(ds["pressure"].sel(lattice="chained")).all()
    same(ds["pressure"].sel(lattice="square").item(), 5.0 / 8e-3)
    warnings = json.loads(ds.attrs["warnings"])
    assert any(text.startswith("lattice chained: pressure is nan") for text in warnings)
    assert "pressure" not in sweep(rough, force=5.0, lattice=CHAINED)
    with pytest.raises(InputError, match="is not a pressure"):
        sweep(rough, pressure=500.0, lattice=CHAINED)


# -- widths ----------------------------------------------------------------------------------------


@given(
    st.one_of(
        st.floats(0.0, 1e-5).map(gp.Uniform),
        st.builds(gp.Normal, st.floats(0.0, 1e-6), st.floats(0.5, 5.0)),
        st.floats(1e-6, 1e-5).map(lambda w: gp.Discrete((8e-3 - w, 8e-3 + 3.0 * w), (0.75, 0.25))),
        st.lists(st.integers(-50, 50), min_size=2, max_size=9, unique=True).map(
            lambda steps: gp.Measured(tuple(8e-3 + 1e-7 * step for step in steps))
        ),
    ),
    st.one_of(st.just(0.0), st.floats(1e-7, 1e-4)),
)
def test_a_width_keeps_the_shape(spread, width):
    found = spread.with_width(width)
    assert type(found) is type(spread)
    assert_allclose(found.width, width, rtol=1e-9)
    if spread.mean is not None:
        assert_allclose(found.mean, spread.mean, rtol=1e-12)
    if width:
        probability = np.linspace(0.01, 0.99, 21)
        # a listed diameter has the digits that 8 mm leaves a deviation
        assert_allclose(
            found.shape.quantile(probability),
            spread.shape.quantile(probability),
            rtol=1e-9,
            atol=1e-9,
        )


def test_equal_diameters_and_a_distribution_of_another_make_keep_their_width():
    with pytest.raises(InputError, match="cannot be spread"):
        gp.Discrete((8e-3,), (1.0,)).with_width(1e-6)

    class Triangle(Spread):
        rms = 1e-6
        shape = gp.Uniform(1e-6).shape

    with pytest.raises(InputError, match="Triangle"):
        Triangle().with_width(1e-6)


def test_spread_and_width_together(rough):
    ds = sweep(rough, force=5.0, media="afa", spread=[gp.Normal(1e-6), BIMODAL], width=[1e-6, 3e-6])
    for i, spread in enumerate((gp.Normal(1e-6), BIMODAL)):
        for j, width in enumerate((1e-6, 3e-6)):
            packing = gp.Packing(rough.material, 8e-3, spread.with_width(width))
            same(ds["overlap"][0, 0, i, j], gp.AveragedForce(packing).at_force(5.0).overlap)


def test_a_width_may_be_what_makes_room_for_a_diameter(rough):
    """The packing of the new diameter and the old spread, which cannot be, is never made."""
    assert change_packing(rough, {"diameter": 1e-6, "width": 1e-8}).spread == gp.Uniform(1e-8)


def test_a_parameter_of_a_kind_without_a_name_is_refused():
    with pytest.raises(InputError, match=r"parameter '\.diameter'"):
        Axis.of(".diameter", [1e-3])


def test_labels_of_spreads_are_told_apart():
    other = gp.Discrete((7.998e-3, 8e-3, 8.002e-3), (0.125, 0.75, 0.125))
    assert Axis.of("spread", [None, gp.Uniform(1e-6), BIMODAL, other]).labels == (
        "equal balls",
        "Uniform, W = 1e-06 m",
        "Discrete, W = 3.4641e-06 m",
        "Discrete, W = 3.4641e-06 m #2",
    )


# -- bands -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_bands_are_those_of_each_state(rough, finite_overlap):
    ds = sweep(
        rough,
        force=[18.446, 5.0],
        media=("ala", "ema"),
        finite_overlap=finite_overlap,
        bands="GKMG",
        npoints=7,
        poisson_ratio=[0.1, 0.3],
    )
    assert ds["frequencies"].dims == (
        "load",
        "medium",
        "poisson_ratio",
        "segment",
        "point",
        "branch",
    )
    assert ds["frequencies"].shape == (2, 2, 2, 3, 7, 3)
    assert ds["labels"].values.tolist() == ["G", "K", "M", "G"]
    # no reader takes "1" for one a day
    assert ds["distances"].attrs["units"] == "1"
    assert f"units of {'1/a' if finite_overlap else '1/d'}," in ds["distances"].attrs["long_name"]
    for i, medium, sigma in itertools.product((0, 1), ("ala", "ema"), (0.1, 0.3)):
        packing = change_packing(rough, {"poisson_ratio": sigma})
        state = (
            MediumChoice(medium)
            .of(packing)
            .at_force([18.446, 5.0][i], finite_overlap=finite_overlap)
        )
        bands = Phonons(state).bands("GKMG", npoints=7)
        found = ds.isel(load=i).sel(medium=medium, poisson_ratio=sigma)
        assert_allclose(
            found["frequencies"],
            bands.frequencies,
            rtol=1e-12,
            atol=1e-12 * bands.frequencies.max(),
        )
        assert_allclose(ds["qpoints"], bands.qpoints, rtol=0, atol=1e-15)
        spacing = 1.0 - state.relative_overlap if finite_overlap else 1.0
        assert_allclose(ds["distances"], bands.distances * spacing, rtol=1e-12)


def test_bands_of_a_state_whose_balls_are_apart_on_average(steel):
    """At low load the mean overlap is negative; the paper's bands need only the stiffness."""
    loose = gp.Packing(steel, 8e-3, gp.Uniform(4e-6))
    ds = sweep(loose, force=[0.05, 18.446], media="ema", bands=[[0, 0], [1 / 3, 1 / 3]], npoints=3)
    assert ds["overlap"][0, 0] < 0.0
    ratio = np.sqrt(ds["normal_stiffness"][0] / ds["normal_stiffness"][1])
    assert_allclose(
        ds["frequencies"][0],
        ratio.values[:, None, None, None] * ds["frequencies"][1].values,
        rtol=1e-14,
    )


def test_labels_of_the_path_may_be_given(rough):
    corners = [[[0, 0], [0.5, 0]], [[1 / 3, 1 / 3], [0, 0]]]
    given = sweep(rough, force=5.0, bands=corners, npoints=3, labels=["A", "B", "C", "D"])
    assert given["labels"].values.tolist() == ["A", "B|C", "D"]
    letters = sweep(rough, force=5.0, bands="GM,KG", npoints=3)
    assert letters["labels"].values.tolist() == ["G", "M|K", "G"]
    assert given.drop_vars("labels").identical(letters.drop_vars("labels"))
    assert_allclose(
        letters["distances"],
        Phonons(gp.AveragedLattice(rough).at_force(5.0)).bands("GM,KG", 3).distances,
    )


@pytest.mark.parametrize(
    "axis", [{"friction": [True, False]}, {"lattice": ["triangular", "kagome"]}]
)
def test_bands_of_different_numbers_make_no_array(rough, axis):
    with pytest.raises(InputError, match="branches"):
        sweep(rough, force=5.0, bands="GK", **axis)


# -- errors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "no load.* force, pressure, overlap"),
        ({"force": 1.0, "pressure": 1.0}, "force and pressure"),
        ({"force": [[1.0, 2.0]]}, "force: .* list"),
        ({"force": []}, "force: .* list"),
        ({"force": True}, "force: found True"),
        ({"force": 1.0, "media": ()}, "no medium"),
        ({"force": 1.0, "media": "emma"}, "medium: found 'emma'; .*'ema'"),
        ({"force": 1.0, "media": ("ema", "ala", "ema")}, "'ema' .* twice"),
        (
            {"force": 1.0, "media": ["ema", {"ema": {"local_field": "computed"}}]},
            "'ema' .* twice",
        ),
        (
            {"force": 1.0, "media": {"ema": {"local_field": "guess"}}},
            "medium.ema.local_field: found 'guess'",
        ),
        (
            {"force": 1.0, "wdith": [1e-6]},
            "'wdith'.*young_modulus.*width",
        ),
        ({"force": 1.0, "width": ["2 um"]}, "width: found .*2 um"),
        ({"force": 1.0, "friction": []}, "friction .*empty"),
        ({"force": 1.0, "width": [1e-6, -1e-6]}, "width = -1 um: "),
        ({"force": 1.0, "width": [1e-6, 2e-6, 1e-6]}, "width = 1 um twice"),
        ({"force": 1.0, "torsion": [0, 0.0]}, "torsion = 0.0 twice"),
        (
            {"force": 1.0, "spread": [None, gp.Uniform(1e-6), gp.Uniform(1e-6)]},
            "spread = Uniform.* twice",
        ),
        ({"force": 1.0, "width": [1e-6, 1.0]}, "width = 1 m: "),
        (
            {"force": 1.0, "poisson_ratio": [0.2, 0.7], "density": [1e3]},
            "poisson_ratio = 0.7, density = 1000 kg",
        ),
        (
            {"force": 1.0, "spread": BIMODAL, "diameter": [8e-3, 9e-3]},
            "diameter = 9 mm: .*mean",
        ),
        ({"force": 1.0, "bands": "GQ"}, "special point"),
        ({"force": 1.0, "bands": "GK", "labels": ["G"]}, "1 label for 2 corners"),
        ({"force": 1.0, "bands": "GK", "npoints": 1}, "npoints"),
        (
            {"force": 1.0, "media": {"simulation": {"shape": 8}}},
            "medium.simulation.shape: found 8",
        ),
        (
            {
                "force": 1.0,
                "media": {"simulation": {"geometry": "lattice"}},
                "finite_overlap": True,
            },
            r"'simulation\(geometry=lattice\)'.*finite overlap",
        ),
        (
            {"force": 1.0, "media": "simulation", "lattice": "square"},
            "simulation, lattice = square: ",
        ),
        ({"force": 1.0, "resume": True, "path": None}, "cannot be resumed"),
        ({"force": 1.0, "resume": "no"}, "resume: found 'no'"),
        ({"force": 1.0, "overwrite": "no"}, "overwrite: found 'no'"),
        ({"force": 1.0, "labels": ["G", "K"]}, "labels"),
        ({"force": 1.0, "npoints": 11}, "npoints"),
        ({"force": 1.0, "path": "sweep.csv"}, "does not end in .nc"),
        ({"force": 1.0, "executor": 3}, "executor is 3"),
        ({"force": 1.0, "store": 3}, "store is 3"),
        ({"force": 1.0, "progress": 3}, "progress is 3"),
        ({"force": [1.0, math.nan]}, "force: found nan"),
        ({"force": [1.0, -1.0]}, r"force is .*: tensile"),
        (
            {"force": 5.0, "lattice": ["square"], "friction": [False]},
            "^ala, lattice = square, friction = False",
        ),
    ],
)
def test_what_makes_no_sweep(rough, tmp_path, arguments, words):
    with pytest.raises(InputError, match=words):
        sweep(rough, **{"path": tmp_path / "sweep.nc"} | arguments)
    assert not list(tmp_path.iterdir())


def test_files_are_checked_before_the_only_state_is_solved(tmp_path):
    ball = gp.Ball(gp.Material(70e9, 0.22, 2500.0), 1e-3)
    path = tmp_path / "sweep.nc"
    path.write_bytes(b"another")
    impossible = 1e12  # N/m, which presses the balls through each other
    with pytest.raises(FileExistsInRunError):
        sweep(gp.Crystal.on("triangular", [ball]), pressure=impossible, path=path)
    assert [file.name for file in tmp_path.iterdir()] == ["sweep.nc"]


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_a_load_without_a_solution_is_named(rough, tmp_path, executor):
    arguments = {"force": [5.0, 1e-15, 2.0], "media": ("ala", "ema"), "width": [1e-6, 4e-6]}
    arguments["path"] = tmp_path / "s" / "sweep.nc"
    words = r"^ema, width = 1 um, force = 1e-15 N: "
    if executor is None:
        with pytest.raises(PrecisionError, match=words):
            sweep(rough, **arguments)
    else:
        with executor(1) as pool, pytest.raises(PrecisionError, match=words):
            sweep(rough, executor=pool, **arguments)
    assert [path.name for path in (tmp_path / "s").iterdir()] == [PARTIAL]  # what "ala" gave


def test_warnings_of_validity_say_where(rough):
    ds = sweep(rough, overlap=[1e-6, 2e-4], width=[0.0, 1e-6])
    warnings = json.loads(ds.attrs["warnings"])
    # what both say is said once, with both states that are beyond the limit
    equal = dataclasses.replace(rough, spread=None)
    expected = gp.validity(gp.AveragedLattice(equal).at_overlap(2e-4)).warnings
    of_both = [text for text in warnings if "at 2 of 4 states" in text.lower()]
    assert len(of_both) == len(expected)
    for text, sentence in zip(of_both, expected, strict=True):
        assert "overlap 200 um" in text
        assert re.search(r"\d[\d.]*", sentence).group() in text
    assert len(set(warnings)) == len(warnings)
    assert expected


# -- side by side ----------------------------------------------------------------------------------


class Backwards(Executor):
    """Does nothing until it has all tasks, and then the last one first."""

    def __init__(self, total):
        self.waiting = []
        self.total = total
        self._max_workers = total

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        self.waiting.append((future, function, args, kwargs))
        if len(self.waiting) == self.total:
            for one, call, a, k in reversed(self.waiting):
                one.set_result(call(*a, **k))
        return future


ARGUMENTS = {
    "force": FORCES,
    "media": LADDER,
    "width": [0.0, 1e-6, WIDTH],
    "bands": "GK",
    "npoints": 5,
}


@pytest.fixture(scope="module")
def serial(rough):
    return sweep(rough, **ARGUMENTS)


@pytest.mark.claim("sweep-same-numbers")
@pytest.mark.parametrize(
    "pool",
    [
        partial(ThreadPoolExecutor, 3),
        pytest.param(partial(ProcessPoolExecutor, 3), marks=pytest.mark.slow),
        partial(Backwards, 9),
    ],
)
def test_the_numbers_do_not_depend_on_the_workers(rough, serial, pool):
    """Nor on who is first."""
    with pool() as executor:
        assert sweep(rough, executor=executor, **ARGUMENTS).identical(serial)


class Piece:
    """A task that notes that it was done."""

    memory = 0.0
    kind = "piece"

    def __init__(self, number, fails=False, steps=1):
        self.number = number
        self.fails = fails
        self.runs = 0
        self.steps = steps

    @property
    def name(self):
        return f"piece-{self.number}"

    where = name

    def count_steps(self, part):
        return len(part["x"])

    def solve(self, begun=None):
        self.runs += 1
        if self.fails:
            raise ArithmeticError(self.number)
        before = [] if begun is None else begun["x"].tolist()
        return {"x": np.array([*before, self.number + len(before)])}


def test_an_error_is_passed_on_and_ends_the_work():
    pieces = [Piece(0), Piece(1, fails=True), *(Piece(n) for n in range(2, 30))]
    with ThreadPoolExecutor(1) as executor, pytest.raises(ArithmeticError):
        solve_all("pieces", pieces, executor)
    runs = [piece.runs for piece in pieces]
    assert runs[:2] == [1, 1]
    serial_pieces = [Piece(0), Piece(1, fails=True), Piece(2)]
    with pytest.raises(ArithmeticError):
        solve_all("pieces", serial_pieces)
    assert [piece.runs for piece in serial_pieces] == [1, 1, 0]


class Held(Executor):
    """Gives the result of the last of four, and holds the others back."""

    _max_workers = 4

    def __init__(self, fails_at=math.inf):
        self.futures = []
        self.fails_at = fails_at

    def submit(self, function, /, *args, **kwargs):
        if len(self.futures) == self.fails_at:
            raise RuntimeError("no more workers")
        future = Future()
        if len(self.futures) == 3:
            future.set_result(function(*args, **kwargs))
        self.futures.append(future)
        return future


@pytest.mark.parametrize(
    ("executor", "error"), [(Held(), KeyboardInterrupt), (Held(fails_at=3), RuntimeError)]
)
def test_outstanding_tasks_are_cancelled_on_an_interruption(executor, error):
    """Or if the executor gives up."""
    with pytest.raises(error):
        solve_all("pieces", [Piece(n) for n in range(6)], executor, Meter(stop=1))
    assert [future.cancelled() for future in executor.futures[:3]] == [True, True, True]
    assert not any(future.cancelled() for future in executor.futures[3:])


class AtOnce(Executor):
    """Has done what it is given by the time it returns."""

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        future.set_result(function(*args, **kwargs))
        return future


@pytest.mark.parametrize("executor", [None, AtOnce(), Backwards(3)])
def test_steps_follow_each_other(tmp_path, executor):
    steps = 1 if isinstance(executor, Backwards) else 4
    pieces = [Piece(10 * n, steps=steps) for n in range(3)]
    meter = Meter()
    parts = solve_all("pieces", pieces, executor, meter, Store(tmp_path / "parts"))
    assert [part["x"].tolist() for part in parts] == [
        [10 * n + k for k in range(steps)] for n in range(3)
    ]
    assert (meter.steps, meter.done) == ([("pieces", 3 * steps)], 3 * steps)


def test_what_is_finished_when_an_interruption_comes_is_kept(tmp_path):
    pieces = [Piece(n, steps=2) for n in range(5)]
    store = Store(tmp_path / "parts")
    with pytest.raises(KeyboardInterrupt):
        solve_all("pieces", pieces, Backwards(5), Meter(stop=1), store)
    assert [store.read(piece.name)["x"].tolist() for piece in pieces] == [[n] for n in range(5)]
    assert [piece.runs for piece in pieces] == [1] * 5


@pytest.mark.parametrize("executor", [None, AtOnce()])
@pytest.mark.parametrize("moment", ["before", "between", "after"])
def test_an_interruption_while_a_result_is_kept_does_not_lose_it(tmp_path, executor, moment):
    calls = []

    def stop(now):
        if now == moment and len(calls) == 2:
            calls.append("once")
            raise KeyboardInterrupt

    class Interrupted(sqlite3.Connection):
        def execute(self, order, *values):
            calls.extend([order] * (order == "BEGIN IMMEDIATE"))
            stop("before")
            return super().execute(order, *values)

        def executemany(self, order, rows):
            super().executemany(order, rows)
            stop("between")

        def __exit__(self, *what):
            super().__exit__(*what)
            stop("after")

    store = Store(tmp_path / "parts")
    with connecting(Interrupted), pytest.raises(KeyboardInterrupt):
        solve_all("pieces", [Piece(0), Piece(1)], executor, store=store)
    for one in (store, Store(store.path)):
        assert [one.read(f"piece-{n}")["x"].tolist() for n in range(2)] == [[0], [1]]
    assert [path.name for path in tmp_path.iterdir()] == ["parts"]


# -- files -----------------------------------------------------------------------------------------


def test_a_sweep_comes_back_from_its_file(rough, serial, tmp_path):
    path = tmp_path / "deep" / "sweep.nc"
    assert sweep(rough, path=path, **ARGUMENTS).identical(serial)
    again = load_sweep(path)
    assert again.identical(serial)
    assert {name: v.dtype for name, v in again.variables.items()} == {
        name: v.dtype for name, v in serial.variables.items()
    }
    assert sorted(p.name for p in path.parent.iterdir()) == [
        ".granphon-files",
        "sweep.csv",
        "sweep.nc",
    ]
    path.unlink()  # the file is closed
    assert again.identical(serial)


def test_another_library_reads_the_file(rough, tmp_path):
    ds = sweep(rough, path=tmp_path / "sweep.nc", **ARGUMENTS)
    import netCDF4

    with netCDF4.Dataset(tmp_path / "sweep.nc") as file:
        assert file.variables["longitudinal"].dimensions == ("load", "medium", "width")
        assert file.variables["longitudinal"].units == "m/s"
        assert "_FillValue" not in file.variables["longitudinal"].ncattrs()
        assert_array_equal(file.variables["frequencies"][:].data, ds["frequencies"])
        assert file.variables["medium"][:].tolist() == list(LADDER)
        assert file.schema == 1


@pytest.mark.parametrize(
    ("spread", "lattice"),
    [
        pytest.param(None, "triangular", marks=pytest.mark.slow),
        (gp.Uniform(WIDTH), gp.Lattice("mine", ((1.0, 0.0), (-0.5, math.sqrt(0.75))))),
        pytest.param(gp.Normal(1e-6, 2.0), "triangular", marks=pytest.mark.slow),
        pytest.param(BIMODAL, "square", marks=pytest.mark.slow),
        pytest.param(
            gp.Measured(tuple(8e-3 + 1e-10 * (n - 4999.5) for n in range(10_000))),
            "triangular",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_packing_comes_back_from_the_file(steel, tmp_path, spread, lattice):
    packing = gp.Packing(steel, getattr(spread, "mean", None) or 8e-3, spread, lattice)
    ds = sweep(packing, force=5.0, path=tmp_path / "sweep.nc")
    assert load_sweep(tmp_path / "sweep.nc").identical(ds)
    assert packing_of(ds) == packing


def test_provenance(rough, tmp_path):
    ds = sweep(rough, force=5.0, spread=[BIMODAL, None], lattice=[CHAINED])
    assert ds.attrs["format"] == "granphon sweep"
    assert json.loads(ds.attrs["versions"])["granphon"] == gp.__version__
    assert {"numpy", "scipy", "xarray", "h5netcdf"} <= set(json.loads(ds.attrs["versions"]))
    assert ds.attrs["finite_overlap"] == 0
    assert json.loads(ds["spread"].attrs["values"])[0]["diameters"] == [7.999e-3, 8.001e-3]
    assert json.loads(ds["lattice"].attrs["values"])[0]["cell"][1] == [0.3, math.sqrt(0.91)]
    finite = sweep(rough, force=5.0, finite_overlap=True)
    assert finite.attrs["finite_overlap"] == 1
    assert "left out" in finite.attrs["exponent"]


@pytest.mark.claim("files-all-digits")
def test_the_table_has_every_digit(rough, tmp_path):
    ds = sweep(
        rough,
        pressure=[500.0, 4e3],
        media=LADDER,
        width=[0.0, 1e-6],
        spread=[None, BIMODAL],
        bands="GK",
        path=tmp_path / "sweep.nc",
    )
    with (tmp_path / "sweep.csv").open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    assert head[:6] == [
        "pressure (N/m)",
        "medium",
        "width (m)",
        "spread",
        "force (N)",
        "overlap (m)",
    ]
    assert len(rows) == 2 * 3 * 2 * 2
    names = [title.split(" (")[0] for title in head]
    assert set(names) == {"pressure", "medium", "width", "spread"} | {
        name for name, data in ds.data_vars.items() if data.dims == ds["bulk"].dims
    }
    for title, name in zip(head, names, strict=True):
        assert title == name + (
            f" ({ds[name].attrs['units']})" if "units" in ds[name].attrs else ""
        )
    points = itertools.product(range(2), range(3), range(2), range(2))
    for row, (i, j, k, m) in zip(rows, points, strict=True):
        point = ds.isel(load=i, medium=j, width=k, spread=m)
        for name, cell in zip(names, row, strict=True):
            value = point[name].values[()]
            assert cell == str(value) if ds[name].dtype.kind in "bU" else float(cell) == value


def test_an_existing_sweep_is_kept_unless_told(rough, tmp_path):
    path, meter = tmp_path / "sweep.nc", Meter()
    sweep(rough, force=5.0, path=path)
    before = path.read_bytes()
    with pytest.raises(FileExistsInRunError, match=r"sweep\.nc, sweep\.csv"):
        sweep(rough, force=6.0, path=path, progress=meter)
    assert path.read_bytes() == before
    assert not meter.steps  # nothing was computed in vain
    assert_array_equal(sweep(rough, force=6.0, path=path, overwrite=True)["force"], [6.0])
    assert_array_equal(load_sweep(path)["force"], [6.0])


def test_a_place_that_cannot_be_written_is_found_out_first(rough, tmp_path):
    (tmp_path / "file").write_text("")
    meter = Meter()
    with pytest.raises(OutputError, match="is not a folder"):
        sweep(rough, force=5.0, path=tmp_path / "file" / "sweep.nc", progress=meter)
    assert not meter.steps


def _other_file(path):
    xarray.Dataset({"x": ("n", [1.0])}).to_netcdf(path, engine="h5netcdf")


def _numbered(path, schema=99):
    xarray.Dataset(attrs={"format": "granphon sweep", "schema": schema}).to_netcdf(
        path, engine="h5netcdf"
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: None, "no such file"),
        (lambda path: path.write_text("force,velocity\n1,2\n"), "cannot be read"),
        (_other_file, "is not a sweep"),
        (_numbered, r"schema 99.*schema 1"),
        (lambda path: _numbered(path, 1), "is damaged"),
    ],
)
def test_what_is_no_sweep_is_not_loaded(tmp_path, monkeypatch, make, words):
    monkeypatch.setattr("granphon.runs.dataset._require_openable", lambda *_: None)
    make(tmp_path / "sweep.nc")
    with pytest.raises(InputError, match=words):
        load_sweep(tmp_path / "sweep.nc")


# -- going on --------------------------------------------------------------------------------------


PARTIAL = ".sweep.nc.partial"


def parts_in(folder):
    return list(dict(read_entries(folder / PARTIAL))) if (folder / PARTIAL).exists() else []


@contextmanager
def opened(folder):
    """The table of the store, as any program would change it."""
    base = sqlite3.connect(folder / PARTIAL)
    with base:
        yield base
    base.close()


@pytest.fixture(scope="module")
def stopped(rough, tmp_path_factory):
    """The folder of a sweep that was stopped after four of its nine tasks, to be copied."""
    folder = tmp_path_factory.mktemp("stopped")
    with pytest.raises(KeyboardInterrupt):
        sweep(rough, path=folder / "sweep.nc", progress=Meter(stop=4), **ARGUMENTS)
    assert [path.name for path in folder.iterdir()] == [PARTIAL]
    return folder


@pytest.fixture
def interrupted(stopped, tmp_path):
    """A copy of that folder."""
    shutil.copytree(stopped, tmp_path, dirs_exist_ok=True)
    assert len(parts_in(tmp_path)) == 4
    return tmp_path


def resumed(packing, folder, expected, arguments=ARGUMENTS, **options):
    """Resume in ``folder``; the number of steps that were done anew."""
    with Counted() as executor:
        found = sweep(packing, path=folder / "sweep.nc", executor=executor, **arguments, **options)
    assert found.identical(expected)
    assert sorted(path.name for path in folder.iterdir()) == [
        ".granphon-files",
        "sweep.csv",
        "sweep.nc",
    ]
    return len(executor.begun)


@pytest.mark.claim("sweep-same-numbers")
@pytest.mark.parametrize(
    "options", [{}, pytest.param({"resume": True, "overwrite": True}, marks=pytest.mark.slow)]
)
def test_an_interrupted_sweep_goes_on_from_what_it_has(rough, serial, interrupted, options):
    """Whatever is said; and again, if it is interrupted again."""
    meter = Meter(stop=7)
    with pytest.raises(KeyboardInterrupt):
        sweep(rough, path=interrupted / "sweep.nc", progress=meter, **ARGUMENTS, **options)
    meter.stop = math.inf
    assert resumed(rough, interrupted, serial, progress=meter, **options) == 2
    assert (meter.steps, meter.done) == ([("states", 9)] * 2, 7.0 + 9.0)
    assert load_sweep(interrupted / "sweep.nc").identical(serial)


@pytest.mark.parametrize(
    ("error", "pool"),
    [
        (RuntimeError("out of memory"), ThreadPoolExecutor),
        pytest.param(SystemExit(1), ProcessPoolExecutor, marks=pytest.mark.slow),
    ],
)
def test_any_end_leaves_the_parts(rough, serial, tmp_path, error, pool):
    with pool(2) as executor, pytest.raises(type(error)):
        sweep(
            rough,
            path=tmp_path / "sweep.nc",
            executor=executor,
            progress=Meter(3, error),
            **ARGUMENTS,
        )
    # those that were finished meanwhile are kept as well
    left = 9 - len(parts_in(tmp_path))
    assert left <= 9 - 3
    assert resumed(rough, tmp_path, serial) == left


@pytest.mark.parametrize(
    "more",
    [
        {"force": 5.0, "bands": "GK", "npoints": 2, "width": [0.0, 1e-6]},
        *(
            pytest.param(more, marks=pytest.mark.slow)
            for more in (
                {"force": [5.0, 2.0], "bands": "GK", "npoints": 3, "width": [0.0, 1e-6]},
                {"force": [5.0, 2.0], "spread": [BIMODAL, None], "lattice": [CHAINED, "square"]},
                {"pressure": [4e3, 500.0], "friction": [True, False], "finite_overlap": True},
            )
        ),
    ],
)
def test_a_complete_sweep_is_read_again(rough, tmp_path, more):
    arguments = {**more, "path": tmp_path / "sweep.nc"}
    path = tmp_path / "sweep.nc"
    whole = sweep(rough, **arguments)
    before = {one: (one.read_bytes(), one.stat().st_mtime_ns) for one in tmp_path.iterdir()}
    assert {one.name for one in before} == {"sweep.nc", "sweep.csv", ".granphon-files"}
    meter = Meter()
    assert sweep(rough, resume=True, progress=meter, **arguments).identical(whole)
    assert not meter.steps
    for other in ({"young_modulus": 2e11}, {"media": "afa"}):
        with pytest.raises(FileExistsInRunError, match="already holds"):
            sweep(rough, resume=True, progress=meter, **arguments | other)
    assert not meter.steps
    assert {one: (one.read_bytes(), one.stat().st_mtime_ns) for one in tmp_path.iterdir()} == before
    (tmp_path / "sweep.csv").unlink()  # not complete
    with pytest.raises(FileExistsInRunError, match=r"already holds sweep\.nc"):
        sweep(rough, resume=True, **arguments)
    assert path.exists()


def test_an_argument_that_cannot_be_leaves_the_parts(rough, interrupted):
    with pytest.raises(InputError):
        sweep(rough, path=interrupted / "sweep.nc", **{**ARGUMENTS, "width": [-1.0]})
    assert len(parts_in(interrupted)) == 4


def _flip(place):
    def change(entry):
        at = place if isinstance(place, int) else int(place * (len(entry) - 1))
        return entry[:at] + bytes([entry[at] ^ 1]) + entry[at + 1 :]

    return change


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(_flip(0), marks=pytest.mark.slow),
        lambda entry: None,
        pytest.param(lambda entry: entry[:-1], marks=pytest.mark.slow),
        pytest.param(lambda entry: "text", marks=pytest.mark.slow),
    ],
)
def test_damaged_parts_are_done_again(rough, serial, interrupted, change):
    name = parts_in(interrupted)[1]
    with opened(interrupted) as base:
        (entry,) = base.execute("SELECT entry FROM task WHERE name = ?", (name,)).fetchone()
        base.execute("UPDATE task SET entry = ? WHERE name = ?", (change(entry), name))
    assert len(parts_in(interrupted)) == 3
    with pytest.raises(KeyboardInterrupt):
        sweep(rough, path=interrupted / "sweep.nc", progress=Meter(stop=4), **ARGUMENTS)
    assert resumed(rough, interrupted, serial) == 5


@given(
    st.floats(0.0, 1.0), st.sampled_from(["flip", "cut", "zero", "junk", "more"]), st.integers(0, 7)
)
@settings(max_examples=60, deadline=None)
def test_a_damaged_file_is_refused_or_gives_the_numbers_that_were_kept(
    tmp_path_factory, place, kind, bit
):
    folder = tmp_path_factory.mktemp("damaged")
    store = Store(folder / "store")
    parts = {f"piece-{n}": {"x": np.arange(900.0) + n} for n in range(4)}
    store.claim({"of": "this"})
    for name, part in parts.items():
        store.append(name, encode(name, part))
    store.close()
    data = bytearray((folder / "store").read_bytes())
    at = int(place * (len(data) - 1))
    if kind == "flip":
        data[at] ^= 1 << bit
    elif kind == "more":
        data += b"\xff" * (at % 5000)
    else:
        data[at:] = {
            "cut": b"",
            "zero": bytes(len(data) - at),
            "junk": b"\xa5" * 4096 + data[at + 4096 :],
        }[kind]
    (folder / "store").write_bytes(data)
    damaged = Store(folder / "store")
    found = {}
    told = ""
    try:
        damaged.claim({"of": "this"}, lambda: parts)
        found = {name: damaged.read(name) for name in parts if name in damaged}
    except OutputError as error:
        told = str(error)
    assert re.search("^$|is damaged: .*--force|no store", told)
    for name, part in found.items():
        if part is not None:
            assert_array_equal(part["x"], parts[name]["x"])
    damaged.close()
    if told:
        assert bytes(data) == (folder / "store").read_bytes()
    if "is damaged" in told:
        Store(folder / "store", force=True).claim({"of": "this"})
        assert not (folder / "store").exists()


def test_a_damaged_store_is_refused_unless_it_is_to_be_discarded(rough, serial, interrupted):
    with open(interrupted / PARTIAL, "r+b") as stream:
        stream.seek(4096)
        stream.write(bytes(4096))
    for resume in (False, True):
        with pytest.raises(
            OutputError,
            match=r"\.partial, .*damaged: .*--force",
        ):
            sweep(rough, path=interrupted / "sweep.nc", resume=resume, **ARGUMENTS)
    with (
        without_rights(interrupted / PARTIAL, remove=False),
        pytest.raises(OutputError, match="is damaged"),
    ):
        Store(interrupted / PARTIAL, force=True).claim({"of": "this"})
    assert resumed(rough, interrupted, serial, overwrite=True) == 9


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.write_bytes(b"mine"),
        lambda path: path.write_bytes(bytes(3000)),
        lambda path: path.symlink_to("elsewhere"),
        lambda path: path.symlink_to("/dev/zero"),
        lambda path: path.mkdir(),
        os.mkfifo,  # a reader would wait for good
    ],
)
def test_what_is_a_file_of_the_user_or_none_is_no_store(rough, tmp_path, make):
    (tmp_path / "elsewhere").write_text("mine")
    make(tmp_path / PARTIAL)
    before = (tmp_path / PARTIAL).lstat()
    for overwrite in (False, True):
        with pytest.raises(OutputError, match=r"\.partial is no store"):
            sweep(rough, force=5.0, path=tmp_path / "sweep.nc", overwrite=overwrite)
    after = (tmp_path / PARTIAL).lstat()
    assert (after.st_ino, after.st_mode, after.st_size) == (
        before.st_ino,
        before.st_mode,
        before.st_size,
    )
    assert (tmp_path / "elsewhere").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"elsewhere", PARTIAL}


@pytest.mark.parametrize("order", ["PRAGMA application_id = 0", "PRAGMA user_version = 2"])
def test_a_data_base_of_the_user_or_of_another_version_is_no_store(rough, interrupted, order):
    with opened(interrupted) as base:
        base.execute(order)
    before = (interrupted / PARTIAL).read_bytes()
    with pytest.raises(
        OutputError,
        match="no store",
    ):
        sweep(rough, force=5.0, path=interrupted / "sweep.nc", overwrite=True)
    assert (interrupted / PARTIAL).read_bytes() == before


def test_a_store_with_orders_of_its_own_is_refused(rough, interrupted):
    with opened(interrupted) as base:
        base.execute("CREATE TRIGGER more AFTER INSERT ON task BEGIN DELETE FROM task; END")
    with pytest.raises(OutputError, match="is damaged"):
        sweep(rough, path=interrupted / "sweep.nc", **ARGUMENTS)


def test_a_store_needs_no_locks_of_the_file_system(rough, serial, tmp_path, no_locks):
    told = []

    class Told(sqlite3.Connection):
        def __init__(self, address, *more, **options):
            told.append(address)
            super().__init__(address, *more, **options)

    with connecting(Told):
        with pytest.raises(KeyboardInterrupt):
            sweep(rough, path=tmp_path / "sweep.nc", progress=Meter(stop=4), **ARGUMENTS)
        assert resumed(rough, tmp_path, serial) == 5
    assert told
    assert all("nolock=1" in address for address in told)


def test_a_reader_does_not_undo_what_is_being_written_where_there_are_no_locks(tmp_path, no_locks):
    store = Store(tmp_path / "store")
    path = tmp_path / "store"
    store.claim({"of": "this"})
    store.append("a", encode("a", {"x": np.zeros(1)}))
    base = store._connect(make=True)
    base.execute("PRAGMA cache_size = 1")  # pages go to the disk before the end of the transaction
    base.execute("BEGIN IMMEDIATE")
    for n in range(50):
        base.execute(
            "INSERT INTO task VALUES (?, 0, ?)", (f"b{n}", encode(f"b{n}", {"x": np.ones(1000)}))
        )
    assert (tmp_path / "store-journal").stat().st_size > 0
    with suppress(OutputError):
        assert set(dict(read_entries(path))) <= {"a", *(f"b{n}" for n in range(50))}
    base.execute("COMMIT")
    store.close()
    assert len(dict(read_entries(path))) == 51


def test_a_store_takes_what_it_gives_back_and_nothing_else():
    """Named fields would come back without their names, and a name of two lines would hide the
    layout. The order is that in which results were kept last.
    """
    store = Store()
    results = {"a": np.zeros((3, 0)), "b": np.array("text"), "c": np.arange(6).reshape(2, 3).T}
    for name in ("first", "second", "first"):
        store.append(name, encode(name, results))
    assert store.names == ["second", "first"]
    back = store.read("first")
    assert list(back) == list(results)
    for name, array in results.items():
        np.testing.assert_array_equal(back[name], array, strict=True)
    with pytest.raises(TypeError, match="'a'"):
        encode("name", {"a": np.zeros(2, [("x", float), ("y", int)])})
    with pytest.raises(ValueError, match="line break"):
        encode("two\nlines", results)


def test_the_path_of_a_store_may_be_a_text(tmp_path):
    store = Store(str(tmp_path / "store"))
    store.append("a", encode("a", {"x": np.ones(2)}))
    store.close()
    assert list(dict(read_entries(str(tmp_path / "store")))) == ["a"]
    with pytest.raises(InputError, match="path"):
        Store(5)


@pytest.mark.parametrize("replaced", [False, True])
def test_a_store_that_is_removed_or_replaced_meanwhile_is_named(tmp_path, replaced):
    store = Store(tmp_path / "store")
    store.claim({"of": "this"})
    store.append("a", encode("a", {"x": np.zeros(1)}))
    os.rename(tmp_path / "store", tmp_path / "other")
    if replaced:
        (tmp_path / "store").touch()
    with pytest.raises(OutputError, match=r"/store, .*removed"):
        store.append("b", encode("b", {"x": np.ones(1)}))
    assert (tmp_path / "store").exists() == replaced
    assert list(dict(read_entries(tmp_path / "other"))) == ["a"]


def test_a_store_that_may_not_be_written_is_found_out_first(rough, interrupted):
    with (
        Counted() as executor,
        without_rights(interrupted / PARTIAL),
        pytest.raises(OutputError, match=r"\.partial .*Permission"),
    ):
        sweep(rough, path=interrupted / "sweep.nc", executor=executor, **ARGUMENTS)
    assert executor.begun == []
    assert len(parts_in(interrupted)) == 4


def test_a_store_that_may_not_be_written_can_be_discarded(tmp_path):
    path = tmp_path / "store"
    old = Store(path)
    old.claim({"of": "that"})
    old.append("a", encode("a", {"x": np.zeros(1)}))
    old.close()
    path.chmod(0o400)
    with without_rights(path), pytest.raises(FileExistsInRunError, match="--force"):
        Store(path).claim({"of": "this"})
    for identity in (
        {"of": "that"},
        {"of": "this"},
    ):
        # its own results, and those that cannot be removed
        with (
            without_rights(path, remove=False),
            pytest.raises(OutputError, match="cannot be written"),
        ):
            Store(path, force=True).claim(identity)
        assert list(dict(read_entries(path))) == ["a"]
    with without_rights(path):
        new = Store(path, force=True)
        new.claim({"of": "this"})
        new.append("b", encode("b", {"x": np.ones(1)}))
    assert list(dict(read_entries(path))) == ["b"]


def test_a_store_can_be_read_while_it_grows(rough, serial, tmp_path):
    seen = []

    class Reader(Meter):
        def advance(self, amount=1.0):
            super().advance(amount)
            path = tmp_path / PARTIAL
            if path.exists():
                every = dict(read_entries(path))
                seen.append(len(every))
                name, part = list(every.items())[-1]
                assert name.startswith(LADDER)
                assert part["force"].shape == (len(FORCES),)
                assert path.stat().st_size > 0

    sweep(rough, path=tmp_path / "sweep.nc", progress=Reader(), **ARGUMENTS)
    assert seen == list(range(1, 10))


def test_a_store_does_not_grow_by_what_it_replaces(tmp_path):
    store = Store(tmp_path / "parts")
    sizes = []
    store.claim({"of": "this"}, tuple)
    for step in range(20):
        for number in range(2):
            store.append(
                f"piece-{number}",
                encode(f"piece-{number}", {"x": np.arange(5000.0) + number + step}),
            )
        sizes.append((tmp_path / "parts").stat().st_size)
    assert max(sizes) < 4 * 40_000
    for one in (store, Store(tmp_path / "parts")):
        assert_array_equal(
            [one.read(f"piece-{n}")["x"] for n in range(2)],
            [np.arange(5000.0) + n + 19 for n in range(2)],
        )
    with pytest.raises(FileExistsInRunError, match=r"'this' .*'that' "):
        Store(tmp_path / "parts").claim({"of": "that"}, tuple)
    store.clear()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("most", [100, 1056])
def test_a_result_of_any_size_is_kept(tmp_path, monkeypatch, most):
    """Beyond what a value of SQLite may hold."""
    monkeypatch.setattr(finished_tasks, "_PIECE", most)
    store = Store(tmp_path / "parts")
    for length in (1000, 7):
        store.append("a", encode("a", {"x": np.arange(float(length)), "y": np.array(["text"])}))
        store.append("b", encode("b", {"x": np.ones(length)}))
        for one in (store, Store(tmp_path / "parts")):
            assert one.names == ["a", "b"]
            assert_array_equal(one.read("a")["x"], np.arange(float(length)))
            assert one.read("a")["y"].tolist() == ["text"]
            assert_array_equal(one.read("b")["x"], np.ones(length))


#: appends entries, larger and larger, and says the name of each that was kept
KEPT = """
import sys
from pathlib import Path
import numpy as np
from granphon.runs.finished_tasks import Store, encode
store = Store(Path(sys.argv[1]))
store.claim({"of": "this"})
for n in range(100_000):
    name = f"piece-{n % 50}"
    store.append(name, encode(name, {"x": np.full(n % 999, float(n))}))
    print(n, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal on this system")
@pytest.mark.parametrize("count", only([1, 150], [1, 2, 3, 20, 150, 800, 1500]))
def test_what_was_kept_survives_a_kill_at_any_moment(tmp_path, count):
    path = tmp_path / "store"
    with subprocess.Popen(
        [sys.executable, "-c", KEPT, str(path)], stdout=subprocess.PIPE, text=True
    ) as running:
        for _ in range(count):
            running.stdout.readline()
        running.kill()  # in the midst of another one, as a rule
        last = [count - 1, *map(int, running.stdout.read().split())][-1]
    store = Store(path)
    store.claim({"of": "this"})
    for n in range(max(0, last - 49), last + 1):
        found = store.read(f"piece-{n % 50}")["x"]
        # the next one may have been kept, and not been said
        assert any(
            np.array_equal(found, np.full(m % 999, float(m)))
            for m in ((n, n + 50) if n + 49 == last else (n,))
        )
    store.append("more", encode("more", {"x": np.ones(3)}))
    assert sorted(one.name for one in tmp_path.iterdir()) == ["store"]


NUMBERS = st.sampled_from(["<f8", "<i8", "<c16", "?", "<f4", "|u1", "<U3", "|S2"])


@given(
    layout=st.dictionaries(
        st.text("abcxyz_.", min_size=1, max_size=5),
        st.tuples(NUMBERS, st.lists(st.integers(0, 3), max_size=3)),
        min_size=1,
        max_size=4,
    ),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=30, deadline=None)
def test_an_entry_holds_every_bit(layout, seed):
    rng = np.random.default_rng(seed)
    part = {}
    for name, (kind, shape) in layout.items():
        dtype = np.dtype(kind)
        if dtype.kind in "US":
            part[name] = rng.integers(0, 999, shape).astype(dtype)
        else:
            raw = rng.bytes(int(np.prod(shape)) * dtype.itemsize)
            part[name] = np.frombuffer(
                bytes(b & 1 for b in raw) if dtype.kind == "b" else raw, dtype
            ).reshape(shape)
    found = decode(encode("name", part))
    assert list(found) == list(part)
    for name, one in part.items():
        assert (found[name].dtype, found[name].shape, found[name].tobytes()) == (
            one.dtype,
            one.shape,
            one.tobytes(),
        )
    assert encode("name", found) == encode("name", part)


def test_an_entry_holds_no_python_objects():
    with pytest.raises(TypeError, match=r"'x' .*object"):
        encode("name", {"x": np.array([None])})


def test_parts_of_another_sweep_are_not_discarded_unless_told(rough, interrupted):
    before = (interrupted / PARTIAL).read_bytes()
    meter = Meter()
    for change, told in (
        ({"force": [18.446, 2.0, 5.0, 2.1]}, r"force\[3\] is 2\.0 .*2\.1 "),
        (
            {"force": [2.0, 18.446, 5.0, 2.0]},
            r"force\[0\] is 18\.446 .*2\.0 .*force\[1\] is",
        ),
        ({"force": [18.446]}, "force .*4 .*1 "),
        ({"npoints": 6}, r"qpoints\[0\] .*5 .*6 "),
        ({"bands": "GM"}, r"labels\[1\] is 'K' .*'M' .*qpoints"),
        ({"bands": None, "npoints": None}, "labels .*there only.*qpoints .*there only"),
        ({"finite_overlap": True}, "finite_overlap .*false .*true "),
        ({"poisson_ratio": 0.3}, "poisson_ratio .*here only"),
        (
            {"width": [0.0, 1e-6, 3e-6], "media": ("ala", "afa")},
            r"media .*3 .*2 .*width\[2\]",
        ),
    ):
        arguments = {**ARGUMENTS, **change}
        for resume in (False, True):
            with pytest.raises(FileExistsInRunError, match=told):
                sweep(
                    rough, path=interrupted / "sweep.nc", resume=resume, progress=meter, **arguments
                )
    assert not meter.steps
    assert (interrupted / PARTIAL).read_bytes() == before
    assert (
        resumed(rough, interrupted, sweep(rough, **arguments), arguments, overwrite=True) == 2 * 3
    )


def test_parts_of_another_packing_or_version_are_not_discarded_unless_told(
    rough, serial, interrupted, monkeypatch
):
    other = change_packing(rough, {"density": 7841.0})
    path = interrupted / "sweep.nc"
    with monkeypatch.context() as patch:
        for module in ("tasks", "dataset"):
            patch.setattr(
                f"granphon.runs.{module}.packages", lambda: packages() | {"numpy": "0.0.9"}
            )
        with pytest.raises(FileExistsInRunError, match=r"versions\.numpy .*'0\.0\.9' "):
            sweep(rough, path=path, **ARGUMENTS)
    with pytest.raises(
        FileExistsInRunError,
        match=r"density is 7840\.0 .*7841\.0 ",
    ):
        sweep(other, path=path, **ARGUMENTS)
    with pytest.raises(KeyboardInterrupt):
        sweep(other, path=path, overwrite=True, progress=Meter(stop=3), **ARGUMENTS)
    assert len(parts_in(interrupted)) == 3
    with pytest.raises(FileExistsInRunError, match=r"density is 7841\.0 there"):
        sweep(rough, path=path, **ARGUMENTS)
    assert resumed(rough, interrupted, serial, overwrite=True) == 9


@pytest.mark.parametrize(
    "change",
    [
        lambda entry: finished_tasks._seal("", b"[" * 100_000),
        pytest.param(lambda entry: b"", marks=pytest.mark.slow),
        pytest.param(_flip(0.5), marks=pytest.mark.slow),
    ],
)
def test_parts_that_belong_to_nothing_known(rough, serial, interrupted, change):
    with opened(interrupted) as base:
        (entry,) = base.execute("SELECT entry FROM task WHERE name = ''").fetchone()
        base.execute("UPDATE task SET entry = ? WHERE name = ''", (change(entry),))
    with pytest.raises(FileExistsInRunError, match="belongs"):
        sweep(rough, path=interrupted / "sweep.nc", **{**ARGUMENTS, "force": 1.0})
    assert resumed(rough, interrupted, serial) == 9 - 4  # each part says what it is


def test_a_sweep_may_grow_while_it_is_interrupted(rough, interrupted):
    """A part belongs to its medium and packing, not to its place: the four that were done serve."""
    arguments = {**ARGUMENTS, "width": [5e-7, *ARGUMENTS["width"]]}
    assert resumed(rough, interrupted, sweep(rough, **arguments), arguments) == 12 - 4


def test_a_store_of_ones_own_is_left_to_its_owner(rough, serial, interrupted):
    store = Store(interrupted / PARTIAL)
    with Counted() as executor:
        assert sweep(rough, store=store, executor=executor, **ARGUMENTS).identical(serial)
    assert len(executor.begun) == 9 - 4
    assert len(parts_in(interrupted)) == 9


def test_an_identity_is_that_of_the_sweep_to_which_all_parts_belong(rough, tmp_path):
    def run(stop, samples):
        media = {"simulation": SAMPLES["simulation"] | {"samples": samples}}
        with pytest.raises(KeyboardInterrupt):
            sweep(
                rough,
                path=tmp_path / "sweep.nc",
                progress=Meter(stop=stop),
                force=18.446,
                media=media,
            )

    def said():
        with closing(sqlite3.connect(tmp_path / PARTIAL)) as base:
            (entry,) = base.execute("SELECT entry FROM task WHERE name = ''").fetchone()
        return json.loads(entry[32:].partition(b"\n")[2])["media"]  # behind a SHA-256 and the name

    def refused():
        with pytest.raises(FileExistsInRunError) as caught:
            sweep(rough, path=tmp_path / "sweep.nc", force=5.0)
        return str(caught.value)

    run(1, 3)
    first = said()
    run(1, 4)  # it takes what is there, and ends before it has added to it
    assert said() == first
    assert "18.446" in refused()
    run(2, 4)
    assert said() != first
    run(2, 3)  # one that has all that is there, and adds nothing
    assert said() != first
    assert len(parts_in(tmp_path)) == 2


@pytest.mark.parametrize(
    ("most", "executor"), [(0, None), pytest.param(4, AtOnce(), marks=pytest.mark.slow)]
)
def test_a_disk_that_is_full_keeps_what_it_has(rough, serial, tmp_path, most, executor):
    folder = tmp_path / "new"
    with full_disk(most), pytest.raises(OutputError, match=r"new/.*No space left"):
        sweep(rough, path=folder / "sweep.nc", executor=executor, **ARGUMENTS)
    assert folder.exists() == bool(most)
    assert len(parts_in(folder)) == most
    assert resumed(rough, folder, serial) == 9 - most


def test_a_sweep_that_fills_the_disk_is_an_error(rough, serial, tmp_path, monkeypatch):
    """HDF5 is not asked to write to it: it would end the process."""
    write = Path.write_bytes

    def full(path, data):
        if path.suffix == ".nc":
            write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OutputError, match="No space left"):
            sweep(rough, path=tmp_path / "sweep.nc", **ARGUMENTS)
    assert [path.name for path in tmp_path.iterdir()] == [PARTIAL]
    assert resumed(rough, tmp_path, serial) == 0


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk of 64 kB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = shutil.which("mount")
    command = [mount or "mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if mount is None or subprocess.run(command, check=False, capture_output=True).returncode:
        pytest.skip("may not mount")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("count", [9, 1])
def test_a_small_disk_fills_up(rough, small_disk, count):
    """By what is kept; or, where that is one part, by the result."""
    arguments = (
        ARGUMENTS | {"npoints": 300} | ({} if count > 1 else {"media": "ala", "width": WIDTH})
    )
    with pytest.raises(OutputError, match="No space left"):
        sweep(rough, **arguments, path=small_disk / "sweep.nc")
    assert [path.name for path in small_disk.iterdir()] == [PARTIAL]
    assert 0 < len(parts_in(small_disk)) < max(count, 2)


@pytest.fixture(scope="module")
def rough(steel):
    """The array of the experiment, with the spread of Section IV."""
    return gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(WIDTH))


@pytest.mark.parametrize(
    ("lattice", "path"), [("square", "GXMG"), ("kagome", "GKMG"), (CHAINED, "GXA1Y")]
)
def test_the_path_is_that_of_phonons_on_every_lattice(rough, lattice, path):
    packing = gp.Packing(rough.material, 8e-3, rough.spread, lattice)
    ds = sweep(packing, force=5.0, bands=path, npoints=4)
    bands = Phonons(gp.AveragedLattice(packing).at_force(5.0)).bands(path, npoints=4)
    assert_array_equal(ds["qpoints"], bands.qpoints)
    assert_allclose(ds["distances"], bands.distances, rtol=1e-14)
    assert_allclose(
        ds["frequencies"][0, 0], bands.frequencies, rtol=1e-12, atol=1e-12 * bands.frequencies.max()
    )


def test_the_only_state_of_a_sweep_is_that_of_a_sweep_of_more(rough):
    """The state of a sweep without axes is kept with its balls, and its variables are found from
    it; those of more states are found from averages.
    """
    media = {"simulation": {"shape": (4, 4), "samples": 2}}
    one = sweep(rough, force=18.446, media=media)
    more = sweep(rough, force=[18.446, 5.0], media=media)
    assert set(one.data_vars) == set(more.data_vars)
    for name, values in one.data_vars.items():
        np.testing.assert_array_equal(values.values[0], more[name].values[0], str(name))
