"""What keys, options and fields mean, in the words of the reference; ``_generate.py`` has
everything else about them.

Observables are not here: the catalogue of granphon/observables says what they mean.
"""

from __future__ import annotations

SPREADS = {
    "uniform": "even over this full width W, the mean ± W/2; `0 um` is equal balls",
    "normal": "normal, of this standard deviation, cut at three of them",
    "normal.std": "the same, as a block: the standard deviation",
    "normal.cutoff": "number of standard deviations at which it is cut",
    "discrete.diameters": "kinds of balls",
    "discrete.fractions": "fraction of each kind; they add up to 1",
    "measured": "a table of diameters beside the scene, whose first line heads its columns, as"
    " `diameter (mm)`; or the diameters themselves, as `[8 mm, 8.01 mm]`",
    "measured.file": "the same, as a block: the table",
    "measured.column": "heading of its column, if that is neither `diameter` nor the only one",
    "measured.diameters": "the diameters themselves, as a block",
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
#: what parameters of a sweep are, where the titles of the catalogue do not say all
PACKINGS = {
    "diameter": "mean diameter; leaves the spread as it is",
    "width": "width W; scales the spread and keeps its form, uniform if there is none",
    "friction": "with and without",
    "spread": "forms of the spread",
    "lattice": "lattices of one dimension",
    "motions": "motions of each ball",
    "torsion": "stiffness against twist, over k d²; numbers, and `mindlin`",
}
RANGE = {
    "from": "the first value",
    "to": "the last value; may be below the first",
    "points": "how many, both ends counted",
    "scale": "how they are spaced",
}
#: fields of output files that are not observables
FIELDS = {
    "schema": "version of the file's format",
    "versions": "versions of granphon and of the packages used",
    "source": "the scene file",
    "observe": "what the scene asked for",
    "finite_overlap": "whether terms of relative order overlap/diameter were kept; a list if media"
    " differ, and `some` where the load decides",
    "medium": "the medium, with its options",
    "local_field": "α, β and Ξ of the effective medium",
    "ok": "whether all checks of `validity` are passed; `valid` is of the medium alone",
    "validity": "the limits of the model, each with its value and whether it is kept",
    "warnings": "a sentence for each limit that is passed",
    "files": "the files of this run",
    "units": "the unit of each number above",
    "sizes": "number of values of each dimension of a sweep",
    "states": "number of states of a sweep",
    "frequency_unit": "the decimal unit of hertz of all frequencies in the file",
    "hertz": "the unit `frequency_unit` in hertz",
    "coordinates": "what phonopy's x, y and z stand for",
    "granphon_length_m": "unit of length, the mean diameter d",
    "granphon_stiffness_N_per_m": "unit of stiffness, the normal stiffness k",
    "granphon_mass_kg": "unit of mass, the mass M of a ball",
    "version": "version of granphon",
    "force_constants_scale": "factor of the stored force constants, a power of two",
    "auxiliary_atom": "symbol of the [heavy atom](../explanation/rotations.md#the-auxiliary-atom)",
    "zero_bands": "number of flat bands at zero frequency",
    "masses": "mass over M",
    "species": "`Fe`, which means nothing",
    "pos": "position of the centre",
    "radius": "radius; OVITO draws it",
    "diameter_deviations": "diameter minus the mean diameter",
    "displacements": "displacement from the site of the lattice",
    "slip_origin": "displacements at which contacts do not slip",
    "granphon_scales": "logarithms of the three units, which some programs lose",
    "granphon_kind": "2, the kind of balls in a sample",
    "rotations": "angle of rotation since the start of a loading with friction; else zero",
    "contacts": "number of contacts that carry load",
    "friction_coefficient": "μ of the contacts; with `friction_history`",
    "class": "class of the Python object; `WidthFit.from_dict` makes it again",
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
    "masses": "M",
    "pos": "d",
    "radius": "d",
    "diameter_deviations": "d",
    "displacements": "d",
    "slip_origin": "d",
    "rotations": "rad",
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
}
#: of tradeoff.csv
MEASURED = {
    "method": "what was measured",
    "knob": "setting of the method",
    "force": "the load, under the name of its kind",
    "observed": "the quantity whose error is given",
    "error": "relative error against the reference",
    "error_stderr": "standard error of `error`, of random samples",
    "draws": "runs that the error is of",
    "reference_error": "relative error of the reference, if known",
    "resolved": "whether the reference is a hundred times better",
    "seconds": "median time of the warm runs",
    "spread": "half the interquartile range of these times",
    "setup": "median time of what is done once",
    "memory": "peak of the allocated memory",
    "floor": "least error: rounding times condition, or the scatter of samples",
    "failure": "why it was not run",
}
#: of a sample, the mean force of a ball's contacts
SAMPLE = {
    "mass": ("`masses`, as OVITO reads them", "M"),
    "contact_force": ("mean force of its contacts, over that of all", "1"),
    "tangential_force": (
        "mean tangential force of its contacts, over the mean normal force; with"
        " `friction_history`",
        "1",
    ),
    "sliding_contacts": (
        "number of these that slide; with `friction_history`",
        "",
    ),
}
#: variables of a sweep that are not observables
SWEPT = {
    "medium": "the medium, with its options",
    "voigt_row": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
    "voigt_column": "xx, yy, xy; in space xx, yy, zz, yz, xz, xy",
    "polarisation": "polarisations of the spectra",
}
ATTRIBUTES = {
    "format": "`granphon sweep`",
    "media": "media with all their options, as JSON",
    "finite_overlap": "whether all states have terms of relative order overlap/diameter",
    "finite_overlap_of_media": "whether the states of each medium have these terms, null if some"
    " have, as JSON",
    "direction": "direction of propagation, if it was given or velocities depend on it",
    "packing": "parameters of the packing that do not vary, as JSON",
    "bands": "corners of the path of the bands, as JSON",
    "labels": "labels of the corners of the path, as JSON",
    "waves": "what is asked of waves and exponents, as JSON",
}
