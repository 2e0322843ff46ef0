"""Benchmarks of waves in arrays as they are: densities of states, and the product of an array with
a vector.

The rivals are the same recursion with SciPy's sparse product, and kwant where it is
installed (its kpm, on the same matrix, with the same numbers of moments and of vectors).
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over, run_alone, spend

Array = NDArray[np.float64]
#: balls on a side of the array that rivals take too, and of the largest one
SIDE = 316
LARGE = 1000
#: moments of the comparison, and of the largest density of states
MOMENTS = 64
MANY = 1000


def array(side: int) -> Any:
    """Return the waves of a triangular array of steel balls with rotations, whose springs all
    differ.
    """
    import granphon as gp
    from granphon.balls.lattices import find_lattice

    lattice = gp.ContactLattice.of("triangular", 0.8)
    units = gp.Units(8e-3, 3e6, 2e-3)
    network = lattice.contact_network(units, lattice=find_lattice("triangular")).repeat(
        (side, side)
    )
    factor = np.random.default_rng(0).uniform(0.2, 1.0, network.n_contacts)
    stiffness = factor * network.normal_stiffness
    shear = factor * network.shear_stiffness
    return gp.Waves(replace(network, normal_stiffness=stiffness, shear_stiffness=shear))


def by_scipy(half: Any, start: Array, count: int) -> Array:
    """Return ``count`` moments of a vector by the plain recursion, as it is typed; ``half`` is D /
    top^2 - 1/2, sparse.
    """
    before = start
    now = 2.0 * (half @ start)
    moments = [start @ start, now @ start, 2.0 * (now @ now) - start @ start]
    while len(moments) < count:
        before, now = now, 4.0 * (half @ now) - before
        moments += [2.0 * (now @ before) - moments[1], 2.0 * (now @ now) - moments[0]]
    return np.array(moments[:count])


def waves(repeats: int) -> list[Row]:
    """Densities of states of a hundred thousand balls against rivals, products of arrays, and a
    million balls alone.
    """
    from scipy.sparse import eye_array

    from granphon.waves.chebyshev import Kernel

    ours = array(SIDE)
    operator = ours.operator
    half = (operator.matrix / operator.top**2 - 0.5 * eye_array(operator.size)).tocsr()
    signs = np.random.default_rng(1).choice([-1.0, 1.0], operator.size)
    starts = [np.where(operator.is_rotation == turns, signs, 0.0) for turns in (False, True)]
    other, vector = array(SIDE).operator, np.ones(operator.size)
    theirs = (
        np.sum([by_scipy(half, start, MOMENTS) for start in starts], axis=0) / operator.balls.size
    )
    dos = ours.dos(moments=MOMENTS, vectors=1)
    error = np.max(np.abs(Kernel(dos.top, MOMENTS).densities(theirs) - dos.total)) / np.max(
        dos.total
    )
    assert error < 0.05, "the other recursion finds another density"
    assert np.max(np.abs(operator.matrix @ vector - other @ vector)) < 1e-9 * operator.top**2, (
        "the products disagree"
    )

    calls = {
        "ours": lambda: ours.dos(moments=MOMENTS, vectors=1),
        "scipy": lambda: [by_scipy(half, start, MOMENTS) for start in starts],
        "product": lambda: other @ vector,
        "csr": lambda: operator.matrix @ vector,
    }
    try:
        from kwant import kpm
    except ImportError:
        kpm = None
    if kpm is not None:
        matrix = operator.matrix
        bounds = (0.0, operator.top**2)
        calls["kwant"] = lambda: kpm.SpectralDensity(
            matrix, num_moments=MOMENTS, num_vectors=1, bounds=bounds
        )
    seconds = alternate(repeats, **calls)
    what = f"{SIDE}x{SIDE} balls with rotations, springs that differ"
    found = [
        over(
            f"density of states in two parts, {what}, {MOMENTS} moments: over the same"
            f" recursion by scipy's sparse product",
            seconds,
            "ours",
            "scipy",
            1.0,
        ),
        over(
            f"D x, {what}: over scipy's sparse product of the same matrix",
            seconds,
            "product",
            "csr",
            1.0,
        ),
    ]
    if kpm is not None:
        found.append(
            over(
                f"density of states, its two parts, {what}, {MOMENTS} moments: over kwant's"
                f" kpm, the total alone",
                seconds,
                "ours",
                "kwant",
                1.0,
            )
        )
    return [*found, *large_product(repeats), *large(repeats), *responses()]


def large_product(repeats: int) -> list[Row]:
    """The product of a million balls against scipy's."""
    ours, other = array(LARGE).operator, array(LARGE).operator
    vector = np.ones(ours.size)
    _ = other.matrix
    seconds = alternate(repeats, product=lambda: ours @ vector, csr=lambda: other.matrix @ vector)
    what = (
        f"D x, {LARGE}x{LARGE} balls with rotations, springs that differ: over scipy's sparse"
        f" product of the same matrix"
    )
    return [over(what, seconds, "product", "csr", 1.0)]


# -- a million balls, alone in a process -----------------------------------------------------------


def alone(side: int, moments: int) -> None:
    """Print what the density of states of a large array takes."""
    ours = array(side)
    dos, spent = spend(lambda: ours.dos(moments=moments, vectors=1))
    print(json.dumps({**spent, "motions": dos.integral}))


def large(repeats: int) -> list[Row]:
    """The density of states of a million balls, with one vector."""
    runs = [run_alone(f"bench_waves.alone({LARGE}, {MANY})") for _ in range(min(repeats, 2))]
    assert all(abs(run["motions"] - 3.0) < 1e-9 for run in runs), (
        "some modes are missing: the time would mean nothing"
    )
    what = f"density of states of {LARGE}x{LARGE} balls with rotations, {MANY} moments, one vector"
    return [
        Row(f"{what}: time", float(np.median([run["s"] for run in runs])), "s", 300.0),
        Row(f"{what}: peak memory of the process", max(run["GiB"] for run in runs), "GiB", 1.5),
    ]


# -- the response in frequency ---------------------------------------------------------------------


def responses() -> list[Row]:
    """Responses of a hundred thousand balls by one Krylov space, damped alike and unevenly."""
    rows = []
    for loss in (0.05, (0.1, 0.05)):
        run = run_alone(f"bench_waves.response_alone({SIDE}, {loss})")
        assert run["error"] < 1e-6, "the response is not found: the time would mean nothing"
        large = f"response of {SIDE}x{SIDE} balls at 200 frequencies, loss factor {loss}"
        rows.append(Row(f"{large}: processor time", run["busy"], "s", 120.0))
        rows.append(
            Row(f"{large}: time of a step, over that of a product", run["products"], "", 8.0)
        )
        rows.append(Row(f"{large}: peak memory of the process", run["GiB"], "GiB", 1.5))
    return rows


def response_alone(side: int, loss_factor: Any) -> None:
    """Print what the response of a large array takes, and the time of a step over that of a real
    product.
    """
    ours = array(side)
    operator, vector = ours.operator, np.ones(ours.operator.size)
    operator @ vector
    _, one = spend(lambda: [operator @ vector for _ in range(50)])
    hertz = np.linspace(0.1, 0.9, 200) * operator.top / (2.0 * np.pi)
    found, spent = spend(
        lambda: ours.response(hertz, (0, "x"), (20 * side + 20, "x"), loss_factor=loss_factor)
    )
    step = spent["busy"] / found.steps / (one["busy"] / 50)
    print(
        json.dumps(
            {
                **spent,
                "error": float(np.median(found.error)),
                "products": step,
                "steps": found.steps,
            }
        )
    )


# -- modes amid the spectrum of an array in space, alone in a process ------------------------------


def modes_alone(cells: int, frequency: float) -> None:
    """Print what the modes nearest to a frequency, Hz, of a simulated fcc array with rotations
    take.
    """
    import granphon as gp

    packing = gp.Packing(
        gp.Material(211.65e9, 0.276, 7840.0), 8e-3, gp.Uniform(2.04e-6), lattice="fcc"
    )
    ours = gp.Waves(gp.DirectSimulation(packing, shape=(cells,) * 3, seed=3).at_force(0.2).sample)
    found, spent = spend(lambda: ours.modes(6, frequency))
    far = float(np.max(np.abs(found.frequencies - frequency)))
    print(json.dumps({**spent, "residual": found.residual, "far": far}))


def modes(repeats: int) -> list[Row]:
    """Modes amid the spectrum of an array too large to be factorised; once, whatever the
    repeats.
    """
    run = run_alone("bench_waves.modes_alone(20, 20e3)")
    assert run["residual"] <= 1e-8, "these are no modes: the time would mean nothing"
    assert run["far"] < 20.0, "these are not the nearest modes: the time would mean nothing"
    what = "6 modes nearest to 20 kHz, 20x20x20 balls in fcc with rotations"
    return [
        Row(f"{what}: processor time", run["busy"], "s", 900.0),
        Row(f"{what}: peak memory of the process", run["GiB"], "GiB", 2.0),
    ]


def factors(repeats: int) -> list[Row]:
    """Factors of D + s, real and damped, by a kept order of elimination and with the order found
    anew, over those of SuperLU.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    from granphon.dynamics.factors import Elimination, factorise

    operator = array(64).operator
    unit = eye_array(operator.size)
    rows = []
    for what, loss in (("", 0.0), (", damped", 0.01j)):
        matrix = ((1.0 + loss) * operator.matrix / operator.top**2 - 0.01 * unit).tocsc()
        elimination = Elimination(matrix)
        superlu = partial(
            splu, matrix, "MMD_AT_PLUS_A", 1e-5 if loss else 0.0, options={"SymmetricMode": True}
        )
        seconds = alternate(
            max(3, repeats // 3),
            time.process_time,
            kept=partial(elimination.factorise, matrix),
            anew=partial(factorise, matrix),
            superlu=superlu,
        )
        of = f"Factors of 64 x 64 balls{what}, over SuperLU"
        rows.append(Row(of, seconds["anew"] / seconds["superlu"], bound=0.8))
        rows.append(Row(f"{of}, order kept", seconds["kept"] / seconds["superlu"], bound=0.6))
    return rows


PARTS: dict[str, Part] = {"waves": waves, "modes": modes}
