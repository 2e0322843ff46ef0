"""All waves of a crystal at given frequencies: those that run across its layers, and those that
decay.

Layers of balls follow each other across an axis, at one wave vector along them
(:class:`granphon.dynamics.half_space.HalfSpace`). A motion u lambda^n of layer n obeys the sum over
s of D_s lambda^s u = w u, w = omega^2, where D_s joins a layer to the s-th after it. That is an
eigenproblem for lambda, twice as large as the layers to which contacts reach. |lambda| is one of
waves that run; where it is less, they decay. Energy flows towards higher layers where dw/dk = -2
Im(u^H A u lambda) is above zero, A being the coupling from block to block (T. Ando, Phys. Rev. B
44, 8017, 1991).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import PrecisionError
from granphon.base.memory import require_memory
from granphon.base.text import counted
from granphon.dynamics.linalg import NO_ENERGY

#: matrices of a block, twice as wide, that are held for each frequency, and rows of a contact where
#: it loses energy
_MATRICES = 7.0
_ROWS = 6.0
#: point of the plane of lambda from which eigenvalues are found: one without symmetry, well inside
#: of the unit circle
_POINT = 0.31 + 0.17j
#: distance of lambda from the unit circle up to which a wave runs
_ON_CIRCLE = 1e-7
#: distance between the lambda of two waves up to which the waves are one
_TOGETHER = 1e-7
#: angle of lambda up to which waves are long: the error of an eigenvalue is that of rounding over
#: this angle
_LONG = 0.1
#: steps of Newton's method for long waves: each step doubles the digits, and the longest waves that
#: are told apart start with one digit
_NEWTON = 5
#: singular value, over the largest, up to which a coupling has none
_UNCOUPLED = 1e-12
#: condition of the waves of one sense from which they are not told apart
_ALIKE = 1e11
#: part of a wave that the next layer must have, at least: that of a wave number with three digits
LEAST_PART = 1e-12
#: difference of lambda of two waves at the edge of a band: some roots of the rounding of w
_EDGE = 1e-6
#: least singular value of the motions of two waves, of length one, from which the waves are two
_PARALLEL = 1e-5
#: w over the largest entry of D up to which two waves at an edge are long, and have all digits
_NEAR_ZERO = 1e-12
#: message of the error of waves that are not told apart; its reason and remedy at an edge, and
#: where a wave decays too fast
_ALIKE_WAVES = "the waves at a frequency cannot be told apart"
_AT_EDGE = "At the very edge of a band waves of both senses are one", "Shift it by a millionth"
_TOO_FAST = "One decays too fast from layer to layer to have digits", "Take lower frequencies"


class Couplings(NamedTuple):
    """Blocks of D, (n, n) or (n_f, n, n), of the layers that contacts reach across: of one block,
    and of it with the next.

    ``inner`` has contacts on both sides, of which ``tail`` is the part of those to the next block,
    ``head`` of those to the one before; ``up`` joins a block to the next, ``down`` to the one
    before (its adjoint if nothing is lost).
    """

    inner: Complex
    tail: Complex
    head: Complex
    up: Complex
    down: Complex


class BlochWaves(NamedTuple):
    """Waves at one frequency that run or decay in one sense, those that run first.

    Attributes
    ----------
    factors : (m,) lambda, from layer to layer; infinitely fast decay is left out.
    vectors : (n, m) motions of a block; of waves that run, dw/dk from block to block is plus or
        minus one.
    running : number of waves that run.
    still : (n, n - m) motions of a block that reach no other block in this sense.
    """

    factors: Complex
    vectors: Complex
    running: int
    still: Complex

    def continue_by(self, steps: int) -> Complex:
        """Return F (n, n), which makes the motions of a block those of the block so many layers,
        ``steps``, on; below zero, back.
        """
        basis = np.concatenate([self.vectors, self.still], axis=1)
        # motions that reach no other block become zero there
        n_still = self.still.shape[1]
        continued = np.pad(self.vectors * self.factors**steps, ((0, 0), (0, n_still)))
        return np.asarray(np.linalg.solve(basis.T, continued.T).T)

    def find_parts(self, motion: Complex) -> Complex:
        """Return the amplitudes (running, ...) of the waves that run in a motion (n, ...) of a
        block.
        """
        basis = np.concatenate([self.vectors, self.still], axis=1)
        return np.asarray(np.linalg.solve(basis, motion)[: self.running])


def require_bloch_memory(count: int, size: int, contacts: int = 0) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if waves at ``count`` frequencies do not fit
    into memory.

    A block has ``size`` motions, and couplings that differ from frequency to frequency have so many
    ``contacts``.
    """
    mend = (
        "Take fewer frequencies" if count > 1 else "Take a narrower block: fewer balls in a layer"
    )
    require_memory(
        f"waves of {size:,} motions at {counted(count, 'frequency', 'frequencies')}",
        count_bloch_bytes(count, size, contacts),
        mend,
    )


def count_bloch_bytes(count: int, size: int, contacts: int = 0) -> float:
    """Return the bytes that waves at ``count`` frequencies take, as :func:`require_bloch_memory`
    counts them.
    """
    bytes_of_matrices = _MATRICES * 16.0 * (2 * size) ** 2
    bytes_of_rows = _ROWS * 32.0 * size * contacts
    return count * (bytes_of_matrices + bytes_of_rows)


def find_bloch_waves(
    blocks: Couplings, w: Array, layer: int
) -> list[tuple[BlochWaves, BlochWaves]]:
    """Return the waves at each w (n_f,), in the unit of the blocks: a pair for each w, the waves
    towards higher layers, and those towards lower ones.

    ``layer`` is the number of motions of a layer. Raises
    :class:`~granphon.base.errors.PrecisionError` where waves cannot be told apart: at an edge of a
    band, where motions that reach no other layer resonate, where a wave decays so fast that it has
    no digits, and at any frequency if some motions reach the next layers alone.
    """
    size = blocks.inner.shape[-1]
    count = len(w)
    reach = size // layer
    inner, _, _, up, down = (np.broadcast_to(block, (count, size, size)) for block in blocks)
    steps = _list_steps(inner, up, down, w, layer)
    scale = float(np.max(np.abs(inner)))
    inverse, vectors = _solve_pencil(steps, size, scale)
    waves = []
    for n in range(count):
        null_spaces = [_null_space(coupling[n]) for coupling in (down, up)]
        _require_passing_on(null_spaces, inner[n], scale)
        # a decay that is infinitely fast is no wave, and one that is nearly so has no digits
        kept = _choose_finite(inverse[n], null_spaces)
        smallest = np.min(np.abs(inverse[n, kept]), initial=1.0)
        if smallest < np.finfo(float).eps ** 2:
            raise PrecisionError(_ALIKE_WAVES, *_TOO_FAST)
        factors = _POINT + 1.0 / inverse[n, kept]
        motions = vectors[n][:size, kept]
        couplings = [step[n] for step in steps]
        couplings[reach] = couplings[reach] + w[n] * np.eye(layer)  # D_0 itself, not less w
        factors, motions = _sharpen_long(factors, motions, couplings, w[n])
        if w[n] > _NEAR_ZERO * scale:
            _require_senses(factors, motions)
        waves.append(_sort_senses(factors, motions, up[n], down[n], null_spaces, reach))
    return waves


def _list_steps(inner: Complex, up: Complex, down: Complex, w: Array, layer: int) -> list[Complex]:
    """Return D_s (n_f, layer, layer), s = -reach ... reach, the middle one less w (n_f,), from the
    blocks ``inner``, ``up`` and ``down`` (n_f, size, size) of :class:`Couplings`, of reach layers
    with ``layer`` motions each.
    """
    reach = inner.shape[-1] // layer
    # all layers are alike: D_s is read from the first layer of a block
    first = slice(0, layer)
    other_layers = [slice(s * layer, (s + 1) * layer) for s in range(1, reach)]
    steps = [down[:, first, first]]
    steps += [inner[:, other, first] for other in reversed(other_layers)]
    steps += [inner[:, first, first] - w[:, None, None] * np.eye(layer)]
    steps += [inner[:, first, other] for other in other_layers]
    steps += [up[:, first, first]]
    return steps


def _choose_finite(inverse: Complex, null_spaces: list[Complex]) -> Index:
    """Return the indices (m,) of the waves that do not decay infinitely fast, from ``inverse``,
    1/(lambda - :data:`_POINT`) (2 size,), of all waves, and from the two ``null_spaces``: motions,
    as columns, without coupling to lower and to higher layers.

    The inverse is zero where the decay towards lower layers is infinitely fast, and -1/point where
    that towards higher ones is. There are as many such waves as motions without coupling to the
    layers on the other side.
    """
    below, above = null_spaces
    fast_upwards = np.argsort(np.abs(inverse + 1.0 / _POINT))[: below.shape[1]]
    fast_downwards = np.argsort(np.abs(inverse))[: above.shape[1]]
    return np.setdiff1d(np.arange(len(inverse)), np.concatenate([fast_upwards, fast_downwards]))


def _solve_pencil(steps: list[Complex], size: int, scale: float) -> tuple[Complex, Complex]:
    """Return 1/(lambda - :data:`_POINT`) (n_f, 2 size), and u of two blocks (n_f, 2 size, 2 size),
    as columns, that solve the sum over s of D_s lambda^s u = w u.

    ``steps`` are D_s (n_f, layer, layer), the middle one less w; ``scale`` is the largest of their
    entries.
    """
    count, layer, _ = steps[0].shape
    # A u = lambda B u: all rows but the last say that each layer follows the one before; the last
    # rows are the sum over s. The scale makes both kinds of rows alike in size
    a = np.zeros((count, 2 * size, 2 * size), complex)
    b = np.zeros((count, 2 * size, 2 * size), complex)
    a[:, :-layer, layer:] = np.eye(2 * size - layer)
    b[:, :-layer, :-layer] = np.eye(2 * size - layer)
    a[:, -layer:] = -np.concatenate(steps[:-1], axis=2) / scale
    b[:, -layer:, -layer:] = steps[-1] / scale
    inverse, vectors = np.linalg.eig(np.linalg.solve(a - _POINT * b, b))
    return inverse, vectors


def _require_passing_on(null_spaces: list[Complex], inner: Complex, scale: float) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if some motions reach the next layers
    alone.

    ``null_spaces`` are the motions of a block, as columns, without coupling to lower and to higher
    layers; ``inner`` (size, size) is the block, with entries up to ``scale``. Motions that reach
    the next layers alone are there at any w. They are sought at a w below zero, where nothing
    resonates.
    """
    below, above = null_spaces
    between = above.conj().T @ (inner + scale * np.eye(len(inner))) @ below
    if not between.size:
        return
    if np.linalg.matrix_rank(between, tol=_UNCOUPLED * scale) < min(between.shape):
        raise PrecisionError(
            "some motions of a layer are passed on to the next ones and no further",
            "They decay infinitely fast, at any frequency",
            "Choose another axis",
        )


def _sharpen_long(
    factors: Complex, vectors: Complex, couplings: list[Complex], w: float
) -> tuple[Complex, Complex]:
    """Return ``factors`` lambda = exp(i theta) (b,) and ``vectors``, the motions (n, b) of a block,
    with all digits of the long waves that run, undamped.

    For long waves the sum of D_s lambda^s, less w, is a difference of near-equal numbers. The part
    of the sum at lambda = 1 is zero on free motions, which cost nothing if all layers move alike:
    for these it is left out, and D_s (exp(i s theta) - 1) remains. Stiff motions follow the free
    ones at each theta, which Newton's method finds. The amplitudes of the free motions are kept:
    theta depends on the square of their error. ``couplings`` are D_s (layer, layer).
    """
    size = len(couplings[0])
    runs = np.abs(np.abs(factors) - 1.0) < _ON_CIRCLE
    long_waves = np.flatnonzero(runs & (np.abs(np.angle(factors)) < _LONG))
    # without loss D_-s is the adjoint of D_s
    loss = max(
        np.max(np.abs(coupling - opposite.conj().T))
        for coupling, opposite in zip(couplings, couplings[::-1], strict=True)
    )
    largest = np.max(np.abs(couplings[len(couplings) // 2]))
    if not long_waves.size or loss > NO_ENERGY * largest:
        return factors, vectors
    stiffness, modes = np.linalg.eigh(np.sum(couplings, axis=0))
    is_stiff = np.abs(stiffness) > NO_ENERGY * np.max(np.abs(stiffness))
    free = modes[:, ~is_stiff]
    stiff = modes[:, is_stiff]
    factors = factors.copy()
    vectors = vectors.copy()
    layers = range(len(vectors) // size)
    for wave in long_waves:
        layer_motion = vectors[:size, wave]
        free_part = free @ (free.conj().T @ layer_motion)
        if np.linalg.norm(free_part) < 0.5 * np.linalg.norm(layer_motion):
            continue  # the edge of another band is near
        start = float(np.angle(factors[wave]))
        theta, motion = _solve_theta(start, free_part, couplings, stiff, stiffness[is_stiff], w)
        factors[wave] = np.exp(1j * theta)
        vectors[:, wave] = np.concatenate([motion * factors[wave] ** layer for layer in layers])
    return factors, vectors


def _solve_theta(
    theta: float,
    free_part: Complex,
    couplings: list[Complex],
    stiff: Complex,
    stiffness: Array,
    w: float,
) -> tuple[float, Complex]:
    """Return theta, rad, and the motion (layer,) of a layer in a long wave, by Newton's method from
    a ``theta``.

    ``free_part`` (layer,) is the part of the motion that costs nothing if all layers move alike.
    ``stiff`` (layer, m) are the other motions, and ``stiffness`` (m,) what they cost then.
    ``couplings`` are D_s (layer, layer), and w the eigenvalue.
    """
    reach = len(couplings) // 2
    steps = list(zip(range(-reach, reach + 1), couplings, strict=True))
    for _ in range(_NEWTON):
        change = sum(coupling * np.expm1(1j * s * theta) for s, coupling in steps)
        slope = sum(coupling * 1j * s * np.exp(1j * s * theta) for s, coupling in steps)
        pull = stiff.conj().T @ change
        stiff_matrix = np.diag(stiffness - w) + pull @ stiff
        stiff_amplitudes = np.linalg.solve(stiff_matrix, -pull @ free_part)
        motion = free_part + stiff @ stiff_amplitudes
        residual = (
            (motion.conj() @ change @ motion).real
            + stiffness @ np.abs(stiff_amplitudes) ** 2
            - w * np.linalg.norm(motion) ** 2
        )
        theta -= float(residual / (motion.conj() @ slope @ motion).real)
    return theta, motion


def _require_senses(factors: Complex, vectors: Complex) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if waves that run (|lambda| is 1 within
    ``_EDGE``) and have the same lambda, within ``_EDGE``, have linearly dependent motions.

    So they have at the edge of a band, where the waves of both senses become one. At a distance
    Delta w from the edge the lambda of both senses differ by the root of Delta w: so near the
    edge, the rounding of w would decide whether waves run, and how fast.

    ``factors`` (b,) are the lambda of the waves, and ``vectors`` (n, b) their motions.
    """
    running = np.flatnonzero(np.abs(np.abs(factors) - 1.0) < _EDGE)
    for number, wave in enumerate(running):
        wave_and_next = running[number:]
        neighbours = wave_and_next[np.abs(factors[wave_and_next] - factors[wave]) < _EDGE]
        motions = vectors[:, neighbours] / np.linalg.norm(vectors[:, neighbours], axis=0)
        # more vectors than components are always dependent
        if neighbours.size > len(motions):
            raise PrecisionError(_ALIKE_WAVES, *_AT_EDGE)
        least_singular_value = np.linalg.svd(motions, compute_uv=False)[-1]
        if least_singular_value < _PARALLEL:
            raise PrecisionError(_ALIKE_WAVES, *_AT_EDGE)


def _null_space(coupling: Complex) -> Complex:
    """Return an orthonormal basis (n, m) of the motions on which a coupling does not act."""
    _, singular_values, right_vectors = np.linalg.svd(coupling)
    return np.asarray(right_vectors[singular_values <= _UNCOUPLED * singular_values[0]].conj().T)


def _sort_senses(
    factors: Complex,
    vectors: Complex,
    up: Complex,
    down: Complex,
    null_spaces: list[Complex],
    reach: int,
) -> tuple[BlochWaves, BlochWaves]:
    """Return the waves towards higher layers, and those towards lower ones, by the sense in which
    they run or decay.

    ``factors`` (b,) are lambda, and ``vectors`` (n, b) the motions of a block of ``reach`` layers;
    ``up`` and ``down`` (n, n) couple the block to the next and to the one before. ``null_spaces``
    are the motions, as columns, without coupling to lower and to higher layers.
    """
    runs = np.abs(np.abs(factors) - 1.0) < _ON_CIRCLE
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    flux = _part_running(factors, vectors, np.flatnonzero(runs), up, down, reach)
    senses = []
    for sign, still in zip((1.0, -1.0), null_spaces, strict=True):
        running = np.flatnonzero(runs & (sign * flux > 0.0))
        running = running[np.argsort(np.angle(factors[running]), kind="stable")]
        with np.errstate(divide="ignore"):  # a decay beyond floating point
            inwards = np.abs(factors) ** sign
        decaying = np.flatnonzero(~runs & (inwards < 1.0))
        decaying = decaying[np.argsort(-inwards[decaying], kind="stable")]
        chosen = np.concatenate([running, decaying])
        waves = BlochWaves(factors[chosen], vectors[:, chosen], running.size, still)
        _require_apart(waves, inwards[decaying] ** reach)
        senses.append(waves)
    return senses[0], senses[1]


def _part_running(
    factors: Complex, vectors: Complex, running: Index, up: Complex, down: Complex, reach: int
) -> Array:
    """Return the flux (b,) of each wave, dw/dk from block to block, zero of waves that decay; turn
    the ``vectors`` (n, b) of ``running`` waves, in place, into waves of a flux of one or minus one.

    The other arguments are those of :func:`_sort_senses`. Waves with one lambda are parted so that
    energy flows in each by itself. Raises :class:`~granphon.base.errors.PrecisionError` if more
    waves have one lambda than a block has motions.
    """
    flux = np.zeros(len(factors))
    ungrouped = running
    while ungrouped.size:
        is_alike = np.abs(factors[ungrouped] - factors[ungrouped[0]]) < _TOGETHER
        group = ungrouped[is_alike]
        ungrouped = np.setdiff1d(ungrouped, group)
        if group.size > len(vectors):
            raise PrecisionError(
                _ALIKE_WAVES, "Near zero waves of both senses are one", "Give a higher frequency"
            )
        basis = np.linalg.qr(vectors[:, group])[0]
        phase = factors[group[0]] ** reach
        flux_form = basis.conj().T @ (1j * (phase * up - down / phase)) @ basis
        flux[group], turn = np.linalg.eigh(0.5 * (flux_form + flux_form.conj().T))
        vectors[:, group] = basis @ turn / np.sqrt(np.abs(flux[group]))
    return flux


def _require_apart(waves: BlochWaves, decays: Array) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` unless the waves of one sense make a
    basis of the motions of a block; ``decays`` (m,) are |lambda| from block to block of those that
    decay.
    """
    scaled = waves.vectors / np.linalg.norm(waves.vectors, axis=0)
    basis = np.concatenate([scaled, waves.still], axis=1)
    is_square = basis.shape[0] == basis.shape[1]
    if is_square and not np.linalg.cond(basis) > _ALIKE:
        return
    if np.any(decays < LEAST_PART):
        raise PrecisionError(_ALIKE_WAVES, *_TOO_FAST)
    raise PrecisionError(
        _ALIKE_WAVES,
        "At the edge of a band waves of both senses are one, and at some frequencies motions of a"
        " layer stay in it",
        "Shift it by a millionth",
    )
