"""What keys, options and fields mean, in the words of the reference; ``_generate.py`` has everything else about them.

Observables are not here: the catalogue of granphon/observables says what they mean.
"""

from __future__ import annotations

#: the keys of a scene, their meaning, and the default in words where it is no plain value
KEYS = {
    "schema": "version of this format",
    "material.young_modulus": "Young modulus of the material",
    "material.poisson_ratio": "Poisson ratio of the material",
    "material.density": "density of the material, not of the packing",
    "material.yield_strength": "uniaxial yield stress; you are warned where contacts would flow",
    "packing.lattice": "how the balls are arranged",
    "packing.diameter": "diameter of a ball; the mean, if they differ",
    "packing.spread": "how diameters differ, see [spread](#spread)",
    "packing.friction": "whether contacts resist shear; without friction balls do not rotate",
    "packing.finite_overlap": "keep the [terms of relative order overlap/diameter](../explanation/model.md#finite-overlap)",
    "load.force": "mean force between touching balls",
    "load.pressure": "force per length of the boundary",
    "load.overlap": "how far touching balls are pressed into each other; may be negative if balls differ",
    "load.side_force": "push F on each side of a hexagonal frame: the contact force is F/(n √3)",
    "load.balls_per_side": "the number n of balls that lean on a side of that frame",
    "medium": "how a spread of diameters is averaged, see [media](#media)",
    "sweep": "parameters of the packing, each with the values that it takes, see [sweep](#sweep)",
    "observe": "what to compute; nothing else is computed. `dos` is for one state only",
    "phonopy.dim": "cells of the supercell for force constants",
    "phonopy.band": "corners of the path, three numbers each, in fractions of the reciprocal cell",
    "phonopy.band_labels": "a label for each corner",
    "phonopy.band_points": "points on each segment, both ends counted",
    "phonopy.mesh": "wave vectors for the density of states",
}
DEFAULTS = {
    "material.yield_strength": "none: not checked",
    "packing.spread": "equal balls",
    "medium": "`ema`; `ala` for equal balls",
    "sweep": "none",
    "phonopy.dim": "as small as serves",
    "phonopy.band": "Γ-K-M-Γ; Γ-X-M-Γ on the square lattice",
    "phonopy.band_labels": "those of the default path; none for another",
}
SPREADS = {
    "uniform": "even over this full width W, the mean ± W/2; `0 um` is equal balls",
    "normal": "normal, of this standard deviation, cut at three of them",
    "normal.std": "the same, as a block: the standard deviation",
    "normal.cutoff": "and at how many standard deviations it is cut",
    "discrete.diameters": "kinds of balls",
    "discrete.fractions": "the part of each; they add up to 1",
    "measured": "a table of diameters beside the scene; the first line heads its columns, as `diameter (mm)`",
    "measured.file": "the same, as a block: the table",
    "measured.column": "the head of its column, if that is neither `diameter` nor the only one",
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
    "simulation": "every ball of an array by itself; triangular lattice, no `finite_overlap`",
    "auto": "the cheapest of these whose expected error is within a tolerance",
}
RUNG_OPTIONS = {
    "ema.local_field": "computed, or what the paper prints, which is [wrong](../errata.md), to reproduce its curves",
    "simulation.shape": "balls along the two directions of the periodic array",
    "simulation.seed": "of the diameters of the first sample; each further sample has the next",
    "simulation.samples": "how many arrays are averaged; two or more have standard errors",
    "auto.tolerance": "largest expected relative error of velocities and frequencies",
}
PACKINGS = {
    "young_modulus": "Young modulus",
    "poisson_ratio": "Poisson ratio",
    "density": "density of the material",
    "diameter": "mean diameter; leaves the spread as it is",
    "width": "W; scales the spread and keeps its form, uniform if there is none",
    "friction": "with and without",
    "spread": "forms of the spread",
    "lattice": "lattices",
}
RANGE = {
    "from": "the first value",
    "to": "the last value; may be below the first",
    "points": "how many, both ends counted",
    "scale": "how they are spaced",
}
FILES = {
    "scene.yaml": ("always", "the scene with every default written out, in SI units, and the versions of the software"),
    "summary.yaml": ("always", "the numbers, see [below](#summaryyaml)"),
    "band.yaml": ("`bands`", "bands in phonopy's format, see [below](#bandyaml)"),
    "phonopy_params.yaml": ("`bands`", "force constants for phonopy and Euphonic, see [below](#phonopy_paramsyaml)"),
    "dos.csv": ("`dos`", "density of states, see [below](#doscsv)"),
    "sample.extxyz": ("a simulation at one load", "the balls of the first sample, see [below](#sampleextxyz)"),
    "bands.png": ("`bands`", "the bands, with the density of states beside them if it was asked for"),
    "dos.png": ("`dos` without `bands`", "the density of states"),
    "forces.png": ("a simulation at one load", "force chains in the first sample, and how forces are distributed in all"),
    "sweep.nc": ("a sweep", "every state, as a data set for xarray (netCDF), see [below](#sweepnc-and-sweepcsv)"),
    "sweep.csv": ("a sweep", "the same as a table, without tensors and bands"),
    "sweep.png": ("a sweep of no more than one parameter", "velocities and exponents over the load"),
    "diameters.csv": ("a measured spread of more than 1000 balls", "`diameter (m)`: the diameters"),
    "fit.yaml": ("`granphon fit`", "the fit, see [below](#fityaml-and-fitcsv)"),
    "fit.csv": ("`granphon fit`", "data and fit"),
    "fit.png": ("`granphon fit`", "data, fit, equal balls, and residuals"),
    "tradeoff.csv": ("`granphon tradeoff`", "errors and costs, see [below](#tradeoffcsv)"),
    "tradeoff.png": ("`granphon tradeoff`", "error over time, a diagram for each study"),
}  # fmt: skip
#: fields of output files that are not observables
FIELDS = {
    "schema": "version of the file's format",
    "versions": "of granphon, and of the packages that the computation took",
    "source": "name of the scene file",
    "observe": "what was asked for",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept",
    "medium": "the medium, with its options",
    "local_field": "α, β and Ξ of the effective medium",
    "ok": "whether all checks under `validity` are passed",
    "validity": "the limits of the model: name, meaning, value, limit, and whether it is kept",
    "warnings": "a sentence for each limit that is passed",
    "files": "the files of this run; `--force` replaces these",
    "units": "the unit of each number above",
    "sizes": "of a sweep: how many values each dimension has",
    "states": "of a sweep: how many states",
    "frequency_Hz": "frequency",
    "total_per_Hz": "density of states of a ball",
    "translational_per_Hz": "the part of it that is translation",
    "rotational_per_Hz": "the part of it that is rotation",
    "frequency_unit": "the decimal unit of hertz of all frequencies in the file",
    "hertz": "that unit in hertz",
    "coordinates": "what stands in phonopy's x, y, z",
    "granphon_length_m": "unit of length, the mean diameter d",
    "granphon_stiffness_N_per_m": "unit of stiffness, the normal stiffness k",
    "granphon_mass_kg": "unit of mass, that of a ball, M",
    "version": "of granphon",
    "force_constants_scale": "by what the stored force constants are multiplied, a power of two",
    "auxiliary_atom": "symbol of the [heavy atom](../explanation/rotations.md#the-auxiliary-atom)",
    "zero_bands": "how many flat bands at zero the export has",
    "masses": "of the balls, over M",
    "species": "`Fe`, of no meaning",
    "pos": "place of the centre",
    "radius": "of the ball; OVITO draws it",
    "diameter_deviations": "diameter less the mean",
    "displacements": "from the site of the lattice",
    "slip_origin": "displacements at which contacts do not slip",
    "granphon_scales": "logarithms of the three units below, which some programs lose",
    "granphon_kind": "2, as of a sample",
    "rotations": "angle; zero in the statics",
    "contacts": "how many contacts carry load",
    "stderr": "standard error of the width; nan where it would rest on a scatter below the rounding of the data",
    "std": "standard deviation of the diameters, W/√12",
    "std_stderr": "standard error of the standard deviation",
    "p": "probability of a larger `chi2`; nan with sigma from the scatter, or no degrees of freedom",
    "sigma_given": "whether `sigma` was given",
    "class": "of the Python object; `WidthFit.from_dict` makes it again",
    "parameters": "what was fitted",
    "values": "of these parameters; `units` has that of each, parted by commas",
    "covariance": "of their errors; `units` has its rows, parted by semicolons",
    "velocity": "measured velocities",
    "sigma": "their standard errors, as given, or from the scatter",
    "velocities": "those of the fit",
    "chi2": "sum of (residual/sigma)²",
    "dof": "measurements less parameters",
    "fit": "velocity of the fit",
    "residual": "measured less fitted",
    "frequency": "of the pulse, if one was given",
}
#: the unit of fields whose files do not say it; one without a unit is "1"
FIELD_UNITS = {
    "granphon_length_m": "m", "granphon_stiffness_N_per_m": "N/m", "granphon_mass_kg": "kg", "hertz": "Hz",
    "force_constants_scale": "1", "masses": "M", "pos": "d", "radius": "d",
    "diameter_deviations": "d", "displacements": "d", "slip_origin": "d", "rotations": "rad", "chi2": "1", "p": "1",
}  # fmt: skip
#: of fit.yaml
FITTED = {
    "digest": "sha256 of the fields from `class` on; `from_dict` compares it",
    "choice": "the medium, and its options",
    "packing": "with the fitted parameters",
    "waves": "which waves were measured: branch, direction, frequency of the pulses",
}
#: of tradeoff.csv
MEASURED = {
    "study": "which question: media, or a knob inside one",
    "method": "what was measured",
    "knob": "its setting",
    "force": "the load, under its own name",
    "observed": "the quantity that the error is of",
    "error": "relative, against the study's reference",
    "reference_error": "that of the reference itself, as far as it is known",
    "resolved": "whether the reference is at least a hundred times better",
    "seconds": "median time of the warm runs",
    "spread": "half the range of their middle half",
    "setup": "median time of what is made ready once, before",
    "memory": "largest sum of what was allocated at a time",
    "floor": "the error cannot be below it: rounding, or the chance of the draws",
    "failure": "why it was not run; empty if it was",
}
#: of a sample, the mean force of a ball's contacts
SAMPLE = {"contact_force": ("mean force of its contacts, over that of all", "1")}
#: variables of a sweep that say nothing of themselves
SWEPT = {
    "medium": "the medium, with its options",
    "voigt_row": "xx, yy, xy",
    "voigt_column": "xx, yy, xy",
}
ATTRIBUTES = {
    "format": "`granphon sweep`",
    "schema": "version of the file's format",
    "versions": "of the packages, as JSON",
    "media": "with all their options, as JSON",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept",
    "direction": "of propagation, where velocities depend on it",
    "warnings": "a list of sentences, as JSON",
    "packing": "what is common to the sweep, as JSON",
    "bands": "corners of the path of the bands, as JSON",
    "labels": "of the corners of the path, as JSON",
}
