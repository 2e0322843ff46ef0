"""What keys, options and fields mean, in the words of the reference; ``_generate.py`` has
everything else about them.

Observables are not here: the catalogue of granphon/observables says what they mean.
"""

from __future__ import annotations

#: the defaults of options of media in words, where they are no plain values
DEFAULTS = {
    "simulation.friction_coefficient": "required with `friction_history`",
    "auto.friction_coefficient": "required with `friction_history`",
    "simulation.start": "`0.5`",
}
SPREADS = {
    "uniform": "even over this full width W, the mean ± W/2; `0 um` is equal balls",
    "normal": "normal, of this standard deviation, cut at three of them",
    "normal.std": "the same, as a block: the standard deviation",
    "normal.cutoff": "number of standard deviations at which it is cut",
    "discrete.diameters": "kinds of balls",
    "discrete.fractions": "fraction of each kind; they add up to 1",
    "measured": "a table of diameters beside the scene; the first line heads its columns, as"
    " `diameter (mm)`",
    "measured.file": "the same, as a block: the table",
    "measured.column": "heading of its column, if that is neither `diameter` nor the only one",
    "measured.diameters": "the diameters themselves",
}
#: the blocks among them, as short as may be
SPREAD_BLOCKS = {
    "normal": {"std": "1 um"},
    "discrete": {"diameters": ["1 mm"], "fractions": [1.0]},
    "measured": {"file": "lot.csv"},
}
RUNGS = {
    "ala": "averaged lattice: all balls have the mean diameter",
    "afa": "averaged force: balls differ, and stay at the sites of the lattice",
    "ema": "effective medium: the neighbours of a ball give way",
    "simulation": "every ball of an array by itself; lattices that stand without friction (chain,"
    " triangular, fcc, hcp), "
    "others with `start: gas`",
    "auto": "the cheapest of these whose expected error is within a tolerance",
}
RUNG_OPTIONS = {
    "ema.local_field": "computed, or what the paper prints, which is [wrong](../errata.md), to"
    " reproduce its curves",
    "simulation.shape": "cells along each period of the array, by default one of these, by the"
    " dimension of the lattice",
    "simulation.seed": "seed of the diameters of the first sample; each further sample has the next"
    " number",
    "simulation.samples": "how many arrays are averaged; two or more have standard errors",
    "simulation.friction_history": "load the samples [with"
    " friction](../how-to/simulation.md#load-it-with-friction)",
    "simulation.friction_coefficient": "of the contacts; needed with `friction_history`, and only"
    " then, as are those below",
    "simulation.geometry": "`lattice`: contacts keep the directions of the lattice; `exact`: their"
    " own, with `finite_overlap`; left out: [exact where it"
    " matters](../explanation/simulation.md#which-geometry)",
    "simulation.start": "where the loading starts, at rest without friction: a reduced spacing"
    " $a^*$ or a load; or `gas`, balls apart",
    "simulation.shear_response": "tangential stiffness under sound: $\\eta k$ everywhere, none"
    " where a contact slides, or "
    "that of Mindlin's partial slip",
    "simulation.step_tolerance": "relative change of the force by which steps of the load may be"
    " wrong",
    "simulation.ordered": "take the loads in the order given, up and down; else from the lowest"
    " to the highest",
    "auto.tolerance": "largest expected relative error of velocities and frequencies",
    "auto.friction_history": "whether errors are relative to arrays [loaded with friction]"
    "(../how-to/tradeoff.md#arrays-loaded-with-friction)",
    "auto.friction_coefficient": "of these arrays; needed with `friction_history`, and only then",
    "auto.shear_response": "of these arrays to sound, as of a `simulation`",
}
PACKINGS = {
    "young_modulus": "Young modulus",
    "poisson_ratio": "Poisson ratio",
    "density": "density of the material",
    "diameter": "mean diameter; leaves the spread as it is",
    "width": "width W; scales the spread and keeps its form, uniform if there is none",
    "friction": "with and without",
    "spread": "forms of the spread",
    "lattice": "lattices of one dimension",
    "motions": "motions of each ball",
    "torsion": "stiffness against twist, over k d²; numbers, and `mindlin`",
    "bending": "stiffness against rolling, over k d²",
}
RANGE = {
    "from": "the first value",
    "to": "the last value; may be below the first",
    "points": "how many, both ends counted",
    "scale": "how they are spaced",
}
FILES = {
    "scene.yaml": (
        "always",
        "the scene with every default written out, in SI units, and the versions of the software",
    ),
    "summary.yaml": ("always", "the numbers, see [below](#summaryyaml)"),
    "band.yaml": ("`bands`", "bands in phonopy's format, see [below](#bandyaml)"),
    "phonopy_params.yaml": (
        "`bands`",
        "force constants for phonopy and Euphonic, see [below](#phonopy_paramsyaml)",
    ),
    "damped_bands.csv": (
        "`bands` with a block `bands`",
        "bands, and frequency, decay and Q of these with losses",
    ),
    "dos.csv": ("`dos`", "density of states, see [below](#doscsv)"),
    "sample.extxyz": (
        "a simulation at one load",
        "the balls of the first sample, see [below](#sampleextxyz)",
    ),
    "sample_balls.csv": (
        "a simulation with `friction_history` at one load",
        "the balls of the first sample, see [below](#sample_ballscsv-and-sample_contactscsv)",
    ),
    "sample_contacts.csv": (
        "the same",
        "its contacts that carry load, with normal and tangential forces",
    ),
    "bands.png": (
        "`bands`",
        "the bands, with the density of states beside them if it was asked for; branches that"
        " coincide are one thick line",
    ),
    "dos.png": ("`dos` without `bands`", "the density of states"),
    "surface.json": (
        "`surface`",
        "spectrum of the outer layer, and waves of the edge, for `gp.SurfaceSpectrum.from_dict`",
    ),
    "surface.csv": (
        "`surface`",
        "the waves of the edge, a row for each: frequency, width, energy in the outer layers",
    ),
    "surface.png": (
        "`surface`",
        "the map of the spectrum, with the edges of the bands and the waves on it",
    ),
    "sample_dos.json": (
        "`dos`, a simulation",
        "density of states of the first sample, for `gp.SpectralDensity.from_dict`",
    ),
    "sample_dos.csv": ("`dos`, a simulation", "the same as a table, with the standard error"),
    "sample_dos.png": ("`dos`, a simulation", "the same as a figure"),
    "spectrum.json": (
        "`spectrum`",
        "spectral functions of the first sample along the path, and bands of the mean lattice",
    ),
    "spectrum.csv": (
        "`spectrum`",
        "their peaks, widths, mean free paths and attenuation, for each wave vector",
    ),
    "spectrum.png": (
        "`spectrum`",
        "the map of the spectral function, with the bands, peaks and widths on it",
    ),
    "pulse.json": (
        "`pulse`",
        "what was sent and heard, ball by ball, as `gp.Pulse.from_dict` reads",
    ),
    "pulse.csv": (
        "`pulse`",
        "over time: the force that was sent, the coherent signal, the rms of the speckle",
    ),
    "pulse.png": ("`pulse`", "seismogram, and the coherent part beside the speckle"),
    "motion.csv": ("`motion`", "energies and the greatest force, a row for each state and time"),
    "motion_contacts.csv": (
        "`motion` of one state",
        "the contacts: when a wave comes, and their greatest force",
    ),
    "motion.nc": (
        "`motion` of one state",
        "the balls at all times, their network, and forces of contacts",
    ),
    "motion.png": (
        "`motion`",
        "the motion and its energies; of several states the greatest force and the kinetic energy",
    ),
    "response.csv": (
        "`response`",
        "magnitude and phase, a row for each state, frequency and place of the receiver",
    ),
    "response.png": (
        "`response`",
        "magnitude and phase over frequency; of six loads and more a map of load and frequency",
    ),
    "forces.png": (
        "a simulation at one load",
        "force chains in the first sample, and how forces are distributed in all",
    ),
    "sweep.nc": (
        "every run",
        "every state, as a data set for xarray (netCDF), see [below](#sweepnc-and-sweepcsv)",
    ),
    "sweep.csv": ("every run", "the same as a table, without tensors and bands"),
    "sweep.png": (
        "a sweep of no more than one parameter",
        "velocities and exponents over the load, and those of pulses",
    ),
    "sweep_incomplete.nc": (
        "a sweep with a path that ends early",
        "the loads that all media have reached, as `sweep.nc`",
    ),
    "sweep_incomplete.csv": ("the same", "the same as a table"),
    "sweep_dos.csv": (
        "`dos`, a sweep",
        "densities of states of the arrays, a row for each state and frequency",
    ),
    "sweep_dos.png": ("`dos`, a sweep", "the same as a figure, with bands of standard errors"),
    "sweep_spectra.csv": (
        "`spectrum`, a sweep",
        "lines of plane waves, a row for each, see [below](#waves-in-arrays)",
    ),
    "sweep_spectra.png": (
        "`spectrum`, a sweep",
        "dispersion, with the widths as bars, and attenuation over frequency",
    ),
    "diameters.csv": ("a measured spread of more than 1000 balls", "`diameter (m)`: the diameters"),
    "fit.yaml": ("`granphon fit`", "the fit, see [below](#fityaml-and-fitcsv)"),
    "fit.csv": ("`granphon fit`", "data and fit"),
    "fit.png": ("`granphon fit`", "data, fit, equal balls, and residuals"),
    "tradeoff.csv": ("`granphon tradeoff`", "errors and costs, see [below](#tradeoffcsv)"),
    "tradeoff.png": ("`granphon tradeoff`", "error over time"),
}
#: fields of output files that are not observables
FIELDS = {
    "schema": "version of the file's format",
    "versions": "versions of granphon and of the packages that the computation used",
    "source": "name of the scene file",
    "observe": "what was computed, as the scene asked for",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept; a list if media"
    " of a sweep differ",
    "medium": "the medium, with its options",
    "local_field": "α, β and Ξ of the effective medium",
    "ok": "whether all checks under `validity` are passed",
    "validity": "the limits of the model: name, meaning, value, limit, and whether it is kept",
    "warnings": "a sentence for each limit that is passed",
    "files": "the files of this run; `--force` replaces these",
    "units": "the unit of each number above",
    "sizes": "number of values of each dimension of a sweep",
    "states": "number of states of a sweep",
    "peaks": "peaks of the response at each place of the receiver: frequency, height and Q,"
    " which are nan if not resolved",
    "frequency_Hz": "frequency",
    "total_per_Hz": "density of states of a ball",
    "translational_per_Hz": "the part of it that is translation",
    "rotational_per_Hz": "the part of it that is rotation",
    "frequency_unit": "the decimal unit of hertz of all frequencies in the file",
    "hertz": "the unit `frequency_unit` in hertz",
    "coordinates": "what phonopy's x, y and z stand for",
    "granphon_length_m": "unit of length, the mean diameter d",
    "granphon_stiffness_N_per_m": "unit of stiffness, the normal stiffness k",
    "granphon_mass_kg": "unit of mass, the mass M of a ball",
    "version": "version of granphon",
    "force_constants_scale": "factor by which the stored force constants are multiplied, a power"
    " of two",
    "auxiliary_atom": "symbol of the [heavy atom](../explanation/rotations.md#the-auxiliary-atom)",
    "zero_bands": "number of flat bands at zero frequency in the export",
    "masses": "masses of the balls over M",
    "species": "`Fe`, which means nothing",
    "pos": "position of the centre",
    "radius": "radius of the ball; OVITO draws it",
    "mass": "the masses once more, under the name that OVITO reads",
    "diameter_deviations": "diameter minus the mean diameter",
    "displacements": "displacement from the site of the lattice",
    "slip_origin": "displacements at which contacts do not slip",
    "granphon_scales": "logarithms of the three units below, which some programs lose",
    "granphon_kind": "2, the kind of balls in a sample",
    "rotations": "angle of rotation since the start of a loading with friction; otherwise zero",
    "contacts": "number of contacts that carry load",
    "friction_coefficient": "μ of the contacts; with `friction_history`",
    "stderr": "standard error of the width; nan where it would rest on a scatter below the"
    " rounding of the data",
    "std": "standard deviation of the diameters, W/√12",
    "std_stderr": "standard error of the standard deviation",
    "p": "probability of a larger `chi2`; nan with sigma from the scatter, or no degrees of"
    " freedom",
    "sigma_given": "whether `sigma` was given",
    "class": "class of the Python object; `WidthFit.from_dict` makes it again",
    "parameters": "names of the fitted parameters",
    "values": "values of these parameters; `units` has the unit of each, separated by commas",
    "covariance": "covariance of their errors; `units` has its rows, separated by semicolons",
    "velocity": "measured velocities",
    "sigma": "their standard errors, as given, or from the scatter",
    "velocities": "velocities of the fit at the data",
    "chi2": "sum of (residual/sigma)²",
    "dof": "degrees of freedom: number of measurements minus number of parameters",
    "fit": "velocity of the fit",
    "residual": "measured minus fitted velocity",
    "frequency": "frequency of the pulse, if one was given",
}
#: the unit of fields whose files do not say it; one without a unit is "1"
FIELD_UNITS = {
    "granphon_length_m": "m",
    "granphon_stiffness_N_per_m": "N/m",
    "granphon_mass_kg": "kg",
    "hertz": "Hz",
    "force_constants_scale": "1",
    "mass": "M",
    "masses": "M",
    "pos": "d",
    "radius": "d",
    "diameter_deviations": "d",
    "displacements": "d",
    "slip_origin": "d",
    "rotations": "rad",
    "chi2": "1",
    "p": "1",
}
#: of band.yaml and phonopy_params.yaml
BANDED = {
    "periods": "number of periods of the lattice, 1 to 3",
    "motions": "motions of each ball: `longitudinal`, `in_plane`, `out_of_plane` or `all`",
    "rotations": "whether the balls turn",
}
#: of fit.yaml
FITTED = {
    "digest": "sha256 of the fields from `class` on; `from_dict` compares it",
    "choice": "the medium, and its options",
    "packing": "the packing with the fitted parameters",
    "waves": "which waves were measured: branch, direction, frequency of the pulses",
}
#: of tradeoff.csv
MEASURED = {
    "method": "what was measured",
    "knob": "setting of the method",
    "force": "the load, in a column with the name of its kind",
    "observed": "the quantity whose error is given",
    "error": "relative error against the reference",
    "error_stderr": "standard error of `error` where it is an rms over random samples, else 0",
    "draws": "number of runs that the error is of",
    "reference_error": "relative error of the reference, as far as it is known",
    "resolved": "whether the reference is at least a hundred times better",
    "seconds": "median time of the warm runs",
    "spread": "half the interquartile range of these times",
    "setup": "median time of the preparation, which is done once",
    "memory": "peak of the allocated memory",
    "floor": "least possible error: that of rounding, or the scatter of random samples",
    "failure": "reason why it was not run; empty if it was run",
}
#: of a sample, the mean force of a ball's contacts
SAMPLE = {
    "contact_force": ("mean force of the contacts of the ball, over that of all contacts", "1"),
    "tangential_force": (
        "mean tangential force of the contacts of the ball, over the mean normal force; with"
        " `friction_history`",
        "1",
    ),
    "sliding_contacts": (
        "number of contacts that carry load and slide; with `friction_history`",
        "",
    ),
}
#: variables of a sweep that are not observables
SWEPT = {
    "medium": "the medium, with its options",
    "voigt_row": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
    "voigt_column": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
    "polarisation": "polarisations of the spectra",
    "response_frequency": "frequencies of the response",
    "motion_time": "times of the motion",
    "receiver": "places of the receiver",
}
ATTRIBUTES = {
    "format": "`granphon sweep`",
    "schema": "version of the file's format",
    "versions": "versions of the packages, as JSON",
    "media": "media with all their options, as JSON",
    "finite_overlap": "whether all media kept terms of relative order overlap/diameter; `geometry:"
    " exact` always does",
    "direction": "direction of propagation, if it was given or velocities depend on it",
    "observe": "the words for what was computed, as in a scene, as JSON",
    "warnings": "a list of sentences, as JSON",
    "packing": "parameters of the packing that do not vary, as JSON",
    "bands": "corners of the path of the bands, as JSON",
    "labels": "labels of the corners of the path, as JSON",
    "waves": "what is asked of the waves in arrays and networks, and whether exponents are, as"
    " JSON",
}
