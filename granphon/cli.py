"""The command ``granphon``: a thin layer over the library."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granphon.errors import GranphonError, InputError, message

if TYPE_CHECKING:
    from granphon.medium import ContactState
    from granphon.run import RunResult
    from granphon.scene import Scene

__all__ = ["main"]

PRESETS = ("steel_hexagon", "glass", "hydrogel")

_EXIT_CODES = """\b
Exit codes:
  0    done
  1    the computation failed, or its result could not be written
  2    the input or the command line is wrong
  130  interrupted"""

app = typer.Typer(
    add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)  # fmt: skip


def _version(wanted: bool) -> None:
    if wanted:
        from granphon import __version__

        _say(f"granphon {__version__}")
        raise typer.Exit


@app.callback(epilog=_EXIT_CODES)
def _granphon(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Vibrations and sound velocities of granular crystals: elastic balls in contact, rotations included.

    \b
    Examples:
      granphon init                       write scene.yaml, commented
      granphon check scene.yaml           is it right, and what will be computed?
      granphon run scene.yaml -o out      compute, and write the folder out
      granphon plot out -o figure.pdf     draw the bands and the density of states together
    """


_Force = Annotated[bool, typer.Option("--force", help="Overwrite what is there.")]
_SceneFile = Annotated[str, typer.Argument(metavar="SCENE", help="The scene file.")]


@app.command()
def init(
    path: Annotated[str, typer.Argument(metavar="[PATH]", help="The file to write.")] = "scene.yaml",
    preset: Annotated[str, typer.Option(help="What to start from: " + ", ".join(PRESETS) + ".")] = PRESETS[0],
    force: _Force = False,
) -> None:
    """Write a commented scene to start from.

    \b
    Examples:
      granphon init
      granphon init beads.yaml --preset glass
    """
    from importlib.resources import files

    from granphon.files import closest, write_text

    if preset not in PRESETS:
        meant = closest(preset, PRESETS)
        raise InputError(
            message(
                f"found the preset {preset!r}; allowed: {', '.join(PRESETS)}",
                mend=f"Did you mean {meant!r}" if meant else "",
            )
        )
    _named("PATH", path)
    write_text(path, (files("granphon") / "data" / f"{preset}.yaml").read_text(encoding="utf-8"), force)
    _say(f"Wrote {path}. Next: granphon check {path}")


@app.command()
def check(scene: _SceneFile) -> None:
    """Say whether a scene is right, and what it means.

    Shows the values in readable units, the files that a run would write, and where the model fails. Writes nothing.

    \b
    Example:
      granphon check scene.yaml
    """
    from granphon.observables import validity
    from granphon.run import expected_files
    from granphon.scene import Scene

    read = Scene.from_yaml(scene)
    state = read.state()
    report = validity(state, finite_overlap=read.finite_overlap)
    _say(f"{scene} can be run.")
    _table(_described(read, state))
    _table([("will compute", ", ".join(read.observe)), ("will write", ", ".join(expected_files(read)))])
    _warn(report.warnings)


@app.command()
def run(
    scene: _SceneFile,
    out: Annotated[str, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if needed.")],
    force: _Force = False,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw a figure.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no summary; warnings stay.")] = False,
) -> None:
    """Compute what a scene observes and write it into a folder.

    The folder gets scene.yaml (every default written out) and summary.yaml (the numbers); bands add band.yaml and
    phonopy_params.yaml, the density of states adds dos.csv, and each a figure. With --force an earlier result is
    replaced, its files that the scene does not write included.

    \b
    Examples:
      granphon run scene.yaml -o out
      granphon run scene.yaml -o out --force --no-figures
    """
    from granphon.progress import on_stderr
    from granphon.scene import Scene

    _named("--out", out)
    result = Scene.from_yaml(scene).run(out, force=force, progress=on_stderr(quiet), figures=figures)
    _warn(result.warnings)
    if not quiet:
        _table(_results(result))
        _say(f"Wrote {', '.join(path.name for path in result.files)} into {out}")


@app.command()
def plot(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="A folder that 'granphon run' wrote.")],
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", metavar="FILE", help="Where to; the ending says the format (.png, .pdf, .svg)."),
    ] = None,
    asymptotes: Annotated[bool, typer.Option("--asymptotes", help="Add the long waves to the bands.")] = False,
    force: _Force = False,
) -> None:
    """Draw the results of a run again.

    The bands with the density of states beside them: bands.png in the folder, or the file given.

    \b
    Examples:
      granphon plot out --force
      granphon plot out --asymptotes -o figure.pdf
    """
    from granphon.run import redraw

    _named("--out", out)
    _say(f"Wrote {redraw(folder, out, force, asymptotes)}")


def _named(option: str, path: str | None) -> None:
    if path == "":
        raise InputError(message(f"{option} is empty", mend="Name a file or folder; was a shell variable not set"))


# -- what is printed ------------------------------------------------------------------------------------------------

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))


def _human(value: float, unit: str) -> str:
    """``value`` with five digits and a decimal prefix."""
    size, prefix = next(((s, p) for s, p in _PREFIXES if abs(value) >= 0.99999999 * s), (1.0, ""))
    return f"{value / size:.5g} {prefix}{unit}"


def _described(scene: Scene, state: ContactState) -> list[tuple[str, str]]:
    from granphon.quantities import LOADS

    packing, material, load = scene.packing, scene.packing.material, scene.load
    elastic = f"E = {_human(material.young_modulus, 'Pa')}, Poisson ratio {material.poisson_ratio:g}"
    yields = "" if material.yield_strength is None else f", yields at {_human(material.yield_strength, 'Pa')}"
    friction = "with friction" if packing.friction else "without friction"
    pressed = f"{load.kind.replace('_', ' ')} {_human(load.value, LOADS[load.kind].unit)}"
    rows = [
        ("material", f"{elastic}, {material.density:g} kg/m^3{yields}"),
        ("packing", f"{packing.structure.name}, balls of {_human(packing.diameter, 'm')}, {friction}"),
        ("load", pressed + ("" if load.balls_per_side is None else f" on each side, {load.balls_per_side} balls long")),
        ("contact", f"force {_human(state.force, 'N')}, overlap {_human(state.overlap, 'm')}"),
        ("stiffness", f"normal {_human(state.normal_stiffness, 'N/m')}, shear {_human(state.shear_stiffness, 'N/m')}"),
        ("medium", scene.medium + ("" if scene.medium == "ala" else " (for equal balls the same as ala)")),
    ]
    if scene.finite_overlap:
        rows.append(("terms", "of the order of the overlap over the diameter are kept"))
    if "bands" in scene.observe:
        labels = f" ({' '.join(scene.path.labels)})" if scene.path.labels else ""
        rows.append(("bands", f"{scene.path}{labels}, {scene.band_points} points in a segment"))
    if "dos" in scene.observe:
        rows.append(("mesh", f"{scene.mesh[0]} x {scene.mesh[1]}"))
    return rows


def _results(result: RunResult) -> list[tuple[str, str]]:
    numbers: dict[str, Any] = result.summary()
    rows = [("contact force", _human(numbers["force"], "N")), ("overlap", _human(numbers["overlap"], "m"))]
    if "longitudinal" in numbers:
        along = "" if "direction" not in numbers else " along ({:g}, {:g})".format(*numbers["direction"])
        rows += [(f"{name} velocity", f"{numbers[name]:.5g} m/s{along}") for name in ("longitudinal", "transverse")]
    rows += [(f"{name} modulus", _human(numbers[name], "Pa")) for name in ("bulk", "shear") if name in numbers]
    if "top_frequency" in numbers:
        rows.append(("top frequency", _human(numbers["top_frequency"], "Hz")))
    return rows


def _table(rows: Sequence[tuple[str, str]]) -> None:
    for name, text in rows:
        _say(f"  {name:<22}{text}")


def _say(text: str) -> None:
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(encoding, "backslashreplace").decode(encoding))


def _warn(warnings: Sequence[str]) -> None:
    for warning in warnings:
        print(f"granphon: warning: {warning}", file=sys.stderr)


def _fail(text: str, code: int) -> int:
    print("granphon: error: " + " ".join(text.split()), file=sys.stderr)
    return code


# -- the entry ------------------------------------------------------------------------------------------------------

#: the base of typer's usage errors, wherever this version of typer keeps it
_USAGE_ERROR = next(one for one in typer.BadParameter.__mro__ if one.__name__ == "ClickException")


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Let SIGTERM (a batch system's time limit, ``kill``) clean up as an interruption does."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code, listed in ``granphon --help``. Raises nothing but bugs."""
    try:
        with _terminated_like_interrupted():
            code = app(args=None if argv is None else list(argv), prog_name="granphon", standalone_mode=False)
        if sys.stdout is not None:  # closed before we started
            sys.stdout.flush()
        if code == 130:  # typer has caught the interruption
            raise KeyboardInterrupt
        return int(code or 0)
    except InputError as error:
        return _fail(str(error), 2)
    except GranphonError as error:
        return _fail(str(error), 1)
    except MemoryError:
        return _fail("there is not enough memory for this scene. Take a coarser mesh, or fewer band_points.", 1)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted; nothing was left behind.", 130)
    except BrokenPipeError:
        # whoever read our output has gone: keep the interpreter from writing into the pipe again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except Exception as error:
        if isinstance(error, _USAGE_ERROR):
            return _fail(f"{error.format_message()} See 'granphon --help'.", 2)  # type: ignore[attr-defined]
        raise
