"""What an array of balls can be asked for: loads in reduced units, the way to them, and the
range of widths. The module imports nothing of granphon, so that media know these words without the
solvers.
"""

from __future__ import annotations

from typing import NamedTuple

#: largest width over diameter: of balls that differ more, some leave their neighbours on the
#: lattice and touch other balls
LARGEST_RATIO = 0.2
#: reduced spacing a* = y + 1/2 at which a history begins, at rest without friction
START_SPACING = 0.5
#: name of the start with balls apart on their sites
GAS = "gas"
#: tolerance of f* for the refinement of steps
REFINEMENT_TOLERANCE = 1e-4
#: the choices of the tangential stiffness under sound; the first is the default
SHEAR_RESPONSES = ("stick", "slide", "partial_slip")


class ReducedLoad(NamedTuple):
    """Prescribed load: the reduced ``overlap`` y or, if that is None, the reduced mean contact
    ``force`` f*.

    If ``on_boundary`` is true, the load is a pressure, given by the mean contact force ``force``
    that has this pressure in a cell that keeps its size. In the true geometry the boundary shrinks
    with the cell, and the mean contact force is then another one.
    """

    overlap: float | None = None
    force: float = 0.0
    on_boundary: bool = False
