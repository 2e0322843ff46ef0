"""The page to play with: its numbers against those of the library, in node and in a browser, and
what it does by itself.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.balls.motions import allowed_motions
from granphon.base.errors import GranphonError, InputError, InstabilityError, MechanismError
from granphon.cli.main import main
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.figures.style import KIND_COLOURS
from granphon.media.choice import MEDIA, MediumChoice
from granphon.page.lattice_data import describe_lattice
from granphon.page.page import (
    describe_network_page,
    describe_page,
    fill_template,
    join_modules,
    make_page,
    read_asset,
    wrap_three,
)
from granphon.page.phononwebsite import write_phononwebsite
from granphon.phonons.paths import BandPath
from granphon.waves.settings import BandsSettings
from tests.conftest import one_error, only
from tests.dynamics.test_network_lattice import CASES as NETWORKS
from tests.dynamics.test_network_lattice import ribbon
from tests.test_structure import loaded_after

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
BRASS = gp.Material(103e9, 0.34, 8500.0)
BALLS = gp.Packing(STEEL, 8e-3)
FORCE = Load("force", 18.446)
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {lattice: triangular, diameter: 8 mm}
load: {force: 18.446 N}
"""
NODE = shutil.which("node")
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
ASSETS = Path(gp.__file__).parent / "page" / "assets"
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")


@cache
def lattice_data(name: str) -> dict[str, Any]:
    return describe_lattice(replace(BALLS, lattice=name), BandPath.default(LATTICES[name]))


def draw_settings(name: str, seed: int) -> dict[str, Any]:
    """Random settings of a lattice, wave vectors in fractions, and a direction."""
    rng = np.random.default_rng([seed, sorted(LATTICES).index(name)])
    lattice = LATTICES[name]
    motions = list(allowed_motions(lattice.dimension).values())[
        int(rng.integers(len(allowed_motions(lattice.dimension))))
    ]
    p = lattice.periods
    spacing = 1.0 - 0.02 * rng.random()
    finite = rng.random() < 0.35
    direction = rng.normal(size=p)
    near = 1e-6 * rng.uniform(-1.0, 1.0, (2, p))
    return {
        "lattice": name,
        "near": [6, 8],
        "settings": {
            "motions": motions.name,
            "eta": float(rng.random() * (rng.random() < 0.8)),
            "torsion": float(0.3 * rng.random() * (rng.random() < 0.5) * motions.twist),
            "bending": float(0.3 * rng.random() * (rng.random() < 0.5) * motions.rotate),
            "spacing": spacing if finite else 1.0,
            "push": 2.0 / 3.0 * (1.0 / spacing - 1.0) if finite else 0.0,
        },
        "q": np.concatenate(
            [rng.uniform(-1.5, 1.5, (6, p)), near, np.zeros((1, p)), np.full((1, p), 0.5)]
        ).tolist(),
        "direction": (direction / np.linalg.norm(direction)).tolist(),
    }


def make_lattice(case: dict[str, Any]) -> ContactLattice:
    settings = dict(case["settings"])
    lattice = LATTICES[case["lattice"]]
    motions = allowed_motions(lattice.dimension)[settings.pop("motions")]
    eta, spacing, push = (settings.pop(one) for one in ("eta", "spacing", "push"))
    return ContactLattice.of(lattice, eta, spacing, push, motions=motions, **settings)


#: what a page's own functions find for the cases, as JSON has it: nan becomes null
SOLVE = """(cases, datas) => cases.map((one) => {
  const lattice = makeLattice(datas[one.lattice], one.settings);
  const found = one.q.map((q) => solveModes(lattice, q));
  return {
    values: found.map((modes) => [...modes.values]),
    squares: found.map((modes) => modes.squares ? [...modes.squares] : null),
    free: lattice.statement.mechanism !== "", tensor: elasticTensor(lattice),
    velocities: soundVelocities(lattice, one.direction).map((wave) => wave.velocity),
    turning: found.map((modes) => [...modes.values].map((_, k) => rotationalPart(lattice, modes, k))),
  };
})"""


def check_agreement(case: dict[str, Any], found: dict[str, Any]) -> None:
    """Frequencies to 1e-9 of the top one, or squares to 1e-12 of the top square; moduli and
    velocities to 1e-9.
    """
    lattice = make_lattice(case)
    q = lattice.wavevectors(case["q"])
    squares = np.linalg.eigvalsh(lattice.dynamical_matrix(q))
    top = squares.max()
    if lattice.is_prestressed:
        assert np.abs(np.array(found["squares"]) - squares).max() <= 1e-12 * top
    else:
        values = lattice.frequencies(q)
        mine = np.array(found["values"], float)
        assert np.abs(mine - values).max() <= 1e-9 * np.sqrt(top)
        # near Gamma small frequencies keep their digits, unless they are of second order in q
        near = slice(*case["near"])
        linear = values[near] > 1e-9 * np.sqrt(top)
        assert np.allclose(mine[near][linear], values[near][linear], rtol=1e-8, atol=0.0)
    try:
        tensor = lattice.elastic_tensor()
    except GranphonError:
        tensor = None
    if tensor is not None:
        assert np.abs(np.array(found["tensor"]) - tensor).max() <= 1e-9 * np.abs(tensor).max()
    try:
        velocities = np.sort(lattice.sound_velocities(case["direction"])[0])
    except MechanismError:
        assert found["free"]
    except InstabilityError:
        assert None in found["velocities"]
    else:
        assert np.allclose(
            found["velocities"], velocities, rtol=1e-9, atol=1e-9 * max(velocities.max(), 1e-300)
        )


def run_node(program: str, **given: Any) -> Any:
    """Run the modules of the page that compute, and then a program that prints JSON, with ``given``
    as constants.
    """
    text = join_modules("long_waves", "state", "mode_view", "numbers_view", "damping")
    constants = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items())
    assert NODE is not None
    run = subprocess.run(
        [NODE, "--input-type=module", "-"],
        input=f"{text}\n{constants}{program}",
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


# -- numbers ---------------------------------------------------------------------------------------


@needs_node
@pytest.mark.claim("page-agrees")
@pytest.mark.parametrize(
    "seeds",
    [
        range(1),
        pytest.param(range(1, 2), marks=pytest.mark.slow),
        pytest.param(range(2, 20), marks=pytest.mark.exhaustive),
    ],
    ids=lambda seeds: f"{len(seeds)} settings",
)
def test_the_page_computes_what_the_library_computes(seeds):
    cases = [draw_settings(name, seed) for name in LATTICES for seed in seeds]
    datas = {name: lattice_data(name) for name in LATTICES}
    found = run_node(
        f"console.log(JSON.stringify(({SOLVE})(cases, datas)));", cases=cases, datas=datas
    )
    for case, one in zip(cases, found, strict=True):
        check_agreement(case, one)


@needs_node
def test_the_page_of_a_cut_says_which_edge_moves():
    packing = gp.Packing(STEEL, 8e-3, lattice="honeycomb", friction=True, motions="in_plane")
    network = gp.AveragedLattice(packing).at_force(18.446).network
    assert describe_network_page(network)["lattice"]["sides"] is None
    ribbon = network.cut(1, 10)
    data = describe_network_page(ribbon)
    bands = gp.Phonons(ribbon).bands([[[0.31], [0.40]]], npoints=2)
    one = {"settings": latticeless(data), "q": bands.qpoints[0].tolist()}
    program = "const it = makeLattice(data, one.settings);"
    program += (
        "console.log(JSON.stringify(one.q.map((q) => [...edgeParts(it, solveModes(it, q))])));"
    )
    found = np.array(run_node(program, one=one, data=data["lattice"]))
    lower, upper = np.moveaxis(bands.edge_weight[0], -1, 0)
    # pairs of waves of the two edges are the same to the last, and are told apart by both
    alone = (
        np.diff(bands.frequencies[0], axis=1, prepend=-1e9, append=1e9)
        > 2e-4 * bands.frequencies.max()
    )
    alone = alone[:, 1:] & alone[:, :-1]
    assert np.count_nonzero(alone) > 50
    both = (upper + lower > 0.8) & (np.abs(upper - lower) < 0.6)
    assert_allclose(found[alone], np.where(both, 2.0, upper - lower)[alone], atol=1e-6)
    assert_allclose(
        np.sort(np.where(found == 2.0, 0.0, found), axis=1)[:2, [0, -1]],
        [[-1.0, 1.0]] * 2,
        atol=0.05,
    )


def test_a_page_draws_no_bands_without_a_potential():
    for name in ("tangential", "slip"):
        case = next(case for case in NETWORKS if case.startswith(name))
        with pytest.raises(InputError, match=name):
            describe_network_page(NETWORKS[case]())


#: networks whose bands a page draws, and those of them that cost least and differ most
DRAWN = [name for name in NETWORKS if not name.startswith(("tangential", "slip"))]
FEW = (
    "chain",
    "out of the plane",
    "prestress",
    "prestress of contacts that pull",
    "turned ribbon",
    "one ball of two that is held",
    "held in space",
)


@needs_node
@pytest.mark.parametrize("case", only(FEW, DRAWN))
def test_the_page_of_a_network_computes_what_the_library_computes(case):
    """Frequencies, rotation, motions, velocities and moduli of balls and contacts that differ."""
    network = NETWORKS[case]()
    data = describe_network_page(network)
    lattice = ContactLattice.from_network(network)
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (4, lattice.periods))
    one = {
        "lattice": case,
        "settings": latticeless(data),
        "q": q.tolist(),
        "direction": data["direction"],
    }
    program = f"console.log(JSON.stringify([({SOLVE})(cases, datas), cases[0].q.map((q) => {{"
    program += (
        "const it = makeLattice(datas[cases[0].lattice], cases[0].settings); const modes ="
        " solveModes(it, q);"
    )
    program += "return [...modes.values].map((_, k) => ballMotions(it, modes, k)); })]));"
    (found,), motions = run_node(program, cases=[one], datas={case: data["lattice"]})
    values = lattice.frequencies(lattice.wavevectors(q))
    top = values.max()
    if lattice.is_prestressed:
        assert np.abs(np.array(found["squares"]) - values**2).max() <= 1e-12 * top**2
    else:
        assert np.abs(np.array(found["values"], float) - values).max() <= 1e-9 * top
    matrix = lattice.dynamical_matrix(lattice.wavevectors(q))
    kept = [*lattice.motions.translations, *(3 + axis for axis in lattice.motions.rotations)]
    for own, moved, squares in zip(matrix, np.array(motions) @ [1.0, 1j], values**2, strict=True):
        weight = np.sqrt(lattice.masses)[:, None] * np.where(
            np.arange(6) < 3, 1.0, lattice.gyration[:, None]
        )
        vectors = (moved * weight)[..., kept].reshape(len(squares), -1).T
        assert np.abs(own @ vectors - vectors * squares).max() <= 1e-11 * squares.max()
    assert found["free"] == lattice.is_held
    if not lattice.is_held:
        velocities = np.sort(lattice.sound_velocities(data["direction"])[0])
        assert np.allclose(found["velocities"], velocities, rtol=1e-9, atol=1e-9 * velocities.max())
        if "longitudinal" in lattice.wave_names:
            tensor = lattice.elastic_tensor()
            assert np.abs(np.array(found["tensor"]) - tensor).max() <= 1e-9 * np.abs(tensor).max()


def latticeless(data):
    """The settings of a network's page, as its own function finds them."""
    return {"motions": data["start"]["motions"], **data["fixed"]}


def test_pages_of_networks_too_large_or_without_periods_are_refused():
    network = gp.AveragedLattice(BALLS).at_force(1.0).network
    with pytest.raises(InputError, match="108 branches"):
        describe_network_page(network.repeat((6, 6)))
    with pytest.raises(InputError, match="repeats along no axis"):
        make_page(ribbon(network.repeat((3, 3))))
    assert "Mean normal stiffness" in make_page(network.repeat((2, 2)))


#: a view of balls that are built, by the library that draws them, but not drawn: nothing of a
#: browser is there
BUILT = """
globalThis.ResizeObserver = class { observe() {} };
const view = Object.assign(Object.create(ModeView.prototype), {
  canvas: { clientWidth: 100, clientHeight: 100 }, data: data.lattice, kinds: data.kinds, balls: listBalls(data.lattice),
  renderer: { setPixelRatio() {}, setSize() {}, render() {} }, angles: [0, 0], time: 0,
});
globalThis.devicePixelRatio = 1;
globalThis.document = {};
globalThis.getComputedStyle = () => ({ getPropertyValue: () => "#123456" });
view.build();
view.recolour();
view.show(data.lattice.positions.map(() => Array(6).fill([0, 0])), [0, 0, 0], false);
view.render();
const [colour, matrix, scale] = [new THREE.Color(), new THREE.Matrix4(), new THREE.Vector3()];
const balls = view.balls.map(({ site }, n) => {
  view.mesh.getColorAt(n, colour);
  view.mesh.getMatrixAt(n, matrix);
  return [site, `#${colour.getHexString()}`, scale.setFromMatrixScale(matrix).x];
});
const element = { tBodies: [{}] };
drawNumbers(element, data, {}, {}, { statement: { mechanism: "none" }, waves: [] }, []);
console.log(JSON.stringify([balls, element.tBodies[0].innerHTML]));
"""


@needs_node
def test_kinds_have_their_colours_sizes_and_names_on_the_page():
    steel = gp.Material(193e9, 0.30, 8000.0)
    large = gp.Ball(steel, 8e-3, name="large & <b>heavy")
    small = gp.Ball(steel, (np.sqrt(2.0) - 1.0) * 8e-3, name="small")
    crystal = gp.Crystal([small, large], np.diag([8e-3, 8e-3]), [[4e-3, 4e-3], [0, 0]])
    data = describe_network_page(crystal.at_pressure(10.0))
    first, second = KIND_COLOURS[:2]
    assert data["kinds"] == [
        {"name": "small", "colour": first, "balls": [0]},
        {"name": "large & <b>heavy", "colour": second, "balls": [1]},
    ]
    assert np.allclose(
        data["lattice"]["radii"],
        [(np.sqrt(2.0) - 1.0) / np.sqrt(2.0), 1.0 / np.sqrt(2.0)],
        rtol=1e-12,
    )
    assert ["small", "1 ball, 152.42 mg, diameter 3.3137 mm"] in data["facts"]
    balls, table = run_node(f"{wrap_three()}\n{BUILT}", data=data)
    assert len(balls) > 20
    for site, colour, size in balls:
        assert colour == data["kinds"][site]["colour"].lower()
        assert size == pytest.approx(2.0 * data["lattice"]["radii"][site], rel=1e-6)
    assert "large &amp; &lt;b>heavy" in table
    assert "<b>" not in table
    assert describe_network_page(gp.Crystal.on("square", [large]).at_pressure(10.0))["kinds"] == []


#: Q of each branch, as a page shows it
QUALITY = """((data, q) => {
  const start = startState(data);
  const { contact, lattice } = solveState(data, start);
  const losses = findLosses(data, contact.stiffness, lattice.settings.eta);
  const modes = solveModes(lattice, q);
  const angular = Math.sqrt(contact.stiffness / data.balls.mass);
  return [...modes.values].map((_, k) => findQuality(lattice, modes, k, losses, angular));
})"""
LOSSY = [
    {"damping": 5e-7, "loss_factor": 0.02, "drag": 2e3},
    {"restitution": 0.8},
    {"dashpot": (2.0, 5.0), "drag": (0.0, 3e3)},
    {"damping": (2e-7, 0.0), "loss_factor": (0.01, 0.05), "restitution": 0.9},
]


def find_qualities(data, q):
    found = run_node(f"console.log(JSON.stringify({QUALITY}(data, q)));", data=data, q=q)
    return np.array(found, float)


@needs_node
@pytest.mark.parametrize("losses", LOSSY)
@pytest.mark.parametrize("overlap", [False, True])
def test_a_page_finds_the_q_factors_of_all_losses(losses, overlap):
    """Those of the quadratic eigenvalue problem, of all branches, to nine digits."""
    packing = gp.Packing(STEEL, 8e-3, lattice="square", friction=True)
    state = gp.AveragedLattice(packing).at_force(18.446, finite_overlap=overlap)
    settings = BandsSettings(**losses)
    q = [0.21, 0.34, 0.0]
    expected = gp.Phonons(state).damped([q[:2]], **settings.losses).quality[0]
    data = describe_page(
        packing, (), Load("force", 18.446), finite_overlap=overlap, losses=settings
    )
    np.testing.assert_allclose(find_qualities(data, q), expected, rtol=1e-9)


@needs_node
@pytest.mark.parametrize("losses", LOSSY)
@pytest.mark.parametrize("ground", [0.0, 1e6])
def test_a_page_of_a_network_finds_the_q_factors_of_all_losses(losses, ground):
    """Contacts of unlike balls have dashpots of their own; springs to the ground lose nothing."""
    balls = [gp.Ball(STEEL, 8e-3), gp.Ball(BRASS, 5e-3)]
    crystal = gp.Crystal.on("NaCl", balls, on_site=ground)
    state = crystal.at_pressure(1e5)
    settings = BandsSettings(**losses)
    q = [0.11, 0.23, 0.37]
    expected = gp.Phonons(state).damped([q], **settings.losses).quality[0]
    found = find_qualities(describe_network_page(state, losses=settings), q)
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=1e-8)


def test_a_page_without_losses_has_no_q_factor():
    crystal = gp.Crystal.on("chain", [gp.Ball(STEEL, 8e-3)]).at_pressure(10.0)
    no_losses = (BandsSettings(), BandsSettings(drag=(0.0, 0.0)), BandsSettings(restitution=1.0))
    for losses in (None, *no_losses):
        assert describe_network_page(crystal, losses=losses)["losses"] is None


@needs_node
def test_motions_are_eigenvectors_of_the_library():
    """What the balls do, in the page's own frame, is a mode of D(q): D e = omega^2 e, with the
    phases of the positions.
    """
    cases = [
        {
            "lattice": name,
            "motions": motions.name,
            "q": [0.21, -0.37, 0.11][: LATTICES[name].periods],
        }
        for name in ("chain", "triangular", "kagome", "fcc", "hcp")
        for motions in allowed_motions(LATTICES[name].dimension).values()
    ]
    datas = {name: lattice_data(name) for name in {case["lattice"] for case in cases}}
    program = """console.log(JSON.stringify(cases.map((one) => {
      const lattice = makeLattice(datas[one.lattice],
        {motions: one.motions, eta: 0.7, torsion: 0.1, bending: 0.05, spacing: 1, push: 0});
      const modes = solveModes(lattice, one.q);
      return [...modes.values].map((_, k) => ballMotions(lattice, modes, k));
    })));"""
    for case, found in zip(cases, run_node(program, cases=cases, datas=datas), strict=True):
        structure = LATTICES[case["lattice"]]
        motions = allowed_motions(structure.dimension)[case["motions"]]
        twist = 0.1 * motions.twist
        roll = 0.05 * motions.rotate
        lattice = ContactLattice.of(structure, 0.7, torsion=0.1, bending=0.05, motions=motions)
        assert lattice.torsion == 0.1 or not twist
        assert lattice.bending == 0.05 or not roll
        matrix = lattice.dynamical_matrix(lattice.wavevectors([case["q"]]))[0]
        kept = [*motions.translations, *(3 + axis for axis in lattice.motions.rotations)]
        vectors = np.array(found) @ [1.0, 1j]  # (branches, balls, 6)
        vectors[..., 3:] *= np.sqrt(0.1)  # phi to w
        vectors = vectors[..., kept].reshape(len(found), -1).T
        squares = np.square(lattice.frequencies(lattice.wavevectors([case["q"]]))[0])
        assert np.abs(matrix @ vectors - vectors * squares).max() <= 1e-12 * squares.max()
        assert np.allclose(vectors.conj().T @ vectors, np.eye(len(squares)), atol=1e-12)


@needs_node
@pytest.mark.claim("page-interpolates")
@pytest.mark.parametrize("name", ["afa", pytest.param("ema", marks=pytest.mark.slow)])
def test_interpolated_contacts_are_as_good_as_the_page_says(name):
    """At loads, widths and frictions between the nodes; the error of k is the one that the page
    tells.
    """
    packing = replace(BALLS, spread=gp.Uniform(1e-6))
    data = describe_page(packing, [MediumChoice(name)], FORCE)
    rng = np.random.default_rng(3)
    (low, high), widest = data["limits"]["force"], data["limits"]["width"]
    width = widest * rng.random(40)
    cases = [
        [float(low * (high / low) ** part), float(w)]
        for part, w in zip(rng.random(40), width, strict=True)
    ]
    program = """console.log(JSON.stringify(cases.map(([force, width]) =>
      findContact(data, data.media[0], force, width, data.start.eta))));"""
    media = {"afa": gp.AveragedForce, "ema": gp.EffectiveMedium}
    for (force, width), found in zip(cases, run_node(program, cases=cases, data=data), strict=True):
        state = media[name](replace(packing, spread=gp.Uniform(width))).at_force(force)
        assert found["stiffness"] == pytest.approx(
            state.normal_stiffness, rel=1.5 * data["media"][0]["error"]
        )
        assert found["overlap"] == pytest.approx(state.overlap, rel=1e-4, abs=1e-6 * width)
        # a slope of a law that has kinks
        assert found["exponent"] == pytest.approx(state.exponent, abs=1e-3)
        assert found["reduced"] == pytest.approx(state.reduced_force)
    assert data["media"][0]["error"] < 1.2e-6
    assert ("stiffness by less than 0.01 %" in data["media"][0]["note"]) == (name == "ema")


@cache
def describe_effective_medium() -> tuple[gp.Packing, dict[str, Any]]:
    """A kagome lattice, and its page with the effective medium."""
    packing = replace(BALLS, spread=gp.Uniform(2e-6), lattice="kagome")
    return packing, describe_page(packing, [MediumChoice("ema")], FORCE)


@needs_node
def test_friction_between_the_nodes_of_the_effective_medium():
    packing, data = describe_effective_medium()
    program = """console.log(JSON.stringify([0.02, 0.06, 0.33, 0.95].map((eta) =>
      findContact(data, data.media[0], 18.446, 2e-6, eta))));"""
    found = run_node(program, data=data)
    # a kagome lattice does not stand without friction
    assert "raise η to 0.05" in found[0]["problem"]
    from granphon.dynamics.local_field import local_field
    from granphon.laws.effective import EffectiveLaw

    for eta, one in zip((0.06, 0.33, 0.95), found[1:], strict=True):
        law = EffectiveLaw(
            packing.law.coefficient,
            packing.width,
            packing.spread.shape,
            local_field("kagome", eta).xi,
        )
        stiffness = law.stiffness(law.overlap(18.446))
        assert one["problem"] == ""
        assert one["stiffness"] == pytest.approx(
            stiffness, rel=1.5 * data["media"][0]["friction_error"]
        )
    assert data["media"][0]["friction_error"] < 2e-4


@pytest.mark.parametrize(
    "fractions",
    [[1.0], pytest.param([0.1, 0.5, 1.0], marks=pytest.mark.slow)],
)
def test_the_page_says_what_bending_would_do_to_the_medium(fractions):
    packing, data = describe_effective_medium()
    told = re.search(r"stiffness by up to (\S+) %", data["media"][0]["note"])
    assert told
    forces = np.geomspace(*data["limits"]["force"], 12)
    stiffness = gp.EffectiveMedium(packing).at_force(forces).normal_stiffness
    found = 0.0
    for bending in data["limits"]["rolling"] * np.array(fractions):
        bent = (
            gp.EffectiveMedium(replace(packing, bending=bending)).at_force(forces).normal_stiffness
        )
        found = max(found, float(np.max(np.abs(bent / stiffness - 1.0))))
    assert 1.0 < 100.0 * found <= 1.05 * float(told[1])


@needs_node
def test_finite_overlap_and_the_torsion_of_hertz_contacts_are_those_of_a_state():
    packing = replace(BALLS, lattice="fcc", torsion="mindlin", bending=0.01)
    data = describe_page(packing, [MediumChoice("afa")], Load("pressure", 2e8), finite_overlap=True)
    program = """const state = startState(data);
    const contact = findContact(data, data.media[0], state.force, state.width, state.eta);
    console.log(JSON.stringify([state, latticeSettings(data, state, contact), contact]));"""
    start, settings, contact = run_node(program, data=data)
    state = gp.AveragedLattice(packing).at_force(start["force"], finite_overlap=True)
    assert data["pressure"] * start["force"] == pytest.approx(2e8)
    assert (start["overlap"], start["mindlin"], start["width"]) == (True, True, 0.0)
    assert settings["torsion"] == pytest.approx(state.torsion)
    assert settings["spacing"] == pytest.approx(1.0 - state.relative_overlap)
    push = state.force / state.normal_stiffness / (packing.diameter * settings["spacing"])
    assert settings["push"] == pytest.approx(push)
    assert contact["stiffness"] == pytest.approx(state.normal_stiffness)


@needs_node
def test_a_link_restores_the_settings_and_forgives_what_is_wrong():
    data = describe_page(BALLS, [MediumChoice("afa")], FORCE)
    program = """const state = {...startState(data), force: 7.5, eta: 0.25, bending: 0.01, overlap: true, place: 0.625,
      branch: 2, motions: "all", theme: "dark"};
    const link = writeLink(data, state);
    console.log(JSON.stringify([state, readLink(data, "#" + link), readLink(data, "#f=x&eta=9&n=-4&motions=none&medium=no"),
      startState(data)]));"""
    state, again, forgiven, start = run_node(program, data=data)
    assert again == state
    assert forgiven == start | {"eta": 1.0, "branch": 0}


# -- one file --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page() -> str:
    return make_page(BALLS, [MediumChoice("afa")], FORCE, title="</title><script>a & b")


def test_everything_is_in_the_page(page):
    assert len(page.encode()) <= 6e6
    assert not re.search(
        r"""<(?:script|img|iframe)[^>]*\ssrc=|<link\b""", page[:20_000] + page[-120_000:]
    )
    assert "default-src 'none'" in page
    assert "<title>&lt;/title&gt;&lt;script&gt;a &amp; b</title>" in page
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    assert json.loads(found[1])["lattice"]["name"] == "triangular"
    for library in ("plotly", "three"):
        assert "MIT License" in read_asset(f"vendor/{library}.LICENSE")


def test_texts_cannot_end_the_script_that_holds_them():
    page = fill_template({"lattice": {"name": "</script><b>"}}, "x")
    assert "</script><b>" not in page
    assert "\\u003c/script>" in page


def test_modules_share_their_names_without_a_clash():
    """Joined modules are one script: a name that two of them had would be an error in the
    browser.
    """
    text = join_modules("main")
    names = re.findall(r"^(?:async )?(?:function|class|const|let) (\w+)", text, re.MULTILINE)
    assert len(names) > 60
    assert sorted(names) == sorted(set(names))
    assert not re.search(r"^(?:import|export)\b", text, re.MULTILINE)
    sources = {path.stem: path.read_text("utf-8") for path in ASSETS.glob("*.js")}
    assert {"main", *re.findall(r'from "\./(\w+)\.js"', "".join(sources.values()))} == set(sources)


def test_a_page_needs_neither_phonopy_nor_matplotlib():
    code = (
        "import granphon as gp\nfrom granphon.balls.loads import Load\nfrom"
        " granphon.media.choice import MediumChoice\n"
        "from granphon.page.page import make_page\n"
        "balls = gp.Packing(gp.Material(70e9, 0.22, 2500.0), 1e-3, lattice='fcc')\n"
        "make_page(balls, [MediumChoice('afa')], Load('force', 1.0))"
    )
    assert not {name.split(".")[0] for name in loaded_after(code)} & {
        "phonopy",
        "spglib",
        "matplotlib",
        "xarray",
    }


# -- the commands ----------------------------------------------------------------------------------


def read_data(path: Path) -> dict[str, Any]:
    found = re.search(r'id="data">(.*?)</script>', path.read_text("utf-8"), re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def test_a_page_of_a_scene(work, capsys):
    assert main(["page", "scene.yaml", "-o", "page.html"]) == 0
    assert capsys.readouterr() == ("Wrote page.html\n", "")
    data = read_data(work / "page.html")
    assert data["start"]["force"] == 18.446
    assert data["start"]["eta"] == pytest.approx(BALLS.mindlin_ratio)
    # for the slider of the width; equal balls are the same
    assert [one["name"] for one in data["media"]] == ["ema"]
    assert main(["page", "scene.yaml", "-o", "page.html"]) == 1
    assert "--force" in one_error(capsys)
    assert main(["page", "scene.yaml", "-o", "page.html", "--force"]) == 0


def test_a_sweep_makes_one_page_that_says_where_it_begins(work, capsys):
    text = SCENE.replace("{force: 18.446 N}", "{force: [10 N, 2 N, 50 N]}") + "medium: [ala, afa]\n"
    (work / "scene.yaml").write_text(text + "sweep: {width: [2 um, 4 um]}\n", encoding="utf-8")
    assert main(["page", "scene.yaml", "-o", "page.html"]) == 0
    data = read_data(work / "page.html")
    assert data["start"]["force"] == 10.0
    assert data["limits"]["force"][0] == pytest.approx(0.02)
    assert data["limits"]["force"][1] >= 50.0
    assert [one["name"] for one in data["media"]] == ["ala", "afa"]
    assert data["start"]["width"] == pytest.approx(2e-6)
    assert "width = 2 um" in data["remarks"][0]
    capsys.readouterr()
    assert main(["export", "scene.yaml", "-o", "modes.json"]) == 2
    assert "has many states" in one_error(capsys)


@pytest.mark.exhaustive
def test_a_simulation_with_a_history_is_tabulated_from_its_start():
    """Below the start there is no state, though the slider goes there."""
    packing = replace(BALLS, spread=gp.Uniform(2e-6))
    options = {
        "shape": (4, 4),
        "friction_history": True,
        "friction_coefficient": 0.2,
        "step_tolerance": 1e-2,
    }
    data = describe_page(packing, [MediumChoice("simulation", tuple(options.items()))], FORCE)
    table = data["media"][0]["table"]
    unit = packing.law.coefficient * packing.width**1.5
    assert data["limits"]["force"][0] < unit * np.exp(table["log_force"][0])
    simulation = gp.DirectSimulation(packing, **options)
    with pytest.raises(InputError, match="below the start"):
        simulation.at_force(unit * np.exp(table["log_force"][0] - 0.25))
    state = simulation.at_force(unit * np.exp(table["log_force"][0]))
    found = np.exp(table["log_stiffness"][0][0]) * unit / packing.width
    assert found == pytest.approx(state.normal_stiffness, rel=1e-6)


def test_an_automatic_medium_is_the_one_of_the_first_load_and_the_page_says_which():
    packing = replace(BALLS, spread=gp.Uniform(2e-6))
    load = Load("force", [6.0, 100.0, 200.0])
    auto = MediumChoice("auto", (("tolerance", 0.02),))
    served = [
        serving.medium.name
        for n in range(3)
        for serving in auto.choose(packing, load)
        if n in serving.loads
    ]
    assert served[0] != served[2] == "ala"
    data = describe_page(packing, [auto], load, remarks=["One."])
    assert [one["name"] for one in data["media"]] == served[:1]
    own, told = data["remarks"]
    assert own == "One."
    for words in (
        "first load",
        "auto(tolerance=0.02)",
        data["media"][0]["words"],
        f"({served[0]})",
    ):
        assert words in told
    data = describe_page(packing, [auto], Load("force", [200.0, 6.0]))
    assert [one["name"] for one in data["media"]] == ["ala"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["page", "scene.yaml", "-o", "page.txt"], "whose ending is not .html"),
        (["page", "scene.yaml", "-o", ""], "--out is empty"),
        (["page", "scene.yaml", "-o", "file/page.html"], "not a folder"),
        (["page", "none.yaml", "-o", "page.html"], "none.yaml"),
        (["export", "scene.yaml", "-o", "modes.xml"], "whose ending is not .json"),
        (["export", "scene.yaml", "-o", "modes.json", "--format", "xyz"], "Use phononwebsite"),
    ],
)
def test_what_cannot_be_done_is_one_error(work, capsys, arguments, said):
    (work / "file").write_text("")
    assert main(arguments) in (1, 2)
    assert said in one_error(capsys)
    assert {path.name for path in work.iterdir()} == {"scene.yaml", "file"}


def test_a_mechanism_is_an_error_where_the_scene_asks_for_its_medium_and_else_a_statement(
    work, capsys
):
    loose = SCENE.replace("lattice: triangular", "lattice: honeycomb") + "observe: [bands]\n"
    (work / "scene.yaml").write_text(
        loose.replace("8 mm", "8 mm, spread: {uniform: 2 um}"), encoding="utf-8"
    )
    assert main(["page", "scene.yaml", "-o", "page.html"]) == 2
    assert "honeycomb" in one_error(capsys)
    assert not (work / "page.html").exists()
    (work / "scene.yaml").write_text(loose, encoding="utf-8")
    assert main(["page", "scene.yaml", "-o", "page.html"]) == 0
    data = read_data(work / "page.html")
    assert data["media"][0]["refusal"]
    (motions,) = (one for one in data["lattice"]["motions"] if one["name"] == "in_plane")
    assert "gears" in motions["statements"]["100"]["mechanism"]


def test_listed_diameters_that_are_all_the_same_are_widened_evenly():
    same = replace(BALLS, spread=gp.Measured([8e-3, 8e-3]))
    even = replace(BALLS, spread=gp.Uniform(0.0))
    listed, expected = (describe_page(p, [MediumChoice("afa")], FORCE) for p in (same, even))
    assert listed["balls"]["spread"] == expected["balls"]["spread"] == "uniform"
    assert listed["media"] == expected["media"]
    assert listed["limits"] == expected["limits"]


@pytest.mark.parametrize("poisson_ratio", [0.0, -0.2])
def test_balls_with_the_largest_friction_of_the_slider_have_a_page(poisson_ratio):
    """Their eta is the last node of the table: no other node may be put there."""
    material = replace(BALLS.material, poisson_ratio=poisson_ratio)
    packing = replace(BALLS, material=material, spread=gp.Uniform(2e-6))
    data = describe_page(packing, [MediumChoice("ema")], FORCE)
    roots = data["media"][0]["table"]["roots"]
    assert data["start"]["eta"] == data["limits"]["eta"] == pytest.approx(roots[-1] ** 2)
    assert np.min(np.diff(roots)) > 0.01


def test_equal_balls_without_the_friction_that_holds_their_lattice_have_a_page():
    """The slider of friction goes to where the medium of balls that differ has a stiffness."""
    equal_balls = replace(BALLS, lattice="square", friction=False)
    data = describe_page(equal_balls, [MediumChoice("ema")], FORCE)
    assert data["start"]["eta"] == 0.0 < data["media"][0]["table"]["roots"][0]
    balls_that_differ = replace(equal_balls, spread=gp.Uniform(2e-6))
    with pytest.raises(MechanismError):
        describe_page(balls_that_differ, [MediumChoice("ema")], FORCE)


@pytest.mark.parametrize("lattice", ["triangular", "chain"])
def test_a_page_refuses_a_registered_medium(lattice):
    @gp.register_medium
    class Sorted(gp.AveragedForce):
        name = "sorted"

    try:
        with pytest.raises(InputError, match="sorted"):
            describe_page(replace(BALLS, lattice=lattice), [MediumChoice("sorted")], FORCE)
    finally:
        MEDIA.remove(Sorted.name)


def test_a_page_begins_with_one_direction():
    packing = gp.Packing(STEEL, 8e-3)
    with pytest.raises(InputError, match="direction"):
        describe_page(packing, [], Load("force", 1.0), direction=[[1.0, 0.0], [0.0, 1.0]])


# -- phononwebsite ---------------------------------------------------------------------------------


def test_phononwebsite_leaves_room_beside_a_wide_ribbon():
    """The cell of the viewer holds the whole ribbon, and the empty room."""
    packing = gp.Packing(STEEL, 8e-3, friction=False)
    ribbon = gp.AveragedLattice(packing).at_force(10.0).network.cut(1, 10)
    data = json.loads(write_phononwebsite(gp.Phonons(ribbon).bands(npoints=3), "ribbon"))
    across = np.array(data["atom_pos_red"])[:, 1]
    width = data["lattice"][1][1]
    # 9 rows of the height sqrt(3)/2, and six diameters
    assert width == pytest.approx(2.5 * (9.0 * 3.0**0.5 / 2.0 + 6.0))
    assert np.ptp(across) * width == pytest.approx(2.5 * 9.0 * 3.0**0.5 / 2.0)


@pytest.mark.parametrize(
    ("lattice", "motions"),
    [("triangular", None), ("kagome", "all"), ("fcc", None), ("chain", None)],
)
def test_phononwebsite_moves_balls_and_marks_as_the_modes_do(lattice, motions):
    packing = replace(BALLS, lattice=lattice, motions=motions)
    bands = gp.Phonons(gp.AveragedLattice(packing).at_force(18.446)).bands(npoints=5)
    data = json.loads(write_phononwebsite(bands, lattice))
    turns = bands.motions.rotate
    balls = LATTICES[lattice].n_balls
    per_ball = 3 if turns else 1
    assert (
        data["natoms"] == balls * per_ball == len(data["atom_types"]) == len(data["atom_pos_car"])
    )
    car, red, cell = (np.array(data[name]) for name in ("atom_pos_car", "atom_pos_red", "lattice"))
    assert np.allclose(red @ cell, car)
    q = np.array(data["qpoints"])
    vectors = np.array(data["vectors"]) @ [1.0, 1j]  # (q, b, atoms, 3)
    assert vectors.shape == (len(q), bands.n_branches, balls * per_ball, 3)
    # kHz
    assert np.allclose(np.array(data["eigenvalues"]) * 1e3, bands.frequencies.reshape(len(q), -1))
    # the kinetic energy of the balls: u, and the spin from the marks
    u = vectors.reshape(len(q), -1, balls, per_ball, 3)
    energy = np.sum(np.abs(u[..., 0, :]) ** 2, axis=(2, 3))
    if turns:
        x = u[..., 1, :] - u[..., 0, :]
        y = u[..., 2, :] - u[..., 0, :]
        phi = np.stack([y[..., 2], -x[..., 2], x[..., 1]], axis=-1) / 0.35
        assert np.allclose(x[..., 1], -y[..., 0])
        energy = energy + 0.1 * np.sum(np.abs(phi) ** 2, axis=(2, 3))
    assert np.allclose(energy, 1.0)
    # displacements have the phase of the ball: exp(2 pi i q.n) carries them to the cell n
    start = bands.eigenvectors.reshape(len(q), balls, -1, bands.n_branches)[:, :, 0]
    sites = red.reshape(balls, per_ball, 3)[:, 0]
    expected = start * np.exp(2j * np.pi * (q @ sites.T))[:, :, None]
    axis = bands.motions.translations[0]
    assert np.allclose(u[:, :, :, 0, axis], expected.swapaxes(1, 2))
    assert [end for _, end in data["line_breaks"]][-1] == len(q) == len(data["distances"])
    assert data["highsym_qpts"][0] == [0, "G"]


def test_the_export_of_a_scene(work, capsys):
    (work / "scene.yaml").write_text(
        SCENE + "phonopy: {band: GKMG, band_points: 6}\n", encoding="utf-8"
    )
    assert main(["export", "scene.yaml", "-o", "modes.json"]) == 0
    data = json.loads((work / "modes.json").read_text("utf-8"))
    assert data["name"] == "triangular (frequencies in kHz)"
    assert len(data["qpoints"]) == 18
    assert data["repetitions"] == [6, 6, 1]
    assert [label for _, label in data["highsym_qpts"]] == ["G", "K", "K", "M", "M", "G"]
