"""Shared fixtures: the steel array of Section IV, and a twin of the lattice that owes nothing to
the package.

The twin writes the force and torque on each ball (equations 5-8, the sign of 5 as Newton's third
law has it) and sums them over the neighbours one by one, in double precision or in as many digits
as asked.
"""

from __future__ import annotations

import os
import signal

# Before numpy is loaded: the suite has a process for each processor, and threads of linear algebra
# beside them, one for each processor in each process, only wait for one another. Processes that
# tests start inherit the setting.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# ruff: noqa: E402
import cmath
import errno
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import settings

import granphon as gp
from granphon.base.registry import Registry
from tests.budget import (  # noqa: F401  (pytest calls the hooks of this module)
    EXAMPLES,
    pytest_fixture_setup,
    pytest_runtest_call,
    pytest_runtest_protocol,
    pytest_sessionstart,
)

settings.register_profile("granphon", deadline=None, derandomize=True, max_examples=EXAMPLES)
settings.load_profile("granphon")


def pytest_configure() -> None:
    """A suite that runs in the background of a shell ignores SIGINT, and so would the commands that
    tests interrupt.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def only(quick: Iterable[Any], cases: Iterable[Any]) -> list[Any]:
    """Cases of ``parametrize``, of which the default selection has those of ``quick``; the others
    are exhaustive.

    A tuple is a case of several arguments.
    """
    kept = list(quick)
    cases = list(cases)
    assert all(case in cases for case in kept), "a quick case that is none"
    return [
        case
        if case in kept
        else pytest.param(
            *(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.exhaustive
        )
        for case in cases
    ]


def one_error(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a command has printed, an error on stderr, without its prefix."""
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("granphon: error: ")
    assert err.count("\n") == 1
    return err.removeprefix("granphon: error: ").strip()


@contextmanager
def without_rights(path: Path, remove: bool = True) -> Iterator[None]:
    """Let nobody write to a file, nor remove it unless ``remove``; root may do both."""
    access = os.access
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "access", lambda at, mode: Path(at) != path and access(at, mode))
        if not remove:
            patch.setattr(os, "unlink", lambda name: (_ for _ in ()).throw(PermissionError()))
        yield


@pytest.fixture(autouse=True)
def nothing_registered_stays():
    """What a test registers is taken out again."""
    yield
    for table in Registry.every.values():
        for name in table:
            table.remove(name)


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Path:
    """An empty working folder with the scene of the module in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(request.module.SCENE, encoding="utf-8")
    return tmp_path


@pytest.fixture
def no_locks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system that keeps no locks, of a part of a file or, as its parameter says, of a whole
    file.
    """

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(pytest.importorskip("fcntl"), getattr(request, "param", "lockf"), refuse)


@pytest.fixture
def memory(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Let the machine have so much memory, in B."""
    return lambda amount: monkeypatch.setattr(
        "granphon.base.memory.available_memory", lambda: amount
    )


#: one neighbour: ball i, ball j, unit normal from i to j
Neighbour = tuple[int, int, tuple[Any, Any]]


class Twin:
    """The dynamics of balls in contact, by explicit sums; reduced units d = k = M = 1."""

    @staticmethod
    def hexagon() -> list[Neighbour]:
        """The six neighbours of a ball of the triangular lattice."""
        return [(0, 0, (math.cos(p * math.pi / 3), math.sin(p * math.pi / 3))) for p in range(6)]

    @staticmethod
    def exact_hexagon() -> list[Neighbour]:
        """The same in the present precision of mpmath."""
        return [
            (0, 0, (mpmath.cos(p * mpmath.pi / 3), mpmath.sin(p * mpmath.pi / 3))) for p in range(6)
        ]

    @staticmethod
    def neighbours(
        cell: Sequence[Sequence[float]], sites: Sequence[Sequence[float]]
    ) -> list[Neighbour]:
        """Every pair at distance one, seen from both ends."""
        places = [tuple(sum(s[a] * cell[a][c] for a in (0, 1)) for c in (0, 1)) for s in sites]
        found = []
        for i, j in itertools.product(range(len(sites)), repeat=2):
            for m, n in itertools.product(range(-3, 4), repeat=2):
                x = places[j][0] - places[i][0] + m * cell[0][0] + n * cell[1][0]
                y = places[j][1] - places[i][1] + m * cell[0][1] + n * cell[1][1]
                if abs(math.hypot(x, y) - 1.0) < 1e-9:
                    found.append((i, j, (x, y)))
        return found

    @staticmethod
    def rows(
        neighbours: Sequence[Neighbour],
        q: Sequence[Any],
        eta: Any,
        spacing: Any = 1,
        prestress: Any = 0,
        exact: bool = False,
    ) -> list[list[Any]]:
        """D(q) as nested lists, dofs (x, y, w) ball by ball, w = phi/sqrt(10); phases at the balls'
        own places.
        """
        exp: Callable[[Any], Any] = mpmath.exp if exact else cmath.exp
        root = mpmath.sqrt(10) if exact else math.sqrt(10.0)
        n_balls = 1 + max(i for i, _, _ in neighbours)
        out = [[0 * root for _ in range(3 * n_balls)] for _ in range(3 * n_balls)]
        arm = spacing / (2 * root / root)
        for i, j, (nx, ny) in neighbours:
            tx = -ny
            ty = nx
            phase = exp(1j * spacing * (q[0] * nx + q[1] * ny))
            for ball, factor, sign in ((i, 1, -1), (j, phase, 1)):
                for dof in range(3):
                    ux, uy, phi = (
                        factor * (root if dof == 2 else 1) if dof == one else 0 for one in range(3)
                    )
                    along = sign * (ux * nx + uy * ny)
                    across = sign * (ux * tx + uy * ty)
                    slip = across - arm * phi
                    shear = eta * slip - prestress * across
                    response = (
                        along * nx + shear * tx,
                        along * ny + shear * ty,
                        root * eta * arm * slip,
                    )
                    for c in range(3):
                        out[3 * i + c][3 * ball + dof] -= response[c]
        return out

    @classmethod
    def matrix(
        cls,
        neighbours: Sequence[Neighbour],
        q: Sequence[float],
        eta: float,
        spacing: float = 1.0,
        prestress: float = 0.0,
    ) -> np.ndarray:
        """D(q) in double precision; rotations left out without friction."""
        full = np.array(cls.rows(neighbours, q, eta, spacing, prestress), complex)
        keep = np.ones(len(full), bool) if eta else np.arange(len(full)) % 3 != 2
        return full[np.ix_(keep, keep)]

    @classmethod
    def frequencies(
        cls, neighbours: Sequence[Neighbour], q: Sequence[float], eta: float, **terms: float
    ) -> np.ndarray:
        """Angular frequencies by a dense eigenvalue solver, ascending."""
        return np.sqrt(np.maximum(np.linalg.eigvalsh(cls.matrix(neighbours, q, eta, **terms)), 0.0))

    @classmethod
    def exact_matrix(
        cls,
        neighbours: Sequence[Neighbour],
        q: Sequence[Any],
        eta: Any,
        spacing: Any = 1,
        prestress: Any = 0,
    ) -> Any:
        """D(q) in the present precision of mpmath; rotations left out without friction."""
        full = cls.rows(neighbours, q, eta, spacing, prestress, exact=True)
        keep = [c for c in range(len(full)) if eta or c % 3 != 2]
        return mpmath.matrix([[full[a][b] for b in keep] for a in keep])

    @classmethod
    def exact_squares(
        cls, neighbours: Sequence[Neighbour], q: Sequence[Any], eta: Any, **terms: Any
    ) -> list[Any]:
        """Squared frequencies in the present precision of mpmath, ascending."""
        values = mpmath.eighe(cls.exact_matrix(neighbours, q, eta, **terms), eigvals_only=True)
        return sorted(values)


@pytest.fixture(scope="session")
def twin() -> type[Twin]:
    """The independent lattice dynamics."""
    return Twin


@pytest.fixture(scope="session")
def steel() -> gp.Material:
    """Steel with the Young modulus that reproduces the velocities of Section IV."""
    return gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)


@pytest.fixture(scope="session")
def packing(steel: gp.Material) -> gp.Packing:
    """The array of the experiment: 8 mm balls, with friction."""
    return gp.Packing(steel, diameter=8e-3)


@pytest.fixture(scope="session")
def rough(steel: gp.Material) -> gp.Packing:
    """The same with the spread of Section IV."""
    return gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))


@pytest.fixture(scope="session")
def unit(rough: gp.Packing) -> float:
    """Of its f*, N."""
    return float(rough.law.coefficient * rough.width**1.5)


@pytest.fixture(scope="session")
def smooth(steel: gp.Material) -> gp.Packing:
    """The same without friction."""
    return gp.Packing(steel, diameter=8e-3, friction=False)


@pytest.fixture(scope="session")
def state(packing: gp.Packing) -> gp.ContactState:
    """The array under the largest load of Section IV."""
    return gp.AveragedLattice(packing).at_force(18.446)


@pytest.fixture(scope="session")
def hexagonal(packing: gp.Packing) -> gp.ContactLattice:
    """The triangular lattice of steel balls, in reduced units."""
    return gp.ContactLattice.of("triangular", packing.mindlin_ratio)
