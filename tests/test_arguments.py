"""Anything in the place of an argument of a public call gives a result, or one error of granphon in
one line.
"""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import GranphonError

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
EQUAL = gp.Packing(STEEL, diameter=8e-3)
DIFFER = gp.Packing(STEEL, diameter=8e-3, spread=gp.Uniform(2e-6))
CRYSTAL = gp.Crystal.on("triangular", [gp.Ball(STEEL, 8e-3)])
SQUARE = gp.ContactLattice.of("square", 0.8)

#: what no argument means, and numbers beyond all sense
ANYTHING: list[Any] = [
    None,
    True,
    -1,
    2**70,
    10**400,
    1e308,
    1e-320,
    float("nan"),
    float("inf"),
    1 + 2j,
    "",
    "x",
    "\0",
    "1e400",
    b"x",
    [],
    (),
    [[]],
    [[1], [1, 2]],
    [1, "a"],
    ["a", None],
    [1e308, 1e308],
    [float("nan")] * 2,
    [0.0, 0.0],
    np.array(1.0),
    np.array([]),
    np.arange(1, 6),
    np.zeros((2, 2, 2)),
    np.array(["a"]),
    np.array([1 + 1j]),
    np.array([None]),
    {},
    {"a": 1},
    {1, 2},
    range(3),
    object(),
    len,
    int,
    np.ma.array([1.0, 2.0], mask=[False, True]),
    slice(1),
]


def bulk(lattice: str) -> gp.ContactNetwork:
    return gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=lattice)).at_force(18.0).network


def at_rest() -> Any:
    return gp.AveragedLattice(EQUAL).at_force(18.0)


def sample() -> Any:
    return gp.DirectSimulation(DIFFER, (4, 4)).at_force(18.0).samples[0]


CALLS: dict[str, tuple[Callable[[], Callable[..., Any]], dict[str, Any]]] = {
    "Material": (
        lambda: gp.Material,
        {"young_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0},
    ),
    "Packing": (
        lambda: gp.Packing,
        {
            "material": STEEL,
            "diameter": 8e-3,
            "spread": None,
            "lattice": "triangular",
            "friction": True,
            "motions": "in_plane",
            "torsion": 0.0,
            "bending": 0.0,
        },
    ),
    "Ball": (
        lambda: gp.Ball,
        {
            "material": STEEL,
            "diameter": 8e-3,
            "mass": None,
            "inertia": None,
            "name": "A",
            "spread": None,
        },
    ),
    "Load": (lambda: gp.Load, {"kind": "force", "array": 1.0}),
    "EffectiveMedium": (lambda: gp.EffectiveMedium, {"packing": DIFFER, "local_field": "computed"}),
    "DirectSimulation": (
        lambda: gp.DirectSimulation,
        {
            "packing": DIFFER,
            "shape": (6, 6),
            "seed": 0,
            "samples": 1,
            "workers": 1,
            "friction_coefficient": None,
            "geometry": None,
            "start": 0.5,
            "shear_response": "stick",
            "step_tolerance": 1e-4,
        },
    ),
    "at_force": (
        lambda: gp.AveragedLattice(EQUAL).at_force,
        {"force": 1.0, "finite_overlap": None},
    ),
    "sound_velocities": (lambda: gp.sound_velocities, {"state": at_rest(), "direction": [1, 0]}),
    "amplitude_shift": (
        lambda: gp.amplitude_shift,
        {"x": at_rest(), "q": [0.1, 0.0], "branch": 1, "law": None},
    ),
    "fit_width": (
        lambda: gp.fit_width,
        {
            "packing": EQUAL,
            "force": [1.0, 2.0, 5.0],
            "velocity": [400.0, 460.0, 550.0],
            "medium": "ema",
        },
    ),
    "Measurements": (
        lambda: gp.Measurements,
        {"force": [1.0, 2.0], "velocity": [400.0, 500.0], "sigma": None},
    ),
    "scattering_lengths": (lambda: gp.scattering_lengths, {"runs": []}),
    "Surface": (lambda: gp.Surface, {"x": bulk("fcc"), "axis": (1, 1, 1), "edge": "free"}),
    "velocity": (lambda: gp.Surface(bulk("fcc"), 2).velocity, {"direction": (1, 0)}),
    "spectrum": (
        lambda: gp.Surface(bulk("square"), 1).spectrum,
        {"q": [[0.1]], "frequencies": [1e3, 2e3], "damping": None},
    ),
    "ContactLattice": (
        lambda: gp.ContactLattice,
        {
            "cell": SQUARE.cell,
            "positions": SQUARE.positions,
            "contacts": SQUARE.contacts,
            "mindlin_ratio": 0.8,
            "stiffness": 1.0,
            "prestress": 0.0,
            "masses": 1.0,
            "gyration": 0.3,
            "torsion": 0.0,
            "tangential_force": 0.0,
            "distance": None,
            "motions": SQUARE.named_motions,
            "on_site": None,
        },
    ),
    "ContactLattice.of": (
        lambda: gp.ContactLattice.of,
        {
            "lattice": "square",
            "mindlin_ratio": 0.8,
            "spacing": 1.0,
            "prestress": 0.0,
            "motions": None,
        },
    ),
    "from_network": (lambda: gp.ContactLattice.from_network, {"network": bulk("square")}),
    "ContactLattice.modes": (
        lambda: SQUARE.modes,
        {"wavevectors": [[0.1, 0.2]], "direction": None},
    ),
    "elastic_tensor": (lambda: SQUARE.elastic_tensor, {"prestress": None}),
    "contact_network": (
        lambda: SQUARE.contact_network,
        {"units": gp.Units(1.0, 1.0, 1.0), "normal_force": 0.0, "radii": 0.5},
    ),
    "optical_branch": (lambda: SQUARE.optical_branch, {"direction": None}),
    "bands": (
        lambda: gp.Phonons(at_rest()).bands,
        {"path": "GK", "npoints": 2, "labels": None, "eigenvectors": True},
    ),
    "dos": (
        lambda: gp.Phonons(at_rest()).dos,
        {"mesh": (4, 4), "method": "smearing", "sigma": None, "points": 20},
    ),
    "Crystal.on": (
        lambda: gp.Crystal.on,
        {
            "lattice": "triangular",
            "balls": [gp.Ball(STEEL, 8e-3)],
            "friction": True,
            "motions": None,
            "torsion": 0.0,
        },
    ),
    "Crystal.at_force": (
        lambda: CRYSTAL.at_force,
        {"force": 1.0, "gravity": None, "finite_overlap": None},
    ),
    "Crystal.remove": (lambda: CRYSTAL.repeat((3, 3)).remove, {"index": 0}),
    "cut": (lambda: bulk("triangular").cut, {"axis": 0, "layers": 3, "edges": "free"}),
    "select": (lambda: bulk("triangular").repeat((3, 3)).select, {"balls": [0, 1]}),
    "transmit": (
        lambda: partial(gp.Waves(bulk("triangular").repeat((4, 3))).transmit, 5e3),
        {
            "direction": [1, 0],
            "distance": 0.016,
            "source": "plane",
            "ends": "free",
        },
    ),
    "NonlinearWaves": (
        lambda: gp.NonlinearWaves,
        {
            "x": at_rest(),
            "law": None,
            "damping": 0.0,
            "friction_coefficient": 0.3,
            "gravity": None,
            "geometry": "lattice",
        },
    ),
    "run": (
        lambda: partial(gp.NonlinearWaves(bulk("chain").repeat((4,))).run, 1e-5),
        {
            "velocities": np.zeros((4, 1)),
            "frames": 2,
            "step": None,
            "scheme": "verlet",
        },
    ),
    "fit_damping": (
        lambda: partial(
            gp.fit_damping,
            bulk("chain").cut(0, 3),
            gp.TransferFunction([1e3, 2e3, 3e3], [1.0, 2.0, 1.0]),
            (0, "x"),
            (2, "x"),
        ),
        {"damping": 0.0, "loss_factor": 0.0, "parameters": ("damping",)},
    ),
    "BallContacts": (lambda: gp.BallContacts, {"balls": {"A": STEEL}, "law": None}),
    "complex_bands": (
        lambda: gp.Phonons(at_rest()).complex_bands,
        {"frequencies": [1e3], "axis": 0},
    ),
    "Signal": (lambda: gp.Signal, {"times": (0.0, 1.0), "values": (0.0, 1.0)}),
    "TabulatedLaw": (lambda: gp.TabulatedLaw, {"overlap": [0, 1e-6, 2e-6], "force": [0, 1.0, 3.0]}),
    "force_distribution": (
        lambda: sample().force_distribution,
        {"bins": 10, "largest": 5.0, "least": 0.0},
    ),
    "contact_fraction": (lambda: sample().contact_fraction, {"threshold": 1e-6}),
    "TransferFunction": (
        lambda: gp.TransferFunction,
        {"frequencies": [1.0, 2.0], "magnitude": [1.0, 2.0], "phase": None},
    ),
}


#: calls that take more than half a second, as some of anything is right
LONG = ("fit_damping",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CALLS]
)
def test_anything_in_the_place_of_an_argument_gives_a_result_or_one_error(name: str) -> None:
    make, good = CALLS[name]
    call = make()
    wrong = []
    for argument, given in itertools.product(good, ANYTHING):
        try:
            call(**(good | {argument: given}))
        except GranphonError as error:
            if "\n" in str(error):
                wrong.append((argument, given, error))
        except Exception as error:
            wrong.append((argument, given, error))
    assert not wrong
