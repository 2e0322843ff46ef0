"""Scenes that observe what velocities, moduli and cut-off frequencies depend on."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.cli.main import main
from granphon.figures.sensitivities import sensitivities_figure
from granphon.scene.report import read_report

SCENE = """\
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8000 kg/m^3}, diameter: 19 mm}
  A: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: 2700 kg/m^3}, diameter: 19 mm}
crystal: {lattice: chain, kinds: [A, S], friction: false}
load: {force: 8 N}
observe: [sensitivities, cutoffs]
sweep: {A.density: [2000 kg/m^3, 4000 kg/m^3]}
"""
PACKING = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 18 N}
observe: [sensitivities]
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sensitivities") / "out"
    return gp.Scene.from_text(SCENE).run(folder)


@pytest.mark.claim("sensitivities-scene")
def test_a_chain_of_two_masses_has_the_powers_of_its_closed_forms(result):
    """The top of the acoustic branch goes as (k/M)^1/2 of the larger mass, k as (E*^2 f)^(1/3)."""
    found = result.dataset["sensitivity"].sel(medium="crystal")
    top = found.sel(sensitivity_of="cutoff_upper 0")
    assert_allclose(top.sel(sensitivity_to="S.density"), -0.5, atol=1e-8)
    assert_allclose(top.sel(sensitivity_to="A.density"), 0.0, atol=1e-8)
    assert_allclose(top.sel(sensitivity_to="force"), 1.0 / 6.0, rtol=1e-8)
    moduli = top.sel(sensitivity_to=["S.young_modulus", "A.young_modulus"]).sum("sensitivity_to")
    assert_allclose(moduli, 1.0 / 3.0, rtol=1e-8)
    bulk = found.sel(sensitivity_of="bulk", sensitivity_to="force")
    assert_allclose(bulk, 1.0 / 3.0, rtol=1e-8)
    # what vanishes everywhere is not there
    assert "cutoff_lower 0" not in found["sensitivity_of"]
    assert "transverse" not in found["sensitivity_of"]


def test_the_table_has_a_row_for_each_quantity_and_parameter(result):
    path = result.folder / "sensitivities.csv"
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    data = result.dataset["sensitivity"]
    assert len(rows) == data.size
    row = next(row for row in rows if row["sensitivity_to"] == "A.density")
    assert float(row["sensitivity (1)"]) < 0.0
    assert (result.folder / "sensitivities.png").is_file()


def test_one_state_says_which_parameter_matters_most(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(PACKING, encoding="utf-8")
    assert main(["run", str(scene), "-o", str(tmp_path / "out"), "--no-figures"]) == 0
    printed = capsys.readouterr().out
    assert "matters most" in printed
    _, sections = read_report(tmp_path / "out")
    rows = {
        row[0]: row[1] for section in sections for row in getattr(section.blocks[0], "rows", ())
    }
    assert "longitudinal density" in rows["matters most"]
    again = gp.Scene.from_yaml(scene).run(tmp_path / "out", resume=True, figures=False)
    assert again.summary()["matters_most"]["longitudinal"] == "density"
    assert_allclose(
        again.dataset["sensitivity"].sel(sensitivity_to="young_modulus").values.ravel(),
        [1.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0],
        rtol=1e-8,
    )


def test_each_quantity_has_a_panel_with_a_bar_for_each_parameter(result):
    figure = sensitivities_figure(result.dataset)
    data = result.dataset
    panels = [ax for ax in figure.axes if ax.axison]
    assert len(panels) == data.sizes["sensitivity_of"]
    assert all(len(ax.patches) == data.sizes["sensitivity_to"] for ax in panels)
    with pytest.raises(InputError, match="derivatives"):
        sensitivities_figure(data.drop_vars("sensitivity"))


def test_of_many_quantities_those_of_the_lowest_branches_are_drawn(result):
    """Beside velocities and moduli; what is left out is told, with its number."""
    data = result.dataset
    count = data.sizes["sensitivity_of"]
    n_branches = 10
    branches = [f"cutoff_{end} {n}" for end in ("lower", "upper") for n in range(1, n_branches)]
    known = [name for name in data["sensitivity_of"].values if " " not in name]
    row = data["sensitivity"].isel(sensitivity_of=[0] * (len(known) + len(branches)))
    many = data.drop_dims("sensitivity_of").assign(sensitivity=row.drop_vars("sensitivity_of"))
    many = many.assign_coords(sensitivity_of=[*known, *branches])
    told = []
    figure = sensitivities_figure(many, told.append)
    titles = [" ".join(ax.get_title().split()) for ax in figure.axes if ax.axison]
    assert len(titles) == 12
    assert sum("branch" not in title for title in titles) == len(known)
    numbers = [int(title.split()[-1]) for title in titles if "branch" in title]
    assert numbers == [1 + n // 2 for n in range(12 - len(known))]
    (sentence,) = told
    assert f"{len(known) + len(branches) - 12} quantities" in sentence
    assert sensitivities_figure(data, told.append)
    assert len(told) == (2 if count > 12 else 1)


def test_the_report_says_what_matters_most(tmp_path):
    folder = tmp_path / "out"
    gp.Scene.from_text(PACKING).run(folder)
    sections = {section.title: section.blocks for section in read_report(folder)[1]}
    rows = dict(sections["Numbers"][0].rows)
    assert "longitudinal density" in rows["matters most"]
    assert "sensitivities.png" in [picture.name for picture in sections["Figures"]]


ROW = """\
balls:
  S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8 g/cm^3}, diameter: 19 mm}
  A: {material: {young_modulus: MODULUS, poisson_ratio: RATIO, density: 8 g/cm^3}, diameter: 19 mm}
crystal: {lattice: triangular, kinds: [S], friction: false, cut: {axis: 1, layers: 1, edges: EDGES}}
load: {pressure: 2 kN/m}
observe: [sensitivities, cutoffs]
"""
WALLS = "[{wall: A}, {wall: {young_modulus: 70 GPa, poisson_ratio: 0.2, density: 2 g/cm^3}}]"


def test_balls_that_are_held_have_no_velocities_to_differentiate():
    held = ROW.replace("EDGES", "floor").replace("MODULUS", "70 GPa").replace("RATIO", "0.3")
    with pytest.raises(InputError, match="'sensitivities' of balls that are held"):
        gp.Scene.from_text(held.replace(", cutoffs", ""))
    data = gp.Scene.from_text(held).sweep()
    assert all("cutoff" in name for name in data["sensitivity_of"].values)
    assert "velocities and moduli are left out" in data.attrs["warnings"]


@pytest.mark.parametrize(
    ("sweep", "is_even"),
    [
        ("{friction: [true, false]}", False),
        ("{lattice: [triangular, honeycomb]}", False),
        ("{lattice: [triangular, square]}", True),
        ("{motions: [in_plane], friction: [true]}", True),
    ],
)
def test_derivatives_of_cutoffs_are_those_of_as_many_branches_in_all_states(sweep, is_even):
    text = PACKING.replace("[sensitivities]", "[sensitivities, cutoffs]") + f"sweep: {sweep}\n"
    if is_even:
        assert gp.Scene.from_text(text).n_states
    else:
        with pytest.raises(InputError, match=r"observe: .*differ in the number of branches"):
            gp.Scene.from_text(text)


def sweep_between_walls(modulus=600.0, ratio=0.3, of_own=70.0, observe="cutoffs"):
    walls = WALLS.replace("70 GPa", f"{of_own!r} GPa")
    text = ROW.replace("EDGES", walls).replace("sensitivities, cutoffs", observe)
    return sweep(text.replace("MODULUS", f"{modulus!r} GPa").replace("RATIO", repr(ratio)))


@pytest.fixture(scope="module")
def table_between_walls():
    data = sweep_between_walls(observe="sensitivities, cutoffs")
    return data["sensitivity"].sel(medium="crystal").squeeze("load")


def test_walls_have_the_names_of_their_kinds_or_their_own(table_between_walls):
    """A kind without balls has the elastic constants of its wall; one of its own has its name."""
    names = ["A.young_modulus", "A.poisson_ratio", "wall_2.young_modulus", "wall_2.poisson_ratio"]
    found = table_between_walls["sensitivity_to"].values
    assert [name for name in found if name[0] in "Aw"] == names


@pytest.mark.claim("sensitivities-walls")
@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("A.young_modulus", "modulus", 600.0),
        ("A.poisson_ratio", "ratio", 0.3),
        ("wall_2.young_modulus", "of_own", 70.0),
    ],
)
def test_walls_at_rest_have_the_derivatives_of_whole_scenes(table_between_walls, name, key, value):
    ends = [end for end in table_between_walls["sensitivity_of"].values if "upper" in end]
    found = table_between_walls.sel(sensitivity_to=name, sensitivity_of=ends)
    step = 1e-4
    lower, upper = (
        np.log(sweep_between_walls(**{key: value * (1.0 + sign * step)})["cutoff_upper"].values)
        for sign in (-1.0, 1.0)
    )
    assert_allclose(found, (upper - lower).ravel() / (2.0 * step), rtol=1e-6)


@pytest.mark.parametrize(
    ("friction", "power"),
    [("true", 0.5), ("false", None)],
)
def test_the_ratio_of_stiffnesses_is_a_parameter_where_there_is_friction(friction, power):
    """A transverse wave of the square lattice shears contacts alone; without them, a mechanism."""
    square = PACKING.replace("8 mm", f"8 mm, lattice: square, friction: {friction}")
    data = gp.Scene.from_text(square.replace("[sens", "[cutoffs, sens")).sweep()
    names = data["sensitivity_to"].values.tolist()
    if power is None:
        assert "mindlin_ratio" not in names
        assert "longitudinal" not in data["sensitivity_of"]
        assert_allclose(data["sensitivity"].sel(sensitivity_to="force"), 1.0 / 6.0, rtol=1e-8)
        assert data.attrs["warnings"].count("left out") == 1
        return
    found = data["sensitivity"].sel(sensitivity_to="mindlin_ratio").squeeze()
    assert_allclose(found.sel(sensitivity_of="transverse"), power, rtol=1e-8)
    assert_allclose(found.sel(sensitivity_of="longitudinal"), 0.0, atol=1e-8)


def test_samples_are_averaged_as_their_states():
    text = PACKING.replace("diameter: 8 mm", "diameter: 8 mm, spread: {uniform: 2 um}")
    text += "medium: {simulation: {shape: 3 3, samples: 2, geometry: lattice}}\n"
    data = gp.Scene.from_text(text).sweep()
    found = data["sensitivity"].sel(sensitivity_of="longitudinal").squeeze()
    assert_allclose(found.sel(sensitivity_to="density"), -0.5, rtol=1e-8)
    # velocities at a given f* go as the root of c W^(1/2)/d^2
    by_modulus = float(found.sel(sensitivity_to="young_modulus"))
    by_force = float(found.sel(sensitivity_to="force"))
    assert np.isclose(by_modulus + by_force, 0.5, rtol=1e-8)


def test_derivatives_of_arrays_are_in_the_cost():
    """Each parameter takes responses at four steps, beside the equilibrium of the state."""
    spread = PACKING.replace("diameter: 8 mm", "diameter: 8 mm, spread: {uniform: 2 um}")
    text = spread + "medium: {simulation: {shape: 64 64}}\n"
    _, _, states = gp.Scene.from_text(text).plan.parts[0]
    _, _, derivatives = gp.Scene.from_text(text).plan.parts[1]
    assert states.equilibria == 1
    assert derivatives.equilibria == 0
    assert "6 parameters" in derivatives.parts[0]
    assert derivatives.units[0].number == 4 * 6 * states.units[0].number
    uncertain = text.replace("211.65 GPa", "211.65 +- 2 GPa")
    costs = [gp.Scene.from_text(words).cost() for words in (text, uncertain)]
    assert costs[1].units[0].number == 3 * costs[0].units[0].number
    plain = gp.Scene.from_text(text.replace("sensitivities", "velocities")).plan.parts[1]
    assert not plain[2].units


def test_derivatives_of_crystals_are_in_the_cost():
    """Each parameter takes the velocities and moduli, and the ends of the branches, of four
    networks.
    """
    text = (
        "balls: {S: {material: {young_modulus: 193 GPa, poisson_ratio: 0.3, density: 8 g/cm^3},"
        " diameter: 19 mm}}\n"
        "crystal: {lattice: fcc, repeat: [16, 16, 16], friction: false}\n"
        "load: {force: [20 N, 30 N]}\n"
        "observe: [sensitivities]\n"
    )
    (*_, (place, _, cost)) = gp.Scene.from_text(text).plan.parts
    assert place == ("observe",)
    assert "5 parameters" in cost.parts[0]
    assert cost.units[0].number == 2 * (1 + 4 * 5)
    assert gp.Scene.from_text(text).cost().seconds > cost.units[0].number * 0.01
    # factors of 3 x 4096 motions, which no small crystal has
    assert 5e8 < cost.working < 4e9
    (*_, (_, _, of_few)) = gp.Scene.from_text(text.replace("16, 16, 16", "2, 2, 2")).plan.parts
    assert of_few.working < 1e-2 * cost.working
    ends = text.replace("[sensitivities]", "[sensitivities, cutoffs]")
    (*_, (_, _, with_ends)) = gp.Scene.from_text(ends).plan.parts
    n_branches = 3 * 16**3
    cubes = with_ends.units[-1].number
    assert np.isclose(cubes, cost.units[0].number * 2.0 * n_branches * n_branches**3)
    assert not gp.Scene.from_text(text.replace("sensitivities", "velocities")).cost()


def test_the_title_of_a_branch_keeps_its_number(result):
    titles = [ax.get_title() for ax in sensitivities_figure(result.dataset).axes]
    ends = [title for title in titles if "branch" in title]
    assert ends
    assert all(title.splitlines()[-1][:-1].endswith("branch\N{NO-BREAK SPACE}") for title in ends)


EDGE = """\
balls:
  A: {material: {young_modulus: 193 GPa, poisson_ratio: 0.30, density: 8 g/cm^3}, diameter: 19 mm}
  B: {material: {young_modulus: 73.5 GPa, poisson_ratio: 0.33, density: DENSITY}, diameter: 19 mm}
crystal: {lattice: chain, kinds: [A, B], friction: false}
load: {force: FORCE}
observe: [OBSERVE]
surface: {axis: 0, edge: {wall: B}}
"""


def sweep(text, **words):
    for name, word in words.items():
        text = text.replace(name, word)
    return gp.Scene.from_text(text).sweep()


def find_power(text, key, value, unit):
    """Return d ln f/d ln p of the waves of the edge, a central difference of whole scenes."""
    step = 1e-4
    fixed = {"FORCE": "8 N", "DENSITY": "2.7 g/cm^3", "OBSERVE": "surface"}
    ends = [
        sweep(text, **(fixed | {key: f"{value * (1.0 + sign * step)!r} {unit}"}))
        for sign in (-1.0, 1.0)
    ]
    lower, upper = (np.log(end["surface_frequency"].values) for end in ends)
    return (upper - lower) / np.log((1.0 + step) / (1.0 - step))


WALL = "{young_modulus: MODULUS, poisson_ratio: 0.3, density: 2 g/cm^3}"
#: an edge at a wall of a kind without balls, and at one of the same material without a kind
AT_KIND = EDGE.replace("wall: B", "wall: W").replace(
    "crystal:", f"  W: {{material: {WALL}, diameter: 1 mm}}\ncrystal:"
)
AT_MATERIAL = EDGE.replace("wall: B", f"wall: {WALL}")


def tabulate_edge(text):
    words = {"FORCE": "8 N", "DENSITY": "2.7 g/cm^3", "OBSERVE": "sensitivities, surface"}
    return sweep(text, MODULUS="600 GPa", **words)["sensitivity"].squeeze()


@pytest.fixture(scope="module")
def table_at_kind():
    return tabulate_edge(AT_KIND)


def make_edge_scene(observe):
    text = EDGE.replace("FORCE", "8 N").replace("DENSITY", "2.7 g/cm^3")
    return gp.Scene.from_text(text.replace("OBSERVE", observe))


@pytest.fixture(scope="module")
def edge_result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edge") / "out"
    return make_edge_scene("sensitivities, surface").run(folder, figures=False)


@pytest.mark.claim("sensitivities-edge-scenes")
def test_waves_at_a_wall_of_another_kind_have_the_derivatives_of_whole_scenes(table_at_kind):
    found = table_at_kind.sel(sensitivity_of="surface_frequency 0")
    powers = find_power(AT_KIND, "MODULUS", 600.0, "GPa").ravel()
    assert_allclose(found.sel(sensitivity_to="W.young_modulus"), powers, rtol=1e-6)
    moduli = [f"{owner}.young_modulus" for owner in "ABW"]
    total = found.sel(sensitivity_to=moduli).sum("sensitivity_to")
    assert_allclose(total, 1.0 / 3.0, rtol=1e-7)


@pytest.mark.slow
@pytest.mark.claim("sensitivities-edge-scenes")
def test_waves_at_a_wall_of_a_material_of_its_own_have_the_derivatives_of_one_of_a_kind(
    table_at_kind,
):
    of_material = tabulate_edge(AT_MATERIAL)
    for parameter in ("young_modulus", "poisson_ratio"):
        by_kind = table_at_kind.sel(sensitivity_to=f"W.{parameter}")
        by_own = of_material.sel(sensitivity_to=f"surface.wall.{parameter}")
        assert_allclose(by_own.values, by_kind.values, rtol=1e-7)
        assert not np.any(by_own.sel(sensitivity_of="longitudinal"))


@pytest.mark.claim("sensitivities-edge-scenes")
def test_waves_of_an_edge_have_the_derivatives_of_whole_scenes(edge_result):
    """The wall is of the material of a kind of balls, and changes with that material."""
    found = edge_result.dataset["sensitivity"].sel(
        sensitivity_of="surface_frequency 0", medium="crystal"
    )
    assert_allclose(found.sel(sensitivity_to="force"), 1.0 / 6.0, rtol=1e-8)
    stiffer = EDGE.replace("73.5 GPa", "MODULUS").replace("DENSITY", "2.7 g/cm^3")
    by_modulus = find_power(stiffer, "MODULUS", 73.5, "GPa").ravel()
    assert_allclose(found.sel(sensitivity_to="B.young_modulus"), by_modulus, rtol=1e-7)
    moduli = found.sel(sensitivity_to=["A.young_modulus", "B.young_modulus"])
    assert_allclose(moduli.sum("sensitivity_to"), 1.0 / 3.0, rtol=1e-8)
    # all is of the kinds: a density of both moves no contact
    densities = found.sel(sensitivity_to=["A.density", "B.density"])
    assert_allclose(densities.sum("sensitivity_to"), -0.5, rtol=1e-8)


@pytest.mark.slow
def test_waves_of_an_edge_in_the_plane_are_at_the_corners_of_its_path():
    """On a floor: the contacts with it are those of the balls that touch it."""
    text = PACKING.replace("[sensitivities]", "[OBSERVE]").replace("18 N", "FORCE")
    text = text.replace("7840 kg/m^3", "DENSITY")
    text += "surface: {axis: 1, edge: floor, points: 2}\n"
    words = {"FORCE": "[2 N, 128 N]", "DENSITY": "2.7 g/cm^3"}
    data = sweep(text, OBSERVE="sensitivities, surface", **words)
    names = [name for name in data["sensitivity_of"].values if "surface" in name]
    assert names == [f"surface_frequency X {number}" for number in range(4)]
    found = data["sensitivity"].sel(sensitivity_of=names).squeeze("medium")
    assert_allclose(found.sel(sensitivity_to="density"), -0.5, rtol=1e-8)
    stiffer = text.replace("poisson_ratio: 0.276", "poisson_ratio: RATIO")
    powers = find_power(stiffer, "RATIO", 0.276, "")[:, 0, -1]
    assert_allclose(
        found.sel(sensitivity_to="poisson_ratio"), np.broadcast_to(powers, (2, 4)), rtol=1e-6
    )


def test_waves_of_an_edge_have_a_table_a_panel_and_a_cost(edge_result):
    table = (edge_result.folder / "sensitivities.csv").read_text(encoding="utf-8")
    assert table.count("surface_frequency 0") == edge_result.dataset.sizes["sensitivity_to"]
    assert edge_result.summary()["matters_most"]["surface_frequency 0"] == "A.diameter"
    titles = [ax.get_title() for ax in sensitivities_figure(edge_result.dataset).axes]
    assert sum("wave\N{NO-BREAK SPACE}0" in title for title in titles) == 1
    (*_, (_, _, cost)) = edge_result.scene.plan.parts
    (*_, (_, _, without)) = make_edge_scene("sensitivities").plan.parts
    assert len(cost.units) == len(without.units) + 1
    assert cost.seconds > without.seconds


def test_derivatives_of_waves_of_an_edge_are_resumed(edge_result):
    again = edge_result.scene.run(edge_result.folder, resume=True, figures=False)
    assert again.dataset.identical(edge_result.dataset)


@pytest.mark.slow
def test_states_with_fewer_waves_of_an_edge_have_empty_derivatives():
    """A lighter ball at the free end has a wave in the gap, a heavier one has none."""
    text = EDGE.replace("edge: {wall: B}", "edge: free").replace("FORCE", "2 N")
    text = text.replace("OBSERVE", "sensitivities, surface").replace("DENSITY", "2.7 g/cm^3")
    text += "sweep: {A.density: [1 g/cm^3, 8 g/cm^3]}\n"
    found = gp.Scene.from_text(text).sweep()["sensitivity"]
    waves = found.sel(sensitivity_of="surface_frequency 0", medium="crystal").squeeze("load")
    assert np.all(np.isfinite(waves[0]))
    assert np.all(np.isnan(waves[1]))
