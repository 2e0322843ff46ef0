"""A crystal that comes to rest anew whenever its springs to the ground or its wall change.

Springs to the ground bear a part of the load, and so does a wall, if balls are pressed between it
and a clamp. Where one of them is stiffer, contacts carry other forces, and Hertz's contacts have
other stiffnesses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

from granphon.balls.ball import Wall
from granphon.balls.loads import Load
from granphon.base.errors import InputError, brief
from granphon.media.arrangement import Arrangement, CrystalMedium, given_balls
from granphon.media.crystal import Crystal
from granphon.networks.network import ContactNetwork
from granphon.observables.parameters import read_load

#: networks that are kept: a fit changes its other parameters between two rests
_CACHE_SIZE = 8


def _keep_whole(network: ContactNetwork) -> ContactNetwork:
    """Return the network as it is."""
    return network


@dataclass(frozen=True, eq=False)
class PressedCrystal:
    """A crystal under a load.

    Attributes
    ----------
    crystal : the crystal.
    load : one load.
    finite_overlap : as for the states of the crystal.
    shape : function that takes the network of the state, and returns the network whose vibrations
        are measured, such as a cut; by default the whole network.
    """

    crystal: Crystal
    load: Load
    finite_overlap: bool | None = None
    shape: Callable[[ContactNetwork], ContactNetwork] = _keep_whole

    @classmethod
    def of(cls, x: Any, load: Mapping[str, float], finite_overlap: bool | None = None) -> Self:
        """Return the crystal ``x`` under a ``load`` by its kind, {"pressure": 20.0}, SI;
        :class:`~granphon.base.errors.InputError` for what is no crystal, and for what is not one
        load.
        """
        if not isinstance(x, Crystal | Arrangement):
            problem = f"{brief(x)} has its load, and another one is given"
            mend = "Give the crystal with a load, or its state or network alone"
            raise InputError(problem, mend=mend)
        balls: Any = given_balls(x)
        return cls(balls.crystal, read_load(load).flat[0], finite_overlap)

    @cached_property
    def walls(self) -> dict[str, Wall]:
        """The walls at the faces of the crystal, by name."""
        edges = [edge for face in self.crystal.faces for edge in face.edges]
        return {edge.name: edge for edge in edges if isinstance(edge, Wall)}

    @cached_property
    def network(self) -> ContactNetwork:
        """The network whose vibrations are measured, with the crystal's own springs and wall."""
        return self.find_network()

    def find_network(
        self, on_site: float = 1.0, wall_modulus: float | None = None
    ) -> ContactNetwork:
        """Return the network whose vibrations are measured, at rest under the load after a change
        of springs and wall. The last few networks are kept, and not found again.

        Springs to the ground are ``on_site`` times as stiff as those of the crystal. The one wall
        has the Young modulus ``wall_modulus``, Pa, or its own if that is None; only a crystal with
        one wall may be given a modulus. Raises :class:`~granphon.base.errors.GranphonError` if the
        crystal is impossible or does not come to rest.
        """
        return self._find_network(on_site, wall_modulus)

    @cached_property
    def _find_network(self) -> Callable[[float, float | None], ContactNetwork]:
        """The function :meth:`_rest`, which keeps the networks of its last few calls."""
        return lru_cache(maxsize=_CACHE_SIZE)(self._rest)

    def _rest(self, on_site: float, wall_modulus: float | None) -> ContactNetwork:
        """Bring the changed crystal to rest, and return the network of :meth:`find_network`, with
        its arguments. A crystal with a ``wall_modulus`` has one wall.
        """
        crystal = self.crystal
        if crystal.on_site is not None and on_site != 1.0:
            crystal = crystal.with_springs(on_site * crystal.on_site)
        if wall_modulus is not None:
            ((name, wall),) = self.walls.items()
            material = replace(wall.solid, young_modulus=wall_modulus)
            crystal = crystal.with_walls({name: replace(wall, material=material)})
        medium = CrystalMedium(Arrangement.of(crystal))
        state = medium.at(self.load, finite_overlap=self.finite_overlap)
        network: ContactNetwork = state.network
        return self.shape(network)
