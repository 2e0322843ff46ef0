"""granphon: the vibrations and sound velocities of granular crystals.

Public names are imported when they are first used, so that ``import granphon`` stays light and a computation loads only
what it needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "AutoMedium": "ladder",
    "AveragedForce": "medium",
    "AveragedLattice": "medium",
    "Bands": "spectra",
    "ContactLattice": "lattice",
    "ContactState": "state",
    "DensityOfStates": "spectra",
    "DirectSimulation": "simulation",
    "Discrete": "diameters",
    "EffectiveMedium": "medium",
    "GranphonError": "errors",
    "HertzLaw": "contact",
    "HertzMindlin": "calculator",
    "Lattice": "geometry",
    "Material": "contact",
    "Measured": "diameters",
    "Medium": "medium",
    "Normal": "diameters",
    "Packing": "packing",
    "Phonons": "phonons",
    "Sample": "samples",
    "Scene": "scene",
    "SimulatedState": "simulation",
    "Uniform": "diameters",
    "Units": "units",
    "atoms": "calculator",
    "fit_width": "fit",
    "load_phonopy": "bridge",
    "load_sweep": "archive",
    "local_exponent": "observables",
    "mindlin_reduction": "contact",
    "moduli": "observables",
    "pulse_velocities": "observables",
    "sound_velocities": "observables",
    "sweep": "sweeps",
    "tradeoff": "tradeoffs",
    "validity": "limits",
    "write_extxyz": "balls",
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
    from granphon.archive import load_sweep
    from granphon.balls import write_extxyz
    from granphon.bridge import load_phonopy
    from granphon.calculator import HertzMindlin, atoms
    from granphon.contact import HertzLaw, Material, mindlin_reduction
    from granphon.diameters import Discrete, Measured, Normal, Uniform
    from granphon.errors import GranphonError
    from granphon.fit import fit_width
    from granphon.geometry import Lattice
    from granphon.ladder import AutoMedium
    from granphon.lattice import ContactLattice
    from granphon.limits import validity
    from granphon.medium import AveragedForce, AveragedLattice, EffectiveMedium, Medium
    from granphon.observables import local_exponent, moduli, pulse_velocities, sound_velocities
    from granphon.packing import Packing
    from granphon.phonons import Phonons
    from granphon.samples import Sample
    from granphon.scene import Scene
    from granphon.simulation import DirectSimulation, SimulatedState
    from granphon.spectra import Bands, DensityOfStates
    from granphon.state import ContactState
    from granphon.sweeps import sweep
    from granphon.tradeoffs import tradeoff
    from granphon.units import Units


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
