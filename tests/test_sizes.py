"""Sizes beyond the memory of the machine are refused before work begins, by every call that takes
one.
"""

from __future__ import annotations

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.memory import require_memory
from granphon.dynamics import fronts
from granphon.dynamics.contact_lattice import ContactLattice

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))


def equal():
    return gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(10.0)


def network():
    return equal().network.repeat((12, 12))


def wide_leads():
    wide = equal().network.repeat((1, 4500))
    return wide, None, wide


def crystal():
    return gp.Crystal.on("triangular", [gp.Ball(STEEL, 8e-3)])


def simulation(shape, **more):
    return gp.DirectSimulation(PACKING, shape=shape, **more)


#: 40 million numbers, which take no memory of their own
MANY = np.broadcast_to(1.0, 40_000_000)
SORTED = np.linspace(1.0, 2.0, 1_100_000)
FRICTION = {"friction_history": True, "friction_coefficient": 0.2}
DOORS = {
    "repeat": lambda: equal().network.repeat((100_000, 100_000)),
    "cut": lambda: network().cut(0, 1_000_000),
    "crystal.repeat": lambda: crystal().repeat((2000, 2000)),
    "crystal.cut": lambda: crystal().repeat((100, 1)).cut(1, 900_000),
    "hexagon": lambda: gp.Hexagon(PACKING, 100_000),
    "gaps": lambda: gp.Phonons(equal()).gaps((100_000, 100_000)),
    "dos, mesh": lambda: gp.Phonons(equal()).dos((30_000, 30_000)),
    "dos, points": lambda: gp.Phonons(equal()).dos((4, 4), points=10**9),
    "bands": lambda: gp.Phonons(equal()).bands(npoints=10**8),
    "frequencies": lambda: gp.Phonons(network()).frequencies(np.zeros((10**6, 2))),
    "dim": lambda: gp.Phonons(equal(), dim=(1000, 1000)).phonopy,
    "surface.path": lambda: gp.Surface(equal(), 1).path(10**9),
    "surface.map, npoints": lambda: gp.Surface(equal(), 1).map(npoints=10**9),
    "surface.map, frequencies": lambda: gp.Surface(equal(), 1).map(3, np.linspace(0.0, 1e4, 10**6)),
    "surface.branches": lambda: gp.Surface(equal(), 1).branches(np.full((10**6, 1), 0.1)),
    "shape": lambda: simulation((8000, 8000)).at_force(10.0),
    "samples": lambda: simulation((64, 64), samples=10**7).at_force(10.0),
    "path": lambda: simulation((3000, 3000), **FRICTION).path(force=[10.0, 20.0]),
    "frames of a motion": lambda: gp.NonlinearWaves(network()).run(1e-4, frames=10**7),
    "frames of a pulse": lambda: gp.Waves(network()).transmit(
        3000.0, (1, 0), 0.03, frames=np.linspace(0.0, 1e-3, 10**6)
    ),
    "response": lambda: gp.Waves(network()).response(
        SORTED, (0, (1, 0)), (np.arange(1, 144), (1, 0)), damping=1e-6
    ),
    "complex bands": lambda: gp.Phonons(equal()).complex_bands(MANY[:2_000_000], 0),
    "complex bands with losses": lambda: gp.Phonons(equal()).complex_bands(
        MANY[:800_000], 0, damping=1e-7
    ),
    "transmission": lambda: gp.transmission(*wide_leads(), 1e3),
    "local_dos": lambda: gp.Waves(network()).local_dos(0, MANY),
    "sweep": lambda: gp.sweep(PACKING, force=MANY),
    "loads": lambda: gp.EffectiveMedium(PACKING).at_force(MANY),
    "loads of pairs": lambda: gp.AveragedForce(PACKING).at_force(MANY[:10_000_000]),
    "pulse velocities": lambda: gp.pulse_velocities(equal(), MANY[:2_000_000]),
    "force constants": lambda: gp.HertzMindlin(equal()).get_force_constants(
        gp.atoms(equal()).repeat((100, 100, 1))
    ),
}


@pytest.mark.parametrize("door", DOORS)
def test_what_does_not_fit_is_refused_before_it_is_begun(door, memory):
    memory(4e9)
    with pytest.raises(InputError, match=r"GB of memory.* 4 GB"):
        DOORS[door]()


def test_factors_of_many_balls_are_refused(memory, monkeypatch):
    monkeypatch.setattr("granphon.base.memory._ASSUMED_MEMORY", 0.0)
    memory(1e6)
    many = equal().network.repeat((12, 12))
    monkeypatch.setattr(fronts, "_factorise", None)
    with pytest.raises(InputError, match="factors"):
        gp.moduli(many)
    assert ContactLattice.from_network(many).n_branches == 432


def test_small_work_asks_nobody(monkeypatch):
    monkeypatch.setattr("granphon.base.memory.available_memory", None)
    require_memory("numbers", 1e7, "")


@pytest.mark.parametrize(("available", "fits"), [(2.9e9, False), (3.1e9, True)])
def test_the_error_says_what_is_needed_and_what_is_there(available, fits, memory):
    memory(available)
    if fits:
        require_memory("numbers", 3e9, "Take fewer")
        return
    with pytest.raises(InputError, match=r"3 GB .*2\.9 GB"):
        require_memory("numbers", 3e9, "Take fewer")
