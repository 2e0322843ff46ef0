"""The catalogue of observables: what is in it is in every file, table and figure."""

from __future__ import annotations

import csv

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

import granphon as gp
from granphon.balls.loads import Load
from granphon.cli.terminal import describe_result
from granphon.figures.curves import plot_sweep
from granphon.observables.catalogue import CATALOGUE, Analysis, axis_label, find_all
from granphon.scene.scene import Scene

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))


@pytest.fixture
def impedance():
    """A new observable, by its entry alone: density times longitudinal velocity."""
    return gp.observables.register(
        "impedance",
        "Pa s/m",
        "acoustic impedance of longitudinal waves",
        lambda of: of.state.effective_density * of.velocities.longitudinal,
        cost="velocities",
    )


def expected(force):
    state = gp.EffectiveMedium(PACKING).at_force(force)
    return state.effective_density * gp.sound_velocities(state).longitudinal


def test_an_entry_is_all_that_a_sweep_its_table_and_its_figure_need(impedance, tmp_path):
    data = gp.sweep(PACKING, force=[2.0, 9.0], media=("ema",), path=tmp_path / "sweep.nc")
    np.testing.assert_array_equal(data["impedance"].values[:, 0], expected([2.0, 9.0]))
    assert data["impedance"].attrs == {"long_name": impedance.title, "units": "Pa s/m"}
    again = gp.load_sweep(tmp_path / "sweep.nc")["impedance"]
    assert (again.dims, again.attrs["units"]) == (("load", "medium"), "Pa s/m")
    with (tmp_path / "sweep.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["impedance (Pa s/m)"]) for row in rows] == expected([2.0, 9.0]).tolist()
    ax = plot_sweep(data, Figure().subplots(), "impedance")
    assert ax.get_ylabel() == "Impedance (Pa s/m)"


def test_an_entry_is_all_that_a_summary_and_the_command_line_need(impedance, tmp_path):
    found = Scene(PACKING, Load("force", (9.0,)), media=("ema",)).run(
        tmp_path / "out", figures=False
    )
    assert found.summary()["impedance"] == expected(9.0)
    written = yaml.safe_load((tmp_path / "out" / "summary.yaml").read_text(encoding="utf-8"))
    assert (written["impedance"], written["units"]["impedance"]) == (expected(9.0), "Pa s/m")
    assert dict(describe_result(found))["impedance"] == f"{expected(9.0) / 1e6:.5g} MPa s/m"


def test_what_costs_more_than_was_asked_for_is_left_out(impedance, tmp_path):
    equal = gp.Packing(STEEL, 8e-3)
    bands = Scene(equal, Load("force", (9.0,)), observe=("bands",)).run(tmp_path, figures=False)
    assert "impedance" not in bands.summary()


def test_what_a_state_does_not_have_is_left_out():
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="square")).at_force(
        5.0, finite_overlap=True
    )
    found = find_all(Analysis(state), ("state", "velocities", "exponent"))
    assert not {
        "shear",
        "longitudinal_error",
        "exponent",
        "contact_force_fluctuation",
        "force_error",
    } & set(found)
    assert {"force", "pressure", "regime", "longitudinal", "direction", "bulk", "tensor"} <= set(
        found
    )
    assert "direction" not in find_all(Analysis(state), ("velocities",), swept=True)


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_entry_has_a_title_and_numbers_have_a_unit(name):
    one = CATALOGUE[name]
    assert one.name == name
    assert one.title
    assert one.unit or name in (
        "regime",
        "choice",
        "truth",
        "friction",
        "spread",
        "lattice",
        "motions",
    )


def test_an_axis_says_what_and_in_which_unit():
    assert axis_label("longitudinal") == "Longitudinal velocity (m/s)"
    assert axis_label("reduced_force") == "Force f*"
    # of a file that says so
    assert axis_label("longitudinal", "km/s") == "Longitudinal velocity (km/s)"
    assert axis_label("of_another_program", "K") == "Of another program (K)"


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (1j * np.ones(2), "complex"),
        (["1", "2"], "'1'"),
        (np.ma.array([1.0, 2.0], mask=[False, True]), "masked"),
        (np.array([1, 2], "m8[s]"), "array"),
    ],
)
def test_what_is_no_real_number_is_left_out_with_its_reason(value, why):
    """NumPy would drop the imaginary part and the mask, and read texts and times as numbers."""
    analysis = Analysis(gp.AveragedLattice(PACKING).at_force([1.0, 2.0]))
    try:
        gp.observables.register("twisted", "1", "a number", lambda _: value)
        found = find_all(analysis, ["state"])
    finally:
        CATALOGUE.remove("twisted")
    assert "twisted" not in found
    assert why in analysis.failed["twisted"]


@pytest.mark.parametrize("value", [[True, False], np.array([True, False])])
def test_truth_values_are_one_and_zero(value):
    analysis = Analysis(gp.AveragedLattice(PACKING).at_force([1.0, 2.0]))
    try:
        gp.observables.register("holds", "1", "whether it holds", lambda _: value)
        assert find_all(analysis, ["state"])["holds"].tolist() == [1.0, 0.0]
    finally:
        CATALOGUE.remove("holds")
