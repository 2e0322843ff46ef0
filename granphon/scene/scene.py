"""The scene: what to compute, read from a YAML file and checked before anything is computed.

Quantities have units ("8 mm") in the file only; a :class:`Scene` holds numbers in SI units. A mistake in a file raises a
:class:`~granphon.base.errors.SceneError` that names file, line and key, what was found, what is allowed, and the likely
intention.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from granphon.base.progress import Progress, silent
from granphon.base.results import write_html
from granphon.base.text import parse_yaml
from granphon.scene.file import SceneSource
from granphon.scene.plan import Plan

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.scene.run import RunResult


@dataclass(frozen=True)
class Scene(Plan):
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : the balls and their arrangement, and the load that presses them. Balls of several kinds are an
        :class:`~granphon.media.arrangement.Arrangement`.
    media : the ways to average over a spread of diameters, one or more; by default "ema" if the balls differ, else "ala".
        Balls of several kinds have "crystal" alone.
        May be given as names ("ala", "afa", "ema", "simulation", "auto") or mappings with options, alone or in a list.
    parameters : the swept parameters of the packing, each with its values; may be given as a mapping.
    finite_overlap : keep the terms of relative order delta/d; True if all media are simulations in their exact geometry,
        which always have them.
    observe : which of "velocities", "bands", "gaps", "dos", "surface", "spectrum", "pulse", "response", "motion" to compute;
        spectrum, pulse and the density of states of the array itself, of a simulation.
    direction : Cartesian direction of sound, a number for each period of the lattice, or a tuple of such directions; None
        for x, on which velocities do not depend where sound is isotropic.
    band, band_points : path of the bands, None for that of the lattice, and number of points on each of its segments.
    mesh : numbers of wave vectors along the reciprocal vectors for the density of states, one for each period of the
        lattice; by default (1024,), (64, 64) or (32, 32, 32).
    surface : the edge whose waves are found, if the scene observes them.
    spectrum, pulse : what spectral functions to find, and what pulse to send, if the scene observes them.
    bands : how contacts damp the bands, if the scene observes them; None for bands without loss alone.
    response, motion : which response of the network of each state to find, and how its balls move, if the scene observes it.
    dim : supercell of the exported force constants, a number for each period; None for the smallest that suffices.
    source : path of the file that the scene was read from; None for a scene made in Python.

    Raises
    ------
    InputError : a value that is not allowed.
    """

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; :class:`~granphon.base.errors.SceneError` names the mistake in it."""
        return cls._read(SceneSource.of_file(path))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Read a scene from a text, which messages call ``name``; raises as :meth:`from_yaml`.

        Files that it names are looked for in the working folder.
        """
        return cls._read(SceneSource(parse_yaml(text, name)))

    @classmethod
    def _read(cls, origin: SceneSource) -> Self:
        given = origin.read()
        with origin.at():
            scene = cls(**given)
        object.__setattr__(scene, "origin", origin)
        scene.require()
        return scene

    def _repr_html_(self) -> str:
        """Return a table of what the scene says, in SI units; no state is computed."""
        return write_html("Scene", self.describe())

    def run(
        self,
        folder: str | os.PathLike[str],
        force: bool = False,
        progress: Progress | None = None,
        figures: bool = True,
        resume: bool = False,
        executor: Executor | None = None,
    ) -> RunResult:
        """Compute what the scene asks for and write it into ``folder``."""
        from granphon.scene.run import run

        self.cost()  # raises if there is too little memory
        told = progress or silent
        return run(self, folder, force=force, progress=told, figures=figures, resume=resume, executor=executor)
