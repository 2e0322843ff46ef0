"""Networks from the files of LIGGGHTS and YADE, against the programs' own forces.

Both have pressed the packings that are kept, with the lines of the page; the response to a motion
of each ball is kept beside them (``tests/networks/liggghts.py``, ``tests/networks/yade.py``).
"""

import re
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.networks.sources import TANGENTIAL_LAWS
from granphon.waves.operator import WaveOperator
from tests import packings
from tests.networks import liggghts, yade
from tests.networks.test_lammps import respond

GLASS = packings.MATERIAL
KEYWORDS = "pos id force delta"


def read_liggghts(folder, name="", **options):
    """The packing of the dumps in a folder, at rest, with its loose balls."""
    options = {"keywords": KEYWORDS, "prestress": True, "keep_rattlers": True} | options
    walls = folder / f"{name}walls.dump"
    return gp.ContactNetwork.from_liggghts(
        folder / f"{name}atoms.dump",
        folder / f"{name}pairs.dump",
        GLASS,
        walls=walls if walls.exists() else None,
        **options,
    )


def read_yade(folder, name="", **options):
    """The packing of the tables in a folder, at rest, with its loose balls."""
    files = (folder / f"{name}{part}.csv" for part in ("balls", "contacts"))
    options = {"prestress": True, "tangential_law": "yade", "keep_rattlers": True} | options
    return gp.ContactNetwork.from_table(*files, **options)


def read_kept(name):
    if name == "yade":
        return read_yade(packings.FOLDER, "yade_", cell=[yade.SIDE] * 3)
    return read_liggghts(packings.FOLDER, f"{name}_")


def weigh(network, response, first):
    """The ``response`` of balls, whose labels count from ``first``, over the roots of masses, in
    the order of the balls that move.
    """
    moving = network.moving
    rows = (6 * (network.labels[moving] - first)[:, None] + np.arange(6)).ravel()
    inertias = [network.masses[moving]] * 3 + [network.inertias[moving]] * 3
    root = np.sqrt(np.column_stack(inertias).ravel())
    return response[np.ix_(rows, rows)] / root / root[:, None]


def differ(network, theirs):
    """The greatest difference of matrices, over the greatest entry."""
    return np.max(np.abs(respond(network) - theirs)) / np.max(np.abs(theirs))


@pytest.fixture(scope="module", params=["liggghts", "liggghts_floor", "yade"])
def kept(request):
    """A packing that is kept, and the program's own response."""
    network = read_kept(request.param)
    with np.load(liggghts.RESPONSES) as responses:
        response = responses[request.param].astype(float)
    return request.param, network, weigh(network, response, 0 if request.param == "yade" else 1)


@pytest.mark.claim("network-programs")
def test_programs_respond_as_the_network(kept):
    """By the word of the program; by that of another one the error is of first order in the static
    forces.
    """
    name, network, theirs = kept
    across = np.mean(np.linalg.norm(network.tangential_force, axis=1))
    assert across > 0.1 * network.mean_force
    assert differ(network, theirs) < 1e-6
    others = {"tangential_law": "mindlin/force" if name != "yade" else "mindlin"}
    if name != "liggghts_floor":  # whose overlaps are small
        assert differ(replace(network, slip_levers="radii"), theirs) > 1e-3
    assert differ(replace(network, **others), theirs) > 1e-3
    assert differ(replace(network, prestress=False), theirs) > 1e-2


@pytest.mark.claim("network-programs")
def test_the_lowest_modes_are_those_of_programs(kept):
    _, network, theirs = kept
    network = network.without_rattlers()
    waves = gp.Waves(network)
    whole = waves.whole_modes(10).frequencies
    assert np.max(np.abs(whole.imag)) == 0.0
    # squares of loose balls, and of all balls that move as one, are zero
    squares = np.sort(np.linalg.eigvals(theirs).real)
    squares = squares[squares > 1e-6 * squares[-1]]
    lowest = np.sqrt(squares[:10]) / (2.0 * np.pi)
    np.testing.assert_allclose(whole.real, lowest, rtol=1e-5)
    np.testing.assert_allclose(waves.modes(10).frequencies, lowest, rtol=5e-3)


@pytest.mark.parametrize("kept", ["yade"], indirect=True, scope="module")
def test_slip_and_forces_of_yade_in_bands(kept):
    """At the wave vector zero, where bands and waves have the symmetric part of one matrix."""
    network = kept[1].without_rattlers()
    squares = np.linalg.eigvalsh(WaveOperator(network).matrix.toarray())
    lattice = ContactLattice.from_network(network)
    bands = lattice.frequencies(np.zeros((1, 3)))[0] * network.scales.angular_frequency
    stiff = squares > 1e-4 * squares[-1]
    np.testing.assert_allclose(bands[stiff] ** 2, squares[stiff], rtol=1e-9)


def test_the_law_of_yade_has_levers_of_its_own(tmp_path):
    """Without a word they are those of the law, and a table that granphon wrote keeps its own."""
    network = read_kept("yade")
    assert network.slip_levers == "yade"
    by_arms = replace(network, slip_levers="arms")
    for one in (network, by_arms):
        files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
        one.write_tables(*files)
        assert gp.ContactNetwork.from_table(*files, keep_rattlers=True) == one


@pytest.mark.parametrize(("law", "turns"), [("yade", True), ("mindlin/force", False)])
def test_forces_turn_with_two_balls_that_turn_as_one(law, turns):
    """A rotation w of both, of two sizes, turns the force F and the torques M of their contact by
    w x F and w x M: about the normal only by the law of YADE.
    """
    arms = np.array([1.15e-3, 0.75e-3])
    normal = np.array([2.0, -1.0, 2.0]) / 3.0
    across = 3.0 * np.cross(normal, [0.0, 0.6, 0.8])
    network = gp.ContactNetwork(
        np.zeros((3, 3)), (False,) * 3, np.outer([0.0, arms.sum()], normal), arms + 5e-5,
        np.ones(2), np.ones(2), np.array([0]), np.array([1]), np.zeros((1, 3), int),
        normal[None], np.array([20.0]), np.array([1e6]), np.array([8e5]), np.zeros(1),
        np.zeros(1), arms[:1], arms[1:], prestress=True, tangential_force=across[None],
        tangential_law=law, slip_levers=TANGENTIAL_LAWS[law].levers,
    )  # fmt: skip
    force = 20.0 * normal + across
    torques = -arms[:, None] * np.cross(normal, across)
    stiffness = WaveOperator(network).whole.toarray()
    for axis in (normal, across / 3.0, np.array([0.3, -0.5, 0.2])):
        motion = np.concatenate(
            [np.concatenate([np.cross(axis, place), axis]) for place in network.positions]
        )
        turned = axis if turns else axis - normal * (axis @ normal)
        pushed = [-np.cross(turned, force), np.cross(turned, force)]
        # what turns about the normal in the torque is that of the tangential force
        wanted = np.concatenate(
            [
                vector
                for pair in zip(pushed, np.cross(turned, torques), strict=True)
                for vector in pair
            ]
        )
        np.testing.assert_allclose(-stiffness @ motion, wanted, atol=1e-9)


def test_a_law_of_rolling_has_its_word():
    """Of LIGGGHTS: the bending stiffness follows from the shear stiffness; at the wall contacts
    count rotations as they are at the distance of its plane.
    """
    network = read_liggghts(
        packings.FOLDER, "liggghts_floor_", rolling_stiffness="epsd2", keep_rattlers=True
    )
    at_wall = np.isinf(network.radii[network.j])
    reduced = 1.0 / (1.0 / network.radii[network.i] + 1.0 / network.radii[network.j])
    ratios = np.where(at_wall, network.arm_i / (2.0 * network.arm_i - reduced), 1.0)
    assert np.max(ratios) > 1.0 + 1e-3
    np.testing.assert_allclose(
        network.bending_stiffness, network.shear_stiffness * reduced**2 * ratios, rtol=1e-12
    )
    assert not np.any(network.torsion_stiffness)
    files = (packings.FOLDER / f"disks_{part}.dump" for part in ("atoms", "pairs"))
    with pytest.raises(InputError, match="rolling_stiffness"):
        gp.ContactNetwork.from_lammps(*files, GLASS, rolling_stiffness="epsd2")
    with pytest.raises(InputError, match="epsd2"):
        read_liggghts(packings.FOLDER, "liggghts_floor_", rolling_stiffness="epsd")


# -- the programs themselves -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.claim("network-programs")
@pytest.mark.parametrize(
    ("name", "keywords"),
    [("liggghts", KEYWORDS), ("liggghts_floor", KEYWORDS), ("liggghts_floor", None)],
)
def test_liggghts_responds_as_the_network(name, keywords, tmp_path):
    """By the lines of the page, and by a compute without keywords."""
    if liggghts.find_program() is None:
        pytest.skip("LIGGGHTS is not installed")
    lines = None if keywords else list_every_column(liggghts.read_page())
    pressed = liggghts.press(tmp_path, *liggghts.KEPT[name], lines=lines)
    for part, text in pressed.dumps.items():
        (tmp_path / f"{part}.dump").write_text(text)
    network = read_liggghts(tmp_path, keywords=keywords)
    theirs = weigh(network, pressed.response, 1)
    assert differ(network, theirs) < 1e-7
    if keywords:
        assert network == read_kept(name)


@pytest.mark.slow
@pytest.mark.claim("network-programs")
@pytest.mark.parametrize("name", ["liggghts", "liggghts_floor"])
def test_liggghts_responds_as_the_network_that_rolls(name, tmp_path):
    """At rest under static torques of rolling, which stay as they are when balls move."""
    if liggghts.find_program() is None:
        pytest.skip("LIGGGHTS is not installed")
    pressed = liggghts.press(tmp_path, *liggghts.KEPT[name], rolls=True)
    for part, text in pressed.dumps.items():
        (tmp_path / f"{part}.dump").write_text(text)
    network = read_liggghts(tmp_path, rolling_stiffness="epsd2")
    torque = np.max(np.abs(network.unbalanced[1]))  # that of the static rolling of contacts
    assert torque > 0.1 * network.mean_force * np.mean(liggghts.RADII)
    assert differ(network, weigh(network, pressed.response, 1)) < 1e-7


def list_every_column(lines):
    """The lines of the page with all columns of a compute without keywords: 25 under this law."""
    for which in ("pair", "wall"):
        columns = " ".join(f"c_{which}[{number}]" for number in range(1, 26))
        lines = re.sub(rf"c_{which}\[1\](?:.|\n)*?c_{which}\[13\]", columns, lines)
    lines = lines.replace("pos id force delta", "")
    return re.sub(r'format "(?:%.16g ?){13}"', f'format "{25 * "%.16g "}"', lines)


@pytest.mark.slow
@pytest.mark.claim("network-programs")
@pytest.mark.parametrize(
    ("law", "walls", "options"),
    [
        ("mindlin", False, {}),
        ("linear", False, {}),
        ("by the arms", False, {"slip_levers": "arms"}),
        ("mindlin", True, {}),
    ],
)
def test_yade_responds_as_the_network(law, walls, options, tmp_path):
    """By the script of the page, under laws and ways to count slip, and between walls."""
    if yade.find_program() is None:
        pytest.skip("YADE is not installed")
    side = 6.2e-3 if walls else yade.SIDE
    pressed = yade.press(tmp_path, law, *yade.KEPT[1:3], walls, side)
    cell = {} if walls else {"cell": [side] * 3}
    network = read_yade(tmp_path, **cell, **options)
    assert np.mean(np.linalg.norm(network.tangential_force, axis=1)) > 0.05 * network.mean_force
    theirs = weigh(network, pressed.response, 0)
    assert differ(network, theirs) < 1e-6
