"""What a notebook shows: short tables of results, scenes, lattices and packings, and the default
picture.
"""

import importlib
import math
import pkgutil
from dataclasses import fields
from functools import cache
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from xarray import Dataset

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import InputError
from granphon.base.results import Result, describe_value, write_html
from granphon.waves.path_spectra import find_path_spectra
from tests.conftest import only
from tests.test_structure import loaded_after

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {lattice: triangular, diameter: 8 mm, spread: {uniform: 2 um}}
load: {force: 18.446 N}
observe: [velocities, bands, dos]
phonopy: {band_points: 5, mesh: 4 4 1}
"""
#: what must not become a part of the page
HOSTILE = "<script>alert('x')</script> & \"q\" \x00\x1b"


def read(html: str) -> dict[str, tuple[str, str]]:
    """The value and the unit of each row of a table, which is well-formed."""
    table = ElementTree.fromstring(html)
    assert {one.tag for one in table.iter()} <= {
        "table",
        "caption",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
    }
    assert [one.text for one in table.iter("th")][:3] == ["name", "value", "unit"]
    found = {}
    for row in table.find("tbody"):
        name, value, unit = (cell.text or "" for cell in row)
        found[name] = (value, unit)
    return found


def panels(figure):
    return [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]


# -- tables ----------------------------------------------------------------------------------------


def result_classes() -> list[type[Result]]:
    """Every class of results in the package."""
    package = importlib.import_module("granphon")
    for module in pkgutil.walk_packages(package.__path__, "granphon."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    found = []
    more = [Result]
    while more:
        more = [one for kind in more for one in kind.__subclasses__()]
        # what is no dataclass of its own is the base of some
        found += [
            one
            for one in more
            if one.__module__.startswith("granphon.") and "__dataclass_fields__" in vars(one)
        ]
    return list(dict.fromkeys(found))


VALUES = [
    HOSTILE,
    np.linspace(0.0, 1.0, 30).reshape(2, 3, 5),
    np.array([1.0, np.nan, math.inf] * 4),
    np.full(9, 2.0 + 1.0j),
    np.zeros((0, 3)),
    np.array([True, False] * 5),
    (HOSTILE,) * 9,
    {"<b>": HOSTILE},
    math.nan,
    True,
    3,
    None,
    np.array([HOSTILE]),
    STEEL,
    object(),
    1 + 2j,
]


def test_the_table_of_every_class_of_results_is_well_formed(monkeypatch):
    """Whatever the fields hold, so that the classes need not be computed."""
    kinds = result_classes()
    assert {
        gp.Bands,
        gp.ContactState,
        gp.SimulatedState,
        gp.Pulse,
        gp.SpectralFunction,
        gp.ContactNetwork,
    } <= set(kinds)
    packing = gp.Packing(STEEL, 8e-3)
    crystal = gp.Crystal.on("chain", [gp.Ball(STEEL, 8e-3)])
    for kind in kinds:
        names = [field.name for field in fields(kind)]
        # properties are those of true results, see below
        monkeypatch.setattr(kind, "_notebook_fields", ())
        for shift in range(0, len(VALUES), 3):
            made: Any = object.__new__(kind)
            given = {name: VALUES[(n + shift) % len(VALUES)] for n, name in enumerate(names)}
            # by these some classes find their units
            needed = {
                "packing": packing,
                "tensor": np.eye(3),
                "normal_stiffness": np.zeros((2, 3, 3, 4)),
                "parameters": ("damping" if "loss_factor" in names else "width",),
            }
            needed["quantity"] = "velocity"
            needed["crystal"] = crystal
            needed["measured"] = SimpleNamespace(calibrated=True)
            for name, value in (
                given | {name: value for name, value in needed.items() if name in names}
            ).items():
                object.__setattr__(made, name, value)
            html = made._repr_html_()
            assert "<script" not in html
            found = read(html)
            units = made._field_units()
            assert set(found) <= set(names)
            for name, (_, unit) in found.items():
                assert unit == ("" if units.get(name) == "1" else units.get(name, "")), (kind, name)


def test_tables_of_results_have_values_and_units(state):
    found = read(state._repr_html_())
    assert found["force"] == (f"{state.force:.6g}", "N")
    assert found["shear_stiffness"] == (f"{state.shear_stiffness:.6g}", "N/m")
    assert found["pressure"] == (f"{state.pressure:.6g}", "N/m")
    moduli = gp.moduli(state)
    assert read(moduli._repr_html_())["bulk"] == (f"{moduli.bulk:.6g}", "Pa")
    velocities = gp.sound_velocities(state)
    assert read(velocities._repr_html_())["longitudinal"] == (
        f"{velocities.longitudinal:.6g}",
        "m/s",
    )
    assert read(gp.validity(state)._repr_html_())["ok"] == ("yes", "")
    frequencies = gp.ContactLattice.of("triangular", 0.8).modes([[0.3, 0.4]] * 7).frequencies
    many = gp.AveragedLattice(state.packing).at_force(np.arange(1.0, 31.0))
    assert read(many._repr_html_())["force"] == ("array 30, 1 to 30", "N")
    assert (
        describe_value(frequencies)
        == f"array 7 x 3, {frequencies.min():.6g} to {frequencies.max():.6g}"
    )


def test_a_table_leaves_out_what_a_result_does_not_have():
    """The stress of this lattice is no pressure."""
    chained = gp.Lattice("chained", ((1.0, 0.0), (0.3, math.sqrt(0.91))))
    for lattice, there in (("chain", True), (chained, False)):
        found = read(
            gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=lattice)).at_force(1.0)._repr_html_()
        )
        assert "force" in found
        assert ("pressure" in found) == there


@pytest.mark.parametrize("name", LATTICES)
def test_tables_of_lattices_and_packings(name):
    lattice = LATTICES[name]
    found = read(lattice._repr_html_())
    assert found["name"] == (name, "")
    assert found["balls in the cell"] == (str(lattice.n_balls), "")
    assert found["contacts of a ball"] == (f"{lattice.coordination:.6g}", "")
    packing = gp.Packing(STEEL, 8e-3, lattice=name, spread=gp.Uniform(2e-6))
    found = read(packing._repr_html_())
    assert found["diameter"] == ("0.008", "m")
    assert found["width of the spread"] == ("2e-06", "m")
    assert found["Young modulus"] == ("2.1165e+11", "Pa")
    assert found["motions"][0] == packing.named_motions.name.replace("_", " ")


def test_the_name_of_a_lattice_is_escaped():
    printable = HOSTILE.rstrip(" \x00\x1b")  # others are no name
    html = gp.Lattice(printable, ((1.0, 0.0), (0.0, 1.0)))._repr_html_()
    assert "<script" not in html
    assert read(html)["name"][0] == printable


def test_the_table_of_a_scene_computes_no_state():
    scene = gp.Scene.from_text(SCENE)
    found = read(scene._repr_html_())
    assert found["force"] == ("18.446", "N")
    assert found["medium"] == ("effective medium", "")
    assert found["path"] == ("G K M G", "")
    assert found["mesh"] == ("4 x 4", "")
    text = SCENE.replace("18.446 N", "[1 N, 2 N]").replace("bands, dos", "bands")
    swept = gp.Scene.from_text(text + "sweep: {width: [1 um, 2 um]}\n")
    assert read(swept._repr_html_())["sweep of width"] == ("1e-06, 2e-06", "m")
    # what would take hours
    loading = (
        "{simulation: {shape: 2000 2000, friction_history: true, friction_coefficient: 0.2,"
        " start: {force: 0.5 N}}}"
    )
    loaded = gp.Scene.from_text(
        SCENE.replace("observe: [velocities, bands, dos]", f"medium: {loading}")
    )
    told = read(loaded._repr_html_())["medium"][0]
    assert told.startswith("simulation, a sample of 2000 x 2000 balls")
    assert told.endswith("from force 500 mN")
    assert "=" not in told


def test_the_table_of_a_run_is_its_summary(tmp_path):
    scene = gp.Scene.from_text(SCENE)
    result = scene.run(tmp_path / "one", figures=False)
    found = read(result._repr_html_())
    summary = result.summary()
    assert list(found) == list(summary)
    assert found["longitudinal"] == (f"{summary['longitudinal']:.6g}", "m/s")
    assert found["top_frequency"][1] == "Hz"
    assert len(panels(gp.plot(result))) == 2  # bands, and the density of states beside them


def test_the_table_of_a_sweep_is_its_summary(tmp_path):
    swept = gp.Scene.from_text(SCENE.replace("18.446 N", "[1 N, 2 N]").replace(", bands, dos", ""))
    result = swept.run(tmp_path / "many", figures=False)
    assert read(result._repr_html_())["states"] == ("2", "")
    assert gp.plot(result).axes


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (1.23456789, "1.23457"),
        (7, "7"),
        (np.int64(7), "7"),
        ((np.int64(7), np.True_), "7, yes"),
        (np.complex128(1.0 + 2.0j), "(1+2j)"),
        (True, "yes"),
        (None, "none"),
        ("word", "word"),
        ("a" * 200, "a" * 156 + " ..."),
        (np.array([1.0, 2.5]), "1, 2.5"),
        (np.zeros((2, 3)), "array 2 x 3, all 0"),
        (np.zeros((0, 3)), "array 0 x 3"),
        (np.array([[1.0, np.nan]]), "array 1 x 2, all 1, 1 not finite"),
        (np.full(3, np.nan), "nan, nan, nan"),
        (np.full(9, np.inf), "array 9, 9 not finite"),
        (np.array([3j, 4.0]), "array 2, magnitudes 3 to 4"),
        (np.array([True] * 8 + [False]), "array 9, 8 of them true"),
        (np.array([[-4.8e-8, 2.97e9]]), "array 1 x 2, 0 to 2.97e+09"),
        (np.array([[-2.0, 1e-16]]), "array 1 x 2, -2 to 0"),
        (np.array([[1e-300, 2e-290]]), "array 1 x 2, 1e-300 to 2e-290"),
        ((), "none"),
        (("a", "b"), "a, b"),
        (tuple("abcdefgh"), "a, b, c, d, e, f, ... (8 in all)"),
        (tuple(range(9)), "array 9, 0 to 8"),
        ((STEEL, STEEL), "2 of Material"),
        ((STEEL, gp.Hertz()), "Material, Hertz"),
        (((1.0, 0.0), (0.0, 1.0)), "1, 0; 0, 1"),
        ({"alpha": 0.5}, "alpha: 0.5"),
        ({}, "none"),
        (
            dict.fromkeys("abcdefgh", 1),
            "a: 1, b: 1, c: 1, d: 1, e: 1, f: 1, ... (8 in all)",
        ),
    ],
)
def test_values_in_words(value, said):
    assert describe_value(value) == said


def test_a_table_of_nothing_is_a_table():
    assert read(write_html(HOSTILE, [])) == {}


def test_a_table_loads_neither_pandas_nor_matplotlib():
    code = (
        "import granphon as gp\n"
        "state = gp.AveragedLattice(gp.Packing(gp.Material(70e9, 0.22, 2500.0),"
        " 1e-3)).at_force(1.0)\n"
        "for one in (state, state.packing, state.packing.structure, gp.moduli(state),"
        " gp.sound_velocities(state)):\n"
        "    one._repr_html_()"
    )
    assert not {"pandas", "matplotlib", "xarray", "phonopy", "IPython"} & loaded_after(code)


# -- the default picture ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated():
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    return gp.DirectSimulation(packing, shape=(12, 12)).at_force(50.0)


def send_pulse(state):
    top = gp.Phonons(state).bands("GKMG", npoints=5).frequencies.max()
    return gp.Waves(state.sample).transmit(0.2 * float(top), (1, 0), 3 * state.packing.diameter, 2)


def find_path(state):
    return find_path_spectra(
        gp.Waves(state.sample),
        gp.ContactLattice.of("triangular", state.packing.mindlin_ratio),
        state.scales,
        [np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])],
        ["G", "M"],
        points=7,
        polarisations=["longitudinal"],
    )


def find_spectral_function(state):
    waves = gp.Waves(state.sample)
    return waves.spectral_function(waves.nearest_wavevectors([[80.0, 0.0], [160.0, 0.0]]))


#: results of a simulated state that have a default picture, and the number of its panels
PICTURES = {
    "bands": (lambda state: gp.Phonons(state).bands("GKMG", npoints=5), 1),
    "density of states": (lambda state: gp.Phonons(state).dos((4, 4), points=30), 1),
    "sweep": (lambda state: gp.sweep(state.packing, force=[1.0, 10.0], media=["afa"]), 2),
    "fit": (
        lambda state: gp.fit_width(
            state.packing, [2.0, 5.0, 9.0, 18.0], [465.0, 603.0, 681.0, 774.0], medium="afa"
        ),
        2,
    ),
    "spectra along a path": (find_path, 1),
    "spectral function": (find_spectral_function, 1),
    "density of states of a sample": (lambda state: gp.Waves(state.sample).dos(), 1),
    "pulse": (send_pulse, 2),
    "simulated state": (lambda state: state, 2),
}


@pytest.fixture(scope="module")
def results(simulated):
    """Finds each of these results once."""
    return cache(lambda name: PICTURES[name][0](simulated))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "pulse")) for name in PICTURES]
)
def test_a_result_has_a_default_picture(results, name):
    figure = gp.plot(results(name))
    drawn = panels(figure)
    assert len(drawn) == PICTURES[name][1]
    assert all(ax.lines or ax.collections or ax.patches or ax.images for ax in drawn)


@pytest.mark.parametrize("name", only(["density of states"], PICTURES))
def test_a_picture_is_shown_as_a_png(results, name):
    figure = gp.plot(results(name))
    png, size = figure._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert size["width"] == round(120 * figure.get_size_inches()[0])


def test_the_table_of_a_fit_has_the_width_and_its_error(results):
    fit = results("fit")
    found = read(fit._repr_html_())
    assert found["width"] == (f"{fit.width:.6g}", "m")
    assert found["stderr"] == (f"{fit.stderr:.6g}", "m")


def test_a_picture_takes_the_options_of_its_function(results):
    bands = results("bands")
    assert gp.plot(bands, title="steel").get_suptitle() == "steel"
    dataset = results("sweep")
    assert gp.plot(dataset, variable="bulk").axes[0].get_ylabel().startswith("Bulk")
    with pytest.raises(InputError, match=r"colour, size.*asymptotes"):
        gp.plot(bands, colour="red", size=3)


def test_a_spectral_function_is_drawn_at_its_wave_vectors(results):
    spectrum = results("spectral function")
    (ax,) = gp.plot(spectrum).axes
    lines = ax.get_lines()
    assert len(lines) == len(spectrum.q) == 2
    for line, values in zip(lines, spectrum.values, strict=True):
        # 1/Hz over Hz: the area is one whatever the decimal unit
        x, y = (np.asarray(part) for part in line.get_data())
        assert np.trapezoid(y, x) == pytest.approx(np.trapezoid(values, spectrum.frequencies))
    assert ax.get_xlim()[1] >= x[np.argmax(y)]


def test_what_has_no_picture_is_one_clear_error():
    for wrong in (
        3,
        None,
        "bands",
        STEEL,
        SimpleNamespace(dataset=None),
        1.0,
        Dataset({"x": ("n", [1.0, 2.0])}),
    ):
        with pytest.raises(
            InputError,
            match=r"picture.*sweep",
        ):
            gp.plot(wrong)
    with pytest.raises(InputError, match=r"1\.0 .*sweeps"):
        gp.plot([1.0])


def test_asking_for_a_picture_loads_matplotlib_and_no_pyplot():
    code = (
        "import sys\nimport granphon as gp\ngp.plot\nassert 'matplotlib' not in sys.modules\n"
        "ball = gp.Ball(gp.Material(70e9, 0.22, 2500.0), 1e-3)\n"
        "gp.plot(gp.Crystal.on('chain', [ball]).at_force(1.0))._repr_png_()"
    )
    assert "matplotlib.pyplot" not in loaded_after(code)
