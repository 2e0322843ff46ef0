"""Benchmarks of pulses through networks of contacts: each with the bound that it is to keep.

One thread throughout.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from side_by_side import Part, Row, alternate

import granphon as gp
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator
from granphon.waves.pulses import Pulse

#: of the array, balls
SHAPE = (100, 400)
#: periods of the top frequency that the record lasts
PERIODS = 300
UNITS = gp.Units(8e-3, 3e6, 2e-3)
LATTICE = gp.ContactLattice.of("triangular", 0.8)
HERTZ = UNITS.angular_frequency / (2.0 * np.pi)


def disordered(shape: tuple[int, int]) -> ContactNetwork:
    """The triangular array with friction, stiffnesses of contacts from a half to three halves of
    the mean.
    """
    network = LATTICE.contact_network(UNITS).repeat(shape)
    factor = np.random.default_rng(1).uniform(0.5, 1.5, network.n_contacts)
    return replace(
        network,
        normal_stiffness=factor * network.normal_stiffness,
        shear_stiffness=factor * network.shear_stiffness,
    )


def leapfrog(operator: WaveOperator, push: np.ndarray, steps: int, step: float) -> float:
    """Seconds of processor time that the leapfrog method takes for ``steps`` of ``step``, per
    step.
    """
    matrix = operator.matrix
    x = np.zeros(operator.size)
    v = step * push
    start = time.process_time()
    for _ in range(steps):
        x += step * v
        v -= step * (matrix @ x)
    assert np.all(np.isfinite(x))
    return (time.process_time() - start) / steps


def pulse(repeats: int) -> list[Row]:
    """A pulse over 400 x 100 balls with friction, heard by a plane of 100 balls."""
    network = disordered(SHAPE)
    duration = PERIODS / (LATTICE.top_frequency * HERTZ)
    height = UNITS.length * np.sqrt(0.75)
    what = f"{SHAPE[1]}x{SHAPE[0]}, {PERIODS} periods of the top frequency"

    def send() -> Pulse:
        return gp.Waves(network).transmit(
            HERTZ, (0, 1), 100 * height, ends="periodic", duration=duration
        )

    found = send()
    seconds = alternate(min(repeats, 3), pulse=send)["pulse"]
    # what the leapfrog method would take for the same record: its phase is wrong by (omega
    # step)^2/24 of itself, so that a thousandth of a radian at the frequency of the pulse needs
    # this step
    omega = 2.0 * np.pi * HERTZ
    step = np.sqrt(24.0 * 1e-3 / (omega * duration)) / omega
    operator = WaveOperator(network)
    each = leapfrog(operator, np.ones(operator.size), 200, min(step, 1.0 / operator.top))
    least = each * duration / min(step, 2.0 / operator.top)
    speed = f"{len(found.receivers)} balls heard, {found.times.size} times"
    return [
        Row(f"{what}: time of a pulse", seconds, "s", 60.0, note=speed),
        Row(f"{what}: change of the energy", abs(found.loss), "", 1e-9),
        Row(
            f"{what}: time of a leapfrog method, its phase right to 1e-3",
            least,
            "s",
            note="steps alone, nothing heard",
        ),
    ]


def bandwidth(repeats: int) -> list[Row]:
    """The velocity of the envelope against the group velocity of the bands, at 40 cycles."""
    q = np.linspace(0.0, np.pi / np.sqrt(0.75), 400)[1:-1]
    modes = LATTICE.modes(q[:, None] * [0.0, 1.0])
    branch = np.argmax(modes.longitudinal_fraction, axis=1)
    omega = np.take_along_axis(modes.frequencies, branch[:, None], 1)[:, 0]
    rows = []
    for target in (1.0, 2.0):
        at = int(np.argmin(np.abs(omega - target)))
        group = modes.group_velocities[at, branch[at], 1] * UNITS.length * UNITS.angular_frequency
        lasting = 40 / (omega[at] * HERTZ)
        shape = (1, int(200 + 1.5 * group * lasting / UNITS.length))
        found = gp.Waves(LATTICE.contact_network(UNITS).repeat(shape)).transmit(
            omega[at] * HERTZ,
            (0, 1),
            60 * UNITS.length,
            40,
            ends="periodic",
            duration=lasting + 1.6 * 60 * UNITS.length / group,
        )
        of = f"ideal array, 40 cycles at {omega[at] / max(omega):.2g} of the top of the branch"
        rows.append(
            Row(f"{of}: velocity against the bands", abs(found.velocity / group - 1.0), "", 1e-3)
        )
    return rows


PARTS: dict[str, Part] = {"pulse": pulse, "bandwidth": bandwidth}
