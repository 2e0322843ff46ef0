"""Choose the studies of speed against accuracy that make sense for a packing.

- the media, against a large ensemble of simulated samples, whose equilibria and responses a sparse LU has checked; or of
  samples loaded with friction, whose steps have been checked;
- the grid of the lattice's Green's function, against adaptive quadrature;
- the solution of the effective medium, against a general integrator of differential equations;
- the mesh of the density of states, against counting between the roots of determinants.

The media are compared on every lattice in the plane and in space that is simulated. What has no second method there (the
grid on other lattices than the triangular one, the mesh in space) is listed as not measured.

Errors are those of the velocities or frequencies that a scene observes, at its loads.
"""

from __future__ import annotations

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError, message
from granphon.media.friction_history import REST, FrictionHistory
from granphon.media.loaded_lattice import ideal_lattice
from granphon.media.simulation import DirectSimulation
from granphon.tradeoffs.disorder import Disorder
from granphon.tradeoffs.ensemble import QUANTITIES
from granphon.tradeoffs.grid_study import GridStudy
from granphon.tradeoffs.media_study import MediaStudy
from granphon.tradeoffs.mesh_study import MeshStudy
from granphon.tradeoffs.solution_study import SolutionStudy
from granphon.tradeoffs.study import SECONDS, Stopwatch, Study


def choose_studies(
    packing: Packing,
    load: Load,
    observe: tuple[str, ...],
    finite_overlap: bool = False,
    stopwatch: Stopwatch = SECONDS,
    truth: FrictionHistory = REST,
) -> list[Study]:
    """Return the studies that make sense for a packing, the media first; see :func:`granphon.tradeoffs.measure.tradeoff`."""
    found: list[Study] = []
    if packing.width:
        _require_reference(packing, finite_overlap, truth)
        spectra = bool({"bands", "dos"} & set(observe))
        asked = {"frequency": spectra, "longitudinal": "velocities" in observe, "transverse": "velocities" in observe}
        quantities = tuple(name for name in QUANTITIES if asked[name])
        disorder = Disorder(packing, load, quantities, stopwatch, truth)
        found += [MediaStudy(disorder), GridStudy(disorder), SolutionStudy(disorder)]
    if "dos" in observe and (packing.structure.periods == 2 or found):
        found.append(MeshStudy(packing, load, finite_overlap))
    if not found and packing.structure.periods != 2:
        what = f"nothing is compared on the {packing.structure.name} lattice"
        why = "All media are exact for equal balls, and a density of states has a reference in the plane only"
        raise InputError(message(what, why, "Use a lattice in the plane"))
    if not found:
        mend = "Give the packing a spread, or observe dos, whose mesh can be chosen"
        raise InputError(
            message("equal balls leave nothing to compare", "All media are exact for them, and equally fast", mend)
        )
    return found


def _require_reference(packing: Packing, finite_overlap: bool, truth: FrictionHistory) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if balls that differ have no simulated array to judge the media by."""
    structure = packing.structure
    where, mend = f"on the {structure.name} lattice", "Use another lattice, or leave the spread out"
    if finite_overlap:
        where, mend = "with finite overlap", "Leave finite_overlap out, or the spread"
        why = "Their reference is the simulated array, which has the paper's limit only"
    elif structure.periods == 1:
        why = "On a line all contacts carry the same force, and every medium is exact"
    else:
        try:
            DirectSimulation(packing, (1,) * structure.periods, **truth.options)
        except GranphonError as error:
            raise InputError(
                message(f"media are not compared {where}", f"Their reference is the simulated array: {error}")
            ) from None
        if structure.periods == 3 or ideal_lattice(packing).is_isotropic:
            return
        why = "In the plane velocities are compared where sound is isotropic"
    raise InputError(message(f"media are not compared {where}", why, mend))
