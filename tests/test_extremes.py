"""At the edges the package is as exact as docs/reference/extremes.md claims, or says why not; never
silently wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import granphon as gp
from granphon.base.errors import GranphonError
from tests.budget import EXAMPLES
from tests.conftest import only
from tests.extreme_cases import CASES, STEEL, Case, D, worst
from tests.extreme_crystals import CRYSTALS
from tests.extreme_refusals import REFUSALS, Refusal, printed, tables

EVERY = [*CASES, *CRYSTALS]


@pytest.mark.claim("readme-range", "extremes-errors", "api-waves", "membranes-bend")
@pytest.mark.parametrize(
    ("case", "thin"),
    only(
        [(case, True) for case in EVERY if not case.slow],
        [
            *((case, True) for case in EVERY if not case.slow),
            *((case, False) for case in EVERY),
        ],
    ),
    ids=[
        *(f"{case.name}, in part" for case in EVERY if not case.slow),
        *(case.name for case in EVERY),
    ],
)
def test_claims(case: Case, thin: bool) -> None:
    assert worst(case, thin) <= case.claim


@pytest.mark.claim("extremes-refusals", "api-diameters", "api-simulation")
@pytest.mark.parametrize(
    "refusal",
    only([refusal for refusal in REFUSALS if not refusal.slow], REFUSALS),
    ids=[refusal.name for refusal in REFUSALS],
)
def test_refusals(refusal: Refusal) -> None:
    attempts = list(refusal.attempts())
    assert attempts
    for attempt in attempts:
        with pytest.raises(refusal.error) as caught:
            attempt()
        assert len(str(caught.value).split()) > 3


@pytest.mark.claim("extremes-errors")
def test_the_page_holds_what_the_suite_claims() -> None:
    seen = [line.split("|")[-2].strip() for line in printed().split("\n\n")[0].splitlines()[2:]]
    assert len(seen) == len(EVERY)
    assert tables(seen) == printed()
    for case, number in zip(EVERY, seen, strict=True):
        assert float(number) <= case.claim


# -- anything at all -------------------------------------------------------------------------------

decades = st.one_of(st.floats(-30.0, 30.0), st.floats(-323.0, 308.0)).map(lambda x: 10.0**x)
widths = st.sampled_from([None, 0.0, 1e-300, 1e-16, 1e-8, 1e-3, 0.3, 1.9])
poisson = st.one_of(
    st.floats(-1.0, 0.5, exclude_min=True), st.sampled_from([-1.0 + 2.0**-53, 0.0, 0.276, 0.5])
)


def numbers(value: Any) -> Iterator[float]:
    """All floats in a result."""
    if isinstance(value, dict):
        for item in value.values():
            yield from numbers(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, float):
        yield value


@settings(max_examples=2 * EXAMPLES)
@given(
    decades,
    decades,
    decades,
    poisson,
    widths,
    st.sampled_from(["uniform", "normal", "two"]),
    st.sampled_from([gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium]),
    st.sampled_from(["force", "pressure", "overlap"]),
    st.floats(-45.0, 2.0),
    st.booleans(),
    st.booleans(),
)
def test_any_numbers_give_finite_ones_or_an_error(
    young: float,
    density: float,
    d: float,
    sigma: float,
    part: float | None,
    kind: str,
    medium: Any,
    name: str,
    decade: float,
    friction: bool,
    finite: bool,
) -> None:
    try:
        material = gp.Material(young, sigma, density, yield_strength=1e-3 * young or None)
        spread: Any = None
        if part is not None:
            width = part * d
            spread = {
                "uniform": lambda: gp.Uniform(width),
                "normal": lambda: gp.Normal(width / 3.4),
                "two": lambda: gp.Discrete((d - width / 4.0, d + 0.75 * width), (0.75, 0.25)),
            }[kind]()
        packing = gp.Packing(material, d, spread, friction=friction)
        unit = {"force": young * d * d, "pressure": young * d, "overlap": d}[name]
        state = getattr(medium(packing), f"at_{name}")(10.0**decade * unit, finite_overlap=finite)
        named = (
            "force",
            "overlap",
            "normal_stiffness",
            "shear_stiffness",
            "pressure",
            "effective_density",
        )
        found = [
            float(getattr(state, attribute))
            for attribute in (*named, "force_fluctuation", "contact_fraction", "stiffness_ratio")
        ]
        law = state.law
        found += [
            float(of(state.overlap))
            for of in (law.energy, law.force, law.stiffness, law.stiffness_slope)
        ]
        found += [float(gp.local_exponent(state)), state.scales.frequency, state.scales.velocity]
        results = [of(state) for of in (gp.sound_velocities, gp.moduli)]
        results.append(gp.validity(state))
    except GranphonError as error:
        event(type(error).__name__)
        return
    event("finite")
    found += [x for result in results for x in numbers(result.to_dict())]
    assert all(map(math.isfinite, found))
    assert state.normal_stiffness > 0.0
    assert results[0].longitudinal > results[0].transverse > 0.0


def test_numbers_at_the_end_of_a_series() -> None:
    """Where the averaged force turns to its series, rounding may put a load on either side."""
    for spread in (
        gp.Uniform(2e-6),
        gp.Normal(6e-7),
        gp.Discrete((D - 1e-6, D + 1e-6), (0.5, 0.5)),
    ):
        medium = gp.AveragedForce(gp.Packing(STEEL, D, spread))
        middle = float(medium.at_overlap(12.0 * spread.largest).force)
        loads = [middle * (1.0 + 2.2e-16 * step) for step in range(-60, 60)]
        overlaps = medium.at_force(loads).overlap
        assert max(overlaps) <= 12.0 * spread.largest * (1.0 + 4e-14)
        assert min(overlaps) >= 12.0 * spread.largest * (1.0 - 4e-14)
