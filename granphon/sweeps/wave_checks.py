"""What of the waves in simulated arrays can be known to be impossible before anything is simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from granphon.balls.loads import Load
from granphon.base.errors import GranphonError
from granphon.media.choice import ServingMedium
from granphon.media.cost import find_typical_force
from granphon.media.loaded_lattice import ideal_lattice
from granphon.media.mean_field import AveragedLattice
from granphon.media.simulation import DirectSimulation
from granphon.networks.network import ContactNetwork
from granphon.waves.chebyshev import Kernel
from granphon.waves.operator import WaveOperator
from granphon.waves.path_spectra import find_path_points
from granphon.waves.plane_waves import find_polarisations
from granphon.waves.pulse_source import MARGIN, PulseSource, require_sendable
from granphon.waves.settings import SpectrumSettings, WaveSettings


def require_waves(serving_media: Sequence[ServingMedium], wanted: WaveSettings, most: float = np.inf) -> None:
    """Raise if what is ``wanted`` cannot be found in the arrays of a case, at any of its loads.

    Each array of up to ``most`` balls is looked at as one of equal balls at the same mean force, which takes no simulation:
    the wave vectors of its cell, the motions of its balls, the way of the pulse and how long it may be heard. What depends
    on the load is refused if it fails at the least and at the greatest.
    """
    if wanted.spectrum is None and wanted.pulse is None:
        return
    for medium, load in ((one, serving.load) for serving in serving_media for one in serving.arrays if one.balls <= most):
        errors = list[GranphonError]()
        forces = find_typical_force(medium.packing, load)
        ends = list(dict.fromkeys((float(np.min(forces)), float(np.max(forces)))))
        for number, force in enumerate(ends):
            ideal = AveragedLattice(medium.packing).at(Load.only(force=force))[0]
            network = ContactNetwork.from_state(ideal, medium.cells)
            if wanted.spectrum is not None and not number:
                _require_spectrum(network, medium, wanted.spectrum, wanted)
            try:
                if wanted.pulse is not None:
                    require_sendable(network, PulseSource.of(wanted.pulse, network, wanted.direction))
            except GranphonError as error:
                errors.append(error)
        if len(errors) == len(ends):
            raise errors[0]


def _require_spectrum(
    network: ContactNetwork, medium: DirectSimulation, settings: SpectrumSettings, wanted: WaveSettings
) -> None:
    packing = medium.packing
    way = find_path_points(network, ideal_lattice(packing), packing.diameter, wanted.path, settings.points)
    operator = WaveOperator(network)
    # the bound of frequencies of equal balls is below that of differing ones, but for a little: it takes no more moments
    Kernel.of(operator.top / (2.0 * math.pi * MARGIN), settings.resolution)
    for name in settings.polarisation:
        find_polarisations(operator, way.q[0], name, None)
