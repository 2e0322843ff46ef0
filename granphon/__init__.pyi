"""The public names of granphon, each with the module that defines it.

Type checkers read this file. ``__init__.py`` reads it too, line by line, so every name needs one line of the form below.
"""

from .array.atoms import write_extxyz as write_extxyz
from .array.hexagon import Hexagon as Hexagon
from .array.hexagon import PressedHexagon as PressedHexagon
from .array.pressed_sample import PressedSample as PressedSample
from .array.sample import Sample as Sample
from .balls.ball import Ball as Ball
from .balls.contact_laws import DMT as DMT
from .balls.contact_laws import JKR as JKR
from .balls.contact_laws import Hertz as Hertz
from .balls.contact_laws import PowerLaw as PowerLaw
from .balls.contact_laws import TabulatedLaw as TabulatedLaw
from .balls.diameters import Discrete as Discrete
from .balls.diameters import Measured as Measured
from .balls.diameters import Normal as Normal
from .balls.diameters import Uniform as Uniform
from .balls.hertz import HertzLaw as HertzLaw
from .balls.hertz import mindlin_reduction as mindlin_reduction
from .balls.lattices import Lattice as Lattice
from .balls.loads import Load as Load
from .balls.material import Material as Material
from .balls.packing import Packing as Packing
from .base.errors import GranphonError as GranphonError
from .base.scales import Units as Units
from .dynamics.contact_lattice import ContactLattice as ContactLattice
from .dynamics.contact_lattice import Modes as Modes
from .dynamics.local_field import LocalField as LocalField
from .figures.plot import plot as plot
from .fits.fit import WidthFit as WidthFit
from .fits.fit import fit_width as fit_width
from .media.choice import AutoMedium as AutoMedium
from .media.cluster import ClusterMedium as ClusterMedium
from .media.mean_field import AveragedForce as AveragedForce
from .media.mean_field import AveragedLattice as AveragedLattice
from .media.mean_field import EffectiveMedium as EffectiveMedium
from .media.medium import Medium as Medium
from .media.simulation import DirectSimulation as DirectSimulation
from .media.simulation import SimulatedState as SimulatedState
from .media.state import ContactState as ContactState
from .networks.network import ContactNetwork as ContactNetwork
from .observables.pulses import PulseVelocities as PulseVelocities
from .observables.pulses import pulse_velocities as pulse_velocities
from .observables.validity import Check as Check
from .observables.validity import Validity as Validity
from .observables.validity import validity as validity
from .observables.velocities import AveragedModuli as AveragedModuli
from .observables.velocities import Moduli as Moduli
from .observables.velocities import SoundVelocities as SoundVelocities
from .observables.velocities import local_exponent as local_exponent
from .observables.velocities import moduli as moduli
from .observables.velocities import sound_velocities as sound_velocities
from .phonons.bands import Bands as Bands
from .phonons.bands import PhononModes as PhononModes
from .phonons.calculator import HertzMindlin as HertzMindlin
from .phonons.calculator import atoms as atoms
from .phonons.dos import DensityOfStates as DensityOfStates
from .phonons.phonons import Phonons as Phonons
from .phonons.phonopy_bridge import load_phonopy as load_phonopy
from .runs.archive import load_sweep as load_sweep
from .runs.sweep import sweep as sweep
from .scene.run import RunResult as RunResult
from .scene.scene import Scene as Scene
from .tradeoffs.measure import MeasuredPoint as MeasuredPoint
from .tradeoffs.measure import TradeOff as TradeOff
from .tradeoffs.measure import tradeoff as tradeoff
from .waves.dos import SpectralDensity as SpectralDensity
from .waves.modes import NetworkModes as NetworkModes
from .waves.path_spectra import PathSpectra as PathSpectra
from .waves.pulses import Pulse as Pulse
from .waves.spectral_functions import SpectralFunction as SpectralFunction
from .waves.waves import Waves as Waves

__version__: str
