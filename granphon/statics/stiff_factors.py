"""Factors of the stiff contacts of a list, a preconditioner where many contacts are open."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Flags
from granphon.contacts.columns import Columns
from granphon.contacts.tangent import Pattern, fill_blocks
from granphon.dynamics.factors import factorise
from granphon.statics.options import RestOptions


def factorise_stiff(
    columns: Columns, axes: NDArray[np.int64], n_balls: int, options: RestOptions
) -> Callable[[Array], Array]:
    """Return an approximate inverse of the tangent of the contacts ``columns``, a function from
    forces (n m,) to motions (n m,), in which the m motions of a ball follow each other; ``axes``
    (m,) are those of the motions, 0 to 2 of displacements and 3 to 5 of rotations.

    Contacts that are softer than the part ``options.factor_stiffness`` of the mean enter by their
    part of the diagonal only, and a weak spring is added at each motion. The inverse is symmetric
    but for rounding, and positive definite.
    """
    stiffness = columns.normal_stiffness
    mean = float(np.mean(stiffness))
    is_stiff = stiffness > options.factor_stiffness * mean
    no_strains = np.zeros((0, 3, 3))
    stiff = _select(columns, is_stiff)
    tangent = fill_blocks(stiff, axes, no_strains, n_balls)
    soft = fill_blocks(_select(columns, ~is_stiff), axes, no_strains, n_balls)
    motions = np.arange(len(axes))
    of_soft = soft.diagonal[motions, motions]
    tangent.diagonal[motions, motions] += of_soft + options.grid.spring * mean
    # made anew, and not kept: which contacts are stiff changes from step to step
    pattern = Pattern(stiff.i, stiff.j, n_balls, len(axes))
    data = pattern.list_entries(tangent)
    # scaled to a diagonal of one, which single precision holds
    scale = 1.0 / np.sqrt(data[pattern.diagonal])
    matrix = pattern.make_matrix(data)
    matrix.data *= scale[matrix.indices] * np.repeat(scale, np.diff(matrix.indptr))
    matrix.data[pattern.diagonal] += options.grid.spring
    factors = factorise(matrix, approximate=True)

    def solve(force: Array) -> Array:
        """Return the motion (n m,) under a ``force`` (n m,), with the digits of single
        precision.
        """
        scaled = scale * force
        # single precision has no numbers below 1e-38
        largest = float(np.max(np.abs(scaled))) or 1.0
        motion = factors.solve((scaled / largest).astype(np.float32))
        return np.asarray(scale * motion * largest)

    return solve


def _select(columns: Columns, chosen: Flags) -> Columns:
    """Return the ``columns`` of the ``chosen`` contacts (n_c,); columns without entries stay so."""
    return columns._replace(
        **{name: values[chosen] for name, values in columns._asdict().items() if len(values)}
    )
