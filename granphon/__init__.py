"""granphon: the vibrations and sound velocities of granular crystals.

Public names are imported when they are first used, so that ``import granphon`` stays light and a computation loads only
what it needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "AutoMedium": "media.choice",
    "AveragedForce": "media.mean_field",
    "AveragedLattice": "media.mean_field",
    "Bands": "phonons.bands",
    "ContactLattice": "dynamics.modes",
    "ContactState": "media.state",
    "DensityOfStates": "phonons.bands",
    "DirectSimulation": "media.simulation",
    "Discrete": "balls.diameters",
    "EffectiveMedium": "media.mean_field",
    "GranphonError": "base.errors",
    "HertzLaw": "balls.contact",
    "HertzMindlin": "phonons.calculator",
    "Lattice": "balls.lattices",
    "Material": "balls.contact",
    "Measured": "balls.diameters",
    "Medium": "media.mean_field",
    "Normal": "balls.diameters",
    "Packing": "balls.packing",
    "Phonons": "phonons.phonons",
    "Sample": "array.sample",
    "Scene": "scene.scene",
    "SimulatedState": "media.simulation",
    "Uniform": "balls.diameters",
    "Units": "base.scales",
    "atoms": "phonons.calculator",
    "fit_width": "fits.fit",
    "load_phonopy": "phonons.phonopy_bridge",
    "load_sweep": "sweeps.archive",
    "local_exponent": "observables.velocities",
    "mindlin_reduction": "balls.contact",
    "moduli": "observables.velocities",
    "pulse_velocities": "observables.velocities",
    "sound_velocities": "observables.velocities",
    "sweep": "sweeps.sweep",
    "tradeoff": "tradeoffs.measure",
    "validity": "observables.validity",
    "write_extxyz": "array.atoms",
}

__all__ = [
    "__version__",
    "AutoMedium",
    "AveragedForce",
    "AveragedLattice",
    "Bands",
    "ContactLattice",
    "ContactState",
    "DensityOfStates",
    "DirectSimulation",
    "Discrete",
    "EffectiveMedium",
    "GranphonError",
    "HertzLaw",
    "HertzMindlin",
    "Lattice",
    "Material",
    "Measured",
    "Medium",
    "Normal",
    "Packing",
    "Phonons",
    "Sample",
    "Scene",
    "SimulatedState",
    "Uniform",
    "Units",
    "atoms",
    "fit_width",
    "load_phonopy",
    "load_sweep",
    "local_exponent",
    "mindlin_reduction",
    "moduli",
    "pulse_velocities",
    "sound_velocities",
    "sweep",
    "tradeoff",
    "validity",
    "write_extxyz",
]

if TYPE_CHECKING:
    from granphon.array.atoms import write_extxyz
    from granphon.array.sample import Sample
    from granphon.balls.contact import HertzLaw, Material, mindlin_reduction
    from granphon.balls.diameters import Discrete, Measured, Normal, Uniform
    from granphon.balls.lattices import Lattice
    from granphon.balls.packing import Packing
    from granphon.base.errors import GranphonError
    from granphon.base.scales import Units
    from granphon.dynamics.modes import ContactLattice
    from granphon.fits.fit import fit_width
    from granphon.media.choice import AutoMedium
    from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium, Medium
    from granphon.media.simulation import DirectSimulation, SimulatedState
    from granphon.media.state import ContactState
    from granphon.observables.validity import validity
    from granphon.observables.velocities import local_exponent, moduli, pulse_velocities, sound_velocities
    from granphon.phonons.bands import Bands, DensityOfStates
    from granphon.phonons.calculator import HertzMindlin, atoms
    from granphon.phonons.phonons import Phonons
    from granphon.phonons.phonopy_bridge import load_phonopy
    from granphon.scene.scene import Scene
    from granphon.sweeps.archive import load_sweep
    from granphon.sweeps.sweep import sweep
    from granphon.tradeoffs.measure import tradeoff


else:
    # hidden from type checkers, which would take any misspelt name for one of ours
    def __getattr__(name: str) -> Any:
        if name not in _HOME:
            raise AttributeError(f"module 'granphon' has no attribute {name!r}")
        value = getattr(import_module(f"granphon.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
