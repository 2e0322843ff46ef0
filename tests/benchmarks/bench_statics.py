"""Benchmarks of statics: time of the processor over yardsticks that do not change with granphon.

A yardstick is one factorisation by SuperLU of the matrix of the state that is found, that of its
motions, one Fourier transform of these motions and back, or, where LAMMPS can be loaded, a hundred
of its steps with as many balls. Balls are spread uniformly. Loads are
a*; at 0.45 some contacts are open, and SuperLU leaves them out.

The first part compares the steps of both geometries with each other, for balls of W/d = 1e-7, where
both have the same equilibria; the search in true directions begins at the sites. Its ratios,
without a bound, say what steps in true directions would cost the limit.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import bench_motion
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.sparse import csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu
from side_by_side import Part, Row, alternate, over

import granphon as gp
from granphon.array.equilibrium import Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.lattices import find_lattice
from granphon.contacts.contact_list import ContactList
from granphon.contacts.tangent import find_tangent, unit_strains

Array = NDArray[np.float64]
SPACINGS = (1.0, 0.7, 0.45)
#: the yardsticks
UNITS = {"superlu": "a factorisation by SuperLU", "transform": "a Fourier transform and back"}
#: arrays at rest: lattice, cells along each period, the yardstick, and for these loads the bounds in
#: the directions of the lattice and in true ones. SuperLU takes long for large arrays
RESTS = (
    ("triangular", 24, "superlu", (1.5, 4.0, 11.0), (3.0, 6.0, 35.0)),
    ("triangular", 64, "superlu", (0.25, 0.65, 4.0), (0.6, 1.5, 13.0)),
    ("triangular", 128, "transform", (80.0, 180.0, 600.0), (220.0, 400.0, 2600.0)),
    ("triangular", 256, "transform", (120.0, 280.0, 1100.0), (400.0, 800.0, 7000.0)),
    ("fcc", 6, "superlu", (0.8, 2.0, 7.0), (1.6, 3.0, 28.0)),
    ("fcc", 12, "transform", (90.0, 180.0, 600.0), (220.0, 500.0, 6000.0)),
)
#: arrays of elastic tensors, and their bound for any load in both geometries. It is reached at low
#: load
TENSORS = (("triangular", 24, 2.2), ("triangular", 64, 1.3), ("fcc", 6, 2.0))
#: arrays that are compared in the limit of small width
LIMITS = (("triangular", 64), ("triangular", 128), ("fcc", 12))
#: shear over normal stiffness, and width over diameter
ETA = 0.84
RATIO = 2.55e-4
#: loads of a path with friction, up and down, and the bounds of one of them over a factorisation
PATH = np.concatenate([np.linspace(0.5, 1.0, 27)[1:], np.linspace(1.0, 0.6, 15)[1:]])
PATHS = (
    ("triangular", 64, "exact", 2.0),
    ("triangular", 64, "lattice", 1.5),
    ("fcc", 8, "exact", 1.2),
)
#: sides of arrays whose rest LAMMPS's steps measure, and the bound in true directions at a* = 1
IN_LAMMPS = {64: 0.3, 128: 0.25}
#: steps of LAMMPS
STEPS = 100
#: balls of crystals, and the loads of samples
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
D = 8e-3
WIDTH = 2.04e-6


def draw(lattice: str, side: int) -> tuple[Stencils, Array]:
    """Return the stencils of an array, and the deviations of its balls, of mean zero."""
    structure = find_lattice(lattice)
    shape = (side,) * structure.periods
    x = gp.Uniform(1.0).sample(shape, 0)
    return Stencils(shape, lattice=structure), x - np.mean(x)


def factorise(matrix: Any) -> Callable[[], object]:
    """Return the yardstick of a symmetric matrix."""
    level = float(np.mean(matrix.diagonal()))
    held = csc_array(matrix + 1e-8 * level * eye_array(matrix.shape[0]))
    return lambda: splu(
        held, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def factorise_list(contacts: ContactList) -> Callable[[], object]:
    """Return the yardstick of the tangent of a list."""
    return factorise(find_tangent(contacts, unit_strains(contacts.dimension)).matrix)


def factorise_network(network: gp.ContactNetwork) -> Callable[[], object]:
    """Return the yardstick of the normal springs of a network."""
    p = network.dimension
    count = len(network.i)
    row = np.repeat(np.arange(count), p)
    normal = network.normal[:, :p]
    shape = (count, p * network.n_balls)
    rows = csr_array((count, p * network.n_balls))
    for ball, sign in ((network.j, 1.0), (network.i, -1.0)):
        column = p * np.asarray(ball)[:, None] + np.arange(p)
        rows = rows + csr_array((sign * normal.ravel(), (row, column.ravel())), shape=shape)
    return factorise(rows.T @ diags_array(network.normal_stiffness) @ rows)


def transform(n_fields: int, shape: tuple[int, ...]) -> Callable[[], object]:
    """Return the yardstick of a grid."""
    motions = np.ones((n_fields, *shape), np.float32)
    axes = tuple(range(1, motions.ndim))
    return lambda: fft.irfftn(fft.rfftn(motions, axes=axes), shape, axes=axes)


# -- arrays ----------------------------------------------------------------------------------------


def compare_limit(repeats: int) -> list[Row]:
    """Rest in true directions over that in those of the lattice."""
    rows = []
    for lattice, side in LIMITS:
        stencils, x = draw(lattice, side)
        for spacing in (1.0, 0.7):
            load = ReducedLoad(overlap=spacing - 0.5)
            still = np.zeros((stencils.n_fields, *stencils.shape))
            sites = Equilibrium(x, load.overlap, still, lattice=stencils.lattice)
            seconds = alternate(
                repeats,
                time.process_time,
                limit=lambda x=x, load=load, of=stencils: bring_to_rest(x, load, of),
                exact=lambda x=x, load=load, of=stencils, sites=sites: bring_to_rest(
                    x, load, of, sites, ratio=1e-7
                ),
            )
            what = f"{lattice}, {side}^{len(x.shape)}, a* = {spacing:g}: exact, from the sites"
            rows.append(over(what, seconds, "exact", "limit"))
    return rows


def rests(repeats: int) -> list[Row]:
    """Rest in both geometries; in true directions from that of the lattice."""
    rows = []
    for lattice, side, unit, *bounds in RESTS:
        stencils, x = draw(lattice, side)
        for at, spacing in enumerate(SPACINGS):
            load = ReducedLoad(overlap=spacing - 0.5)
            contacts = bring_to_rest(x, load, stencils)._list_contacts()
            seconds = alternate(
                min(repeats, 3),
                time.process_time,
                lattice=lambda x=x, load=load, of=stencils: bring_to_rest(x, load, of),
                exact=lambda x=x, load=load, of=stencils: bring_to_rest(x, load, of, ratio=RATIO),
                unit=factorise_list(contacts)
                if unit == "superlu"
                else transform(stencils.n_fields, stencils.shape),
            )
            for geometry, bound in zip(("lattice", "exact"), bounds, strict=True):
                what = (
                    f"{lattice}, {side}^{len(x.shape)}, a* = {spacing:g}, {geometry} directions:"
                    f" rest over {UNITS[unit]}"
                )
                rows.append(over(what, seconds, geometry, "unit", bound[at]))
    return rows


def tensors(repeats: int) -> list[Row]:
    """Elastic tensors without friction in both geometries."""
    rows = []
    for lattice, side, bound in TENSORS:
        stencils, x = draw(lattice, side)
        for spacing in SPACINGS:
            load = ReducedLoad(overlap=spacing - 0.5)
            limit = bring_to_rest(x, load, stencils)
            exact = bring_to_rest(x, load, stencils, start=limit, ratio=RATIO)
            seconds = alternate(
                repeats,
                time.process_time,
                lattice=lambda rest=limit: rest.find_elasticity(ETA),
                exact=lambda rest=exact: rest.find_elasticity(ETA),
                unit=factorise_list(limit._list_contacts(ETA)),
            )
            for geometry in ("lattice", "exact"):
                what = (
                    f"{lattice}, {side}^{len(x.shape)}, a* = {spacing:g}, {geometry} directions:"
                    f" elastic tensor over {UNITS['superlu']}"
                )
                rows.append(over(what, seconds, geometry, "unit", bound))
    return rows


def loadings(repeats: int) -> list[Row]:
    """Paths with friction, elastic tensors of all states included."""
    rows = []
    for lattice, side, geometry, bound in PATHS:
        packing = gp.Packing(STEEL, D, lattice=lattice, spread=gp.Uniform(WIDTH))
        shape = (side,) * find_lattice(lattice).periods
        simulation = gp.DirectSimulation(
            packing,
            shape,
            0,
            friction_history=True,
            friction_coefficient=0.2,
            geometry=geometry,
            step_tolerance=1.0,
        )
        overlaps = (PATH - 0.5) * WIDTH
        last = simulation.path(overlap=overlaps[:2])[1].sample.equilibrium
        seconds = alternate(
            1 if repeats < 3 else 3,
            time.process_time,
            path=lambda of=simulation, overlaps=overlaps: of.path(overlap=overlaps),
            superlu=factorise_list(Equilibrium._list_contacts(last, ETA)),
        )
        each = seconds | {"path": seconds["path"] / len(PATH)}
        what = (
            f"{lattice}, {side}^{len(shape)}, {geometry} directions, with friction: a load of"
            f" {len(PATH)}, with its elastic tensor, over {UNITS['superlu']}"
        )
        rows.append(over(what, each, "path", "superlu", bound))
    return rows


def against_lammps(repeats: int) -> list[Row]:
    """Rest in true directions against LAMMPS's steps with as many balls, on one core."""
    rows = []
    for side, bound in IN_LAMMPS.items():
        try:
            lmp = bench_motion.in_lammps(*bench_motion.array((side, side)))
        except (ImportError, OSError):
            print("LAMMPS cannot be loaded: rests are not compared with it", file=sys.stderr)
            break
        stencils, x = draw("triangular", side)
        load = ReducedLoad(overlap=0.5)
        seconds = alternate(
            repeats,
            time.process_time,
            rest=partial(bring_to_rest, x, load, stencils, ratio=RATIO),
            lammps=partial(lmp.command, f"run {STEPS} post no"),
        )
        what = (
            f"triangular, {side}^2, a* = 1, exact directions: rest over {STEPS} steps of LAMMPS's"
            f" pair granular with as many balls, one core"
        )
        rows.append(over(what, seconds, "rest", "lammps", bound))
    return rows


# -- crystals --------------------------------------------------------------------------------------


def crystals(repeats: int) -> list[Row]:
    """Crystals at rest, over a factorisation of their normal springs."""
    ball = gp.Ball(STEEL, D)
    rubber = gp.Ball(gp.Material(young_modulus=2e6, poisson_ratio=0.49, density=1100.0), D)
    vacancy = gp.Crystal.on("fcc", [ball]).repeat((12, 12, 12)).remove(0)
    salt = gp.Crystal.on("NaCl", [ball, gp.Ball(STEEL, 0.5 * D)]).repeat((6, 6, 6))
    sticky = gp.Crystal.on("fcc", [rubber], law=gp.JKR(0.05)).repeat((8, 8, 8))
    column = gp.Crystal.on("chain", [ball]).cut(0, 100_000, edges=("floor", "free"))
    hexagon = gp.Hexagon(gp.Packing(STEEL, D, spread=gp.Uniform(WIDTH), friction=False), 24, seed=0)
    cases: dict[str, tuple[Callable[[], Any], float]] = {
        "column of 1e5 balls under gravity": (
            lambda: column.at_pressure(5.0, gravity=(-9.81,)),
            13.0,
        ),
        "fcc 12^3 with a vacancy": (lambda: vacancy.at_pressure(1e5), 0.08),
        "NaCl 6^3, sheared": (
            lambda: salt.at_strain([-1e-4, -1e-4, -1e-4, 2e-5, 0.0, 0.0]),
            3.0,
        ),
        "fcc 8^3 of rubber with JKR's law": (lambda: sticky.at_pressure(100.0), 0.18),
        "hexagon of 24 balls on a side": (lambda: hexagon.at_side_force(500.0), 9.0),
    }
    rows = []
    for name, (rest, bound) in cases.items():
        seconds = alternate(
            min(repeats, 3),
            time.process_time,
            rest=rest,
            superlu=factorise_network(rest().network),
        )
        what = f"{name}: rest over {UNITS['superlu']}"
        rows.append(over(what, seconds, "rest", "superlu", bound))
    rows.append(_time_large_crystal(min(repeats, 3)))
    return rows


def _time_large_crystal(repeats: int) -> Row:
    """A crystal of too many balls for factors."""
    large = gp.Crystal.on("fcc", [gp.Ball(STEEL, D)]).repeat((20, 20, 20)).remove(0)
    seconds = alternate(
        repeats,
        time.process_time,
        rest=lambda: large.at_pressure(1e5),
        transform=transform(3, (20, 20, 20)),
    )
    what = f"fcc 20^3 with a vacancy: rest over {UNITS['transform']}"
    return over(what, seconds, "rest", "transform", 700.0)


def doors(repeats: int) -> list[Row]:
    """The same balls as a sample of a crystal, and as an array."""
    rows = []
    for lattice, side in (("triangular", 64), ("triangular", 128), ("fcc", 12)):
        packing = gp.Packing(STEEL, D, lattice=lattice, spread=gp.Uniform(WIDTH), friction=False)
        shape = (side,) * find_lattice(lattice).periods
        array = gp.DirectSimulation(packing, shape, 0, boundary="stress")
        for spacing in (1.0, 0.7, 0.5):
            state = array.at_overlap((spacing - 0.5) * WIDTH)
            one = gp.Crystal.on(lattice, [gp.Ball(STEEL, D)])
            crystal = one.sample(diameters=state.sample.diameters)
            pressure = float(state.pressure)
            seconds = alternate(
                min(repeats, 3),
                time.process_time,
                crystal=lambda of=crystal, pressure=pressure: of.at_pressure(pressure),
                array=lambda of=array, pressure=pressure: of.at_pressure(pressure),
            )
            what = (
                f"{lattice}, {side}^{len(shape)}, a* = {spacing:g}: `Crystal.sample` over"
                f" `DirectSimulation`"
            )
            rows.append(over(what, seconds, "crystal", "array", 1.3))
    return rows


PARTS: dict[str, Part] = {
    "limit": compare_limit,
    "rests": rests,
    "tensors": tensors,
    "loadings": loadings,
    "lammps": against_lammps,
    "crystals": crystals,
    "doors": doors,
}
