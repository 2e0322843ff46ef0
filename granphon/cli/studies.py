"""The commands that compare: ``fit`` compares a scene with measurements, and ``tradeoff`` media
with each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias, TypeVar, cast

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
    from granphon.media.choice import MediumChoice
    from granphon.scene.scene import Scene

#: a fit of velocities, or of a response
FitT = TypeVar("FitT", "WidthFit", "DampingFit")
#: the inputs of a fit that are varied: the scene, and the text of the option --distance
_Inputs: TypeAlias = "tuple[Scene, str | None]"


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
    quantity = _expect_response(scene, table, columns)
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
        response_fit, rows = _fit_transfer(scene_file, scene, data, columns, parameters)
        _finish_fit(out, files, response_fit, response_fit.warnings, rows)
        return
    if quantity:
        # the table lacks a column of the transfer function: this raises the error that names it
        TransferFunction.read(data, columns, quantity)
    branch_name = "longitudinal" if branch is None else branch
    options = _VelocityOptions(
        parameters, width, branch_name, frequency, distance, sigma, direction
    )
    fit, notes, rows_of_inputs = _fit_velocities(scene_file, scene, data, table, columns, options)
    rows = [*describe_fit(fit), *rows_of_inputs]
    _finish_fit(out, files, fit, (*notes, *fit.warnings), rows)


def _expect_response(scene: Scene, table: Table, columns: Mapping[str, str]) -> str:
    """Return the quantity of the response that a ``scene`` expects in a ``table``, such as
    "displacement"; empty if it expects velocities. ``columns`` are those of
    :func:`_read_velocities`.
    """
    # whether the table has velocities, or what they are found from
    has_sound = any(columns.get(kind, kind) in table for kind in ("velocity", "time", "cutoff"))
    if has_sound:
        return ""
    if scene.response is not None:
        return scene.response.quantity
    has_crystal = bool(scene.packing.kind_names)  # velocities are fitted to a packing only
    return "displacement" if has_crystal else ""


def _fit_transfer(
    scene_file: str, scene: Scene, data: str, columns: Mapping[str, str], names: tuple[str, ...]
) -> tuple[DampingFit, list[tuple[str, str]]]:
    """Return the fit to a transfer function, and the rows of its table; the arguments are those of
    :func:`_fit_response`, whose errors are raised.
    """

    def find_response_fit(varied_scene: Scene, _distance: str | None) -> DampingFit:
        """Return the fit to the transfer function for the values that a scene has.
        :func:`_fit_with_errors` calls this with the given scene and with shifted scenes; a response
        has no distance.
        """
        return _fit_response(scene_file, varied_scene, data, columns, names)

    fit, rows_of_inputs = _fit_with_errors(find_response_fit, scene)
    return fit, [*describe_response_fit(fit), *rows_of_inputs]


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


class _FittedCase(NamedTuple):
    """Balls whose velocities are fitted, and the sound in them.

    They are the ``packing`` of a ``scene``, read from the file ``scene_file``, in the ``medium``.
    ``parameters`` names what is fitted of the packing beside the width. Sound is of the ``branch``
    and along the ``direction`` (p,), a component for each of p periods; None for the direction that
    the fit takes by default.
    """

    scene_file: str
    scene: Scene
    packing: Packing
    medium: MediumChoice
    parameters: tuple[str, ...]
    branch: str
    direction: Sequence[float] | None


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
    :func:`_read_velocities`. Warnings on traces are printed before the fit.

    InputError for a scene of several packings, media or directions, or of a crystal, for nothing to
    fit, for options that are no numbers or do not fit the table, and for what the fit refuses.
    """
    _require_fitted(options.width, options.parameters)
    case = _FittedCase(
        scene_file,
        scene,
        _require_one_packing("A fit", scene_file, scene),
        _choose_medium(scene_file, scene, fits_width=options.width),
        options.parameters,
        options.branch,
        _choose_direction(scene_file, scene, options.direction),
    )
    traced = _find_traced(data, table, columns, options)

    def find_velocity_fit(varied_scene: Scene, varied_distance: str | None) -> WidthFit:
        """Return the fit to the velocities for the values that a scene and the option --distance
        have: :func:`_fit_with_errors` calls this first with the given values, and again with each
        of them moved by its error.
        """
        packing = _require_one_packing("A fit", scene_file, varied_scene)
        varied_case = case._replace(scene=varied_scene, packing=packing)
        if traced is not None:
            measured = _place_traced(data, traced, varied_case)
        else:
            measured = _read_velocities(data, columns, varied_distance, varied_case)
        return _fit_case(varied_case, measured, options)

    fit, rows_of_inputs = _fit_with_errors(find_velocity_fit, scene, options.distance)
    return fit, _list_notes(case, data, fit), rows_of_inputs


def _choose_medium(scene_file: str, scene: Scene, *, fits_width: bool) -> MediumChoice:
    """Return the one medium of the ``scene``, or the effective medium in place of the averaged
    lattice where the fit ``fits_width`` of equal balls. InputError if the scene, of the file
    ``scene_file``, has several media.
    """
    from granphon.media.choice import MediumChoice

    if len(scene.media) > 1:
        raise InputError(f"{scene_file} has several media", mend="Keep only the one to fit with")
    # "ala" is the default for equal balls, so that a scene with this medium does not say how
    # balls of the fitted width are to be averaged
    takes_ema = fits_width and scene.media[0].name == "ala" and not scene.balls_differ
    return MediumChoice("ema") if takes_ema else scene.media[0]


def _find_traced(
    data: str, table: Table, columns: Mapping[str, str], options: _VelocityOptions
) -> TraceVelocity | None:
    """Return the velocity that the traces in a ``table``, of the file ``data``, show, and print its
    warnings; None if the table has no traces. InputError for options of a table of velocities
    beside traces, of which ``columns`` are those of --column.
    """
    from granphon.fits.trace_files import has_traces
    from granphon.fits.traces import Traces

    if not has_traces(table):
        return None
    options_of_tables = {
        "--distance": options.distance,
        "--sigma": options.sigma,
        "--column": ", ".join(columns) or None,
    }
    _refuse_options(options_of_tables, data, "traces")
    traced = Traces.read(data).velocity()
    warn(traced.warnings)
    return traced


def _fit_case(case: _FittedCase, measured: Measurements, options: _VelocityOptions) -> WidthFit:
    """Return the fit of a ``case`` to the ``measured`` velocities. A standard error and a frequency
    among the ``options`` replace the measured ones.
    """
    from granphon.fits.fit import fit_width

    velocity_sigma, pulse_frequency = _choose_sigma_and_frequency(
        measured, options.sigma, options.frequency
    )
    fitted_names = ("width", *case.parameters) if options.width else case.parameters
    return fit_width(
        case.packing,
        measured.force,
        measured.velocity,
        velocity_sigma,
        pulse_frequency,
        medium=case.medium,
        parameters=tuple(dict.fromkeys(fitted_names)),  # "width" may be named among them too
        branch=case.branch,
        direction=case.direction,
        finite_overlap=case.scene.finite_overlap,
    )


def _list_notes(case: _FittedCase, data: str, fit: WidthFit) -> list[str]:
    """Return notes on the ``fit`` of a ``case`` to the table ``data``: that it takes the effective
    medium in place of the averaged lattice, that it does not use the loads of a scene with several,
    and which direction it takes if sound depends on its direction and none is given.
    """
    scene_file = case.scene_file
    notes = list[str]()
    if case.medium != case.scene.media[0]:
        notes.append(
            f"{scene_file} has the medium ala, which knows no width: the fit takes ema. Name afa or"
            " ema in it"
        )
    n_loads = len(case.scene.load.values)
    if n_loads > 1:
        notes.append(
            f"the {n_loads} loads of {scene_file} are not used: a fit takes the loads of {data}"
        )
    if case.direction is None and not fit.is_isotropic:
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

    InputError if the distance is no length, or its error is as large as the distance or larger; and
    what ``find`` raises.
    """
    from granphon.scene.uncertainty import make_matrix

    distance_alone, shifted_distances = _shift_distance(distance)
    shifted_inputs = _list_shifted_inputs(scene, distance_alone, shifted_distances)
    fit = find(scene, distance_alone)
    if not shifted_inputs:
        return fit, []
    # (inputs, parameters): change of each fitted value by the error of each input
    changes = [
        0.5 * (find(*larger).values - find(*smaller).values)
        for _, smaller, larger in shifted_inputs
    ]
    names = [name for name, _, _ in shifted_inputs]
    correlation = make_matrix(names, scene.correlations)
    rows = _describe_input_errors(fit, names, changes, correlation)
    return fit.with_input_errors(changes, correlation), rows


def _shift_distance(distance: str | None) -> tuple[str | None, tuple[str, ...]]:
    """Return the ``distance``, a text perhaps with a standard error, without its error, and two
    texts with the distance smaller and larger by the error; () if it has none. None stays None.

    InputError for a text that is no length, and for an error that is as large as the distance or
    larger.
    """
    from granphon.base.quantities import LENGTH, read_with_error
    from granphon.base.validation import require

    if distance is None:
        return None, ()
    value, error = require("--distance", partial(read_with_error, quantity=LENGTH), distance)
    if error >= value:
        problem = f"--distance is {distance}, whose error is as large as the distance or larger"
        raise InputError(problem, mend="Give a distance that is known better")
    if not error:
        return f"{value!r} m", ()
    return f"{value!r} m", (f"{value - error!r} m", f"{value + error!r} m")


def _list_shifted_inputs(
    scene: Scene, distance: str | None, shifted_distances: tuple[str, ...]
) -> list[tuple[str, _Inputs, _Inputs]]:
    """Return for each input of a fit that has a standard error its name and the inputs of the fit
    with this one smaller and larger by its error: the keys of the ``scene`` that have one, and the
    ``distance`` if there are ``shifted_distances``.
    """
    from granphon.scene.written_errors import name_keys

    shifted_inputs: list[tuple[str, _Inputs, _Inputs]] = [
        (name_keys(keys), (lower_scene, distance), (upper_scene, distance))
        for (keys, _), (lower_scene, upper_scene) in zip(scene.errors, scene.shifted, strict=True)
    ]
    if shifted_distances:
        shorter, longer = shifted_distances
        shifted_inputs.append(("--distance", (scene, shorter), (scene, longer)))
    return shifted_inputs


def _describe_input_errors(
    fit: WidthFit | DampingFit, names: Sequence[str], changes: Sequence[Any], correlation: Any
) -> list[tuple[str, str]]:
    """Return a row (name, text) for each of the m parameters of a ``fit``: the part of its standard
    error that follows from those of the n inputs with these ``names``, and the input that gives
    most of it.

    ``changes``, n arrays (m,), are those of the fitted values by the error of each input, and
    ``correlation`` (n, n) is that of the errors.
    """
    import numpy as np

    from granphon.base.scales import write_quantity
    from granphon.base.text import spell

    rows = []
    for number, (name, unit) in enumerate(zip(fit.parameters, fit.units_of_values, strict=True)):
        changes_of_value = np.array([change[number] for change in changes])
        # the part of each input in the variance, whose sum rounding may leave below zero
        contributions = changes_of_value * (correlation @ changes_of_value)
        error = float(np.sqrt(max(np.sum(contributions), 0.0)))
        main_input = names[int(np.argmax(contributions))]
        size = write_quantity(error, "" if unit == "1" else unit)
        rows.append((f"{spell(name)}, of inputs", f"+/- {size}, most from {main_input}"))
    return rows


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
    """Raise InputError if one of the ``options`` is given: values by name, None where none is
    given. All options are for tables of velocities, and the file ``data`` has ``content`` instead,
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
    data: str, columns: Mapping[str, str], distance: str | None, case: _FittedCase
) -> Measurements:
    """Return the measured velocities in the table ``data``, m/s, with the contact forces of their
    loads, N.

    ``columns`` has the headings of columns whose names are not the usual ones, by what the columns
    hold, and ``distance`` is the text of the option --distance without an error, None without the
    option. Side forces, pressures and cutoff frequencies are converted for the packing of the
    ``case``, and side forces for the frame of its scene.

    InputError for a text that is no length, for a table that
    :meth:`~granphon.fits.measurements.Measurements.read` refuses, and for what cannot be converted.
    """
    from granphon.balls.loads import force_of_frame
    from granphon.base.quantities import LENGTH
    from granphon.base.validation import require
    from granphon.fits.fit import convert_cutoff, convert_pressure
    from granphon.fits.measurements import Measurements

    distance_of_pulses = None  # m
    if distance is not None:
        distance_of_pulses = require("--distance", LENGTH.read, distance)
    balls_per_side = case.scene.load.balls_per_side
    convert_side_force = None
    if balls_per_side is not None:
        convert_side_force = partial(force_of_frame, balls_per_side=balls_per_side)
    packing = case.packing
    finite_overlap = case.scene.finite_overlap
    return Measurements.read(
        data,
        columns,
        distance_of_pulses,
        convert_side_force,
        partial(convert_pressure, packing, finite_overlap, case.medium, case.parameters),
        packing.structure.periods,
        partial(
            convert_cutoff, packing, case.branch, case.direction, finite_overlap, case.parameters
        ),
    )


def _place_traced(data: str, traced: TraceVelocity, case: _FittedCase) -> Measurements:
    """Return as one measurement the velocity that the traces in the file ``data`` show,
    ``traced``, with its standard error, and the contact force of the one load of the scene of the
    ``case``. A pressure is converted for its packing.

    InputError if the scene has several loads, or a load that is no force, pressure or side_force,
    and if a pressure cannot be converted.
    """
    import numpy as np

    from granphon.balls.loads import force_of_frame
    from granphon.fits.fit import convert_pressure
    from granphon.fits.measurements import Measurements

    scene_file = case.scene_file
    load = case.scene.load
    if load.size != 1:
        problem = f"{scene_file} has {load.size} loads, and {data} has traces"
        raise InputError(problem, "Traces are of one load", "Keep the load of the traces")
    value = load.values[0]
    if load.kind == "force":
        force = value
    elif load.kind == "side_force" and load.balls_per_side is not None:
        force = force_of_frame(value, balls_per_side=load.balls_per_side)
    elif load.kind == "pressure":
        finite_overlap = case.scene.finite_overlap
        force = convert_pressure(case.packing, finite_overlap, case.medium, case.parameters, value)
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
