"""What a data set of a sweep does by itself, and its units in pint-xarray."""

from __future__ import annotations

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))


@pytest.fixture(scope="module")
def swept():
    return gp.sweep(PACKING, force=np.geomspace(1.0, 100.0, 41), media=("ala", "ema"))


def test_exponents_are_those_of_the_law(swept):
    found = swept.granphon.exponent()
    assert (found.dims, found.attrs["units"], found.name) == (
        ("load", "medium"),
        "1",
        "longitudinal_exponent",
    )
    # a power law, to rounding
    np.testing.assert_allclose(found.sel(medium="ala"), 1.0 / 6.0, rtol=1e-12)
    exact = swept["exponent"].sel(medium="ema")
    # at a kink of its law
    np.testing.assert_allclose(found.sel(medium="ema")[1:-1], exact[1:-1], atol=5e-3)
    # the second order: half the points, four times the error
    errors = []
    for step in (1, 2):
        data = swept.isel(load=slice(0, None, step))
        data["wave"] = np.exp(np.sin(np.log(data["force"])))
        errors.append(
            float(
                np.abs(data.granphon.exponent("wave") - np.cos(np.log(data["force"])))[2:-2].max()
            )
        )
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.1)
    over = swept.granphon.exponent("normal_stiffness", over="overlap")
    np.testing.assert_allclose(over.sel(medium="ala"), 0.5, rtol=1e-10)


def test_exponents_over_a_variable_of_fewer_dimensions():
    """Pressures have no direction, and velocities have: each direction has the exponent 1/6."""
    data = gp.sweep(PACKING, force=[1.0, 3.0, 10.0, 40.0], direction=[(1, 0), (0, 1)])
    exponents = data.granphon.exponent(over="pressure")
    assert exponents.dims == ("load", "medium", "direction")
    np.testing.assert_allclose(exponents, 1.0 / 6.0, rtol=1e-12)
    with pytest.raises(InputError, match="medium"):
        data.granphon.exponent("force", over="pressure")


def test_exponents_of_what_is_infinite_are_nan():
    """Reduced forces of equal balls are. One infinite value, at the end, makes two exponents nan."""
    data = gp.sweep(gp.Packing(STEEL, 8e-3), force=[1.0, 2.0, 3.0, 5.0, 8.0, 9.0])
    assert np.all(np.isnan(data.granphon.exponent("reduced_force")))
    values = data["longitudinal"].values.copy()
    values[-1] = np.inf
    data["longitudinal"] = data["longitudinal"].dims, values
    exponents = data.granphon.exponent().values[:, 0]
    assert np.isnan(exponents).tolist() == [False] * 4 + [True] * 2
    np.testing.assert_allclose(exponents[:4], 1.0 / 6.0, rtol=1e-12)


def test_exponents_amid_equal_steps_need_their_own_value():
    """The slope of a parabola amid equal steps does not depend on the value in the middle."""
    data = gp.sweep(gp.Packing(STEEL, 8e-3), force=[1.0, 10.0, 100.0])
    values = data["longitudinal"].values.copy()
    values[1] = np.nan
    data["longitudinal"] = data["longitudinal"].dims, values
    assert np.all(np.isnan(data.granphon.exponent()))


def test_it_draws_fits_and_knows_its_packing(swept, tmp_path):
    assert swept.granphon.packing == PACKING
    assert swept.granphon.plot(variable="bulk").axes[0].get_ylabel() == "Bulk modulus (GPa)"
    force = swept["force"].values[::4]
    velocity = swept["longitudinal"].sel(medium="ema").values[::4]
    assert swept.granphon.fit(force, velocity).width == pytest.approx(2e-6, rel=1e-6)
    gp.sweep(PACKING, force=[1.0, 2.0, 3.0], media=("ala",), path=tmp_path / "sweep.nc")
    assert gp.load_sweep(tmp_path / "sweep.nc").granphon.exponent().shape == (3, 1)


def test_what_has_no_exponent(swept):
    for call, told in (
        (
            lambda: swept.granphon.exponent("longitudnal"),
            "no numbers 'longitudnal' over loads. Did you mean longitudinal",
        ),
        (lambda: swept.granphon.exponent("regime"), "no numbers 'regime'"),
        (lambda: swept.granphon.exponent(over="medium"), "no numbers 'medium'"),
        (lambda: swept.granphon.exponent(over=3), "no numbers 3"),
        (lambda: swept.isel(load=[0, 1]).granphon.exponent(), "three loads"),
        (lambda: swept.isel(load=slice(None, None, -1)).granphon.exponent(), "Loads must ascend"),
        (lambda: swept.isel(load=0).granphon.exponent(), r"gp\.sweep"),
        (lambda: swept.isel(load=0).granphon.plot(), "no dimension 'load'"),
        (lambda: swept.mean("load").granphon.plot(), "no dimension 'load'"),
        (lambda: swept.isel(medium=0).granphon.plot(), "no dimension 'medium'"),
        (lambda: swept.drop_attrs().granphon.packing, "holds no packing"),
        (lambda: swept.assign_attrs(packing="[" * 9999).granphon.packing, "holds no packing"),
    ):
        with pytest.raises(InputError, match=told):
            call()


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_pint_xarray_knows_the_units(swept):
    pytest.importorskip("pint_xarray")
    found = swept.drop_vars(["regime", "valid"]).pint.quantify()
    assert str(found["longitudinal"].pint.units) == "meter / second"
    unit = {name: found[name].pint.to("kg/m/s^2") for name in ("bulk", "shear")}
    np.testing.assert_allclose(unit["bulk"].pint.magnitude, swept["bulk"])
    speed = (found["bulk"] / found["effective_density"]) ** 0.5 / found["longitudinal"]
    assert speed.pint.to("1").pint.magnitude.shape == swept["bulk"].shape
    assert {name for name in found.data_vars if found[name].pint.units is None} == set()


@pytest.mark.filterwarnings("ignore")
def test_what_is_not_in_si_is_refused(swept):
    pint = pytest.importorskip("pint")
    pytest.importorskip("pint_xarray")
    unit = pint.UnitRegistry()
    chain = gp.Crystal.on("chain", [gp.Ball(STEEL, 8e-3)])
    for medium in (chain, gp.AveragedLattice(gp.Packing(STEEL, 8e-3))):
        for force in (
            0.02 * unit.kN,
            np.array([0.02]) * unit.kN,
            swept["force"].assign_attrs(units="kN"),
        ):
            with pytest.raises(
                InputError,
                match=r"(kilonewton|kN).*SI",
            ):
                medium.at_force(force)
        medium.at_force(20.0 * unit.N)
        medium.at_force(swept["force"])
    slow = swept.assign(longitudinal=swept.pint.quantify()["longitudinal"].pint.to("km/s"))
    for data in (slow, slow.pint.dequantify()):
        with pytest.raises(InputError, match=r"longitudinal .*kilometer .*\.pint\.to"):
            data.granphon.plot()
    with pytest.raises(InputError, match=r"velocity: .*kilometer .*m/s"):
        swept.granphon.fit(swept["force"], slow["longitudinal"].sel(medium="ema"))
    with pytest.raises(InputError, match=r"force: .* m; .* N"):
        swept.granphon.fit(
            swept["overlap"].sel(medium="ema"), swept["longitudinal"].sel(medium="ema")
        )
