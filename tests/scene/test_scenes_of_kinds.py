"""Scenes with balls of several kinds: what is read, written, checked and run."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import granphon as gp
from granphon.balls.loads import Load
from granphon.base.errors import GranphonError, InputError, SceneError
from granphon.cli.main import main
from granphon.media.arrangement import Arrangement, CrystalMedium
from granphon.observables.catalogue import entry_of
from granphon.runs.dataset import load_sweep
from tests.scene.mistakes import BALLS

STEEL = gp.Material(193e9, 0.30, 8000.0)
ALUMINIUM = gp.Material(73.5e9, 0.33, 2700.0)
CHAIN = (
    BALLS + "crystal: {lattice: chain, kinds: [A, S]}\nload: {force: 20 N}\nobserve: [velocities,"
    " bands, gaps, dos]\n"
)


def balls(diameter: float = 19.05e-3) -> tuple[gp.Ball, gp.Ball]:
    """Aluminium and steel."""
    return gp.Ball(ALUMINIUM, diameter, mass=9.75e-3, name="A"), gp.Ball(
        STEEL, 19.05e-3, mass=28.84e-3, name="S"
    )


def test_the_preset_of_a_diatomic_chain_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--preset", "diatomic"]) == 0
    assert main(["run", "scene.yaml", "-o", "out", "--no-figures"]) == 0
    assert re.search(r"gap +4\.7\d+ kHz to 8\.0\d+ kHz", capsys.readouterr().out)


def test_a_scene_takes_a_crystal_that_exists_already_and_writes_it():
    crystal = gp.Crystal.on("CsCl", list(balls()))
    scene = gp.Scene(crystal, Load("pressure", 1e3), observe=("onsets",))
    again = gp.Scene.from_text(scene.to_yaml())
    assert again == scene
    right = crystal.at_pressure(1e3)
    assert again.state().source.normal_force == pytest.approx(right.normal_force, rel=1e-14)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda crystal: crystal.sample((3, 3), 5), "sample"),
        (lambda crystal: crystal.cut(1, 3, "free"), "cut"),
        (lambda crystal: crystal.with_springs({"x": 1e3}), "springs"),
    ],
    ids=["sample", "cut", "springs"],
)
def test_a_crystal_that_no_file_makes_again_is_not_written(change, words):
    ball = replace(balls()[0], spread=gp.Uniform(2e-6))
    scene = gp.Scene(
        change(gp.Crystal.on("triangular", [ball])), Load("pressure", 1e3), observe=("bands",)
    )
    with pytest.raises(InputError, match=words):
        scene.to_yaml()


def test_a_crystal_that_buckles_is_told_at_its_own_key():
    text = CHAIN.replace("[A, S]", "[A, S], motions: in_plane, finite_overlap: true")
    with pytest.raises(SceneError, match=r":\d+: crystal\.finite_overlap: found true.*buckles"):
        gp.Scene.from_text(text.split("observe")[0]).sweep()


@pytest.mark.claim("crystal-scene")
def test_a_diatomic_chain_has_the_edges_of_its_bands_and_its_gap(tmp_path):
    result = gp.Scene.from_text(CHAIN).run(tmp_path / "out", figures=False)
    assert result.gaps == pytest.approx(np.array([[4710.53, 8101.49]]), abs=0.01)
    numbers = result.summary()
    assert numbers["gaps"] == result.gaps.tolist()
    assert numbers["top_frequency"] == pytest.approx(9371.40, abs=0.01)
    assert numbers["longitudinal"] == pytest.approx(487.42, abs=0.01)
    assert numbers["exponent"] == pytest.approx(1.0 / 6.0, rel=1e-13)
    assert result.validity.ok
    assert {"band.yaml", "phonopy_params.yaml", "dos.csv", "sweep.csv"} <= {
        path.name for path in result.files
    }
    again = gp.Scene.from_yaml(tmp_path / "out" / "scene.yaml")
    assert again == replace(gp.Scene.from_text(CHAIN), source=again.source)


def test_what_a_sweep_finds_is_what_states_have(tmp_path):
    text = (
        BALLS + "crystal: {lattice: chain, kinds: [A, S]}\nload: {force: {from: 1 N, to: 20 N,"
        " points: 2}}\n"
    )
    scene = gp.Scene.from_text(
        text + "sweep: {A.diameter: [12 mm, 19.05 mm], S.density: [8000 kg/m^3, 7000 kg/m^3]}\n"
    )
    data = scene.run(tmp_path / "out", figures=False).dataset
    assert data["longitudinal"].dims == ("load", "medium", "A.diameter", "S.density")
    read = load_sweep(tmp_path / "out" / "sweep.nc")
    for d, diameter in enumerate((12e-3, 19.05e-3)):
        small, large = balls(diameter)
        for m, mass in enumerate((28.84e-3, 28.84e-3)):
            # a mass that was given stays where the density is another
            crystal = gp.Crystal.on("chain", [small, replace(large, mass=mass)])
            states = crystal.at_force(np.array(data["force"]))
            right = gp.sound_velocities(states).longitudinal
            assert data["longitudinal"].values[:, 0, d, m] == pytest.approx(right, rel=1e-13)
    assert np.array_equal(read["longitudinal"], data["longitudinal"])
    assert read["A.diameter"].attrs["units"] == "m"
    assert "of A" in read["A.diameter"].attrs["long_name"]
    entry = entry_of("A.poisson_ratio", scene.packing)
    assert (entry.title, entry.label) == ("Poisson ratio of A", "Poisson ratio of A")
    assert ("sweep of S.density", (8000.0, 7000.0), "kg/m^3") in scene.describe()


def test_sweeps_in_python_take_crystals():
    crystal = gp.Crystal.on("NaCl", list(balls()))
    pressures = [1e4, 1e5, 1e6]
    data = gp.sweep(crystal, pressure=pressures, direction=(1, 1, 0))
    right = gp.sound_velocities(crystal.at_pressure(pressures), (1, 1, 0))
    assert data["longitudinal"].values[:, 0] == pytest.approx(right.longitudinal, rel=1e-13)
    assert data["tensor"].values[:, 0] == pytest.approx(
        gp.moduli(crystal.at_pressure(pressures)).tensor, rel=1e-12
    )
    assert data["pressure"].values == pytest.approx(pressures)
    softer = gp.sweep(crystal, pressure=[1e5], **{"A.young_modulus": [50e9, 73.5e9]})
    other = crystal.with_balls(
        {"A": replace(balls()[0], material=replace(ALUMINIUM, young_modulus=50e9))}
    )
    assert softer["bulk"].values[0, 0] == pytest.approx(
        [gp.moduli(one.at_pressure(1e5)).bulk for one in (other, crystal)]
    )
    with pytest.raises(InputError, match="touch"):
        gp.sweep(crystal, pressure=[1e5], **{"A.diameter": [0.019]})
    with pytest.raises(InputError, match=r"no parameter 'B\.mass'"):
        gp.sweep(crystal, pressure=[1e5], **{"B.mass": [0.019]})
    with pytest.raises(InputError, match=r"'A\.colour'.*A\.young_modulus"):
        gp.sweep(crystal, pressure=[1e5], **{"A.colour": [1.0]})
    with pytest.raises(InputError, match=r"'ema'.*crystal"):
        gp.sweep(crystal, pressure=[1e5], media="ema")
    with pytest.raises(InputError, match="Balls of several kinds"):
        gp.sweep(gp.Packing(STEEL, 8e-3), force=[1.0], media="crystal")


def test_loads_that_are_tensors():
    text = BALLS + "crystal: {lattice: fcc, kinds: [S]}\ndirection: [0, 0, 1]\n"
    scene = gp.Scene.from_text(
        text + "load: {strain: [0, 0, -1e-4, 0, 0, 0], times: [0.1, 1, 2]}\n"
    )
    data = scene.sweep()
    crystal = gp.Crystal.on("fcc", [balls()[1]])
    strains = -1e-4 * np.array([0.1, 1.0, 2.0])[:, None] * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    states = crystal.at_strain(strains)
    right = gp.sound_velocities(states, (0, 0, 1))
    assert data["longitudinal"].values[:, 0] == pytest.approx(right.longitudinal, rel=1e-13)
    assert data["contact_fraction"].values == pytest.approx(8.0 / 12.0)
    assert data["strain"].values == pytest.approx([1e-5, 1e-4, 2e-4])
    # along [001] v^2 = k + kappa, in units d^2/m
    k = states.normal_stiffness.max(axis=1)
    ratio = crystal.mindlin_ratios[0]
    ball = crystal.kinds[0]
    assert right.longitudinal**2 == pytest.approx(
        ball.diameter**2 * k * (1.0 + ratio) / ball.mass, rel=1e-12
    )
    matrix = "load: {strain: [[0, 0, 0], [0, 0, 0], [0, 0, -1e-4]], times: [0.1, 1, 2]}\n"
    assert gp.Scene.from_text(text + matrix) == replace(scene, source=None)


@pytest.mark.parametrize(
    ("lines", "check"),
    [
        (
            "crystal: {lattice: square, kinds: [A], cut: {axis: 1, layers: 4, edges: floor free}}\n"
            "load: {gravity: 9.81 m/s^2}\nobserve: [bands]\n",
            lambda c: c.cut(1, 4, ("floor", "free")).at_pressure(0.0, gravity=(0.0, -9.81)),
        ),
        pytest.param(
            "crystal: {lattice: square, kinds: [A], cut: {axis: 1, layers: 4, edges: free floor}}\n"
            "load: {pressure: 5 N/m, gravity: 9.81 m/s^2}\nobserve: [bands]\n",
            lambda c: c.cut(1, 4, ("free", "floor")).at_pressure(5.0, gravity=(0.0, 9.81)),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_layers_stand_on_a_floor(tmp_path, lines, check):
    state = check(gp.Crystal.on("square", [balls()[0]]))
    result = gp.Scene.from_text(BALLS + lines).run(tmp_path / "out", figures=False)
    live = state.normal_force[state.normal_stiffness > 0.0]
    assert result.summary()["force"] == pytest.approx(live.mean(), rel=1e-12)
    assert result.bands.frequencies.max() == pytest.approx(
        gp.Phonons(state).bands().frequencies.max(), rel=1e-9
    )
    assert not any("velocities" in text for text in result.warnings)


def test_a_column_has_no_pressure_of_periods():
    crystal = gp.Crystal.on("chain", [balls()[0]]).cut(0, 3, "floor")
    state = CrystalMedium(Arrangement.of(crystal)).at_pressure(2.0)
    assert state.force == pytest.approx(2.0, rel=1e-12)
    with pytest.raises(InputError, match="column"):
        _ = state.pressure


def test_a_defect_and_laws_of_pairs():
    text = (
        BALLS
        + """
crystal:
  cell: [[38.1 mm]]
  sites: [{kind: A, at: [0 mm]}, {kind: S, at: [19.05 mm]}]
  repeat: 4
  replace: {3: A}
  law: {A A: {power: {exponent: 2, coefficient: 1e11}}, A S: hertz}
load: {force: 5 N}
"""
    )
    scene = gp.Scene.from_text(text)
    small, large = balls()
    law = {("A", "A"): gp.PowerLaw(2.0, 1e11), ("A", "S"): gp.Hertz()}
    crystal = (
        gp.Crystal([small, large], [[38.1e-3]], [[0.0], [19.05e-3]], law=law)
        .repeat(4)
        .replace(3, small)
    )
    right = crystal.at_force(5.0)
    assert scene.state().source.normal_stiffness == pytest.approx(right.normal_stiffness, rel=1e-14)
    assert gp.Scene.from_text(scene.to_yaml()) == replace(scene, source=None)


def test_a_kind_may_have_a_spread_of_diameters(tmp_path):
    text = (
        BALLS.replace("28.84 g}", "28.84 g, spread: {uniform: 1 um}}")
        + """
crystal: {lattice: triangular, kinds: [S], repeat: 6 6, seed: 3}
load: {pressure: 20 kN/m}
"""
    )
    scene = gp.Scene.from_text(text)
    rows = [
        ("spread of S", "uniform", ""),
        ("width of S", 1e-6, "m"),
        ("Young modulus of S", 193e9, "Pa"),
    ]
    assert set(rows) <= set(scene.packing.describe())
    ball = replace(balls()[1], spread=gp.Uniform(1e-6))
    right = gp.Crystal.on("triangular", [ball]).sample((6, 6), 3).at_pressure(2e4)
    assert scene.state().source.normal_force == pytest.approx(right.normal_force, rel=1e-13)
    assert np.ptp(right.normal_force) > 0.0
    assert gp.Scene.from_text(scene.to_yaml()) == replace(scene, source=None)
    found = scene.run(tmp_path / "out", figures=False).summary()
    assert found["force"] == pytest.approx(np.mean(right.normal_force), rel=1e-12)
    weak = gp.Scene.from_text(text.replace("pressure: 20 kN/m", "force: 2 N"))
    assert weak.state().contact_fraction < 1.0
    assert weak.state().force == pytest.approx(2.0, rel=1e-9)
    assert np.array(found["tensor"]) == pytest.approx(gp.moduli(right).tensor, rel=1e-12)
    with pytest.raises(SceneError, match="repeat one sample"):
        gp.Scene.from_text(text.replace("seed: 3", "remove: [3]"))


def test_the_table_of_the_diameters_of_a_kind_is_read_by_the_scene(tmp_path):
    table = tmp_path / "balls.csv"
    table.write_text("diameter (mm)\n19\n19.1\n", encoding="utf-8")
    path = tmp_path / "scene.yaml"
    kinds = BALLS.replace("mass: 28.84 g", "spread: {measured: balls.csv}")
    path.write_text(f"{kinds}crystal: {{lattice: chain, repeat: 8}}\nload: {{force: 20 N}}\n")
    assert gp.Scene.from_yaml(path).origin.inputs == (path, table)


@pytest.mark.parametrize(
    "command",
    [
        ["page", "s.yaml", "-o", "p.html"],
        ["mode", "s.yaml", "--at", "X", "--branch", "1", "-o", "m.png"],
        ["export", "s.yaml", "-o", "m.json"],
        ["check", "s.yaml"],
    ],
    ids=lambda command: command[0],
)
def test_commands_take_a_scene_of_kinds(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(CHAIN, encoding="utf-8")
    assert main(command) == 0
    if command[0] == "export":
        assert json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))


_LENGTHS = st.floats(1e-4, 1e-1)


@st.composite
def scenes(draw: st.DrawFn) -> gp.Scene:
    """Scenes of crystals, whose numbers have all digits."""
    size = draw(_LENGTHS)
    moduli = st.floats(1e9, 3e11)
    ratios = st.floats(-0.5, 0.49)
    densities = st.floats(1e3, 1e4)
    kinds = tuple(
        (name, gp.Ball(gp.Material(draw(moduli), draw(ratios), draw(densities)), size))
        for name in "AB"
    )
    table = gp.TabulatedLaw([1e-6, 2e-6], [1.0, 3.1])
    law = draw(
        st.sampled_from([gp.Hertz(), gp.PowerLaw(1.75, 3e8), gp.DMT(0.05), gp.JKR(0.02), table])
    )
    lattice = draw(st.sampled_from(["chain", "NaCl", "square", "fcc"]))
    order = ("A", "B") if lattice in ("chain", "NaCl") else ("B",)
    cut = (
        ((draw(st.sampled_from([1, (1, 1)])), 3, ("free", "free")),) if lattice == "square" else ()
    )
    repeat = draw(st.sampled_from([(), (2,)])) if lattice == "chain" else ()
    balls = Arrangement(kinds, lattice, order, law=law, cut=cut, repeat=repeat)
    p = balls.structure.periods
    values = tuple(draw(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=3, unique=True)))
    if draw(st.booleans()):
        load = gp.Load("force", values)
    else:
        plain = np.zeros({1: 1, 2: 3, 3: 6}[p])
        plain[:p] = [-draw(st.floats(1e-6, 1e-3)) for _ in range(p)]
        load = gp.Load("strain", values, tensor=tuple((plain / np.max(np.abs(plain))).tolist()))
    return gp.Scene(balls, load, observe=("bands",))


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(scenes())
def test_a_written_scene_is_the_same_to_the_last_bit(scene):
    refused = None
    try:
        again = gp.Scene.from_text(scene.to_yaml())
    except GranphonError as error:  # a load that the balls cannot carry
        again = scene
        refused = str(error)
    assert again == scene
    assert refused is None or "carry" in refused or "beyond" in refused
