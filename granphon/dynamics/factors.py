"""Factors of sparse matrices, and the number of eigenvalues below zero, which the factors of a
symmetric matrix tell.

Symmetric matrices, real or complex with A = A^T, are factorised by the library rslab as A = L D
L^T, with pivots of one or two rows (Bunch and Kaufman). D has as many eigenvalues below zero as A
(Sylvester's law of inertia). If there are none, a stationary point is proved to be a minimum; and
factors of A - s count the eigenvalues of A below s. The order of elimination is found once for all
matrices with entries at the same places. SuperLU factorises matrices that are not symmetric, and
all matrices if rslab is not installed.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import ConvergenceError

#: part of the largest entry of a column from which SuperLU takes the entry on the diagonal as the
#: pivot. With a tenth, factors of damped matrices within bands have up to a hundred times more
#: entries, and solutions that are refined have no digit more
_PIVOT = 1e-5
#: entries of factors from which rslab shares their work among threads: of fewer, threads take more
#: of the processor (tests/benchmarks/bench_commands.py), and no less time
_LEAST_SHARED_ENTRIES = 10**6


class Factors(Protocol):
    """What the factors of a matrix A (n, n) can do."""

    def solve(self, right: NDArray[Any], /) -> NDArray[Any]:
        """Return x of A x = ``right``, (n,) or (n, m)."""

    @property
    def n_below(self) -> int:
        """Number of eigenvalues of A below zero, where A is real and symmetric.

        Without rslab a new factorisation may be needed, and
        :class:`~granphon.base.errors.ConvergenceError` is raised if that does not tell the number.
        """


class Elimination:
    """The order of elimination of all symmetric matrices that have entries at the same places as
    the sparse ``matrix``.

    If ``is_approximate``, factors are in single precision, half as large, for preconditioners;
    their order of elimination is found in half of the time, and leaves factors with a few more
    entries.
    """

    def __init__(self, matrix: Any, is_approximate: bool = False) -> None:
        """Find the order of elimination by rslab, if it is installed."""
        self._is_approximate = is_approximate
        self._symbolic: Any = None
        #: threads that share the work of factors; None: as many as rslab chooses
        self._threads: int | None = None
        try:
            import rslab
        except ImportError:
            return  # without rslab `factorise` uses SuperLU, which finds its own order each time
        columns = _sort_columns(matrix)
        #: the lines of the stored entries, column by column
        self._lines = columns.indices
        #: which of these entries stand on the diagonal or below it: rslab reads these alone
        self._is_lower = self._lines >= np.repeat(
            np.arange(columns.shape[1]), np.diff(columns.indptr)
        )
        order = "amd" if is_approximate else "auto"
        self._symbolic = rslab.analyze(columns, path="ldlt", ordering=order)
        if self._symbolic.factor_nnz < _LEAST_SHARED_ENTRIES:
            self._threads = 1

    def factorise(self, matrix: Any) -> Factors:
        """Return the factors of a symmetric sparse ``matrix`` with entries at these places.

        Raises RuntimeError if the matrix is singular. With rslab, ValueError is raised if it has
        entries at other places.
        """
        if self._symbolic is None:
            # only positive definite matrices have approximate factors, and need no exchange of rows
            pivot = 0.0 if self._is_approximate else _PIVOT
            return _LUFactors(matrix, pivot, self._is_approximate)
        columns = _sort_columns(matrix)
        if not np.array_equal(columns.indices, self._lines):
            raise ValueError("the matrix has entries at other places than its order of elimination")
        entries = columns.data[self._is_lower]
        if self._is_approximate:
            entries = _halve_precision(entries)
        return _LDLFactors(self._symbolic.factor(entries, threads=self._threads))


def factorise(matrix: Any, symmetric: bool = True, approximate: bool = False) -> Factors:
    """Return the factors of a sparse ``matrix`` A, which has an entry A_ji wherever it has A_ij.

    ``symmetric`` says whether A_ij = A_ji, without conjugation if A is complex. ``approximate``
    factors are in single precision, see :class:`Elimination`. Raises RuntimeError if the matrix is
    singular.
    """
    if symmetric:
        return Elimination(matrix, approximate).factorise(matrix)
    return _LUFactors(matrix, _PIVOT, approximate)


def _sort_columns(matrix: Any) -> Any:
    """Return a sparse ``matrix`` stored by columns, each with its lines in ascending order."""
    columns = matrix.tocsc()
    columns.sum_duplicates()  # sorts; nothing to do for a matrix that is known to be sorted
    return columns


def _halve_precision(values: Any) -> Any:
    """Return ``values``, real or complex, an array or a sparse matrix, in single precision."""
    return values.astype(np.complex64 if np.iscomplexobj(values) else np.float32)


class _LDLFactors:
    """Factors L D L^T that rslab has found."""

    def __init__(self, factors: Any) -> None:
        """Keep the object of rslab that holds the factors."""
        self._factors = factors

    def solve(self, right: NDArray[Any], /) -> NDArray[Any]:
        """Return x of A x = ``right``, (n,) or (n, m)."""
        dtype = np.dtype(self._factors.dtype)
        if np.iscomplexobj(right) and dtype.kind != "c":
            # real factors solve for real and imaginary parts apart
            return np.asarray(self.solve(right.real) + 1j * self.solve(right.imag))
        columns = np.asarray(right, dtype)
        if not columns.size:  # rslab refuses arrays without columns
            return columns.copy()
        if columns.ndim == 1:
            return np.asarray(self._factors.solve(columns))
        return np.asarray(self._factors.solve_many(columns))

    @property
    def n_below(self) -> int:
        """Number of eigenvalues of A below zero."""
        return int(self._factors.inertia[1])


class _LUFactors:
    """Factors L U of a sparse ``matrix``, found by SuperLU.

    A pivot is taken from the diagonal if its entry is at least the part ``pivot`` of the largest
    entry of its column. If ``approximate``, factors are in single precision.
    """

    def __init__(self, matrix: Any, pivot: float, approximate: bool) -> None:
        """Factorise the sparse ``matrix``; raise RuntimeError if it is singular."""
        from scipy.sparse.linalg import splu

        self._matrix = matrix
        columns = matrix.tocsc()
        options: dict[str, Any] = {"SymmetricMode": True}
        relax = None
        if approximate:
            columns = _halve_precision(columns)
            options["Equil"] = False
            # SuperLU would else treat neighbouring columns as one dense block (a supernode), and
            # fill a matrix of so few entries with zeros
            relax = 1
        self._dtype = columns.dtype
        self._factors = splu(
            columns, "MMD_AT_PLUS_A", diag_pivot_thresh=pivot, relax=relax, options=options
        )

    def solve(self, right: NDArray[Any], /) -> NDArray[Any]:
        """Return x of A x = ``right``, (n,) or (n, m)."""
        if np.iscomplexobj(right) and self._dtype.kind != "c":
            # real factors solve for real and imaginary parts apart
            return np.asarray(self.solve(right.real) + 1j * self.solve(right.imag))
        return np.asarray(self._factors.solve(np.asarray(right, self._dtype)))

    @cached_property
    def n_below(self) -> int:
        """Number of eigenvalues of A below zero.

        Raises :class:`~granphon.base.errors.ConvergenceError` if there are no factors with all
        pivots on the diagonal.
        """
        # if no rows were exchanged, as many pivots as eigenvalues are below zero
        factors = self._factors
        if not np.array_equal(factors.perm_r, factors.perm_c):
            # new factors, with pivot = 0, which takes any entry on the diagonal but zero
            factors = _LUFactors(self._matrix, pivot=0.0, approximate=False)._factors
        if not np.array_equal(factors.perm_r, factors.perm_c):
            raise ConvergenceError(
                "the factors of a matrix have pivots off the diagonal",
                "Its eigenvalues are not counted",
                "Install rslab",
            )
        return int(np.sum(factors.U.diagonal() < 0.0))
