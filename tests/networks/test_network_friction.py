"""Prestress of networks whose contacts bear static tangential forces: against LAMMPS' own response,
and by hand.
"""

import ctypes
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError, InstabilityError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.waves.operator import WaveOperator
from tests import packings
from tests.networks import liggghts
from tests.networks.test_lammps import measure

GLASS = packings.MATERIAL
#: dimension, number of balls, filled part of the box before and after it is pressed with friction,
#: seed
PACKINGS = {"disks": (2, 20, 0.80, 0.85, 1), "balls": (3, 24, 0.56, 0.60, 5)}


#: power of the overlap as which a tangential force grows at a constant slip, by LAMMPS' laws: the
#: slip of the past is kept, or the force; where it is scaled down with the radius of the contact,
#: the mean over growing and shrinking overlaps
POWERS = {
    "mindlin/force": 0.0,
    "mindlin": 0.5,
    "mindlin_rescale/force": 0.25,
    "mindlin_rescale": 0.75,
    "yade": 0.0,
    "liggghts": 0.5,
}


def cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def respond(network):
    """Stiffnesses -d(force, torque)/d(u, phi) over the roots of masses, contact by contact, by the
    law of LAMMPS.
    """
    count = network.n_balls
    p = network.dimension
    whole = np.zeros((6 * count, 6 * count))
    eye = np.eye(12)
    for c in range(network.n_contacts):
        i = network.i[c]
        j = network.j[c]
        n = network.normal[c]
        r = network.distance[c]
        arms = network.arm_i[c], network.arm_j[c]
        by_radii = network.slip_levers == "radii"
        reach = (network.radii[i], network.radii[j]) if by_radii else arms
        # of Hertz's law the overlap is 3 f/2 k
        overlap = 1.5 * network.normal_force[c] / network.normal_stiffness[c]
        grown = POWERS[network.tangential_law] / overlap if overlap > 0.0 else 0.0
        apart = eye[6:9] - eye[0:3]
        turned = (eye[3:6], eye[9:12])
        aside = apart - np.outer(n, n @ apart)
        slip = aside + cross(n) @ (reach[0] * turned[0] + reach[1] * turned[1])
        across = network.tangential_force[c]
        tilt = aside / r
        longer = n @ apart
        held = -network.shear_stiffness[c] * slip - np.outer(n, across @ tilt)
        held -= grown * np.outer(across, longer)
        push = (
            held
            - network.normal_stiffness[c] * np.outer(n, longer)
            + network.normal_force[c] * tilt
        )
        twist = [
            -arm * cross(n) @ held
            + arm * cross(across) @ tilt
            - 0.5 * np.outer(np.cross(n, across), longer)
            for arm in arms
        ]
        places = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        np.add.at(whole, np.ix_(places, places), -np.vstack([-push, twist[0], push, twist[1]]))
    axes = [*range(p), *([3, 4, 5] if p == 3 else [5])]
    kept = (6 * np.arange(count)[:, None] + axes).ravel()
    root = np.sqrt(
        np.column_stack([network.masses] * p + [network.inertias] * (len(axes) - p)).ravel()
    )
    return whole[np.ix_(kept, kept)] / root / root[:, None]


def press(lmp, dimension, count, loose, filled, seed, law="mindlin/force", rolling="", **options):
    """Press balls with friction, by a ``law`` of LAMMPS, until they are at rest; ``rolling`` are
    the words of rolling and twisting, and ``options`` those of the balls and their box.
    """
    packings.relax(lmp, dimension, count, loose, seed, **options)
    low, high = lmp.extract_box()[:2]
    side = (high[0] - low[0]) * (loose / filled) ** (1.0 / dimension)
    mass = GLASS.density * 4.0 / 3.0 * np.pi * 1e-9
    plane = dimension == 2
    sides = " ".join(f"{axis} final 0 {side!r}" for axis in "xyz"[:dimension])
    damped = packings.coefficients(f"{law} NULL 0.1 0.5 {rolling}")
    lmp.commands_string(f"""
        {damped.replace("70000000000.0 0 ", "70000000000.0 0.1 ")}
        timestep 1e-7
        thermo 100000000
        fix move all nve/sphere {"disc" if plane else ""}
        {"fix flat all enforce2d" if plane else ""}
        fix drag all viscous {0.2 * mass / 1e-6!r}
        fix turn all viscous/sphere {0.06 * mass!r}
        fix press all deform 1 {sides} remap x units box
        run 20000 post no
        unfix press
        run 40000 post no
        unfix drag
        unfix turn
        {"unfix flat" if plane else ""}
        unfix move
        velocity all set 0 0 0
        set group all omega 0 0 0""")


@pytest.fixture(scope="module", params=list(PACKINGS))
def pressed(request, tmp_path_factory):
    """A packing that LAMMPS has pressed with friction, and LAMMPS' own response."""
    try:
        running = packings.start()
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    press(running, *PACKINGS[request.param])
    folder = tmp_path_factory.mktemp(request.param)
    packings.write_dumps(running, folder / "atoms.dump", folder / "pairs.dump")
    read = gp.ContactNetwork.from_lammps(
        folder / "atoms.dump", folder / "pairs.dump", GLASS, prestress=True, keep_rattlers=True
    )
    found = measure(running, read, "mindlin/force NULL 0 1")
    running.close()
    return read, found


@pytest.mark.claim("network-friction")
def test_lammps_responds_as_the_network_with_tangential_forces(pressed):
    network, found = pressed
    force = network.normal_force[:, None] * network.normal + network.tangential_force
    assert np.mean(np.linalg.norm(network.tangential_force, axis=1)) > 0.05 * np.mean(
        network.normal_force
    )
    pull, turn = np.zeros((2, network.n_balls, 3))
    for end, sign, arm in ((network.j, 1.0, network.arm_j), (network.i, -1.0, network.arm_i)):
        np.add.at(pull, end, sign * force)
        np.add.at(turn, end, -arm[:, None] * np.cross(network.normal, network.tangential_force))
    assert np.max(np.abs(pull)) < 1e-6 * network.normal_force.mean()
    assert np.max(np.abs(turn)) < 1e-9 * network.normal_force.mean()
    # LAMMPS counts slip with the radii, and torques with the arms
    wanted = respond(network)
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.max(found))
    none = replace(network, tangential_force=np.zeros_like(network.normal))
    assert np.max(np.abs(found - respond(none))) > 1e-3 * np.max(found)


@pytest.mark.slow
@pytest.mark.claim("tangential-laws")
@pytest.mark.parametrize("name", list(PACKINGS))
def test_lammps_responds_by_its_law_of_displacements(name, tmp_path):
    """That of ``mindlin``, whose tangential forces grow with the overlap."""
    running = packings.start_or_skip()
    press(running, *PACKINGS[name], law="mindlin")
    packings.write_dumps(running, tmp_path / "atoms.dump", tmp_path / "pairs.dump")
    options = {"prestress": True, "keep_rattlers": True, "tangential_law": "mindlin"}
    network = gp.ContactNetwork.from_lammps(
        tmp_path / "atoms.dump", tmp_path / "pairs.dump", GLASS, **options
    )
    found = measure(running, network, "mindlin NULL 0 1")
    running.close()
    np.testing.assert_allclose(found, respond(network), atol=1e-5 * np.max(found))
    other = replace(network, tangential_law="mindlin/force")
    assert np.max(np.abs(found - respond(other))) > 1e-3 * np.max(found)


@pytest.mark.slow
@pytest.mark.claim("network-friction")
def test_lammps_responds_as_the_network_on_a_floor(tmp_path):
    """Of balls that have fallen onto it: the arm at a wall of LAMMPS is the radius, whatever the
    overlap, so that torques of the static tangential forces there do not change with it.
    """
    radii, places = liggghts.place(16, 1, [5e-3, 5e-3, 2e-2], (True, True, False))
    running = packings.start_or_skip()
    stick = "mindlin/force NULL 0 10"
    running.commands_string("""
        units si
        boundary p p f
        atom_style sphere
        atom_modify map array
        newton off
        comm_modify vel yes
        region box block 0 5e-3 0 5e-3 -1e-3 2e-2
        create_box 1 box""")
    running.create_atoms(16, list(range(1, 17)), [1] * 16, places.ravel().tolist())
    for ball, radius in enumerate(radii.tolist(), 1):
        diameter = 2.0 * radius
        running.command(f"set atom {ball} diameter {diameter!r} density {GLASS.density!r}")
    damped = packings.coefficients("mindlin/force NULL 0.1 0.5")
    running.commands_string(f"""
        pair_style granular
        {damped.replace("70000000000.0 0 ", "70000000000.0 0.1 ")}
        neighbor 4e-4 bin
        timestep 1e-7
        {add_floor(stick)}
        fix gravity all gravity 5e6 vector 0 0 -1
        fix move all nve/sphere
        fix drag all viscous 1e-2
        run 80000 post no
        unfix drag
        run 200000 post no
        unfix move
        velocity all set 0 0 0
        set group all omega 0 0 0
        dump fallen all custom 1 {tmp_path}/atoms.dump id x y z radius mass f_floor[*]
        dump_modify fallen sort id format float %.16g units yes""")
    packings.write_dumps(running, tmp_path / "others.dump", tmp_path / "pairs.dump")
    network = gp.ContactNetwork.from_lammps(
        tmp_path / "atoms.dump", tmp_path / "pairs.dump", GLASS, walls="floor", prestress=True,
        keep_rattlers=True,
    )  # fmt: skip
    at_wall = np.isinf(network.radii[network.j])
    assert np.min(np.linalg.norm(network.tangential_force[at_wall], axis=1)) > 0.0
    found = measure(running, network, "mindlin/force NULL 0 1")
    running.close()
    own = (WaveOperator(replace(network, slip_levers=one)).whole for one in ("radii", "arms"))
    error, other = (np.max(np.abs(found - one.toarray())) / np.max(found) for one in own)
    assert error < 1e-5
    assert other > 1e-4


def add_floor(law):
    of_wall = packings.coefficients(law).removeprefix("pair_coeff * * ")
    return f"fix floor all wall/gran granular {of_wall} zplane 0 NULL contacts"


@pytest.mark.claim("tangential-laws")
@pytest.mark.parametrize("law", [law for law in POWERS if law != "yade"])
def test_a_tangential_force_of_lammps_grows_with_the_overlap(law):
    """One of two balls turns by one step of time, so that a tangential force acts; then the overlap
    grows, or shrinks. LIGGGHTS' law of Hertz is that of ``gran/hertz/history``, from which it comes.
    """
    overlap = 2e-5
    step = 1e-9
    forces = {}
    for push in (0.0, step, -step):
        lmp = packings.start_or_skip()
        places = [(-1e-3 + 0.5 * overlap, 0.0, 0.0), (1e-3 - 0.5 * overlap, 0.0, 0.0)]
        packings.fill(lmp, "block -5e-3 5e-3 -5e-3 5e-3 -5e-3 5e-3", places, dimension=3)
        pair = """
            pair_style gran/hertz/history 70e9 50e9 0 0 0.5 0
            pair_coeff * *"""
        if law != "liggghts":
            pair = f"pair_style granular\n{packings.coefficients(f'{law} NULL 0 1e9')}"
        lmp.commands_string(f"""
            set type 1 diameter 2e-3 density 2500
            {pair}
            fix move all nve/sphere
            timestep 1e-12
            run 0 post no""")
        motion = np.zeros((2, 6))
        motion[0, 5] = 1e-4  # rad, which turn the surface by 1e-7 m
        press_pair = np.zeros((2, 6))
        press_pair[0, 0] = push
        for moved in (motion, press_pair):
            for name, values in (("v", moved[:, :3]), ("omega", moved[:, 3:])):
                numbers = (values / 1e-12).ravel()
                lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * 6)(*numbers))
            lmp.command("run 1 post no")
        forces[push] = np.array(lmp.gather_atoms("f", 1, 3)).reshape(2, 3)[1]
        lmp.close()
    slope = (forces[step][1] - forces[-step][1]) / (2.0 * step) / forces[0.0][1]
    assert abs(forces[0.0][1]) > 1e-3 * forces[0.0][0]
    assert slope * overlap == pytest.approx(POWERS[law], abs=1e-4)


@pytest.mark.claim("tangential-laws")
@pytest.mark.parametrize("law", ["mindlin", "mindlin_rescale"])
def test_every_tangential_law_is_that_of_its_power(pressed, law):
    """Of a network pressed by LAMMPS, in waves and in bands at the wave vector zero."""
    network = replace(pressed[0].without_rattlers(), tangential_law=law)
    whole = respond(network)
    operator = WaveOperator(network)
    np.testing.assert_allclose(operator.whole.toarray(), whole, atol=1e-12 * np.max(whole))
    squares = np.linalg.eigvalsh(operator.matrix.toarray())
    bands = ContactLattice.from_network(network).frequencies(np.zeros((1, network.dimension)))
    stiff = squares > 1e-4 * squares[-1]
    np.testing.assert_allclose(
        (bands[0] * network.scales.frequency * 2.0 * np.pi)[stiff] ** 2,
        squares[stiff],
        rtol=1e-9,
    )


def test_a_law_that_is_unknown_is_refused(lattice, tmp_path):
    with pytest.raises(InputError, match="tangential_law"):
        replace(lattice, tangential_law="coulomb")
    other = replace(lattice, tangential_law="mindlin")
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    other.write_tables(*files)
    read = gp.ContactNetwork.from_table(*files)
    assert read.tangential_law == "mindlin"
    assert gp.ContactNetwork.from_table(*files, tangential_law="yade").tangential_law == "yade"
    assert gp.ContactNetwork.from_dict(other.to_dict()) == other


@pytest.mark.claim("network-friction")
def test_the_symmetric_part_has_the_frequencies_of_the_whole(pressed):
    network = pressed[0].without_rattlers()
    operator = WaveOperator(network)
    whole = respond(network)
    ours = operator.matrix.toarray()
    np.testing.assert_allclose(ours, 0.5 * (whole + whole.T), atol=1e-12 * np.max(whole))
    own = np.linalg.eigvalsh(ours)
    theirs = np.sort(np.linalg.eigvals(whole).real)
    solid = theirs > 1e-5 * operator.top**2
    np.testing.assert_allclose(np.sqrt(own[solid]), np.sqrt(theirs[solid]), rtol=5e-4)
    by_arms = WaveOperator(replace(network, slip_levers="arms"))
    own = np.linalg.eigvalsh(by_arms.matrix.toarray())
    theirs = np.sort(np.linalg.eigvals(by_arms.whole.toarray()).real)
    np.testing.assert_allclose(np.sqrt(own[solid]), np.sqrt(theirs[solid]), rtol=1e-4)
    assert own[-1] < operator.top**2
    assert gp.Waves(network).modes(3).frequencies[0] > 0.0


@pytest.mark.claim("network-friction")
def test_great_overlaps_leave_the_symmetric_part_farther_from_the_whole():
    files = (packings.FOLDER / f"pressed_{part}.dump" for part in ("atoms", "pairs"))
    network = gp.ContactNetwork.from_lammps(
        *files, packings.MATERIAL, rolling_stiffness=1e5, prestress=True
    )
    overlap = 1.0 - network.distance / (network.radii[network.i] + network.radii[network.j])
    assert (np.mean(overlap), np.max(overlap)) == pytest.approx((0.033, 0.064), abs=5e-4)
    waves = gp.Waves(network)
    ratios = waves.modes(80).frequencies / waves.whole_modes(80).frequencies.real
    assert np.max(np.abs(ratios - 1.0)) == pytest.approx(2.5e-3, rel=0.02)


def test_packings_at_rest_are_not_refused_for_their_tangential_forces(pressed):
    """Balls in space with two contacts turn about the line through them: the normal forces alone
    push them aside.
    """
    network = pressed[0].without_rattlers()
    if network.dimension == 2:
        return
    assert np.any(np.bincount(np.r_[network.i, network.j]) == 2)
    with pytest.raises(InputError, match="tangential_force"):
        gp.Waves(replace(network, tangential_force=None))
    waves = gp.Waves(network)
    assert waves.modes(3).zero_modes >= 4
    top = waves.operator.top**2
    (D, whole) = (one.toarray() for one in (waves.operator.matrix, waves.operator.whole))
    assert (
        np.linalg.eigvalsh(D)[0]
        < -1e-7 * top
        < -1e-10 * top
        < np.min(np.linalg.eigvals(whole).real)
    )
    # a twentieth of the tangential forces away from balance, the ball falls
    pulled = replace(network, tangential_force=0.95 * network.tangential_force)
    assert np.min(np.linalg.eigvals(WaveOperator(pulled).whole.toarray()).real) < -1e-7 * top
    with pytest.raises(InputError, match="ball"):
        gp.Waves(pulled)


def test_packings_at_rest_are_not_refused_for_forces_that_are_left(pressed):
    """Forces with six digits leave 1e-6 of their mean on balls; where these are off by 1 %, the
    balls are not at rest.
    """
    network = pressed[0].without_rattlers()
    rng = np.random.default_rng(0)
    exact = gp.Waves(network).modes(3)
    for digits in (1e-6, 1e-5):
        rounded = replace(
            network,
            normal_force=network.normal_force
            * (1.0 + digits * rng.normal(size=network.n_contacts)),
        )
        waves = gp.Waves(rounded)
        assert digits < rounded.imbalance[2] < 10.0 * digits
        np.testing.assert_allclose(
            waves.modes(3).frequencies, exact.frequencies, rtol=10.0 * digits
        )
        assert waves.modes(3).zero_modes == exact.zero_modes
        assert waves.warnings == gp.Waves(network).warnings
    off = replace(
        network,
        normal_force=network.normal_force * (1.0 + 1e-2 * rng.normal(size=network.n_contacts)),
    )
    ball = off.labels[off.imbalance[0]]
    with pytest.raises(InputError, match=f"ball {ball} "):
        gp.Waves(off)


def press_one_contact(network, factor):
    """Return the network with another force at one of its contacts."""
    factors = np.where(np.arange(network.n_contacts) == 4, factor, 1.0)
    return replace(network, normal_force=network.normal_force * factors)


@pytest.fixture(scope="module")
def lattice():
    """Balls of an ideal lattice, at rest under their static forces."""
    state = gp.AveragedLattice(gp.Packing(GLASS, 2e-3)).at_force(1.0, finite_overlap=True)
    return state.network.repeat((3, 3))


def test_results_of_a_network_out_of_balance_say_so(lattice):
    assert not gp.Waves(lattice).warnings
    assert lattice.is_balanced
    off = press_one_contact(lattice, 1.003)
    assert off.imbalance[2] == pytest.approx(0.003, rel=1e-2)
    waves = gp.Waves(off)
    for found in (
        waves,
        waves.modes(2),
        waves.dos(),
        gp.Phonons(off).bands(npoints=2),
        gp.sound_velocities(off, (1, 0)),
    ):
        assert any(f"ball {off.imbalance[0]} add up" in warning for warning in found.warnings)
    assert replace(off, prestress=False).is_balanced


@pytest.mark.parametrize(
    "door", [gp.Waves, gp.Phonons, gp.moduli, lambda x: gp.sound_velocities(x, (1, 0))]
)
def test_a_packing_that_still_moves_is_refused(lattice, door):
    moving = press_one_contact(lattice, 1.01)
    with pytest.raises(InputError, match=f"ball {moving.imbalance[0]} .*prestress"):
        door(moving)
    door(replace(moving, prestress=False))
    # what the file of a packing with open ends lacks may hold the ball
    strip = press_one_contact(lattice.cut(0, 3), 1.01)
    assert any("a wall" in warning for warning in gp.Waves(strip).warnings)


def test_balls_that_rest_under_their_weight_are_taken(lattice):
    """One ball of a periodic layer does not move, and holds the weights of all others."""
    held = np.arange(lattice.n_balls) == 0
    still = replace(
        lattice,
        masses=np.where(held, np.inf, lattice.masses),
        inertias=np.where(held, np.inf, lattice.inertias),
    )
    weight = 0.05 * np.mean(still.normal_force)
    resting = packings.balance(still, [0.0, -weight, 0.0])
    assert resting.imbalance[2] == pytest.approx(0.05, rel=1e-2)
    resting.require_rest()
    # the message names a ball of the contact, though weights are larger
    moving = press_one_contact(resting, 1.02)
    ends = f"ball ({moving.i[4]}|{moving.j[4]}) "
    with pytest.raises(InputError, match=ends):
        moving.require_rest()


def hang(off=0.0):
    """A ball between two that do not move, which press it along the line through its two contacts,
    but for normal forces.
    """
    radius = 1e-3
    angle = 0.3
    force = 10.0
    normal = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.cos(angle), np.sin(angle), 0.0]])
    push = force * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    along = force * np.cos(angle)
    return gp.ContactNetwork(
        np.zeros((3, 3)),
        (False,) * 3,
        np.vstack([np.zeros(3), 2.0 * radius * normal]),
        np.full(3, radius),
        np.array([1e-5, np.inf, np.inf]),
        np.array([4e-12, np.inf, np.inf]),
        np.zeros(2, int),
        np.array([1, 2]),
        np.zeros((2, 3), int),
        normal,
        np.full(2, along * (1.0 + off)),
        np.full(2, 1e6),
        np.full(2, 8e5),
        np.zeros(2),
        np.zeros(2),
        np.full(2, radius),
        np.full(2, radius),
        prestress=True,
        tangential_force=push - along * normal,
    )


def test_a_ball_between_two_falls_by_the_force_that_is_left():
    """About the line through the contacts it turns freely; F h/2 is the torque that a force F left
    on it makes there.
    """
    height = 1e-3 * np.sin(0.3)
    for off in (1e-6, 1e-5, 1e-2):
        network = hang(off)
        (ball, left, part), operator = network.imbalance, WaveOperator(network)
        assert (ball, left) == (0, pytest.approx(off * 10.0 * np.sin(0.6)))
        assert part == pytest.approx(left / 10.0, rel=1e-2)
        lowest = np.min(np.linalg.eigvals(operator.whole.toarray()).real)
        assert lowest == pytest.approx(-0.5 * left * height / (1e-5 * height**2 + 4e-12), rel=1e-2)
        if off < 1e-2:
            assert gp.Waves(network).modes(1).zero_modes == 1
        else:
            with pytest.raises(InstabilityError, match=r"ball 0 .*0\.0565 N"):
                gp.Waves(network).modes(1)


def test_what_tangential_forces_have_along_normals_counts_as_normal():
    """Programs turn them to the plane of a contact a step late."""
    network = hang()
    along = 8e-3 * np.linalg.norm(network.tangential_force, axis=1) * np.array([1.0, -1.0])
    late = replace(
        network,
        normal_force=network.normal_force - along,
        tangential_force=network.tangential_force + along[:, None] * network.normal,
    )
    assert late.imbalance[2] < 1e-15
    ours = WaveOperator(network)
    theirs = WaveOperator(late)
    np.testing.assert_allclose(
        theirs.whole.toarray(), ours.whole.toarray(), atol=1e-14 * ours.top**2
    )
    assert gp.Waves(late).modes(1).zero_modes == 1


@pytest.mark.claim("network-friction-moduli")
@pytest.mark.parametrize(
    "pressed",
    ["disks", pytest.param("balls", marks=pytest.mark.slow)],
    indirect=True,
    scope="module",
)
def test_bands_and_sound_of_packings_with_tangential_forces(pressed, monkeypatch):
    network = pressed[0].without_rattlers()
    matrix = WaveOperator(network).matrix.toarray()
    top = float(np.linalg.eigvalsh(matrix)[-1])
    scale = network.scales.angular_frequency
    lattice = ContactLattice.from_network(network)
    at_gamma = lattice.frequencies(np.zeros((1, network.dimension)))[0] * scale
    solid = at_gamma**2 > 1e-5 * top
    np.testing.assert_allclose(
        at_gamma[solid] ** 2, np.linalg.eigvalsh(matrix)[solid], atol=1e-12 * top
    )
    # sound is the slope of the lowest branches, and the same by dense matrices and by sparse ones
    direction = np.array([0.6, 0.8] if network.dimension == 2 else [0.6, 0.64, 0.48])
    waves = gp.sound_velocities(network, direction)
    tensor = lattice.elastic_tensor()
    q = 1e-2
    modes = lattice.modes(q * direction[None])
    monkeypatch.setattr("granphon.dynamics.long_waves.MANY_COLUMNS", 0)
    sparse = ContactLattice._make_of_network(network)
    # both leave out spins, of which D lacks the second order
    np.testing.assert_allclose(sparse.elastic_tensor(), tensor, rtol=0.0, atol=1e-6)
    shift = modes.eigenvectors[0].reshape(network.n_balls, -1, lattice.n_branches)[
        :, : network.dimension
    ]
    together = np.einsum("n,nab->ab", np.sqrt(network.masses / network.masses.sum()), shift)
    sound = np.sort(np.argsort(np.sum(np.abs(together) ** 2, axis=0))[-network.dimension :])
    slow = modes.frequencies[0, sound] / q * network.scales.velocity
    # in space D lowers the squares of spins by a hundredth of those of sound at this q, and mixes
    # them a little
    np.testing.assert_allclose(
        slow, waves.velocities, rtol=2e-4 if network.dimension == 2 else 2e-3
    )


@pytest.mark.claim("network-without-forces")
def test_what_a_network_without_static_forces_leaves_out(pressed):
    network = pressed[0].without_rattlers()
    whole, normal, none = (
        np.linalg.eigvalsh(WaveOperator(one).matrix.toarray())
        for one in (
            network,
            replace(network, tangential_force=np.zeros_like(network.normal)),
            replace(network, prestress=False),
        )
    )
    solid = whole > 1e-5 * whole[-1]
    off = [
        float(np.max(np.abs(np.sqrt(one[solid] / whole[solid]) - 1.0))) for one in (normal, none)
    ]
    assert (
        0.01
        < 1.0 - np.mean(network.distance / (network.radii[network.i] + network.radii[network.j]))
        < 0.03
    )
    assert off[0] < (1e-3 if network.dimension == 2 else 5e-3)
    assert 0.02 < off[1] < 0.05


@pytest.mark.filterwarnings("ignore:.* the static (forces|torques)")
def test_prestress_without_tangential_forces_is_a_warning(tmp_path):
    balls = packings.FOLDER / "yade_balls.csv"
    rows = (packings.FOLDER / "yade_contacts.csv").read_text().splitlines()
    contacts = tmp_path / "bare.csv"
    # eleven columns are left, without tangential forces and arms
    contacts.write_text("".join(",".join(row.split(",")[:11]) + "\n" for row in rows))
    with pytest.warns(InconsistencyWarning, match="tangential.*p1, p2, p3"):
        gp.ContactNetwork.from_table(balls, contacts, cell=[5.5e-3] * 3, prestress=True)
    given = {"i": [0], "j": [1], "tangential_x": [0.0], "tangential_y": [0.3]}
    places = {"x": [0.0, 1.99e-3], "y": [0.0, 0.0], "radius": [1e-3] * 2}
    with pytest.warns(InconsistencyWarning, match="static forces on ball 0"):
        known = gp.ContactNetwork.from_table(
            places, given, material=GLASS, prestress=True, keep_rattlers=True
        )
    known.write_tables(tmp_path / "balls.csv", tmp_path / "contacts.csv")
    with pytest.warns(InconsistencyWarning, match="static forces on ball 0"):
        read = gp.ContactNetwork.from_table(
            tmp_path / "balls.csv", tmp_path / "contacts.csv", keep_rattlers=True
        )
    assert read == known
    state = gp.AveragedLattice(gp.Packing(GLASS, 2e-3)).at_force(1.0, finite_overlap=True)
    assert not np.any(state.network.repeat((3, 3)).tangential_force)


@pytest.mark.parametrize("mu", [pytest.param(0.05, marks=pytest.mark.slow), 0.2])
def test_exact_histories_in_fcc_have_modes(mu):
    packing = gp.Packing(
        gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(8e-5), lattice="fcc"
    )
    state = gp.DirectSimulation(
        packing,
        (3, 3, 3),
        1,
        geometry="exact",
        friction_history=True,
        friction_coefficient=mu,
        step_tolerance=1.0,
    ).at_overlap(1.6e-6)
    network = state.sample.respond("stick").network.without_rattlers()
    assert np.any(network.tangential_force)
    assert gp.Waves(network).modes(3).frequencies[0] > 0.0
    whole = respond(network)
    np.testing.assert_allclose(
        WaveOperator(network).matrix.toarray(), 0.5 * (whole + whole.T), atol=1e-12 * np.max(whole)
    )
