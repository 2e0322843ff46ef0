"""C of a periodic array of contacts, its transpose, and C^T D C, without a matrix.

C maps the motions of balls to the deformations of contacts. The product of a small matrix with the
motions of all balls gives what the two ends of all contacts contribute to all deformations, and
another such product the forces on balls; between them stand shifts of whole arrays with ghost
cells. In the flattened array a shift by some cells is one number of places: so the two ends of all
contacts of a kind are two slices of one long array, whatever the number of dimensions. Ghost cells
hold images of balls, and images of contacts: so each ball finds all its contacts, and nothing has
to be added up across the boundary. The array is worked on in slabs, some layers of its first axis
at a time, that stay in the processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

Values = NDArray[Any]
Slices = tuple[Any, ...]
#: about the greatest number of bytes that the contributions of the ends of contacts in one slab
#: take, so that they stay in the processor's cache
_CACHE_BYTES = 2**21
#: least ratio of the layers of a slab to the ghost layers around it; the work of these is done
#: once more in another slab
_LEAST_RATIO = 2
#: number of multiplications in a product of matrices up to which OpenBLAS takes one thread
_PRODUCTS_OF_THREAD = 2**18


class Halo:
    """Ghost cells of periodic arrays: as many layers on each side as the farthest contact needs.

    Parameters
    ----------
    shape : numbers of cells (L1, ..., Lp).
    shifts : for each contact, one or more, the p numbers of cells to the cell that it leads to.

    Attributes
    ----------
    below, above : numbers of ghost layers on the two sides of each axis.
    outer : shape (P1, ..., Pp) with ghost cells.
    inner : index of the array without ghost cells in an array (..., P1, ..., Pp) with them.
    """

    def __init__(self, shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> None:
        """Find how many ghost layers the shifts need, and the shape with them."""
        self.shape = tuple(shape)
        steps_of_axes = list(zip(*shifts, strict=True))
        self.below = tuple(max(0, -min(steps)) for steps in steps_of_axes)
        self.above = tuple(max(0, *steps) for steps in steps_of_axes)
        self.outer = tuple(
            sum(widths) for widths in zip(self.below, self.shape, self.above, strict=True)
        )
        # the numbers of places in the flattened array by which one step along each axis moves
        self._strides = [math.prod(self.outer[axis + 1 :]) for axis in range(len(self.outer))]
        inside = (slice(low, low + size) for low, size in zip(self.below, self.shape, strict=True))
        self.inner: tuple[Any, ...] = (..., *inside)

    def offset(self, shift: Sequence[int]) -> int:
        """Return the number of places in the flattened array by which a ``shift`` (p,) of cells
        moves.
        """
        return sum(step * stride for step, stride in zip(shift, self._strides, strict=True))

    def images(self, array: Values, first: int) -> Iterator[tuple[Values, Values]]:
        """Yield pairs of views of an ``array`` (..., P1, ..., Pp): ghost layers, and the layers
        that they repeat, axis after axis from the axis ``first`` on.

        The caller copies the second of each pair to the first; in this order corners become right
        too.
        """
        for axis in range(first, len(self.shape)):
            below = self.below[axis]
            size = self.shape[axis]
            above = self.above[axis]
            stop = below + size
            # if there are more ghost layers than layers, they repeat the array more than once
            for n_copied in range(0, above, size):
                count = min(size, above - n_copied)
                ghosts = self._take_layers(array, axis, stop + n_copied, count)
                yield ghosts, self._take_layers(array, axis, below, count)
            for n_copied in range(0, below, size):
                count = min(size, below - n_copied)
                ghosts = self._take_layers(array, axis, below - n_copied - count, count)
                yield ghosts, self._take_layers(array, axis, stop - count, count)

    def _take_layers(self, array: Values, axis: int, start: int, count: int) -> Values:
        """Return a view of ``count`` layers along the ``axis`` of an ``array`` (..., P1, ..., Pp),
        from the layer ``start`` on.
        """
        later_axes: tuple[Any, ...] = (slice(None),) * (len(self.shape) - 1 - axis)
        return array[(..., slice(start, start + count), *later_axes)]


class _Workspace(NamedTuple):
    """Views of the two buffers for a slab of the array. One buffer is ``balls``; the other holds
    the contributions of the two ends of contacts to deformations, first those of all heads, then
    those of all tails.

    The axis ``places`` runs over places in the flattened slab, ghost cells included; each range of
    places begins and ends where the slab needs it.

    Attributes
    ----------
    balls : (fields, layers, ...) motions of balls, and later forces on them.
    images : pairs of ghost cells and the cells that they repeat, along all axes but the first.
    near : (fields, places) motions of the balls that contacts with an end in the slab join.
    ends : (2 rows, places) contributions of these balls, as balls j and as balls i of contacts.
    contacts : (rows, layers, ...) the contributions of the tails, which deformations and then
        tensions of all contacts replace, at the cell of ball i.
    rows : (rows, places) the part of ``contacts`` that has an end in the slab.
    pairs : for each kind of contact, the contributions of its heads and of its tails.
    gathered : for each kind of contact, the places of its heads, at the cell of ball j, to which
        tensions are copied; and the tensions, at the cell of ball i.
    joined : (2 rows, places) tensions at both ends of contacts, at the cell of the ball.
    forces : (fields, places) forces on the balls of the slab.
    """

    balls: Values
    images: list[tuple[Values, Values]]
    near: Values
    ends: Values
    contacts: Values
    rows: Values
    pairs: list[tuple[Values, Values]]
    gathered: list[tuple[Values, Values]]
    joined: Values
    forces: Values


class _Slab(NamedTuple):
    """Layers of the first axis that are worked on together.

    Attributes
    ----------
    layers : the layers in the array.
    sources : pairs of layers of the array and of their index in the workspace, ghost layers
        included.
    start : place in the flattened array where the slab's ``rows`` begin.
    inner : index of the layers in the workspace.
    space : the workspace, which slabs with as many layers share.
    """

    layers: slice
    sources: list[tuple[slice, Slices]]
    start: int
    inner: Slices
    space: _Workspace


class ContactOperator:
    """C of an array of cells.

    A deformation is ``head . x_j - tail . x_i``, where x are the motions of all balls of the cells
    of balls j and i. Motions and forces are (fields, L1, ..., Lp); deformations and tensions are
    (rows, L1, ..., Lp), at the cell of ball i. Results have the precision of the motions or
    tensions that are given.

    Parameters
    ----------
    shape : numbers of cells (L1, ..., Lp).
    shifts : for each contact of a cell, the p numbers of cells from ball i to ball j.
    head, tail : (rows, fields) coefficients. Rows come in groups, elongations first; each group has
        one row for each contact of a cell, in the order of ``shifts``.
    """

    def __init__(
        self, shape: Sequence[int], shifts: Sequence[tuple[int, ...]], head: Values, tail: Values
    ) -> None:
        """Find how many ghost layers the array needs; :meth:`slabs` makes the buffers later."""
        both_ways = [tuple(sign * n for n in shift) for shift in shifts for sign in (1, -1)]
        halo = Halo(shape, both_ways)  # with no more ghost layers than contacts need
        other_axes = (0,) * (len(shape) - 1)  # no step along the axes but the first
        steps = [halo.offset(shift) for shift in shifts]
        # deformations of all kinds of contacts are found for the same places of balls i: a contact
        # that begins in a ghost cell and leads away from the slab needs a cell j too. There are so
        # many ghost layers that the farthest of these cells is among them
        farthest = max(0, *steps) - min(0, *steps) - halo.offset((0, *halo.below[1:]))
        layers = math.ceil(farthest / halo.offset((1, *other_axes)))
        self.shape = tuple(shape)
        self.n_contacts = len(shifts)
        self.head = head
        self.tail = tail
        self.n_rows, self.n_fields = head.shape
        self.halo = Halo(shape, [*both_ways, (layers, *other_axes), (-layers, *other_axes)])
        self._stride = self.halo.offset((1, *other_axes))
        self._steps = [self.halo.offset(shift) for shift in shifts]
        #: slabs by the precision of their buffers
        self._slabs: dict[Any, list[_Slab]] = {}

    # -- slabs -------------------------------------------------------------------------------------

    def slabs(self, precision: DTypeLike) -> list[_Slab]:
        """Return the slabs of the array, in order, with buffers of a ``precision``, which slabs
        with as many layers share. The slabs are kept for further calls.
        """
        key = np.dtype(precision)
        if key not in self._slabs:
            self._slabs[key] = self._make_slabs(key)
        return self._slabs[key]

    def _make_slabs(self, precision: np.dtype[Any]) -> list[_Slab]:
        """Return the slabs of :meth:`slabs`."""
        halo = self.halo
        below = halo.below[0]
        count = self.shape[0]
        ghosts = below + halo.above[0]
        layer_bytes = 2 * self.n_rows * precision.itemsize * self._stride
        most_layers = max(1, _CACHE_BYTES // layer_bytes - ghosts, _LEAST_RATIO * ghosts)
        n_slabs = math.ceil(count / most_layers)
        step = math.ceil(count / n_slabs)  # slabs of one length, but for the last
        spaces: dict[int, _Workspace] = {}
        slabs = []
        for start in range(0, count, step):
            stop = min(start + step, count)
            layers = stop - start
            if layers not in spaces:
                spaces[layers] = self._make_workspace(layers, precision)
            slabs.append(
                _Slab(
                    layers=slice(start, stop),
                    sources=self._list_sources(start, stop),
                    start=start * self._stride + halo.offset(halo.below) - max(0, *self._steps),
                    inner=(slice(None), slice(below, below + layers), *halo.inner[2:]),
                    space=spaces[layers],
                )
            )
        return slabs

    def _list_sources(self, start: int, stop: int) -> list[tuple[slice, Slices]]:
        """Return the ``sources`` of the :class:`_Slab` of the layers from ``start`` to before
        ``stop``: runs of layers that follow each other in the array.
        """
        halo = self.halo
        count = self.shape[0]
        first = start - halo.below[0]
        end = stop + halo.above[0]
        sources = []
        layer = first
        while layer < end:
            low = layer % count
            length = min(count - low, end - layer)
            place = layer - first
            in_workspace = (slice(None), slice(place, place + length), *halo.inner[2:])
            sources.append((slice(low, low + length), in_workspace))
            layer += length
        return sources

    def _make_workspace(self, layers: int, precision: DTypeLike) -> _Workspace:
        """Return new buffers of a ``precision`` for a slab of so many ``layers``: the views over
        which :meth:`deform`, :meth:`collect` and :class:`ContactHessian` loop.
        """
        halo = self.halo
        n = self.n_contacts
        count = self.n_rows
        outer = (layers + halo.below[0] + halo.above[0], *halo.outer[1:])
        balls = np.zeros((self.n_fields, *outer), precision)
        ends = np.zeros((2 * count, *outer), precision)
        flat = balls.reshape(self.n_fields, -1)
        flat_ends = ends.reshape(2 * count, -1)
        heads, tails = flat_ends.reshape(2, -1, n, flat.shape[1])
        least_step = min(0, *self._steps)
        most_step = max(0, *self._steps)
        # balls of the slab, between its ghosts
        first = halo.offset(halo.below)
        end = flat.shape[1] - halo.offset(halo.above)
        # balls i of contacts that have an end in the slab
        low = first - most_step
        high = end - least_step
        kinds = list(enumerate(self._steps))
        return _Workspace(
            balls=balls,
            images=list(halo.images(balls, 1)),
            near=flat[:, low + least_step : high + most_step],
            ends=flat_ends[:, low + least_step : high + most_step],
            contacts=ends[count:],
            rows=flat_ends[count:, low:high],
            pairs=[
                (heads[:, kind, low + step : high + step], tails[:, kind, low:high])
                for kind, step in kinds
            ],
            gathered=[
                (heads[:, kind, first:end], tails[:, kind, first - step : end - step])
                for kind, step in kinds
            ],
            joined=flat_ends[:, first:end],
            forces=flat[:, first:end],
        )

    # -- products ----------------------------------------------------------------------------------

    def deform(self, balls: Values) -> Values:
        """Return the deformations C u (rows, L1, ..., Lp) by the motions u, ``balls`` (fields, L1,
        ..., Lp).
        """
        out = np.empty((self.n_rows, *self.shape), balls.dtype)
        split = np.concatenate([self.head, self.tail]).astype(balls.real.dtype)
        for slab in self.slabs(balls.dtype):
            stretch(split, balls, slab)
            out[:, slab.layers] = slab.space.contacts[slab.inner]
        return out

    def pull(self, *tensions: Values) -> Values:
        """Return the forces C^T f (fields, L1, ..., Lp) of the tensions f. ``tensions`` are f in
        parts (n, L1, ..., Lp), one after the other, (rows, L1, ..., Lp) in all.
        """
        return self.collect(np.concatenate([self.head, -self.tail]).T, tensions)

    def collect(self, matrix: Values, contacts: Sequence[Values]) -> Values:
        """Return sums (m, L1, ..., Lp) over contacts: for each cell, ``matrix`` (m, 2 rows) times
        the values of the contacts that end or start in the cell.

        The first half of the columns multiplies the values of contacts whose ball j is in the cell,
        the second half those of contacts whose ball i is in the cell. ``contacts`` are the values
        in parts (n, L1, ..., Lp), one after the other, (rows, L1, ..., Lp) in all.
        """
        precision = contacts[0].dtype
        matrix = matrix.astype(contacts[0].real.dtype)
        out = np.empty((len(matrix), *self.shape), precision)
        for slab in self.slabs(precision):
            space = slab.space
            row = 0
            for values in contacts:
                for layers, source in slab.sources:
                    space.contacts[row : row + len(values)][source] = values[:, layers]
                row += len(values)
            for image, cell in self.halo.images(space.contacts, 1):
                image[...] = cell
            for place, tension in space.gathered:
                place[...] = tension
            if len(matrix) == self.n_fields:  # the buffer of the balls has room for the sums
                sums = space.balls
                flat_sums = space.forces
            else:
                sums = np.empty((len(matrix), *space.balls.shape[1:]), precision)
                first = self.halo.offset(self.halo.below)
                flat_sums = sums.reshape(len(matrix), -1)[:, first : first + space.forces.shape[1]]
            multiply_columns(matrix, space.joined, flat_sums)
            out[:, slab.layers] = sums[slab.inner]
        return out


class ContactHessian:
    """Product of C^T D C with motions of balls, in a given precision; D is diagonal.

    Parameters
    ----------
    operator : C.
    stiffness : the diagonal of D, in parts (n, L1, ..., Lp) one after the other, (rows, L1, ...,
        Lp) in all.
    precision : single or double, real or complex; that of all motions. It is complex if stiffnesses
        have losses, or if motions are complex.
    """

    def __init__(
        self,
        operator: ContactOperator,
        stiffness: Sequence[Values],
        precision: DTypeLike = np.float32,
    ) -> None:
        """Cut D into the parts of the slabs, with images in the ghost cells."""
        self._operator = operator
        self._precision = np.dtype(precision)
        real = np.zeros(0, precision).real.dtype
        self._split = np.concatenate([operator.head, operator.tail]).astype(real)
        self._join = np.concatenate([operator.head, -operator.tail]).T.astype(real)
        # with images in the ghost cells
        diagonal = np.empty((operator.n_rows, *operator.halo.outer), precision)
        np.concatenate(stiffness, out=diagonal[operator.halo.inner])
        for image, cell in operator.halo.images(diagonal, 0):
            image[...] = cell
        diagonal = diagonal.reshape(len(diagonal), -1)
        #: D of each slab
        self._diagonals: list[Values] = []
        for slab in operator.slabs(precision):
            count = slab.space.rows.shape[1]
            self._diagonals.append(diagonal[:, slab.start : slab.start + count])

    def __call__(self, balls: Values, press: float | None = None) -> tuple[Values, float]:
        """Return the forces C^T D C u (fields, L1, ..., Lp) for the motions u, ``balls`` (fields,
        L1, ..., Lp), and minus the sum of the tensions against elongations.

        ``press`` is added to the overlaps of all contacts, and so subtracted from their
        elongations. If ``press`` is None, nothing is added, and the sum is returned as zero; so it
        has to be where the precision is complex.
        """
        operator = self._operator
        n = self._operator.n_contacts
        total = 0.0
        out = np.empty((operator.n_fields, *operator.shape), self._precision)
        for slab, diagonal in zip(operator.slabs(self._precision), self._diagonals, strict=True):
            space = slab.space
            stretch(self._split, balls, slab)
            if press:
                loss = space.rows[:n]
                np.subtract(loss, space.rows.dtype.type(press), out=loss)
            np.multiply(space.rows, diagonal, out=space.rows)
            if press is not None:
                total -= float(np.sum(space.contacts[:n][slab.inner]))
            for place, tension in space.gathered:
                place[...] = tension
            multiply_columns(self._join, space.joined, space.forces)
            out[:, slab.layers] = space.balls[slab.inner]
        return out, total

    @property
    def n_contacts(self) -> int:
        """Number of contacts of the array."""
        return self._operator.n_contacts * math.prod(self._operator.shape)


def stretch(split: Values, balls: Values, slab: _Slab) -> None:
    """Write the deformations of the contacts of a ``slab`` into its buffer, as
    ``slab.space.rows``. ``balls`` (fields, L1, ..., Lp) are the motions, and ``split`` (2 rows,
    fields) the coefficients of heads and then of tails.
    """
    space = slab.space
    for layers, place in slab.sources:
        space.balls[place] = balls[:, layers]
    for image, cell in space.images:
        image[...] = cell
    multiply_columns(split, space.near, space.ends)
    for head, tail in space.pairs:
        np.subtract(head, tail, out=tail)


def multiply_columns(matrix: Values, columns: Values, out: Values) -> None:
    """Write the product of a small ``matrix`` (m, n) with ``columns`` (n, places) into ``out`` (m,
    places), in parts that are so small that BLAS takes one thread.

    Threads of BLAS wait for each other, and their number changes the last digit. If the matrix is
    real and the columns are complex, the real and the imaginary part of each column are multiplied
    as two columns.
    """
    if matrix.dtype != out.dtype:
        columns = columns.view(matrix.dtype)
        out = out.view(matrix.dtype)
    step = max(1, _PRODUCTS_OF_THREAD // matrix.size)
    if columns.shape[1] <= step:
        np.matmul(matrix, columns, out=out)
        return
    for low in range(0, columns.shape[1], step):
        np.matmul(matrix, columns[:, low : low + step], out=out[:, low : low + step])
