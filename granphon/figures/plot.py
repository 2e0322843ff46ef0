"""The default picture of a result; this module does not load matplotlib until it draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, brief
from granphon.networks.network import ContactNetwork, refuse_unpressed
from granphon.runs.dataset import find_dataset

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class _Drawing:
    """The function that draws a result.

    Attributes
    ----------
    module, function : the module of figures, and the name of the function in the module.
    keyword : the keyword under which the function takes the result.
    height : where the function draws on an Axes, the height of a figure of the Axes, inches; else
        0.
    """

    module: str
    function: str
    keyword: str
    height: float = 0.0

    def load(self) -> Callable[..., Any]:
        """Import the function."""
        module = import_module(f"granphon.figures.{self.module}")
        function: Callable[..., Any] = getattr(module, self.function)
        return function


#: pictures of results, by package and name of the class, so that no class is imported here
_PICTURES = {
    "granphon.Bands": _Drawing("bands", "bands_figure", "bands"),
    "granphon.DensityOfStates": _Drawing("bands", "bands_figure", "dos"),
    "granphon.WidthFit": _Drawing("curves", "fit_figure", "fit"),
    "granphon.DampingFit": _Drawing("waves", "transfer_fit_figure", "fit"),
    "granphon.Traces": _Drawing("traces", "traces_figure", "traces"),
    "granphon.TradeOff": _Drawing("work_precision", "tradeoff_figure", "result"),
    "granphon.PathSpectra": _Drawing("waves", "spectrum_figure", "spectra"),
    "granphon.SpectralFunction": _Drawing("waves", "plot_lines", "spectrum", 2.6),
    "granphon.SpectralDensity": _Drawing("waves", "plot_sample_dos", "dos", 2.4),
    "granphon.SurfaceSpectrum": _Drawing("waves", "plot_surface", "spectrum", 3.1),
    "granphon.Transmission": _Drawing("waves", "plot_transmission", "result", 2.3),
    "granphon.ComplexBands": _Drawing("waves", "complex_bands_figure", "bands"),
    "granphon.Motion": _Drawing("motions", "motion_figure", "motion"),
    "granphon.Response": _Drawing("waves", "response_figure", "response"),
    "granphon.Pulse": _Drawing("waves", "pulse_figure", "pulse"),
    "granphon.NetworkModes": _Drawing("modes", "plot_network_mode", "modes", 3.4),
    "granphon.ContactNetwork": _Drawing("forces", "plot_forces", "sample"),
    "granphon.SimulatedState": _Drawing("forces", "forces_figure", "state"),
    "xarray.Dataset": _Drawing("curves", "sweep_figure", "dataset"),
}
#: cells along each period in the picture of a small network, for one, two and three periods
_CELLS = (8, 4, 2)
#: greatest number of balls of a network that counts as small
_MOST_BALLS = 8
#: pictures of the networks of the states of a data set, by the block of the scene
_OF_STATES = {
    "response": _Drawing("waves", "responses_figure", "dataset"),
    "motion": _Drawing("motions", "motions_figure", "dataset"),
}
#: pictures of the waves of all states of a sweep, by the stem of their file
_OF_SWEEPS = {
    "sweep_dos": _Drawing("waves", "sweep_dos_figure", "dataset"),
    "sweep_spectra": _Drawing("waves", "sweep_spectra_figure", "dataset"),
    "sweep_gaps": _Drawing("gaps", "sweep_gaps_figure", "dataset"),
    "sweep_surface": _Drawing("gaps", "sweep_surface_figure", "dataset"),
}


def plot(result: Any, *, axes: Axes | None = None, **options: Any) -> Figure:
    """Draw the default picture of a result, or one picture of several results, and return the
    figure, which a notebook shows.

    ``result`` is bands, complex bands, a transmission, a density of states (of a lattice or of a
    sample), a sweep, a fit, a trade-off, spectra along a path or at single wave vectors, a pulse, a
    response, a motion, traces of sensors (``velocity`` adds their arrivals), modes of a network
    (``mode`` is the number of the mode), a state at one load, a sample, a network of contacts, or
    the result of a scene's run, of which bands, density of states or sweep are drawn. A state whose
    contacts follow from a law is drawn as some cells of its network. ``options`` go to the function
    of :mod:`granphon.figures` that draws the result, such as ``asymptotes`` of ``bands_figure`` and
    ``variable`` of ``sweep_figure``. The same modules have functions that draw on your own Axes.

    A list of results, or a mapping that names results, is one picture: sweeps, fits and results of
    scenes over the load, with measured points, or bands, or densities of states. ``options`` are
    then those of :func:`granphon.figures.curves.plot_together`: ``x``, ``y``, ``data``. With
    ``axes`` the picture is drawn on these Axes, as is a single result of these kinds, and the
    figure of the Axes is returned.

    Raises :class:`~granphon.base.errors.InputError` for any other object, and for an option that
    the function does not have.
    """
    # package and name of the class and of its bases
    classes = []
    for kind in type(result).__mro__:
        package = kind.__module__.partition(".")[0]
        classes.append(f"{package}.{kind.__name__}")
    # a data set is a mapping too, of variables
    are_several = isinstance(result, Mapping | list | tuple) and "xarray.Dataset" not in classes
    if are_several or axes is not None:
        from granphon.figures.curves import comparison_figure, plot_together

        results = result if are_several else [result]
        _require_options(plot_together, "plot_together", {"results": None, "ax": None}, options)
        if axes is None:
            return _show(comparison_figure(results, **options))
        figure: Any = plot_together(results, axes, **options).get_figure()
        return figure  # type: ignore[no-any-return]
    dataset = find_dataset(result)
    if dataset is not None:
        drawing, arguments = _choose_of_dataset(result, dataset)
    else:
        drawing, arguments = _choose_of_object(result, classes)
    draw = drawing.load()
    _require_options(draw, drawing.function, arguments | {"ax": None}, options)
    if drawing.height:
        from granphon.figures.scales import draw_alone

        return _show(draw_alone(lambda ax: draw(**arguments, ax=ax, **options), drawing.height))
    figure_or_axes = draw(**arguments, **options)
    makes_axes = "ax" in signature(draw).parameters
    return _show(figure_or_axes.get_figure() if makes_axes else figure_or_axes)


def draw_states(dataset: Any, block: str) -> Figure:
    """Draw the results of the network of each state of a data set, for a block of the scene."""
    figure: Figure = _OF_STATES[block].load()(dataset)
    return figure


def draw_waves_of_sweep(dataset: Any, stem: str) -> Figure:
    """Draw the waves of all states of a sweep that the ``stem`` of a file names."""
    figure: Figure = _OF_SWEEPS[stem].load()(dataset)
    return figure


def _choose_of_object(result: Any, classes: list[str]) -> tuple[_Drawing, dict[str, Any]]:
    """Return the drawing of an object without a data set, and the arguments of its function.

    ``classes`` are the names of the object's class and of its bases. If none of these has a
    drawing, the drawing is that of the object's network, or of some cells of a small network.
    InputError if there is no network.
    """
    known_classes = [name for name in classes if name in _PICTURES]
    is_dataset = classes[0] == "xarray.Dataset"
    if known_classes and not is_dataset:
        drawing = _PICTURES[known_classes[0]]
        return drawing, {drawing.keyword: result}
    network = getattr(result, "network", None)
    if not known_classes and isinstance(network, ContactNetwork):
        periods = sum(network.pbc)
        is_small = network.n_balls <= _MOST_BALLS
        if periods > 0 and is_small:
            n_cells = _CELLS[periods - 1]
            network = network.repeat((n_cells,) * periods)
        return _PICTURES["granphon.ContactNetwork"], {"sample": network}
    refuse_unpressed(result)
    drawable = (
        "bands (complex ones too), a transmission, a density of states, a sweep, a fit, a"
        " trade-off, spectra (of an edge too), a pulse, a response, a motion, traces, modes, a"
        " state, a sample, a network, or the result of a run of a scene with bands, a density of"
        " states or a sweep"
    )
    raise InputError(f"{brief(result)} has no default picture", mend=f"Give {drawable}")


def _choose_of_dataset(result: Any, dataset: Any) -> tuple[_Drawing, dict[str, Any]]:
    """Return the drawing of a data set, or of the spectra of a scene's ``result`` that has the data
    set, and the arguments of its function. InputError for a data set without an axis of loads.
    """
    if "load" not in dataset.dims:
        raise InputError(
            "the data set has no dimension 'load'",
            "Its picture is over the load, and one was chosen, or their mean taken",
            "Keep all loads, or choose by a list: isel(load=[0])",
        )
    if dataset is not result:
        spectra = {name: getattr(result, name, None) for name in ("bands", "dos")}
        if any(spectrum is not None for spectrum in spectra.values()):
            return _PICTURES["granphon.Bands"], spectra
        surface = getattr(result, "surface", None)
        if surface is not None:
            return _PICTURES["granphon.SurfaceSpectrum"], {"spectrum": surface}
        motion = getattr(getattr(result, "waves", None), "motion", None)
        if motion is not None:
            return _PICTURES["granphon.Motion"], {"motion": motion}
    drawing = _PICTURES["xarray.Dataset"]
    is_single_state = dataset["valid"].size == 1
    if is_single_state:  # which has no curves over the load
        if "response_phase" in dataset:
            drawing = _OF_STATES["response"]
        elif "motion_force" in dataset:
            drawing = _OF_STATES["motion"]
    return drawing, {"dataset": dataset}


def _show(figure: Any) -> Figure:
    """Return a plain figure as a picture that shows itself in a notebook."""
    from granphon.figures.scales import Picture

    figure.__class__ = Picture
    return figure  # type: ignore[no-any-return]


def _require_options(
    draw: Callable[..., Any], name: str, arguments: dict[str, Any], options: dict[str, Any]
) -> None:
    """Raise InputError, which calls the function ``draw`` by its ``name``, for ``options`` that the
    function does not have besides its ``arguments``.
    """
    allowed = [option for option in signature(draw).parameters if option not in arguments]
    unknown = [option for option in options if option not in allowed]
    if unknown:
        mend = f"It has {', '.join(allowed)}" if allowed else "It has none"
        raise InputError(f"{name} has no option {', '.join(unknown)}", mend=mend)
