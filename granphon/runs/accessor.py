"""What a data set of a sweep does by itself: ``dataset.granphon.plot()``, ``.exponent()``, ``.fit(...)``.

The accessor is there as soon as granphon has made or read a data set. Units are the attributes ``units`` of the variables,
which ``dataset.pint.quantify()`` of pint-xarray takes.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.packing import Packing
from granphon.base.errors import InputError
from granphon.base.results import restore
from granphon.base.text import closest

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


class SweepAccessor:
    """What ``dataset.granphon`` is, for a ``dataset`` of :func:`~granphon.sweep` or :func:`~granphon.load_sweep`."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset

    @property
    def packing(self) -> Packing:
        """The packing that was swept; :class:`InputError` for a data set of a crystal, or one that granphon has not made."""
        try:
            found: Packing = restore(json.loads(self._dataset.attrs["packing"]), Packing, "the attribute packing")
        except (KeyError, ValueError, TypeError):
            raise InputError(
                "the data set holds no packing", "It is a crystal's, or was not made by granphon.sweep"
            ) from None
        return found

    def plot(self, **options: Any) -> Any:
        """Return the figure of the sweep; ``options`` are those of :func:`~granphon.plot`, as ``variable``."""
        import granphon

        return granphon.plot(self._dataset, **options)

    def exponent(self, name: str = "longitudinal", over: str | None = None) -> DataArray:
        """Return the local exponent of a variable over the load, d log(variable)/d log(load), of the variable's shape.

        It is the slope of the parabola through each load and its neighbours, on logarithmic scales, so that its error goes
        as the square of their distance. The variable ``exponent`` of a sweep has that of the velocities at each load alone.

        Parameters
        ----------
        name : the variable.
        over : another variable, as "pressure", in place of what the loads are given by.

        Raises
        ------
        InputError : a name that the data set does not have, fewer than three loads, loads that do not ascend, or values that
            are not above zero.
        """
        data = self._dataset
        for one in (name, over or name):
            if one not in data.variables:
                meant = closest(one, map(str, data.variables))
                raise InputError(f"the data set has no {one!r}", mend=f"Did you mean {meant!r}?" if meant else "")
        values = data[name]
        loads = data[over] if over else _find_load(data)
        if "load" not in values.dims or data.sizes["load"] < 3:
            raise InputError("an exponent needs three loads or more", mend="Sweep more loads")
        x, y = (one.transpose("load", ...).values.astype(float) for one in (loads, values))
        if not (np.all(x > 0.0) and np.all(y[~np.isnan(y)] > 0.0) and np.all(np.diff(x, axis=0) > 0.0)):
            raise InputError(f"{name} has no exponent here", "Loads must ascend, and values be above zero")
        x, y = np.log(x.reshape(len(x), *(1,) * (y.ndim - 1)) if x.ndim == 1 else x + 0.0 * y), np.log(y)
        found = values.transpose("load", ...).copy(data=_slopes(np.broadcast_to(x, y.shape), y))
        found.attrs = {"units": "1", "long_name": f"local exponent of {values.attrs.get('long_name', name)}"}
        return found.transpose(*values.dims).rename(f"{name}_exponent")

    def fit(self, force: ArrayLike, velocity: ArrayLike, *more: Any, **options: Any) -> Any:
        """Fit the width of the packing to measured ``velocity``, m/s (n,), over ``force``, N (n,).

        ``more``, ``options`` and the result are those of :func:`~granphon.fit_width` for the packing of the data set.
        """
        import granphon

        return granphon.fit_width(self.packing, force, velocity, *more, **options)


def _find_load(data: Dataset) -> Any:
    """Return the coordinate that the loads were given by."""
    return next(data[name] for name in ("force", "pressure", "overlap", "stress", "strain") if data[name].dims == ("load",))


def _slopes(x: Any, y: Any) -> Any:
    """Return the slope at each point of the parabola through it and its neighbours, along the first axis."""
    out = np.empty_like(y)
    for at in range(len(x)):
        first = min(max(at - 1, 0), len(x) - 3)
        (a, b, c), (fa, fb, fc) = x[first : first + 3], y[first : first + 3]
        ab, bc = (fb - fa) / (b - a), (fc - fb) / (c - b)
        out[at] = ab + (bc - ab) / (c - a) * (2.0 * x[at] - a - b)
    return out


def register_accessor() -> None:
    """Give data sets the accessor, once."""
    import xarray

    if getattr(xarray.Dataset, "granphon", None) is not SweepAccessor:
        register: Any = xarray.register_dataset_accessor
        register("granphon")(SweepAccessor)
