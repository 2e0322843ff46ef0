"""The commands that compare: ``fit`` compares a scene with measurements, and ``tradeoff`` media
with each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, cast

import typer

from granphon.base.errors import InputError, Refused
from granphon.base.text import show
from granphon.cli.app import COMPARISONS, Force, SceneFile, Scheduler, Workers, command
from granphon.cli.terminal import (
    GO_ON,
    NOTHING_WRITTEN,
    describe_fit,
    describe_response_fit,
    describe_tradeoff,
    require_name,
    say,
    say_table,
    tell_interruption,
    warn,
    write_direction,
)

if TYPE_CHECKING:
    from granphon.balls.packing import Packing
    from granphon.base.staging import ResultFiles
    from granphon.base.tables import Table
    from granphon.fits.fit import WidthFit
    from granphon.fits.measurements import Measurements
    from granphon.fits.traces import TraceVelocity
    from granphon.fits.transfer import DampingFit
    from granphon.scene.scene import Scene

#: a fit of velocities, or of a response
FitT = TypeVar("FitT", "WidthFit", "DampingFit")


@command("fit", rich_help_panel=COMPARISONS)
def fit_measurements(
    scene_file: SceneFile,
    data: Annotated[
        str, typer.Argument(metavar="DATA.csv", help="Measured velocities, or a transfer function.")
    ],
    out: Annotated[
        str | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Fit this as well: young_modulus, diameter; or, of a response: damping, drag,"
            " dashpot, restitution, stiffness, load and others of gp.fit_damping. May be"
            " repeated.",
        ),
    ] = None,
    frequency: Annotated[
        str | None, typer.Option(metavar="HZ", help="Frequency of the pulses, such as '6.5 kHz'.")
    ] = None,
    distance: Annotated[
        str | None,
        typer.Option(metavar="M", help="Distance of the time of flight, such as '0.4 m +- 1 mm'."),
    ] = None,
    sigma: Annotated[
        str | None,
        typer.Option(metavar="M/S", help="Standard error of velocities, such as '5 m/s' or '1 %'."),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND=NAME",
            help="Name of a column, such as 'velocity=v (km/s)'. May be repeated.",
        ),
    ] = None,
    width: Annotated[
        bool, typer.Option("--width/--no-width", help="Fit the width, or keep the scene's spread.")
    ] = True,
    branch: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="longitudinal, by default, or transverse; in space transverse_slow,"
            " transverse_fast.",
        ),
    ] = None,
    direction: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y'",
            help="Direction of sound, a number for each period; by default the scene's, else the"
            " last axis.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Fit the spread to velocities, or losses to a response.

    The scene gives the balls and the medium. Unless --no-width is given, the fit replaces the width
    of their spread, and equal balls in the medium ala are fitted with ema. The loads of the scene
    are not used; a warning says so if it has several.

    Each column of the table has a name and a unit. The load is 'force (N)', 'pressure (N/m)' (in
    space 'pressure (kPa)') or 'side_force (N)' (the scene then gives balls_per_side). The velocity
    is 'velocity (m/s)', or 'time (ms)' and 'distance (m)', or 'cutoff (kHz)', the highest frequency
    of the branch. If known, there are also 'sigma (m/s)' or 'sigma (%)', 'time_sigma (us)' or
    'cutoff_sigma (Hz)', and 'frequency (kHz)'. Velocities with a frequency are those of pulses. A
    table of traces, as for 'granphon velocity', gives one velocity, under the one load of the
    scene. A transfer function has 'frequency (kHz)' and columns of 'granphon run' with the block
    response. The folder gets fit.yaml, fit.csv and fit.png.

    \b
    Examples:
      granphon fit scene.yaml data.csv
      granphon fit scene.yaml data.csv -o fit --frequency "6.5 kHz" --parameter young_modulus
      granphon fit scene.yaml data.csv --column "force=F (kN)" --column time=t --distance "430 mm"
      granphon fit fcc.yaml data.csv --no-width --parameter young_modulus --direction "1 1 0"
      granphon fit chain.yaml transfer.csv --parameter damping --parameter stiffness
    """
    from granphon.base.tables import Table
    from granphon.fits.transfer import TransferFunction, has_transfer
    from granphon.scene.scene import Scene

    require_name("--out", out)
    scene = Scene.from_yaml(scene_file)
    files = _prepare_files("fit", out, force, (*scene.origin.inputs, Path(data)))
    parameters = _read_parameters(parameter)
    columns = _read_columns(column)
    table = Table.read(data)
    # whether the table has velocities, or what they are found from
    has_sound = any(columns.get(kind, kind) in table for kind in ("velocity", "time", "cutoff"))
    has_crystal = bool(scene.packing.kind_names)  # velocities are fitted to a packing only
    quantity = ""  # of the response that the scene expects in the table; empty if it expects none
    if not has_sound and scene.response is not None:
        quantity = scene.response.quantity
    elif not has_sound and has_crystal:
        quantity = "displacement"
    if has_transfer(table, columns, quantity):
        options_of_velocities = {
            "--frequency": frequency,
            "--distance": distance,
            "--sigma": sigma,
            "--direction": direction,
            "--branch": branch,
            "--no-width": None if width else "",
        }
        _refuse_options(options_of_velocities, data, "a transfer function")

        def find_response_fit(varied_scene: Scene, _distance: str | None) -> DampingFit:
            """Return the fit to the transfer function for the values that a scene has.
            :func:`_fit_with_errors` calls this with the given scene and with shifted scenes; a
            response has no distance.
            """
            return _fit_response(scene_file, varied_scene, data, columns, parameters)

        response_fit, rows_of_inputs = _fit_with_errors(find_response_fit, scene)
        rows = [*describe_response_fit(response_fit), *rows_of_inputs]
        _finish_fit(out, files, response_fit, response_fit.warnings, rows)
        return
    if quantity:
        # the table lacks a column of the transfer function: this raises the error that names it
        TransferFunction.read(data, columns, quantity)
    options = _VelocityOptions(
        parameters, width, branch or "longitudinal", frequency, distance, sigma, direction
    )
    fit, notes, rows_of_inputs = _fit_velocities(scene_file, scene, data, table, columns, options)
    rows = [*describe_fit(fit), *rows_of_inputs]
    _finish_fit(out, files, fit, (*notes, *fit.warnings), rows)


class _VelocityOptions(NamedTuple):
    """The options of a fit of velocities, see :func:`fit_measurements`: names of the fitted
    ``parameters`` beside the width, whether the ``width`` is fitted, the ``branch``, and the texts
    of the other options; None in place of an option that is not given.
    """

    parameters: tuple[str, ...]
    width: bool
    branch: str
    frequency: str | None
    distance: str | None
    sigma: str | None
    direction: str | None


def _fit_velocities(
    scene_file: str,
    scene: Scene,
    data: str,
    table: Table,
    columns: Mapping[str, str],
    options: _VelocityOptions,
) -> tuple[WidthFit, list[str], list[tuple[str, str]]]:
    """Return the fit to the velocities in a ``table``, or to the one velocity of a table of traces;
    notes on what the fit takes that was not given, or does not use; and the rows of inputs of
    :func:`_fit_with_errors`.

    ``data`` is the file of the table, and ``columns`` are its headings as in
    :func:`_read_velocities`. Warnings on traces are printed before the fit. InputError for what a
    fit of velocities cannot use: several media, packings, directions, or nothing to fit.
    """
    from granphon.fits.fit import fit_width
    from granphon.fits.trace_files import has_traces
    from granphon.fits.traces import Traces

    _require_one_packing("A fit", scene_file, scene)
    sound_direction = _choose_direction(scene_file, scene, options.direction)
    if len(scene.media) > 1:
        raise InputError(f"{scene_file} has several media", mend="Keep only the one to fit with")
    parameters = options.parameters
    _require_fitted(options.width, parameters)
    # "ala" is the default for equal balls, so that a scene with this medium does not say how
    # balls of the fitted width are to be averaged
    takes_ema = options.width and scene.media[0].name == "ala" and not scene.balls_differ
    medium: Any = "ema" if takes_ema else scene.media[0]
    traced = None  # the velocity that traces show, if the table has traces in place of velocities
    if has_traces(table):
        given_columns = ", ".join(columns) or None
        options_of_tables = {
            "--distance": options.distance,
            "--sigma": options.sigma,
            "--column": given_columns,
        }
        _refuse_options(options_of_tables, data, "traces")
        traced = Traces.read(data).velocity()
        warn(traced.warnings)
    fitted_names = ("width", *parameters) if options.width else parameters

    def find_velocity_fit(varied_scene: Scene, varied_distance: str | None) -> WidthFit:
        """Return the fit to the velocities for the values that a scene and the option --distance
        have: :func:`_fit_with_errors` calls this first with the given values, and again with each
        of them moved by its error.
        """
        packing = _require_one_packing("A fit", scene_file, varied_scene)
        if traced is not None:
            measured = _place_traced(
                scene_file, data, traced, varied_scene, packing, medium, parameters
            )
        else:
            measured = _read_velocities(
                data,
                columns,
                varied_distance,
                varied_scene,
                packing,
                medium,
                parameters,
                branch=options.branch,
                direction=sound_direction,
            )
        velocity_sigma, pulse_frequency = _choose_sigma_and_frequency(
            measured, options.sigma, options.frequency
        )
        return fit_width(
            packing,
            measured.force,
            measured.velocity,
            velocity_sigma,
            pulse_frequency,
            medium=medium,
            parameters=tuple(dict.fromkeys(fitted_names)),  # each name once, in order
            branch=options.branch,
            direction=sound_direction,
            finite_overlap=varied_scene.finite_overlap,
        )

    fit, rows_of_inputs = _fit_with_errors(find_velocity_fit, scene, options.distance)
    notes = list[str]()
    if takes_ema:
        notes.append(
            f"{scene_file} has the medium ala, which knows no width: the fit takes ema. Name afa or"
            " ema in it"
        )
    names_direction = options.direction is not None or scene.direction is not None
    notes += _list_notes(scene_file, scene, data, fit, names_direction=names_direction)
    return fit, notes, rows_of_inputs


def _list_notes(
    scene_file: str, scene: Scene, data: str, fit: WidthFit, *, names_direction: bool
) -> list[str]:
    """Return a note if the ``scene`` has several loads, because a fit takes those of the table
    ``data``; and a note if sound depends on its direction and none was given. ``names_direction``
    says whether the scene or an option gives one.
    """
    notes = list[str]()
    n_loads = len(scene.load.values)
    if n_loads > 1:
        notes.append(
            f"the {n_loads} loads of {scene_file} are not used: a fit takes the loads of {data}"
        )
    if not names_direction and not fit.is_isotropic:
        notes.append(
            f"sound in the lattice {fit.packing.structure.name} depends on the direction, and none"
            f" is given: the fit takes {write_direction(fit.waves.direction)}. Give --direction,"
            f" or direction in {scene_file}"
        )
    return notes


def _fit_with_errors(
    find: Callable[[Scene, str | None], FitT], scene: Scene, distance: str | None = None
) -> tuple[FitT, list[tuple[str, str]]]:
    """Return the fit that ``find`` finds for a ``scene`` and a text of the option --distance, and
    rows (name, text) of a table. ``distance`` is that text, perhaps with a standard error; None
    without the option.

    The standard errors of the fit contain the part that follows from the standard errors of the
    scene's parameters and of the distance. To find this part, the fit is found again with each of
    these inputs smaller and larger by its error. The rows say for each fitted parameter how large
    the part is and which input gives most of it; there are none if no input has an error.

    InputError if the error of the distance is as large as the distance.
    """
    import numpy as np

    from granphon.base.quantities import LENGTH, read_with_error
    from granphon.base.scales import write_quantity
    from granphon.base.text import spell
    from granphon.base.validation import require
    from granphon.scene.uncertainty import make_matrix
    from granphon.scene.written_errors import name_keys

    distance_alone = distance  # text without the error
    distance_error = 0.0  # m
    if distance is not None:
        read = partial(read_with_error, quantity=LENGTH)
        distance_value, distance_error = require("--distance", read, distance)
        distance_alone = f"{distance_value!r} m"
    # names of the inputs with an error; the arguments of ``find`` with each of them smaller, larger
    inputs = [name_keys(keys) for keys, _ in scene.errors]
    pairs_of_arguments: list[tuple[tuple[Scene, str | None], tuple[Scene, str | None]]] = [
        ((lower_scene, distance_alone), (upper_scene, distance_alone))
        for lower_scene, upper_scene in scene.shifted
    ]
    if distance_error:
        if distance_error >= distance_value:
            problem = f"--distance is {distance}, whose error is as large as the distance"
            raise InputError(problem, mend="Give a distance that is known better")
        shorter = f"{distance_value - distance_error!r} m"
        longer = f"{distance_value + distance_error!r} m"
        inputs.append("--distance")
        pairs_of_arguments.append(((scene, shorter), (scene, longer)))
    fit = find(scene, distance_alone)
    if not inputs:
        return fit, []
    # (inputs, parameters): change of each fitted value by the error of each input
    changes = [
        0.5 * (find(*upper).values - find(*lower).values) for lower, upper in pairs_of_arguments
    ]
    correlation = make_matrix(inputs, scene.correlations)
    rows = []
    for number, (name, unit) in enumerate(zip(fit.parameters, fit.units_of_values, strict=True)):
        changes_of_value = np.array([change[number] for change in changes])
        # the part of each input in the variance, whose sum rounding may leave below zero
        contributions = changes_of_value * (correlation @ changes_of_value)
        error = float(np.sqrt(max(np.sum(contributions), 0.0)))
        main_input = inputs[int(np.argmax(contributions))]
        size = write_quantity(error, "" if unit == "1" else unit)
        rows.append((f"{spell(name)}, of inputs", f"+/- {size}, most from {main_input}"))
    return fit.with_input_errors(changes, correlation), rows


def _prepare_files(
    name: str, out: str | None, force: bool, inputs: Sequence[Path]
) -> ResultFiles | None:
    """Return the files of the output ``name`` that are to be written into the folder ``out``; None
    without a folder.

    Raises OutputError, before anything is computed, if the folder cannot hold the files, and its
    subclass FileExistsInRunError if a file exists that ``force`` may not replace, or if a file is
    one of the ``inputs``. An earlier result that was cut off while its files moved is completed.
    """
    from granphon.base.staging import ResultFiles
    from granphon.scene.outputs import OUTPUTS

    if out is None:
        return None
    files = ResultFiles(out, OUTPUTS[name].files, force, inputs=inputs)
    files.require_free()
    return files


def _read_parameters(names: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the parameters that are fitted, () if none is given; InputError for a
    name given twice.
    """
    parameters = tuple(names or ())
    for name in parameters:
        if parameters.count(name) > 1:
            problem = f"--parameter {name} is given {parameters.count(name)} times"
            raise InputError(problem, mend="Give it once")
    return parameters


def _read_columns(options: Sequence[str] | None) -> dict[str, str]:
    """Return the names of columns by what they hold, {"velocity": "v (km/s)"}, from options such as
    "velocity=v (km/s)"; InputError for an option without kind or name, and for a kind that is given
    twice.
    """
    columns = dict[str, str]()
    for option in options or ():
        kind, _equals, name = (text.strip() for text in option.partition("="))
        if not kind or not name or kind in columns:
            fault = "is given twice" if kind in columns else "is no KIND=NAME"
            mend = "Write --column 'velocity=v (km/s)', once for each kind"
            raise InputError(f"--column {option} {fault}", mend=mend)
        columns[kind] = name
    return columns


def _refuse_options(options: Mapping[str, str | None], data: str, content: str) -> None:
    """Raise InputError if one of the ``options`` is given. These are values by name, None of an
    option that is not given. They are for velocities, and the table ``data`` has other ``content``,
    such as a transfer function.
    """
    for name, value in options.items():
        if value is not None:
            problem = f"{name} is for velocities, and {data} has {content}"
            raise InputError(problem, mend="Leave it out")


def _require_fitted(width: bool, parameters: Sequence[str]) -> None:
    """Raise InputError if neither the width nor any of the ``parameters`` is fitted, and if the
    ``parameters`` name the width although it is kept. ``width`` is false where --no-width keeps it.
    """
    if "width" in parameters and not width:
        problem = "--no-width keeps the width, and --parameter width fits it"
        raise InputError(problem, mend="Leave one out")
    if not width and not parameters:
        why = "--no-width keeps the spread"
        raise InputError("nothing is left to fit", why, "Leave it out, or give --parameter")


def _read_velocities(
    data: str,
    columns: Mapping[str, str],
    distance: str | None,
    scene: Scene,
    packing: Packing,
    medium: Any,
    parameters: tuple[str, ...],
    *,
    branch: str,
    direction: Sequence[float] | None,
) -> Measurements:
    """Return the measured velocities in the table ``data``, m/s, with the contact forces of their
    loads, N.

    ``columns`` has the headings of columns whose names are not the usual ones, by what the columns
    hold, and ``distance`` is the text of the option --distance. Side forces are converted for the
    frame of the ``scene``. Pressures and cutoff frequencies are converted for the ``packing`` in
    the ``medium``; ``parameters`` names what is fitted of the packing. ``branch`` and ``direction``
    (p,), one component for each of p periods, are those of the sound.
    """
    from granphon.balls.loads import force_of_frame
    from granphon.base.quantities import LENGTH
    from granphon.base.validation import require
    from granphon.fits.fit import convert_cutoff, convert_pressure
    from granphon.fits.measurements import Measurements

    distance_of_pulses = None  # m
    if distance is not None:
        distance_of_pulses = require("--distance", LENGTH.read, distance)
    convert_side_force = None
    if scene.load.balls_per_side is not None:
        convert_side_force = partial(force_of_frame, balls_per_side=scene.load.balls_per_side)
    finite_overlap = scene.finite_overlap
    return Measurements.read(
        data,
        columns,
        distance_of_pulses,
        convert_side_force,
        partial(convert_pressure, packing, finite_overlap, medium, parameters),
        packing.structure.periods,
        partial(convert_cutoff, packing, branch, direction, finite_overlap, parameters),
    )


def _place_traced(
    scene_file: str,
    data: str,
    traced: TraceVelocity,
    scene: Scene,
    packing: Packing,
    medium: Any,
    parameters: tuple[str, ...],
) -> Measurements:
    """Return as one measurement the velocity that the traces in the file ``data`` show,
    ``traced``, with its standard error, and the contact force of the one load of the ``scene``.

    A pressure is converted for the ``packing`` in the ``medium``; ``parameters`` names what is
    fitted of the packing. InputError if the scene, of the file ``scene_file``, has several loads,
    or a load that is no force, pressure or side_force.
    """
    import numpy as np

    from granphon.balls.loads import force_of_frame
    from granphon.fits.fit import convert_pressure
    from granphon.fits.measurements import Measurements

    load = scene.load
    if load.size != 1:
        problem = f"{scene_file} has {load.size} loads, and {data} has traces"
        raise InputError(problem, "Traces are of one load", "Keep the load of the traces")
    value = load.values[0]
    if load.kind == "force":
        force = value
    elif load.kind == "side_force" and load.balls_per_side is not None:
        force = force_of_frame(value, balls_per_side=load.balls_per_side)
    elif load.kind == "pressure":
        force = convert_pressure(packing, scene.finite_overlap, medium, parameters, value)
    else:
        problem = f"the load of {scene_file} is of the kind {load.kind}"
        why = "A fit to traces takes a force, pressure or side_force"
        raise InputError(problem, why, "Give the load that the balls had")
    return Measurements(np.array([force]), np.array([traced.velocity]), traced.stderr)


def _choose_sigma_and_frequency(
    measured: Measurements, sigma: str | None, frequency: str | None
) -> tuple[Any, Any]:
    """Return the standard errors of the n ``measured`` velocities, m/s, and the frequencies of the
    pulses, Hz; each is an array (n,), one number, or None.

    The options ``sigma`` and ``frequency``, texts with units, replace what the table of the
    measured velocities holds.
    """
    from granphon.base.quantities import FREQUENCY
    from granphon.base.validation import require
    from granphon.fits.measurements import read_sigma

    velocity_sigma = measured.sigma
    if sigma is not None:
        velocity_sigma = require("--sigma", partial(read_sigma, velocity=measured.velocity), sigma)
    pulse_frequency = measured.frequency
    if frequency is not None:
        pulse_frequency = require("--frequency", FREQUENCY.read, frequency)
    return velocity_sigma, pulse_frequency


def _choose_direction(path: str, scene: Scene, option: str | None) -> Sequence[float] | None:
    """Return the direction of sound (p,), a component for each of p periods: that of the ``option``
    --direction, or without the option that of the ``scene`` in the file ``path``; None if neither
    names a direction. How many components there are is not checked. InputError if the option is
    no list of numbers, and without the option if the scene names several directions.
    """
    from granphon.base.validation import require

    if option is not None:
        components: list[float] = require("--direction", _read_direction, option)
        return components
    if len(scene.directions) > 1:
        problem = f"{path} has {len(scene.directions)} directions"
        why = "A fit takes sound along one direction"
        raise InputError(problem, why, "Name one by --direction")
    return scene.directions[0] if scene.directions else None


def _fit_response(
    scene_file: str, scene: Scene, data: str, columns: Mapping[str, str], names: tuple[str, ...]
) -> DampingFit:
    """Return the fit of the parameters ``names``, by default "damping" alone, to the transfer
    function in the table ``data``. ``columns`` are as in :func:`_read_velocities`.

    The network is that of the one state of the scene, with the sources, receivers and losses of its
    block response. InputError if the scene, of the file ``scene_file``, has no such block, or
    several states.
    """
    from granphon.fits.pressed import PressedCrystal
    from granphon.fits.transfer import TransferFunction, fit_damping
    from granphon.media.arrangement import Arrangement
    from granphon.waves.settings import find_place

    settings = scene.observed_settings("response") or scene.response
    if settings is None:
        problem = f"{scene_file} has no block response, and {data} has a transfer function"
        why = "It says where the network is driven and heard"
        raise InputError(problem, why, "Write it, with observe: [response]")
    if scene.n_states > 1:
        problem = f"{scene_file} has {scene.n_states} states"
        raise InputError(problem, "A transfer function is of one", "Keep one load and medium")
    measured = TransferFunction.read(data, columns, settings.quantity)
    case = scene.plan.cases[0].case
    network: Any
    if isinstance(case.packing, Arrangement):
        # the crystal comes to rest anew where a fitted parameter changes what bears the load
        load = case.load[0]
        finite_overlap = case.request.finite_overlap
        network = PressedCrystal(case.packing.crystal, load, finite_overlap, settings.shape)
    else:
        network = settings.shape(case.state.network)
    sources = [find_place(words) for words in settings.source]
    receivers = [find_place(words) for words in settings.receiver]
    return fit_damping(
        network,
        measured,
        sources,
        receivers,
        parameters=names or ("damping",),
        quantity=settings.quantity,
        direction=settings.direction,
        polarisation=settings.polarisation,
        distance=settings.distance,
        **settings.losses,
    )


def _finish_fit(
    out: str | None,
    files: ResultFiles | None,
    fit: Any,
    notes: Sequence[str],
    table: list[tuple[str, str]],
) -> None:
    """Write the ``files`` of a ``fit`` into the folder ``out``; both are None without the option
    --out. Then print the ``notes`` as warnings, the reason if the figure could not be drawn, the
    rows of the ``table``, and the names of the files.
    """
    failures: dict[str, str] = {}
    if files is not None:
        with files.open() as locked:
            failures = _stage_study(locked, "fit", fit)
    state_of_folder = NOTHING_WRITTEN if out is None else f"the result was written into {out}."
    with tell_interruption(lambda: state_of_folder):
        warn((*notes, *failures.values()))
        say_table(table)
        _say_written(out, "fit", failures)


def _read_direction(value: str) -> list[float]:
    """Return the components of a direction from the text ``value``, in which spaces or commas part
    the numbers; how many they are is not checked. Raises Refused for another text.
    """
    try:
        return [float(word) for word in value.replace(",", " ").split()]
    except ValueError:
        raise Refused(show(value), "numbers parted by spaces, such as '0 1'") from None


@command("tradeoff", rich_help_panel=COMPARISONS)
def measure_tradeoff(
    scene_file: SceneFile,
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for tradeoff.csv and .png."),
    ] = None,
    budget: Annotated[
        str,
        typer.Option(
            metavar="TIME", help="Time for the measurements; imports and drawing are extra."
        ),
    ] = "3 minutes",
    loads: Annotated[
        int, typer.Option(min=1, metavar="N", help="Largest number of loads to use.")
    ] = 3,
    runs: Annotated[
        int, typer.Option(min=5, metavar="N", help="Number of timed runs of each point.")
    ] = 5,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="No progress and no table; warnings stay.")
    ] = False,
) -> None:
    """Measure time, memory and error of the media for a scene.

    For the balls and the loads of the scene, the averaged lattice, the averaged force, the
    effective medium and simulations of several sizes are compared with arrays at rest without
    friction or, if a medium of the scene has friction_history, with arrays loaded with friction. An
    error is that of the observed quantities, against an ensemble of such arrays that another
    algorithm has checked. A time is the median of warm runs, measured by the worker: --workers and
    --scheduler need an idle processor. What does not fit into the budget is listed as not run. The
    folder gets tradeoff.csv and tradeoff.png, the work-precision diagram.

    \b
    Examples:
      granphon tradeoff scene.yaml
      granphon tradeoff scene.yaml -o tradeoff --budget "20 minutes" --loads 5
    """
    from granphon.base.progress import on_stderr
    from granphon.base.quantities import TIME
    from granphon.base.validation import require
    from granphon.runs.finished_tasks import open_store
    from granphon.runs.workers import open_executor, require_workers
    from granphon.scene.scene import WORK_FILE, Scene
    from granphon.tradeoffs.measure import tradeoff

    require_name("--out", out)
    require_workers(workers, scheduler)
    seconds = require("--budget", TIME.read, budget)
    scene = Scene.from_yaml(scene_file)
    files = _prepare_files("tradeoff", out, force, scene.origin.inputs)
    packing = _require_one_packing("A trade-off", scene_file, scene)
    load = scene.load.applied
    options_of_reference = _choose_reference(scene_file, scene)
    loads_of_scene: dict[str, Any] = {load.kind: load.values}
    work_file = None if out is None else Path(out) / WORK_FILE
    failures: dict[str, str] | None = None  # None until the files are written

    def describe_folder() -> str:
        """Return a sentence on what an interruption has left in the folder of the results: it reads
        ``failures`` as they are at the time of the interruption.
        """
        if work_file is None:
            return NOTHING_WRITTEN
        if failures is not None:
            return f"the result was written into {out}."
        return f"{NOTHING_WRITTEN} {GO_ON}" if work_file.is_file() else NOTHING_WRITTEN

    opened_files = nullcontext() if files is None else files.open()
    with (
        tell_interruption(describe_folder),
        opened_files as locked,
        open_store(work_file, force=force) as store,
    ):
        with open_executor(workers, scheduler) as executor:
            measured = tradeoff(
                packing,
                **loads_of_scene,
                **options_of_reference,
                observe=scene.observe,
                finite_overlap=scene.finite_overlap,
                budget=seconds,
                most_loads=loads,
                runs=runs,
                progress=on_stderr(quiet),
                executor=executor,
                store=store,
            )
        # assigned after the files have been written, as an interruption before says otherwise
        failures = {} if locked is None else _stage_study(locked, "tradeoff", measured)
    with tell_interruption(describe_folder):
        warn(tuple(failures.values()))
        if not quiet:
            for line in describe_tradeoff(measured, packing.structure.periods):
                say(line)
            _say_written(out, "tradeoff", failures)


def _choose_reference(scene_file: str, scene: Scene) -> dict[str, Any]:
    """Return the options, by name, of the simulated arrays by which the media of the scene are
    judged: arrays at rest without friction, or arrays that are loaded with friction in the way of
    a medium of the scene.

    InputError if media of the scene, of the file ``scene_file``, are loaded in different ways.
    """
    from granphon.media.array_options import REFERENCE_OPTIONS, REST

    histories = [choice.history for choice in scene.media if choice.history.is_loaded]
    references = list(dict.fromkeys(history.reference for history in histories))
    if len(references) > 1:
        problem = f"the media of {scene_file} are loaded with friction in {len(references)} ways"
        raise InputError(problem, "A trade-off judges all by one of them", "Keep one")
    reference = references[0] if references else REST
    return {name: reference.options[name] for name in REFERENCE_OPTIONS}


def _stage_study(locked: ResultFiles, name: str, value: Any) -> dict[str, str]:
    """Write the files of the output ``name``, "fit" or "tradeoff", with its ``value`` into their
    ``locked`` folder, and draw its figure. Return the reason for which the figure could not be
    drawn, by the name of its file; an empty mapping if it could.
    """
    from granphon.figures.style import draw
    from granphon.scene.outputs import OUTPUTS, Results

    row = OUTPUTS[name]
    results = Results(Path(locked.folder), values={name: value})
    with locked.staging([row.figure]) as stage:
        row.write_numbers(results, stage)
        return draw(lambda _file: row.make_figure(results), [row.figure], stage)


def _say_written(out: str | None, name: str, failures: Mapping[str, str]) -> None:
    """Print the names of the files of the output ``name`` that were written into the folder
    ``out``: all but those in ``failures``. Print nothing if ``out`` is None.
    """
    from granphon.scene.outputs import OUTPUTS

    if out is not None:
        written_names = [file for file in OUTPUTS[name].files if file not in failures]
        say(f"Wrote {', '.join(written_names)} into {out}")


def _require_one_packing(study: str, scene_file: str, scene: Scene) -> Packing:
    """Return the packing of the ``scene`` in the file ``scene_file``. InputError for a crystal and
    for a sweep over parameters; the message says that the ``study``, such as "A fit", is for one
    packing.
    """
    why = f"{study} is for one packing"
    if scene.packing.kind_names:
        mend = "Describe balls of one kind by the blocks material and packing"
        raise InputError(f"{scene_file} has balls of several kinds", why, mend)
    if scene.parameters:
        swept_names = ", ".join(name for name, _ in scene.parameters)
        raise InputError(f"{scene_file} sweeps {swept_names}", why, "Leave the block 'sweep' out")
    return cast("Packing", scene.packing)
