"""Motions that cost nothing: branches that vanish at every wave vector, and modes that vanish at some."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arguments import real_array
from granphon.dynamics.blocks import Block, find_blocks
from granphon.dynamics.long_waves import LongWaves

Array = NDArray[np.float64]
#: |q|d near Gamma, and the part of a vector that is more than of first order in it
_NEAR, _APART = 1e-4, 1e-2


class FreeMotions(LongWaves):
    """Balls in contact on a periodic lattice, in reduced units, and which of their motions cost no energy."""

    @cached_property
    def _blocks(self) -> list[Block]:
        """Motions of the frame that nothing joins to others, with their rows of C(q)."""
        kinds = [self._deforming, self._pushing] if self.is_prestressed else [self._deforming]
        effects = [waves.find_effects() for waves in kinds]
        joined = np.concatenate([effect.reshape(-1, self.n_branches) for effect in effects])
        found = []
        for columns in find_blocks(joined):
            own = [np.asarray(effect[..., columns].any(axis=2)) for effect in effects]
            if not own[0].any():
                own[0][0, 0] = True  # a row of zeros stands for none
            waves = [one.select(rows, columns) for one, rows in zip(kinds, own, strict=True)]
            if self.is_prestressed:
                signs = np.broadcast_to(np.sign(self.prestress[self._wave_contacts]), own[1].shape)[own[1]]
                found.append(Block(columns, waves[0], waves[1], signs[:, None]))
                continue
            bent, tilt = self._find_tilt(columns, waves[0].odd.dtype)
            block = Block(columns, waves[0], bent=bent, tilt=tilt)
            found.append((block if block.keeps_digits else Block(columns, waves[0])).still())
        return found

    def _find_tilt(self, columns: NDArray[np.intp], dtype: Any) -> tuple[tuple[int, ...], NDArray[Any]]:
        """Return the displacements across the periods in a block, and what goes with each as the balls tilt with it.

        A displacement u of the centre of mass turns the balls by phi = i q x u, and moves those that lie off the middle of
        the layer, by the distance z along u, by -i q z.
        """
        motions, p = self.motions, self.periods
        bent = [
            one for one in np.flatnonzero(columns < len(motions.translations)) if motions.translations[columns[one]] >= p
        ]
        if not bent:
            return (), np.zeros((0, len(columns), p))
        found = np.zeros((len(bent), len(columns), p), complex)
        weights = self._frame * np.sqrt(self.masses / self.masses.sum())[:, None]
        for number, place in enumerate(bent):
            axis = motions.translations[columns[place]]
            off = self.positions[:, axis] if axis < self.dimension else np.zeros(self.n_balls)
            off = off - self.masses @ off / self.masses.sum()
            for along in range(p):
                turn = np.cross(np.eye(3)[along], np.eye(3)[axis])
                moved = np.zeros((self.n_balls, motions.count), complex)
                moved[:, motions.turning] = self.gyration[:, None] * turn[list(motions.rotations)]
                if along in motions.translations:
                    moved[:, motions.translations.index(along)] = -1.0j * off
                found[number, :, along] = (weights.T @ moved).ravel()[columns]
        if np.issubdtype(dtype, np.floating):
            found = found.real.copy()
        used = np.flatnonzero(np.any(found != 0.0, axis=(1, 2)))
        return tuple(int(bent[one]) for one in used), found[used]

    @cached_property
    def elongating_blocks(self) -> list[Block]:
        """Those blocks whose motions lengthen or shorten contacts; other motions do not act on static forces."""
        lengthens = self._deforming.find_effects()[0].any(axis=0)  # elongations come first among the kinds of rows
        return [block for block in self._blocks if np.any(lengthens[block.columns])]

    # -- branches that vanish at every wave vector -----------------------------------------------------------------------

    @cached_property
    def free_branches(self) -> int:
        """Number of branches that vanish at every wave vector: branches less the generic rank of C(q)."""
        return sum(block.free for block in self._blocks)

    @cached_property
    def free_branch_warnings(self) -> tuple[str, ...]:
        """A sentence that counts the branches that vanish at every wave vector and says what would stop them, or none."""
        count = self.free_branches
        if not count:
            return ()
        vanish, them = ("vanishes", "it") if count == 1 else ("vanish", "them")
        return (
            f"{count} of {self.n_branches} branches {vanish} at every wave vector, as these motions deform no contact;"
            f" to stop {them}, {self.find_remedy(lambda other: other.free_branches == 0)}",
        )

    def find_remedy(self, stops: Callable[[Self], bool]) -> str:
        """Return what would stop a motion that costs nothing, in words: the fewest kinds of stiffness that do.

        ``stops`` says whether the motion costs energy on the lattice that it is given, which has more kinds of stiffness.
        """
        stiffness = {"friction": self.mindlin_ratio, "torsion": self.torsion, "bending": self.bending}
        missing = [name for name, present in stiffness.items() if not np.any(present)]
        for several in range(1, len(missing) + 1):
            enough = [names for names in itertools.combinations(missing, several) if stops(self._add(names))]
            if enough:
                return "add " + ", or ".join(", ".join((*names[:-2], " and ".join(names[-2:]))) for names in enough)
        return "use a lattice with more contacts"

    def _add(self, names: tuple[str, ...]) -> Self:
        """Return the lattice whose contacts have stiffness of these kinds too; without static forces."""
        return type(self)(
            self.cell, self.positions, self.contacts, 1.0 if "friction" in names else self.mindlin_ratio,
            masses=self.masses, gyration=self.gyration, torsion=1.0 if "torsion" in names else self.torsion,
            bending=1.0 if "bending" in names else self.bending, motions=self.named_motions,
        )  # fmt: skip

    # -- modes that vanish at some wave vectors --------------------------------------------------------------------------

    def soft_mode_warnings(self, wavevectors: ArrayLike, frequencies: ArrayLike) -> tuple[str, ...]:
        """Return a sentence that counts the modes that vanish at some of the wave vectors and names the first, or none.

        Neither sound at Gamma nor the branches that vanish everywhere count.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        frequencies : (n_q, n_branches), of :meth:`~granphon.dynamics.modes.ContactLattice.frequencies`, in any unit.
        """
        q, zero = self._fold(wavevectors)[0], real_array("frequencies", frequencies) == 0.0
        counts = np.count_nonzero(zero.reshape(len(q), self.n_branches), axis=1)
        if not np.any(counts):
            return ()
        expected = np.where(np.all(q == 0.0, axis=1), self._zeros_at_gamma, self.free_branches)
        soft = np.maximum(counts - expected, 0)
        if not np.any(soft):
            return ()
        first = int(np.argmax(soft > 0))
        asked = np.reshape(real_array("wavevectors", wavevectors), (-1, self.periods))[first]
        several = int(soft.sum())
        modes, points = ("mode" if several == 1 else "modes"), np.count_nonzero(soft)
        vanish = "vanishes" if several == 1 else "vanish"
        where = f"at 1 of {len(q)} wave vectors" if points == 1 else f"at {points} of {len(q)} wave vectors"
        place = self.name_place(asked)
        return (f"{several} {modes} {vanish} {where}, the first at {place}: these motions deform no contact there",)

    @cached_property
    def _zeros_at_gamma(self) -> int:
        """Number of branches that are zero at Gamma because they are sound, or zero everywhere.

        On a line, a rotation of all balls about it is sound too: the torsional wave.
        """
        direction = np.array([[0.5497, 0.6843, 0.4793]])[:, : self.periods]
        rigid = np.eye(self.n_branches, len(self.motions.translations), dtype=complex)
        if self.periods == 1:
            rigid = np.column_stack([rigid, self._turn_about_line()])
        total = 0
        for block in self._blocks:
            free = block.solve(_NEAR * direction)[1][0][:, : block.free]
            total += int(np.linalg.matrix_rank(np.concatenate([rigid[block.columns], free], axis=1), tol=_APART))
        return total

    def _turn_about_line(self) -> NDArray[np.complex128]:
        """Return the rotation (n_branches,) of all balls about the only period, as a motion of the frame."""
        place = np.zeros((self.n_balls, 3))
        place[:, : self.dimension] = self.positions
        off = place - self.masses @ place / self.masses.sum()
        moved = np.concatenate([1.0j * np.cross([1.0, 0.0, 0.0], off), self.gyration[:, None] * np.eye(3)[:1]], axis=1)
        chosen = [*self.motions.translations, *(3 + axis for axis in self.motions.rotations)]
        turned = (self._frame * np.sqrt(self.masses)[:, None]).T @ moved[:, chosen]
        return np.asarray(turned.ravel() / max(float(np.linalg.norm(turned)), np.finfo(float).tiny))
