"""The picture of a result that it gets if nothing more is said; this module does not load
matplotlib until it draws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, brief
from granphon.networks.network import ContactNetwork, refuse_unpressed
from granphon.runs.dataset import find_dataset

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: for the class of a result, by the package and the name, so that none is imported here: the module
#: of figures, the function that draws it, the keyword under which the function takes it, and where
#: it draws on an Axes, the height of a figure of it, inches
_PICTURES: dict[str, tuple[str, str, str, float]] = {
    "granphon.Bands": ("bands", "bands_figure", "bands", 0.0),
    "granphon.DensityOfStates": ("bands", "bands_figure", "dos", 0.0),
    "granphon.WidthFit": ("curves", "fit_figure", "fit", 0.0),
    "granphon.DampingFit": ("waves", "transfer_fit_figure", "fit", 0.0),
    "granphon.TradeOff": ("work_precision", "tradeoff_figure", "result", 0.0),
    "granphon.PathSpectra": ("waves", "spectrum_figure", "spectra", 0.0),
    "granphon.SpectralFunction": ("waves", "plot_lines", "spectrum", 2.6),
    "granphon.SpectralDensity": ("waves", "plot_sample_dos", "dos", 2.4),
    "granphon.SurfaceSpectrum": ("waves", "plot_surface", "spectrum", 3.1),
    "granphon.Transmission": ("waves", "plot_transmission", "result", 2.3),
    "granphon.ComplexBands": ("waves", "complex_bands_figure", "bands", 0.0),
    "granphon.Motion": ("motions", "motion_figure", "motion", 0.0),
    "granphon.Response": ("waves", "response_figure", "response", 0.0),
    "granphon.Pulse": ("waves", "pulse_figure", "pulse", 0.0),
    "granphon.NetworkModes": ("modes", "plot_network_mode", "modes", 3.4),
    "granphon.ContactNetwork": ("forces", "plot_forces", "sample", 0.0),
    "granphon.SimulatedState": ("forces", "forces_figure", "state", 0.0),
    "xarray.Dataset": ("curves", "sweep_figure", "dataset", 0.0),
}
#: the same for what is found of the network of each state of a data set, by the block of the scene
_OF_STATES = {
    "response": ("waves", "responses_figure", "dataset", 0.0),
    "motion": ("motions", "motions_figure", "dataset", 0.0),
}


def plot(result: Any, *, axes: Axes | None = None, **options: Any) -> Figure:
    """Draw the default picture of a result, or one picture of several, and return the figure, which
    a notebook shows.

    ``result`` is bands, complex bands, a transmission, a density of states (of a lattice or of a
    sample), a sweep, a fit, a trade-off, spectra along a path or at single wave vectors, a pulse, a
    response, a motion, modes of a network (``mode``: which of them), a state at one load, a sample,
    a network of contacts, or the result of a scene's run, of which bands, density of states or
    sweep are drawn. A state whose contacts follow from a law is drawn as some cells of its network.
    ``options`` go to the function of :mod:`granphon.figures` that draws the result, such as
    ``asymptotes`` of ``bands_figure`` and ``variable`` of ``sweep_figure``. Functions that draw on
    an Axes of yours are in the same modules.

    A list of results, or a mapping that names them, is one picture: sweeps, fits and results of
    scenes over the load, with measured points, or bands, or densities of states. ``options`` are
    then those of :func:`granphon.figures.curves.plot_together`: ``x``, ``y``, ``data``. With
    ``axes`` it is drawn there, as is a single result of these kinds, and the figure of the Axes is
    returned.

    Raises :class:`~granphon.base.errors.InputError` for anything else, and for an option that the
    function does not have.
    """
    kinds = [
        f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in type(result).__mro__
    ]
    # a data set is a mapping too, of variables
    several = isinstance(result, Mapping | list | tuple) and "xarray.Dataset" not in kinds
    if several or axes is not None:
        from granphon.figures.curves import comparison_figure, plot_together

        results = result if several else [result]
        _require_options(plot_together, "plot_together", {"results": None, "ax": None}, options)
        if axes is None:
            return _show(comparison_figure(results, **options))
        figure: Any = plot_together(results, axes, **options).get_figure()
        return figure  # type: ignore[no-any-return]
    known = next((_PICTURES[kind] for kind in kinds if kind in _PICTURES), None)
    given = {} if known is None else {known[2]: result}
    if (
        dataset := find_dataset(result)
    ) is not None:  # of the result of a scene the spectra come first
        if "load" not in dataset.dims:
            why = "Its picture is over the load, and one was chosen, or their mean taken"
            mend = "isel(load=[0])"
            raise InputError(
                "the data set has no dimension 'load'",
                why,
                f"Keep all loads, or choose by a list: {mend}",
            )
        spectra = {name: getattr(result, name, None) for name in ("bands", "dos")}
        known = _PICTURES["xarray.Dataset"]
        given = {"dataset": dataset}
        if dataset is not result and any(one is not None for one in spectra.values()):
            known = _PICTURES["granphon.Bands"]
            given = spectra
        elif dataset is not result and getattr(result, "surface", None) is not None:
            known = _PICTURES["granphon.SurfaceSpectrum"]
            given = {"spectrum": result.surface}
        elif (
            dataset is not result
            and getattr(getattr(result, "waves", None), "motion", None) is not None
        ):
            known = _PICTURES["granphon.Motion"]
            given = {"motion": result.waves.motion}
        elif dataset["valid"].size == 1:  # of one state there is nothing to draw over the load
            marks = {"response_phase": "response", "motion_force": "motion"}
            known = next(
                (_OF_STATES[block] for mark, block in marks.items() if mark in dataset), known
            )
    if known is None:
        # what the figure of a network takes for a state or a sample: its network, or several small
        # cells of it
        known = _PICTURES["granphon.ContactNetwork"]
        network = getattr(result, "network", None)
        if isinstance(network, ContactNetwork):
            periods = sum(network.pbc)
            few = periods > 0 and network.n_balls <= 8  # of which some cells are drawn
            given = {
                "sample": network.repeat(((8, 4, 2)[periods - 1],) * periods) if few else network
            }
    if not given or (kinds[0] == "xarray.Dataset" and dataset is None):
        refuse_unpressed(result)
        words = (
            "bands (complex ones too), a transmission, a density of states, a sweep, a fit, a"
            " trade-off, spectra (of an"
            " edge too), a pulse, a response, a motion, modes, a state, a sample, a network,"
            " or the result of a run of a"
            " scene with bands, a density of states or a sweep"
        )
        raise InputError(f"{brief(result)} has no default picture", mend=f"Give {words}")
    draw: Callable[..., Any] = getattr(import_module(f"granphon.figures.{known[0]}"), known[1])
    _require_options(draw, known[1], given | {"ax": None}, options)
    if known[3]:
        from granphon.figures.scales import draw_alone

        return _show(draw_alone(lambda own: draw(**given, ax=own, **options), known[3]))
    drawn = draw(**given, **options)
    return _show(drawn.get_figure() if "ax" in signature(draw).parameters else drawn)


def draw_states(dataset: Any, block: str) -> Figure:
    """Draw what is found of the network of each state of a data set, by the block of the scene that
    asks for it.
    """
    module, name, _, _ = _OF_STATES[block]
    figure: Figure = getattr(import_module(f"granphon.figures.{module}"), name)(dataset)
    return figure


def _show(figure: Any) -> Figure:
    """Return a plain figure, as the functions make it, as a picture that shows itself, whether
    pyplot is loaded or not.
    """
    from granphon.figures.scales import Picture

    figure.__class__ = Picture
    return figure  # type: ignore[no-any-return]


def _require_options(
    draw: Callable[..., Any], name: str, given: dict[str, Any], options: dict[str, Any]
) -> None:
    allowed = [one for one in signature(draw).parameters if one not in given]
    if unknown := [one for one in options if one not in allowed]:
        mend = f"It has {', '.join(allowed)}" if allowed else "It has none"
        raise InputError(f"{name} has no option {', '.join(unknown)}", mend=mend)
