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
    "packing.lattice": "how the balls are arranged, see [lattices](#lattices)",
    "packing.diameter": "diameter of a ball; the mean, if they differ",
    "packing.spread": "how diameters differ, see [spread](#spread)",
    "packing.friction": "whether contacts resist shear; without friction, torsion and bending balls do not rotate",
    "packing.finite_overlap": "keep the [terms of relative order overlap/diameter](../explanation/model.md#finite-overlap)",
    "packing.motions": "how each ball moves, see [lattices](#lattices)",
    "packing.torsion": "stiffness of a contact against twist, over k d²; `mindlin`: that of Hertz contacts without slip",
    "packing.bending": "stiffness of a contact against rolling, over k d²",
    "load.force": "mean force between touching balls",
    "load.pressure": "force per length of the boundary; on a chain the force, N; in space the force per area, Pa",
    "load.overlap": "how far touching balls are pressed into each other; may be negative if balls differ",
    "load.side_force": "push F on each side of a hexagonal frame: the contact force is F/(n √3)",
    "load.balls_per_side": "the number n of balls that lean on a side of that frame",
    "medium": "how a spread of diameters is averaged, see [media](#media)",
    "sweep": "parameters of the packing, each with the values that it takes, see [sweep](#sweep)",
    "observe": "what to compute; nothing else is computed. `dos` is for one state only",
    "direction": "direction of sound, Cartesian, or a list of directions, see [direction](#direction)",
    "phonopy.dim": "cells of the supercell for force constants, along each period; `3 1 1` on a chain, `3 3 3` in space",
    "phonopy.band": "corners of the path: letters, or three numbers each, in fractions of the reciprocal cell",
    "phonopy.band_labels": "a label for each corner",
    "phonopy.band_points": "points on each segment, both ends counted",
    "phonopy.mesh": "wave vectors for the density of states, along each period; `1024 1 1` on a chain, `32 32 32` in space",
}
DEFAULTS = {
    "material.yield_strength": "none: not checked",
    "packing.spread": "equal balls",
    "medium": "`ema`; `ala` for equal balls",
    "cluster.balls": "the first shell",
    "sweep": "none",
    "direction": "x",
    "phonopy.dim": "the smallest that is large enough",
    "phonopy.band": "Γ-K-M-Γ; Γ-X-M-Γ on the square lattice; Γ-X on a chain; in space ASE's",
    "phonopy.mesh": "`64 64 1`; `1024 1 1` on a chain; `32 32 32` in space",
    "packing.motions": "`longitudinal` on a chain, `in_plane` in the plane, `all` in space",
    "packing.torsion": "`0`",
    "packing.bending": "`0`",
    "phonopy.band_labels": "the letters of the path; none for one in numbers",
}
SPREADS = {
    "uniform": "even over this full width W, the mean ± W/2; `0 um` is equal balls",
    "normal": "normal, of this standard deviation, cut at three of them",
    "normal.std": "the same, as a block: the standard deviation",
    "normal.cutoff": "number of standard deviations at which it is cut",
    "discrete.diameters": "kinds of balls",
    "discrete.fractions": "fraction of each kind; they add up to 1",
    "measured": "a table of diameters beside the scene; the first line heads its columns, as `diameter (mm)`",
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
    "cluster": "cluster medium: a ball and its neighbours differ; better than `ema` at low load, and dearer",
    "simulation": "every ball of an array by itself; lattices that stand without friction (chain, triangular, fcc, hcp), "
    "no `finite_overlap`",
    "auto": "the cheapest of these whose expected error is within a tolerance",
}
RUNG_OPTIONS = {
    "ema.local_field": "computed, or what the paper prints, which is [wrong](../errata.md), to reproduce its curves",
    "cluster.balls": "balls of the cluster; 7, 19 or 37 on the triangular lattice, 13 in fcc and hcp",
    "simulation.shape": "cells along each period of the array, by default one of these, by the dimension of the lattice",
    "simulation.seed": "seed of the diameters of the first sample; each further sample has the next number",
    "simulation.samples": "how many arrays are averaged; two or more have standard errors",
    "auto.tolerance": "largest expected relative error of velocities and frequencies",
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
    "versions": "versions of granphon and of the packages that the computation used",
    "source": "name of the scene file",
    "observe": "what was computed, as the scene asked for",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept",
    "medium": "the medium, with its options",
    "local_field": "α, β and Ξ of the effective medium",
    "ok": "whether all checks under `validity` are passed",
    "validity": "the limits of the model: name, meaning, value, limit, and whether it is kept",
    "warnings": "a sentence for each limit that is passed",
    "files": "the files of this run; `--force` replaces these",
    "units": "the unit of each number above",
    "sizes": "number of values of each dimension of a sweep",
    "states": "number of states of a sweep",
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
    "force_constants_scale": "factor by which the stored force constants are multiplied, a power of two",
    "auxiliary_atom": "symbol of the [heavy atom](../explanation/rotations.md#the-auxiliary-atom)",
    "zero_bands": "number of flat bands at zero frequency in the export",
    "masses": "masses of the balls over M",
    "species": "`Fe`, which means nothing",
    "pos": "position of the centre",
    "radius": "radius of the ball; OVITO draws it",
    "diameter_deviations": "diameter minus the mean diameter",
    "displacements": "displacement from the site of the lattice",
    "slip_origin": "displacements at which contacts do not slip",
    "granphon_scales": "logarithms of the three units below, which some programs lose",
    "granphon_kind": "2, the kind of balls in a sample",
    "rotations": "angle of rotation; zero, as samples are in static equilibrium",
    "contacts": "number of contacts that carry load",
    "stderr": "standard error of the width; nan where it would rest on a scatter below the rounding of the data",
    "std": "standard deviation of the diameters, W/√12",
    "std_stderr": "standard error of the standard deviation",
    "p": "probability of a larger `chi2`; nan with sigma from the scatter, or no degrees of freedom",
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
    "granphon_length_m": "m", "granphon_stiffness_N_per_m": "N/m", "granphon_mass_kg": "kg", "hertz": "Hz",
    "force_constants_scale": "1", "masses": "M", "pos": "d", "radius": "d",
    "diameter_deviations": "d", "displacements": "d", "slip_origin": "d", "rotations": "rad", "chi2": "1", "p": "1",
}  # fmt: skip
#: of band.yaml and phonopy_params.yaml, where motions are not those in the plane
BANDED = {
    "periods": "number of periods of the lattice, 1 to 3; with the next two in schema 2 only",
    "motions": "motions of each ball: `longitudinal`, `out_of_plane`, `all`, or `in_plane` on a line",
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
    "study": "name of the study: it compares media, or settings inside one medium",
    "method": "what was measured",
    "knob": "setting of the method",
    "force": "the load, in a column with the name of its kind",
    "observed": "the quantity whose error is given",
    "error": "relative error against the reference of the study",
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
SAMPLE = {"contact_force": ("mean force of the contacts of the ball, over that of all contacts", "1")}
#: variables of a sweep that are not observables
SWEPT = {
    "medium": "the medium, with its options",
    "voigt_row": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
    "voigt_column": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
}
ATTRIBUTES = {
    "format": "`granphon sweep`",
    "schema": "version of the file's format",
    "versions": "versions of the packages, as JSON",
    "media": "media with all their options, as JSON",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept",
    "direction": "direction of propagation, if it was given or velocities depend on it",
    "warnings": "a list of sentences, as JSON",
    "packing": "parameters of the packing that do not vary, as JSON",
    "bands": "corners of the path of the bands, as JSON",
    "labels": "labels of the corners of the path, as JSON",
}
