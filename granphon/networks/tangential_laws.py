"""How static tangential forces change, and how slip is counted, in other programs."""

from __future__ import annotations

from typing import NamedTuple


class TangentialLaw(NamedTuple):
    """How a static tangential force changes while the slip stays.

    Attributes
    ----------
    power : p, by which it grows with the overlap delta, as delta^p.
    turns : whether it turns about the normal with the balls, by the mean of their rotations.
    levers : one of :data:`SLIP_LEVERS`, that of slip in the program.
    """

    power: float
    turns: bool = False
    levers: str = "arms"


#: by the names of the laws in other programs
TANGENTIAL_LAWS = {
    "mindlin/force": TangentialLaw(0.0),
    "mindlin": TangentialLaw(0.5),
    "mindlin_rescale/force": TangentialLaw(0.25),
    "mindlin_rescale": TangentialLaw(0.75),
    "yade": TangentialLaw(0.0, turns=True, levers="yade"),
    "liggghts": TangentialLaw(0.5),
}
#: how rotations and displacements make slip; see the field ``slip_levers`` of
#: :class:`~granphon.networks.network.ContactNetwork`
SLIP_LEVERS = ("arms", "radii", "yade")
