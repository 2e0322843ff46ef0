"""The default picture of a result; this module does not load matplotlib until it draws."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, brief
from granphon.base.validation import require_instance
from granphon.networks.network import ContactNetwork, refuse_unpressed
from granphon.runs.dataset import find_dataset, find_energy_errors, find_wave_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A picture of a kind of results: a row of :data:`PICTURES` or :data:`OF_DATASETS`.

    Attributes
    ----------
    figure : the function that draws the picture, "bands.bands_figure" in the module ``bands`` of
        figures.
    keyword : the keyword under which the function takes the result.
    height : where the function draws on an Axes, the height of a figure of the Axes, inches; else
        0.
    of_state : for a figure that draws each state by itself, the variable of data sets that it
        draws; empty for other figures. A data set of one state that has this variable is drawn by
        the figure, because one state makes no curve over the load.
    """

    figure: str
    keyword: str = "dataset"
    height: float = 0.0
    of_state: str = ""

    def load(self) -> Callable[..., Any]:
        """Import the module of the function, and return the function."""
        module, _, name = self.figure.partition(".")
        function: Callable[..., Any] = getattr(import_module(f"granphon.figures.{module}"), name)
        return function


#: the default pictures of results, by the places of their classes in the package: no class is
#: imported here
PICTURES = {
    "phonons.bands.Bands": Picture("bands.bands_figure", "bands"),
    "phonons.dos.DensityOfStates": Picture("bands.bands_figure", "dos"),
    "phonons.bands.ComplexBands": Picture("waves.complex_bands_figure", "bands"),
    "phonons.surfaces.SurfaceSpectrum": Picture("waves.plot_surface", "spectrum", 3.1),
    "inverse.design.Design": Picture("design.design_figure", "design"),
    "fits.fit.WidthFit": Picture("curves.fit_figure", "fit"),
    "fits.transfer.DampingFit": Picture("waves.transfer_fit_figure", "fit"),
    "fits.traces.Traces": Picture("traces.traces_figure", "traces"),
    "tradeoffs.measure.TradeOff": Picture("work_precision.tradeoff_figure", "result"),
    "waves.path_spectra.PathSpectra": Picture("waves.spectrum_figure", "spectra"),
    "waves.spectral_functions.SpectralFunction": Picture("waves.plot_lines", "spectrum", 2.6),
    "waves.dos.SpectralDensity": Picture("waves.plot_sample_dos", "dos", 2.4),
    "waves.scattering.Transmission": Picture("waves.plot_transmission", "result", 2.3),
    "waves.motion.Motion": Picture("motions.motion_figure", "motion"),
    "waves.response.Response": Picture("waves.response_figure", "response"),
    "waves.pulses.Pulse": Picture("waves.pulse_figure", "pulse"),
    "waves.modes.NetworkModes": Picture("modes.plot_network_mode", "modes", 3.4),
    "networks.network.ContactNetwork": Picture("forces.plot_forces", "sample"),
    "media.simulation.SimulatedState": Picture("forces.forces_figure", "state"),
}
#: the pictures of data sets, by the names of the outputs whose figures they are
OF_DATASETS = {
    "sweep": Picture("curves.sweep_figure"),
    "response": Picture("waves.responses_figure", of_state="response_phase"),
    "motion": Picture("motions.motions_figure", of_state="motion_force"),
    "sweep_dos": Picture("waves.sweep_dos_figure"),
    "sweep_spectra": Picture("waves.sweep_spectra_figure"),
    "sweep_gaps": Picture("gaps.sweep_gaps_figure"),
    "sweep_surface": Picture("gaps.sweep_surface_figure"),
    "cutoffs": Picture("gaps.cutoffs_figure"),
    "onsets": Picture("gaps.onsets_figure"),
    "modes": Picture("gaps.modes_figure"),
    "sensitivities": Picture("sensitivities.sensitivities_figure"),
}
#: the names of the outputs whose figure draws each state by itself
OF_STATES = tuple(name for name, picture in OF_DATASETS.items() if picture.of_state)
#: cells along each period in the picture of a small network, for one, two and three periods
_CELLS = (8, 4, 2)
#: greatest number of balls of a network that counts as small
_MOST_BALLS = 8


def plot(result: Any, *, axes: Axes | None = None, **options: Any) -> Figure:
    """Draw the default picture of a result, or one picture of several results, and return the
    figure, which a notebook shows.

    ``result`` is bands, complex bands, a transmission, a density of states (of a lattice or of a
    sample), a sweep, a fit, a trade-off, spectra along a path, at single wave vectors or of an
    edge, a pulse, a response, a motion, a design, traces of sensors (``velocity`` adds their
    arrivals), modes of a network (``mode`` is the number of the mode), a state at one load, a
    sample, a network of contacts, or the result of a scene's run. Of this the bands and the density
    of states are drawn, or the spectrum of an edge, or the motion, or the data set, whichever it
    has first. A data set of one state with a response or a motion is drawn as that. A state whose
    contacts follow from a law is drawn as some cells of its network. ``options`` go to the function
    of :mod:`granphon.figures` that draws the result, such as ``asymptotes`` of ``bands_figure`` and
    ``variable`` of ``sweep_figure``. The same modules have functions that draw on your own Axes.

    A list of results, or a mapping that names results, is one picture: sweeps, fits and results of
    scenes over the load, with measured points, or bands, or densities of states. ``options`` are
    then those of :func:`granphon.figures.curves.plot_together`, such as ``x``, ``y`` and ``data``.
    With ``axes`` the picture is drawn on these Axes, as is a single result of these kinds, and the
    figure of the Axes is returned.

    Raises :class:`~granphon.base.errors.InputError` for any other object, for a state of several
    loads, for no results, for results that cannot share an axis, for ``axes`` that are no Axes, and
    for an option that the function does not have; and what the function raises.
    """
    # a data set is a mapping too, of variables; a result may be a tuple with names
    are_several = (
        isinstance(result, Mapping | list | tuple)
        and not hasattr(result, "data_vars")
        and _find_picture(result) is None
    )
    if are_several or axes is not None:
        from granphon.figures.curves import comparison_figure, plot_together

        results = result if are_several else [result]
        _require_options(plot_together, "plot_together", {"results": None, "ax": None}, options)
        if axes is None:
            return _make_showable(comparison_figure(results, **options))
        from matplotlib.axes import Axes

        require_instance("axes", axes, Axes, "Give Axes of matplotlib, one of figure.subplots()")
        figure: Any = plot_together(results, axes, **options).get_figure()
        return figure  # type: ignore[no-any-return]
    dataset = find_dataset(result)
    if dataset is not None:
        picture, arguments = _choose_of_dataset(result, dataset)
    else:
        picture, arguments = _choose_of_object(result)
    draw = picture.load()
    _require_options(draw, draw.__name__, arguments | {"ax": None}, options)
    if picture.height:
        from granphon.figures.scales import draw_alone

        return _make_showable(
            draw_alone(lambda ax: draw(**arguments, ax=ax, **options), picture.height)
        )
    figure_or_axes = draw(**arguments, **options)
    makes_axes = "ax" in signature(draw).parameters
    return _make_showable(figure_or_axes.get_figure() if makes_axes else figure_or_axes)


def draw_dataset(dataset: Any, name: str, **options: Any) -> Figure:
    """Draw the picture of a data set that is the figure of the output ``name``; ``options`` go to
    its function.
    """
    figure: Figure = OF_DATASETS[name].load()(dataset, **options)
    return figure


def _find_picture(result: Any) -> Picture | None:
    """Return the picture of the class of a ``result``, or else of the first base class that has a
    picture; None if no base class has one.
    """
    for kind in type(result).__mro__:
        picture = PICTURES.get(f"{kind.__module__}.{kind.__qualname__}".removeprefix("granphon."))
        if picture is not None:
            return picture
    return None


def _choose_of_object(result: Any) -> tuple[Picture, dict[str, Any]]:
    """Return the picture of an object without a data set, and the arguments of its function.

    An object of a class that has no picture is drawn by its network, or by some cells of a small
    network. InputError if there is no network.
    """
    picture = _find_picture(result)
    if picture is not None:
        return picture, {picture.keyword: result}
    network = getattr(result, "network", None)
    if isinstance(network, ContactNetwork):
        periods = sum(network.pbc)
        is_small = network.n_balls <= _MOST_BALLS
        if periods > 0 and is_small:
            n_cells = _CELLS[periods - 1]
            network = network.repeat((n_cells,) * periods)
        return _choose_of_object(network)
    refuse_unpressed(result)
    drawable = (
        "bands (complex ones too), a transmission, a density of states, a sweep, a fit, a"
        " trade-off, spectra (of an edge too), a pulse, a response, a motion, a design, traces,"
        " modes, a state, a sample, a network, or the result of a run of a scene with bands, a"
        " density of states or a sweep"
    )
    raise InputError(f"{brief(result)} has no default picture", mend=f"Give {drawable}")


def _choose_of_dataset(result: Any, dataset: Any) -> tuple[Picture, dict[str, Any]]:
    """Return the picture of a ``result``, and the arguments of the function that draws it. The
    result is the ``dataset`` itself, or the result of a scene with this data set, whose bands,
    densities of states, waves of an edge or motion are drawn if it has them. Raises what
    :func:`~granphon.figures.choices.require_axes` raises.
    """
    from granphon.figures.choices import require_axes

    require_axes(dataset)
    if dataset is not result:
        spectra = {name: result[name] for name in ("bands", "dos")}
        if any(spectrum is not None for spectrum in spectra.values()):
            errors = dataset.get("frequencies_error")
            of_spectra = {"errors": errors, "dos_errors": result.find_errors("dos")}
            return PICTURES["phonons.bands.Bands"], spectra | of_spectra
        if result["surface"] is not None:
            picture, arguments = _choose_of_object(result["surface"])
            return picture, arguments | {"errors": find_wave_errors(dataset)}
        motion = result["balls_in_motion"]
        if motion is not None:
            picture, arguments = _choose_of_object(motion)
            return picture, arguments | {"errors": find_energy_errors(motion, dataset)}
    name = choose_figure(dataset, OF_STATES)
    picture = OF_DATASETS[name]
    return picture, {picture.keyword: dataset}


def choose_figure(dataset: Any, names: Iterable[str]) -> str:
    """Return the output whose figure draws a data set. A data set of one state is drawn by the
    first of the ``names`` whose figure draws each state by itself, and whose variable the data set
    has. Any other data set is drawn by "sweep", the curves over the load.
    """
    if dataset["valid"].size > 1:
        return "sweep"
    for name in names:
        if name in OF_STATES and OF_DATASETS[name].of_state in dataset:
            return name
    return "sweep"


def _make_showable(figure: Any) -> Figure:
    """Change a plain figure into one that a notebook shows, and return the figure."""
    from granphon.figures.scales import NotebookFigure

    figure.__class__ = NotebookFigure
    return figure  # type: ignore[no-any-return]


def _require_options(
    draw: Callable[..., Any], name: str, arguments: dict[str, Any], options: dict[str, Any]
) -> None:
    """Raise InputError for ``options`` that are no keywords of the function ``draw``, or that are
    among its ``arguments``, which are given already. The message calls the function ``name``.
    """
    allowed = [option for option in signature(draw).parameters if option not in arguments]
    unknown = [option for option in options if option not in allowed]
    if unknown:
        mend = f"It has {', '.join(allowed)}" if allowed else "It has none"
        raise InputError(f"{name} has no option {', '.join(unknown)}", mend=mend)
