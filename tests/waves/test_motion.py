"""What is found of balls in motion: peaks, fronts, spectra, harmonics, in closed form on motions
that are made up.
"""

from __future__ import annotations

import math
import os
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError, OutputError
from granphon.runs.wave_records import Passage

N = 12
FRAMES = 801
SPACING = 1e-3
V = 3.0


def make(displacements=None, forces=None):
    """A motion of balls 2 m apart along x, with contacts between neighbours."""
    times, still, zero = np.linspace(0.0, 1.0, FRAMES), np.zeros((FRAMES, N, 3)), np.zeros(FRAMES)
    chain = (
        gp.Crystal.on("chain", [gp.Ball(gp.Material(1e9, 0.3, 1e3), 2.0)])
        .at_force(1.0)
        .network.cut(0, N)
    )
    moved = still if displacements is None else displacements(times)
    pushed = (
        np.zeros((FRAMES, N - 1))
        if forces is None
        else forces(times[:, None], chain.positions[1:, 0] - 1.0)
    )
    return gp.Motion(
        times,
        moved,
        still,
        still,
        still,
        pushed,
        0.0 * pushed,
        zero,
        zero,
        zero,
        zero,
        zero,
        1e-4,
        chain,
    )


def test_distances_from_a_driven_flat_wall_are_those_from_its_plane():
    """The place by which a flat wall is given may be anywhere."""
    chain = gp.Crystal.on("chain", [gp.Ball(gp.Material(1e9, 0.3, 1e3), 2.0)]).at_force(1.0)
    network = chain.network.cut(0, N - 1, ("free", "floor"))
    positions = network.positions.copy()
    positions[-1] = positions[0]
    motion = replace(make(), network=replace(network, positions=positions))
    distances = Passage.of(motion, np.array([N - 1])).distances
    assert_allclose(distances, 2.0 * np.arange(N - 2, -1, -1), rtol=1e-3, atol=1e-3)


def late(motion, count):
    """The last frames of a motion, as they are read of a file."""
    return replace(
        motion,
        **{
            name: getattr(motion, name)[-count:]
            for name, one in motion._shapes.items()
            if one[0] == "f"
        },
    )


def test_peaks_and_velocities_of_a_pulse():
    """A parabola in time is found to rounding; a front is where the force has risen to its
    share.
    """
    motion = make(forces=lambda t, x: 5.0 + np.maximum(2.0 - 1e3 * (t - 0.2 - x / 80.0) ** 2, 0.0))
    times, heights = motion.peaks()
    assert_allclose(heights, 7.0, rtol=1e-12)
    assert_allclose(times, 0.2 + motion.middles[:, 0] / 80.0, rtol=1e-9)
    assert_allclose(motion.pulse_velocity(range(11)), 80.0, rtol=1e-9)
    assert_allclose(motion.passages(), times, rtol=1e-12)
    assert_allclose(motion.arrivals(0.5), times - math.sqrt(1e-3), atol=1e-5)
    assert_allclose(motion.pulse_velocity(range(11), of="front", share=0.5), 80.0, rtol=1e-4)
    assert np.all(np.isinf(make().arrivals()))


def test_an_echo_does_not_count_and_a_run_may_be_too_short():
    """The first maxima count, though what comes back from the end is higher; a force that still
    rises has none.
    """

    def push(t, x, back):
        onwards = t - 0.1 - x / 80.0
        echo = t - 0.1 - (44.0 - x) / 80.0
        return 5.0 + np.exp(-((onwards / 0.01) ** 2)) + back * np.exp(-((echo / 0.01) ** 2))

    for back in (0.0, 1.0, 1.6):
        motion = make(forces=lambda t, x, back=back: push(t, x, back))
        for of in ("peak", "front"):
            assert_allclose(motion.pulse_velocity(range(8), of=of), 80.0, rtol=1e-3)
    # the pulse is at x = 24 m, between contacts 11 and 12, where the run ends
    short = {
        name: getattr(motion, name)[:281] for name, one in motion._shapes.items() if one[0] == "f"
    }
    short = replace(motion, **short)
    assert np.flatnonzero(np.isnan(short.passages())).tolist() == [10]
    assert_allclose(short.pulse_velocity(range(9)), 80.0, rtol=1e-3)
    with pytest.raises(InputError, match="contact 10"):
        short.pulse_velocity(range(11))


def test_a_velocity_is_that_of_a_straight_line_that_rises():
    forces = {
        # it comes from the other end
        "no later": lambda t, x: np.exp(-(((t - 0.9 + x / 80.0) / 0.01) ** 2)),
        # it diffuses
        "no straight line": lambda t, x: np.exp(-(((t - 0.1 - x * x / 800.0) / 0.01) ** 2)),
        "scatter": lambda t, x: np.exp(
            -(((t - 0.3 - x / 400.0 - 0.1 * np.sin(4.0 * x)) / 0.01) ** 2)
        ),
    }
    for words, push in forces.items():
        motion = make(forces=lambda t, x, push=push: 5.0 + push(t, x))
        for of in ("peak", "front"):
            with pytest.raises(InputError, match=words):
                motion.pulse_velocity(range(11), of=of)
    with pytest.raises(InputError, match="no later"):
        make(forces=lambda t, x: push(t, x)).pulse_velocity([0, 4, 9], direction=(0, 0, 1))


def test_a_hit_chain_has_one_velocity_however_long_it_is_heard():
    """Against a floor at its other end, from which an echo comes; while the pulse is on its way
    there is none.
    """
    ball = gp.Ball(gp.Material(193e9, 0.30, 7958.0), 19.05e-3)
    network = gp.Crystal.on("chain", [ball]).at_force(20.0).network.cut(0, 30, ("free", "floor"))
    velocities = np.zeros((network.n_balls, 3))
    velocities[0, 0] = 0.1
    run = gp.NonlinearWaves(network).run(1.6e-3, velocities=velocities, frames=321)
    found = []
    for frames in (101, 201, 321):
        short = {
            name: getattr(run, name)[:frames] for name, one in run._shapes.items() if one[0] == "f"
        }
        motion = replace(run, **short)
        if frames == 101:  # 0.5 ms, 0.26 m of 0.57 m
            with pytest.raises(InputError, match="does not pass contact"):
                motion.pulse_velocity(range(5, 20))
        else:
            found.append(motion.pulse_velocity(range(5, 20)))
            assert_allclose(Passage.of(motion, np.array([0])).peak, found[-1], rtol=0.02)
    assert_allclose(found[0], found[1], rtol=1e-12)
    long_waves = gp.sound_velocities(gp.Crystal.on("chain", [ball]).at_force(20.0)).longitudinal
    assert long_waves < found[0] < 1.2 * long_waves


def test_few_frames_are_refused_or_tell_the_velocity():
    """Thinned frames of a chain that is hit: what they tell converges, and what follows the pulse
    is not taken for it.
    """
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    network = gp.Crystal.on("chain", [ball]).at_force(10.0).network.repeat((40,)).cut(0, 1)
    velocities = np.zeros((network.n_balls, 3))
    velocities[0, 0] = 0.01
    run = gp.NonlinearWaves(network).run(6e-4, velocities=velocities, frames=721)
    for of in ("peak", "front"):
        fine = run.pulse_velocity([5, 25], of=of)
        errors = {}
        for every in (2, 3, 4, 6, 8, 10, 12, 15, 20, 24, 40, 60, 80, 120, 180, 240, 360):
            names = [name for name, one in run._shapes.items() if one[0] == "f"]
            few = replace(run, **{name: getattr(run, name)[::every] for name in names})
            if np.isfinite(few.passages(of)[[5, 25]]).all():
                errors[every] = abs(few.pulse_velocity([5, 25], of=of) / fine - 1.0)
                continue
            assert every > 10
            with pytest.raises(InputError, match=r"contact (5|25)\b.*frames"):
                few.pulse_velocity([5, 25], of=of)
        assert errors[2] < 1e-4
        assert max(errors.values()) < 0.01
        # as the square of the step of frames
        assert max(errors[2], errors[3]) < max(errors[8], errors[10]) / 5.0
    assert run.pulse_velocity([5, 25]) == pytest.approx(579.05, rel=1e-4)


def test_places_where_balls_meet_across_the_cell():
    """They are on the line to the nearest image, not half a cell away from it."""
    motion = make()
    net = replace(motion.network, cell=np.diag([2.0 * N, 0.0, 0.0]), pbc=(True, False, False))
    motion = replace(
        motion, network=net, met=np.array([[1, N - 1], [0, 2]]), forces=np.zeros((FRAMES, N + 1))
    )
    along = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    assert_allclose(motion.middles[N - 1 :], net.positions[0] + along, atol=1e-12)


def test_the_greatest_force_may_be_the_first_or_the_last():
    """Of contacts that a pull unloads, or that are still being pressed, it is that of the frame
    itself.
    """
    motion = make(forces=lambda t, x: np.where(x < 10.0, 5.0 - t, 5.0 + t**2))
    times, heights = motion.peaks()
    assert_allclose(heights, motion.forces.max(axis=0), rtol=0.0)
    assert_allclose(times, np.where(motion.middles[:, 0] < 10.0, 0.0, 1.0), rtol=0.0)


def test_a_peak_by_rounding_is_finite():
    """A force that one frame has larger by the last digit has its peak beside that frame."""
    times, heights = make(
        forces=lambda t, x: np.where(t == 0.5, 1.0, 1.0 - 2.0**-53) + 0.0 * x
    ).peaks()
    assert_allclose(heights, 1.0)
    assert_allclose(times, 0.5, rtol=1e-12)
    times, _ = make(forces=lambda t, x: np.where(t < 0.5, 1.0 - 2.0**-53, 1.0) + 0.0 * x).peaks()
    assert_allclose(times, 0.5, atol=2.0 / FRAMES)


def test_few_frames_have_no_parabola():
    motion = make(forces=lambda t, x: 1.0 + t * (1.0 + x))
    for frames in (1, 2):
        cut = {name: getattr(motion, name)[:: FRAMES - 1][:frames] for name in ("times", "forces")}
        few = replace(motion, **cut)
        times, heights = few.peaks()
        assert_allclose(heights, few.forces[-1])
        assert_allclose(times, few.times[-1])
        assert np.all(np.isinf(few.arrivals()) == (frames == 1))


def test_a_spectrum_and_harmonics_of_a_steady_motion():
    """Amplitudes and phases of three multiples, over a mean that is left out."""
    f, sizes = 20.0, np.array([1.0 + 0.5j, 0.2j, -0.03])

    def move(times):
        out = np.zeros((FRAMES, N, 3))
        waves = np.exp(-2j * math.pi * f * times[:, None] * np.arange(1, 4)) @ sizes
        out[:, :, 1] = 0.7 + waves.real[:, None] * (1.0 + np.arange(N))
        return out

    motion = make(move)
    assert_allclose(motion.harmonics(f, axis=1), sizes[:, None] * (1.0 + np.arange(N)), rtol=1e-10)
    frequencies, amplitudes = motion.spectrum(3, axis=1)
    assert_allclose(amplitudes[20], 4.0 * abs(sizes[0]), rtol=5e-3)
    assert_allclose(frequencies[20], f, rtol=2e-3)
    assert_allclose(motion.positions[0, 5, 0], 10.0)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda m: m.pulse_velocity([0]), "contacts are"),
        (lambda m: m.pulse_velocity([0, 99]), "indices of contacts"),
        (lambda m: m.pulse_velocity([0, 1], of="foot"), "of: found"),
        (lambda m: m.pulse_velocity([0, 1]), "does not pass"),
        (lambda m: m.pulse_velocity([0, 1], direction=(0, 0, 0)), "direction"),
        (lambda m: m.arrivals(0.0), "share"),
        (lambda m: m.pulse_velocity([0, 1], share=0.5), "a peak has none"),
        (lambda m: m.pulse_velocity([1, 1]), "each once"),
        (lambda m: m.spectrum(99), "ball"),
        (lambda m: m.harmonics(1.0), "periods in the run"),
        (lambda m: m.harmonics(300.0), "in a period"),
        (lambda m: late(m, 50).harmonics(20.0), "in the run"),
        (lambda m: late(m, 3).spectrum(0), "3 frames.*spectrum"),
        (lambda m: late(m, 1).harmonics(1.0), "0 frames"),
        (lambda m: m.harmonics(20.0, axis=3), "axis"),
        (lambda m: m.harmonics(5e-324, 1, 1), "periods in the run"),
        (lambda m: m.harmonics(10**400, 1), "frequency"),
        (lambda m: m.harmonics(20.0, 10**400), "count"),
        (lambda m: m.harmonics(20.0, 1, 0, 10**400), "periods"),
        (lambda m: gp.Motion.read(7), "Give a path"),
    ],
)
def test_bad_questions_are_one_error(ask, words):
    with pytest.raises(InputError, match=words):
        ask(make())


@pytest.mark.parametrize("mode", ["text", "closed", "rb", "ab", "filled", "pipe"])
def test_a_stream_that_cannot_hold_a_motion_is_one_error(mode, tmp_path):
    path = tmp_path / "motion.nc"
    path.write_bytes(b"earlier")
    with ExitStack() as stack:
        if mode == "pipe":
            reader, writer = os.pipe()
            stack.callback(os.close, reader)
            stream = stack.enter_context(open(writer, "wb"))
        else:
            other_mode = {"text": "r+", "closed": "rb", "filled": "r+b"}
            stream = stack.enter_context(open(path, other_mode.get(mode, mode)))
            if mode == "closed":
                stream.close()
        with pytest.raises(InputError, match="binary"):
            make().write(stream)
    assert path.read_bytes() == b"earlier"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_stream_that_is_full_is_one_error():
    with (
        open("/dev/full", "wb", buffering=0) as full,
        pytest.raises(OutputError, match="space"),
    ):
        make().write(full)


@pytest.mark.parametrize(
    "frames", [slice(None, None, np.int64(-1)), slice(None, None, 0), slice(0.5, None), 3]
)
def test_frames_that_are_no_slice_forward_are_one_error(frames, tmp_path):
    make().write(tmp_path / "motion.nc")
    with pytest.raises(InputError, match="frames"):
        gp.Motion.read(tmp_path / "motion.nc", frames)


def test_a_motion_replaces_one_that_was_cut_off_without_a_warning(tmp_path):
    path = tmp_path / "motion.nc"
    motion = make()
    motion.write(path)
    path.write_bytes(path.read_bytes()[:-8])
    motion.write(path)
    assert gp.Motion.read(path) == motion


def test_a_motion_on_springs_to_the_ground_is_written_with_the_contacts_that_came_about(tmp_path):
    """The motions of a ball, one here, are another axis of the file than these contacts, two."""
    motion = make()
    forces = np.pad(motion.forces, ((0, 0), (0, 2)))
    network = replace(motion.network, on_site=np.full((N, 1), 2.0))
    held = replace(
        motion, network=network, forces=forces, shears=forces, met=np.array([[0, 2], [1, 3]])
    )
    held.write(tmp_path / "motion.nc")
    assert gp.Motion.read(tmp_path / "motion.nc") == held


def test_contacts_that_came_about_are_between_nearest_images_in_a_tilted_cell():
    ball = gp.Ball(gp.Material(1e9, 0.3, 1e3), 2.0)
    network = gp.Crystal.on("triangular", [ball]).at_force(1.0).network.repeat((4, 4))
    n = network.n_balls
    met = np.array([(0, j) for j in range(1, n)])
    zeros, vectors = np.zeros(1), np.zeros((1, n, 3))
    forces = np.zeros((1, network.n_contacts + len(met)))
    motion = gp.Motion(
        times=zeros,
        displacements=vectors,
        velocities=vectors,
        rotations=vectors,
        spins=vectors,
        forces=forces,
        shears=forces,
        translation=zeros,
        rotation=zeros,
        stored=zeros,
        lost=zeros,
        work=zeros,
        step=1.0,
        network=network,
        met=met,
    )
    steps = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2), axis=-1).reshape(-1, 2)
    images = network.positions[1:, None] - network.positions[0] + steps @ network.cell[:2]
    lengths = np.min(np.linalg.norm(images, axis=2), axis=1)
    arms = motion.middles[network.n_contacts :] - network.positions[0]
    assert_allclose(2.0 * np.linalg.norm(arms, axis=1), lengths, rtol=1e-12)


def test_a_file_of_a_motion_is_no_sweep(tmp_path):
    make().write(tmp_path / "motion.nc")
    with pytest.raises(InputError, match=r"motion.*gp.plot\(gp.Motion"):
        gp.load_sweep(tmp_path / "motion.nc")
