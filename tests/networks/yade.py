"""Packings that YADE presses, and what YADE answers to small motions of their balls.

``python -m tests.networks.yade`` writes the packing of :data:`KEPT` into ``examples/packings``, and
its response beside this module, for tests where YADE is not installed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests import packings
from tests.networks.liggghts import PAGE, keep

#: side of the periodic cell of the packing that is kept, m
SIDE = 5.5e-3
#: functors of YADE, by the names of contact laws, and whether slip avoids the ratcheting of YADE's
#: documentation, as it does by default
LAWS = {
    "mindlin": "Ip2_FrictMat_FrictMat_MindlinPhys(), Law2_ScGeom_MindlinPhys_Mindlin(), True",
    "linear": "Ip2_FrictMat_FrictMat_FrictPhys(), Law2_ScGeom_FrictPhys_CundallStrack(), True",
    "by the arms": "Ip2_FrictMat_FrictMat_MindlinPhys(), Law2_ScGeom_MindlinPhys_Mindlin(), False",
}
#: Young's modulus of a law, Pa; that of the linear one gives stiffnesses E R
MODULI = {"linear": 2e9}
#: balls in a cell or between walls come to rest; the names in capitals are put in front
PRESS = """
import math
import random

random.seed(SEED)
sizes = [random.choice([0.8e-3, 1.0e-3, 1.2e-3]) for _ in range(COUNT)]
loose = 9e-3 if WALLS else 7.2e-3
O.periodic = not WALLS
if not WALLS:
    O.cell.setBox(loose, loose, loose)
glass = FrictMat(young=YOUNG, poisson=POISSON, density=DENSITY, frictionAngle=0.4)
O.materials.append(glass)
places = []
while len(places) < COUNT:
    margin = 1.2e-3 if WALLS else 0.0
    new = [random.uniform(margin, loose - margin) for _ in range(3)]
    free = True
    for old, size in zip(places, sizes):
        apart = [a - b for a, b in zip(new, old)]
        if not WALLS:
            apart = [a - loose * round(a / loose) for a in apart]
        free = free and sum(a * a for a in apart) > (size + sizes[len(places)]) ** 2
    if free:
        places.append(new)
for new, size in zip(places, sizes):
    O.bodies.append(sphere(new, size, material=glass))
if WALLS:
    walls = [
        O.bodies.append(wall(end * loose, axis, sense=0, material=glass))
        for axis in range(3)
        for end in range(2)
    ]
ip2, law2, avoids_ratcheting = FUNCTORS
O.engines = [
    ForceResetter(),
    InsertionSortCollider(
        [Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()], allowBiggerThanPeriod=not WALLS
    ),
    InteractionLoop(
        [
            Ig2_Sphere_Sphere_ScGeom(avoidGranularRatcheting=avoids_ratcheting),
            Ig2_Wall_Sphere_ScGeom(),
        ],
        [ip2],
        [law2],
    ),
    NewtonIntegrator(damping=0.3, label="newton"),
]
O.dt = 1e-7
steps = 40000
if WALLS:
    for axis in range(3):
        for end in range(2):
            speed = [0.0, 0.0, 0.0]
            speed[axis] = (0.5 - end) * (loose - SIDE) / (steps * O.dt)
            O.bodies[walls[2 * axis + end]].state.vel = Vector3(speed)
    O.run(steps, True)
    for number in walls:
        O.bodies[number].state.vel = Vector3.Zero
else:
    rate = math.log(SIDE / loose) / (steps * O.dt)
    O.cell.velGrad = rate * Matrix3.Identity
    O.run(steps, True)
    O.cell.velGrad = Matrix3.Zero
    O.run(1, True)  # the rate changes after the next step
    O.cell.setBox(SIDE, SIDE, SIDE)
O.run(100000, True)
for b in O.bodies:
    b.state.vel = b.state.angVel = Vector3.Zero
"""
#: each ball moves along each axis by one step, back, by one step the other way, and back; slip adds
#: up along the way. No contact slides
MEASURE = """
newton.dead = True
for c in O.interactions:
    if c.isReal:
        c.phys.tangensOfFrictionAngle = 1e9


def move(ball, axis, size):
    unit = Vector3([float(k == axis % 3) for k in range(3)])
    state = O.bodies[ball].state
    if axis < 3:
        state.pos = state.pos + size * unit
        state.vel = size / O.dt * unit
    else:
        state.angVel = size / O.dt * unit
    O.step()
    state.vel = state.angVel = Vector3.Zero
    # only the call with True sums the forces of this step
    return [
        number
        for k in range(COUNT)
        for vector in (O.forces.f(k, True), O.forces.t(k, True))
        for number in vector
    ]


move(0, 0, 0.0)
with open("response.csv", "w") as response:
    for ball in range(COUNT):
        for axis in range(6):
            size = SIZE if axis < 3 else SIZE / 1e-3
            ahead, _, behind, _ = [move(ball, axis, sign * size) for sign in (1, -1, -1, 1)]
            column = [(b - a) / (2.0 * size) for a, b in zip(ahead, behind)]
            response.write(",".join(map(repr, column)) + "\\n")
"""
SIZE = 5e-11
#: law, number of balls, seed, whether walls hold them, and the side, m
KEPT = ("mindlin", 24, 5, False, SIDE)


class Pressed(NamedTuple):
    """The two tables of the page, as texts, and the response (6 n, 6 n) of the balls, N/m, N, and
    N m: minus the derivatives of forces and torques by displacements and rotations.
    """

    balls: str
    contacts: str
    response: np.ndarray


def find_program() -> str | None:
    """The path of YADE, or None."""
    return shutil.which("yade")


def read_page() -> str:
    """The script of the page, which writes the tables."""
    match = re.search(r"```\{code-block\} python\n(with open.*?)```", PAGE.read_text(), re.DOTALL)
    assert match is not None
    return match[1]


def press(folder: Path, law: str, count: int, seed: int, has_walls: bool, side: float) -> Pressed:
    """Press balls in a periodic cell, or between walls, until they are at rest under friction;
    write the tables into the ``folder`` by the script of the page, and measure the response.
    """
    glass = packings.MATERIAL
    names = {
        "SEED": seed,
        "COUNT": count,
        "WALLS": has_walls,
        "SIDE": side,
        "SIZE": SIZE,
        "YOUNG": MODULI.get(law, glass.young_modulus),
        "POISSON": glass.poisson_ratio,
        "DENSITY": glass.density,
    }
    head = "\n".join(f"{name} = {value!r}" for name, value in names.items())
    head += f"\nFUNCTORS = ({LAWS[law]})\n"
    (folder / "press.py").write_text(head + PRESS + read_page() + MEASURE)
    program = find_program()
    assert program is not None
    done = subprocess.run(
        [program, "-x", "-n", "press.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-2000:]
    response = np.loadtxt(folder / "response.csv", delimiter=",").T
    return Pressed(
        (folder / "balls.csv").read_text(), (folder / "contacts.csv").read_text(), response
    )


if __name__ == "__main__":
    if find_program() is None:
        sys.exit("YADE is not installed")
    with tempfile.TemporaryDirectory() as where:
        pressed = press(Path(where), *KEPT)
    (packings.FOLDER / "yade_balls.csv").write_text(pressed.balls)
    (packings.FOLDER / "yade_contacts.csv").write_text(pressed.contacts)
    keep({"yade": pressed.response})
