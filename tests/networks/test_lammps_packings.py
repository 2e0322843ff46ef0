"""Packings that LAMMPS makes, of every kind that its dumps can hold, against LAMMPS' own forces."""

import numpy as np
import pytest

import granphon as gp
from granphon.waves.operator import WaveOperator
from tests import packings
from tests.networks.test_lammps import measure, respond

GLASS = packings.MATERIAL
ROLLING = 3e5
TWISTING = 0.02
FREE = "linear_nohistory 0 0"
STICK = "mindlin NULL 0 1e9"
ROLL = f"{STICK} rolling sds {ROLLING} 0 1e9 twisting sds {TWISTING} 0 1e9"
SPACE = pytest.mark.slow
#: balls along each axis, the tilts of the box in spacings, the axis across which a floor and a lid
#: are, the law of slip, rolling and twisting, and what the reader is told of it
PACKINGS = {
    "tilted": ((3, 3), (0.8, 0, 0), "", FREE, {"friction": False}),
    "rolling": ((3, 3), (0, 0, 0), "", ROLL, {"rolling_stiffness": ROLLING}),
    "walls": ((3, 3), (0, 0, 0), "y", STICK, {"walls": ["floor"]}),
    "frozen": ((3, 3), (0.4, 0, 0), "", STICK, {"frozen": {"type": 2, "id": [5]}}),
    "tilted in space": ((3, 3, 3), (0.5, 0.3, -0.4), "", STICK, {}),
    "rolling in space": (
        (3, 3, 3), (0, 0, 0), "", ROLL,
        {"rolling_stiffness": ROLLING, "twisting_stiffness": TWISTING},
    ),
    "marshall": (
        (3, 3, 3), (0, 0, 0), "", f"{STICK} twisting marshall", {"twisting_stiffness": "marshall"},
    ),
    "frozen bottom": (
        (3, 3, 2), (0, 0, 0), "z", STICK, {"walls": "floor", "frozen": {"type": 2}},
    ),
}  # fmt: skip
#: of balls in a plane and in space, m
SPACINGS = {2: 1.92e-3, 3: 1.84e-3}


def relax(lmp, counts, tilts, wall):
    """Put balls of three sizes on a grid, nearer than their diameters, and let them come to
    rest.
    """
    dimension = len(counts)
    spacing = SPACINGS[dimension]
    grid = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, dimension)
    places = np.zeros((len(grid), 3))
    places[:, :dimension] = grid + 0.5
    places[:, :dimension] += np.random.default_rng(2).uniform(-0.06, 0.06, grid.shape)
    xy, xz, yz = tilts
    skew = np.array([[1.0, 0.0, 0.0], [xy / counts[1], 1.0, 0.0], [0.0, 0.0, 1.0]])
    if dimension == 3:
        skew[2, :2] = xz / counts[2], yz / counts[2]
    sides = [spacing * count for count in counts]
    bounds = [f"0 {side!r}" for side in sides] + ["-2e-3 2e-3"] * (3 - dimension)
    edges = ["f" if axis == wall else "p" for axis in "xyz"]
    lmp.commands_string(f"""
        units si
        dimension {dimension}
        boundary {" ".join(edges)}
        atom_style sphere
        atom_modify map array
        newton off
        comm_modify vel yes
        region box prism {" ".join(bounds)} {" ".join(repr(spacing * tilt) for tilt in tilts)}
        create_box 2 box""")
    count = len(grid)
    lmp.create_atoms(
        count, list(range(1, count + 1)), [1] * count, (spacing * places @ skew).ravel().tolist()
    )
    for ball in range(1, count + 1):
        diameter = 2.0 * (0.9e-3, 1.0e-3, 1.1e-3)[ball % 3]
        lmp.command(f"set atom {ball} diameter {diameter!r} density {GLASS.density!r}")
        if ball % counts[-1] == 1:
            lmp.command(f"set atom {ball} type 2")
    lmp.commands_string(f"""
        pair_style granular
        {packings.coefficients(FREE)}
        neighbor 2e-4 bin
        timestep 1e-8
        thermo 1000000""")
    if wall:  # walls of LAMMPS do not act on balls that are minimised
        drag = 0.4 * GLASS.density * 4.0 / 3.0 * np.pi * 1e-9 / 1e-6
        lmp.commands_string(f"""
            {add_floor(counts, wall, FREE)}
            timestep 1e-7
            fix move all nve/sphere
            {"fix flat all enforce2d" if dimension == 2 else ""}
            fix drag all viscous {drag!r}
            run 8000 post no
            unfix drag
            unfix move
            {"unfix flat" if dimension == 2 else ""}
            velocity all set 0 0 0""")
    else:
        lmp.commands_string("""
            min_style fire
            min_modify dmax 1e-5
            minimize 0 1e-9 20000 100000""")


def add_floor(counts, wall, law):
    """The line of a floor and a lid across an axis; none without an axis."""
    if not wall:
        return ""
    side = SPACINGS[len(counts)] * counts["xyz".index(wall)]
    of_wall = packings.coefficients(law).removeprefix("pair_coeff * * ")
    return f"fix floor all wall/gran granular {of_wall} {wall}plane 0 {side!r} contacts"


def write(lmp, folder, wall):
    """Write the two dumps of the present state, those of the atoms as text and as YAML."""
    columns = "id type x y z radius mass" + (" f_floor[*]" if wall else "")
    lmp.commands_string(f"""
        dump text all custom 1 {folder}/text.dump {columns}
        dump_modify text sort id format float %.16g units yes
        dump yaml all yaml 1 {folder}/atoms.yaml {columns}
        dump_modify yaml sort id format float %.16g units yes
        dump packed all custom/gz 1 {folder}/atoms.dump.gz {columns}
        dump_modify packed sort id format float %.16g""")
    packings.write_dumps(lmp, folder / "atoms.dump", folder / "pairs.dump")
    lmp.commands_string("undump text\nundump yaml\nundump packed")


@pytest.fixture(
    params=[
        pytest.param(name, marks=SPACE if len(about[0]) == 3 else ())
        for name, about in PACKINGS.items()
    ]
)
def packed(request, tmp_path):
    """A packing of LAMMPS, its dumps, and what the reader is told."""
    counts, tilts, wall, law, told = PACKINGS[request.param]
    running = packings.start_or_skip()
    relax(running, counts, tilts, wall)
    write(running, tmp_path, wall)
    running.command(add_floor(counts, wall, law) or "run 0 post no")
    yield running, tmp_path, wall, law, told
    running.close()


@pytest.mark.claim("network-lammps-kinds")
def test_lammps_responds_as_the_network_of_its_dumps(packed):
    lmp, folder, wall, law, told = packed
    options = {"material": GLASS, "prestress": True, "keep_rattlers": True} | told
    network = gp.ContactNetwork.from_lammps(folder / "text.dump", folder / "pairs.dump", **options)
    for name in ("atoms.yaml", "atoms.dump.gz"):
        same = gp.ContactNetwork.from_lammps(folder / name, folder / "pairs.dump", **options)
        assert same == network
    n_frozen = {2: 4, 1: 9}[len(told["frozen"])] if "frozen" in told else 0
    assert np.count_nonzero(~network.moving) == n_frozen + bool(wall)
    assert network.imbalance[2] < 1e-6
    if wall:
        assert np.count_nonzero(np.isinf(network.radii)) == 1
        assert np.count_nonzero(np.isinf(network.radii[network.j])) >= 4
    friction = told.get("friction", True)
    expected = respond(network)
    found = measure(lmp, network, law)
    if not friction:  # balls do not turn
        kept = np.arange(len(found)) % 3 < 2
        found = found[np.ix_(kept, kept)]
    greatest = np.max(np.abs(expected))
    np.testing.assert_allclose(found, expected, atol=1e-5 * greatest)
    # the frequencies, of the symmetric part
    ours = np.linalg.eigvalsh(WaveOperator(network).matrix.toarray())
    theirs = np.sort(np.linalg.eigvals(found).real)
    solid = ours > 1e-4 * ours[-1]
    # slip is counted with the radii there, and with the arms in a network
    radii = network.radii[network.i]
    rtol = np.max(1.0 - network.arm_i / radii) if friction else 1e-5
    np.testing.assert_allclose(np.sqrt(theirs[solid]), np.sqrt(ours[solid]), rtol=rtol)
