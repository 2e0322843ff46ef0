"""Packings that LIGGGHTS presses, and what LIGGGHTS answers to small motions of their balls.

``python -m tests.networks.liggghts`` writes the packings of :data:`KEPT` into
``examples/packings``, and their responses beside this module, for tests where LIGGGHTS is not
installed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests import packings

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "dem.md"
#: the responses of the packings that are kept
RESPONSES = Path(__file__).parent / "responses.npz"
#: number of balls, their seed
KEPT = {"liggghts": (24, 1, False), "liggghts_floor": (16, 1, True)}
RADII = (0.8e-3, 1.0e-3, 1.2e-3)
#: side of the box, m, before and after balls are pressed in all directions; and of that over a
#: floor, with its height
SIDES = 7.2e-3, 5.6e-3
FLOOR = 5e-3, 2e-2
#: displacement of a ball, m, and the step of time in which it is made, s
SIZE = 5e-11
STEP = 1e-12
MOTIONS = ("vx", "vy", "vz", "omegax", "omegay", "omegaz")


class Pressed(NamedTuple):
    """The last frames of the dumps, as texts by their names, and the response (6 n, 6 n) of the
    balls, N/m, N, and N m: minus the derivatives of forces and torques by displacements and
    rotations.
    """

    dumps: dict[str, str]
    response: np.ndarray


def find_program() -> str | None:
    """The path of LIGGGHTS, or None."""
    return shutil.which("liggghts")


def read_page() -> str:
    """The lines that the page gives, which write the dumps."""
    match = re.search(r"```\{code-block\} text\n(compute.*?)```", PAGE.read_text(), re.DOTALL)
    assert match is not None
    return match[1]


def place(count: int, seed: int, sides: list[float], pbc: tuple[bool, bool, bool]) -> Any:
    """Radii (n,) and places (n, 3), m, of balls in a box that do not touch."""
    rng = np.random.default_rng(seed)
    radii = rng.choice(RADII, count)
    largest = max(RADII)
    places = np.zeros((0, 3))
    box = np.array(sides)
    repeats = np.array(pbc)
    while len(places) < count:
        new = rng.uniform(np.where(repeats, 0.0, largest), np.where(repeats, box, box - largest))
        apart = places - new
        apart -= np.where(repeats, box * np.rint(apart / box), 0.0)
        reach = radii[: len(places)] + radii[len(places)]
        if np.all(np.linalg.norm(apart, axis=1) > reach):
            places = np.vstack([places, new])
    return radii, places


def press(
    folder: Path,
    count: int,
    seed: int,
    on_floor: bool,
    *,
    lines: str | None = None,
    rolls: bool = False,
) -> Pressed:
    """Press balls in a periodic box until they are at rest under friction, or let them fall onto a
    floor; write the dumps into the ``folder`` by the ``lines`` of a script, by default those of the
    page, and measure the response. If it ``rolls``, contacts resist rolling by the law epsd2.

    Balls that touch keep the slip of the past. A ball is displaced by one step of time at a
    velocity, as the slip adds up along the way; then there is no damping, and no contact slides.
    """
    sides = [FLOOR[0], FLOOR[0], FLOOR[1]] if on_floor else [SIDES[0]] * 3
    pbc = (True, True, not on_floor)
    radii, places = place(count, seed, sides, pbc)
    density = packings.MATERIAL.density
    rows = [
        f"{ball} 1 {2.0 * radius!r} {density!r} {x!r} {y!r} {z!r}"
        for ball, (radius, (x, y, z)) in enumerate(
            zip(radii.tolist(), places.tolist(), strict=True), 1
        )
    ]
    low = -1e-3 if on_floor else 0.0
    bounds = [f"0 {sides[0]!r} xlo xhi", f"0 {sides[1]!r} ylo yhi", f"{low!r} {sides[2]!r} zlo zhi"]
    head = ["balls", "", f"{count} atoms", "1 atom types", "", *bounds, "", "Atoms", ""]
    (folder / "balls.data").write_text("\n".join([*head, *rows, ""]))
    (folder / "floor.stl").write_text(_floor_text())
    dumps = lines or read_page()
    if not on_floor:  # without a mesh there is no contact with one
        dumps = re.sub(r"^.*wall(?:.*&\n.*)?.*\n", "", dumps, flags=re.MULTILINE)
        dumps = re.sub(r"^dump_modify +3 .*\n", "", dumps, flags=re.MULTILINE)
    script = [_start_text(on_floor, rolls), dumps, _rest_text(on_floor), _measure_text(count)]
    (folder / "press.in").write_text("\n".join(script))
    program = find_program()
    assert program is not None
    done = subprocess.run(
        [program, "-in", "press.in", "-log", "none"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    names = ("atoms", "pairs", "walls") if on_floor else ("atoms", "pairs")
    texts = {name: _last_frame(folder / f"{name}.dump") for name in names}
    return Pressed(texts, _read_response(folder / "forces.dump", count))


def _floor_text() -> str:
    """The floor, two triangles that span the box, as STL."""
    side = FLOOR[0]
    corners = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)]
    text = ["solid floor"]
    for triangle in ((0, 1, 2), (0, 2, 3)):
        text += ["facet normal 0 0 1", "outer loop"]
        text += [f"vertex {corners[corner][0]!r} {corners[corner][1]!r} 0" for corner in triangle]
        text += ["endloop", "endfacet"]
    return "\n".join([*text, "endsolid floor", ""])


def _start_text(on_floor: bool, rolls: bool) -> str:
    """The balls, their law, and what presses them."""
    glass = packings.MATERIAL
    low = 0.5 * (SIDES[0] - SIDES[1])
    pushed = " ".join(f"{axis} final {low!r} {SIDES[0] - low!r}" for axis in "xyz")
    model = f"model hertz tangential history{' rolling_friction epsd2' if rolls else ''}"
    floor = f"""
        fix floor all mesh/surface file floor.stl type 1
        fix walls all wall/gran {model} mesh n_meshes 1 meshes floor
        fix gravity all gravity 1e6 vector 0 0 -1"""
    return f"""
        units si
        hard_particles yes
        atom_style granular
        atom_modify map array
        boundary p p {"f" if on_floor else "p"}
        newton off
        communicate single vel yes
        read_data balls.data
        neighbor 4e-4 bin
        neigh_modify delay 0
        fix young all property/global youngsModulus peratomtype {glass.young_modulus!r}
        fix poisson all property/global poissonsRatio peratomtype {glass.poisson_ratio!r}
        fix bounce all property/global coefficientRestitution peratomtypepair 1 0.2
        fix friction all property/global coefficientFriction peratomtypepair 1 0.5
        fix rolling all property/global coefficientRollingFriction peratomtypepair 1 0.1
        pair_style gran {model}
        pair_coeff * *
        timestep 1e-7
        thermo 1000000
        fix move all nve/sphere
        fix drag all viscous 1e-2
        {floor if on_floor else f"fix press all deform 1 {pushed} remap x units box"}"""


def _rest_text(on_floor: bool) -> str:
    """The run until balls are at rest."""
    return f"""
        run 40000
        {"" if on_floor else "unfix press"}
        run 40000
        unfix drag
        run 100000
        undump 1
        undump 2
        {"undump 3" if on_floor else ""}"""


def _measure_text(count: int) -> str:
    """Each ball moves along each axis by one step, back, by one step the other way, and back."""
    text = [
        "unfix move",
        "velocity all set 0 0 0",
        "set group all omegax 0 omegay 0 omegaz 0",
        "unfix bounce",
        "unfix friction",
        "unfix rolling",
        "fix bounce all property/global coefficientRestitution peratomtypepair 1 1.0",
        "fix friction all property/global coefficientFriction peratomtypepair 1 1e6",
        "fix rolling all property/global coefficientRollingFriction peratomtypepair 1 1e6",
        "fix move all nve/sphere",
        f"timestep {STEP!r}",
        "dump forces all custom 1 forces.dump id fx fy fz tqx tqy tqz",
        'dump_modify forces sort id format "%d' + 6 * " %.17g" + '"',
    ]
    for ball in range(1, count + 1):
        for motion in MOTIONS:
            speed = _size_of(motion) / STEP
            for sign in (1.0, -1.0, -1.0, 1.0):
                text += [f"set atom {ball} {motion} {sign * speed!r}", "run 1 post no"]
            text.append(f"set atom {ball} {motion} 0")
    return "\n".join([*text, ""])


def _size_of(motion: str) -> float:
    """The displacement, m, or the rotation, rad, by which a ball moves."""
    return SIZE if motion.startswith("v") else SIZE / 1e-3


def _read_response(path: Path, count: int) -> np.ndarray:
    frames = path.read_text().split("ITEM: TIMESTEP\n")[1:]
    rows = [[line.split()[1:] for line in frame.splitlines()[-count:]] for frame in frames]
    forces = np.array(rows, float)[-4 * 6 * count :].reshape(6 * count, 4, 6 * count)
    sizes = np.tile([_size_of(motion) for motion in MOTIONS], count)
    return ((forces[:, 2] - forces[:, 0]) / (2.0 * sizes[:, None])).T


def _last_frame(path: Path) -> str:
    return "ITEM: TIMESTEP" + path.read_text().rpartition("ITEM: TIMESTEP")[2]


def keep(responses: dict[str, np.ndarray]) -> None:
    """Write ``responses`` beside those that are kept, with the digits that differences have."""
    kept: dict[str, Any] = dict(np.load(RESPONSES)) if RESPONSES.exists() else {}
    kept |= {name: response.astype(np.float32) for name, response in responses.items()}
    np.savez_compressed(RESPONSES, **kept)


if __name__ == "__main__":
    if find_program() is None:
        sys.exit("LIGGGHTS is not installed")
    for name, about in KEPT.items():
        with tempfile.TemporaryDirectory() as where:
            pressed = press(Path(where), *about)
        for part, text in pressed.dumps.items():
            (packings.FOLDER / f"{name}_{part}.dump").write_text(text)
        keep({name: pressed.response})
