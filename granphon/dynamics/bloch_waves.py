"""All waves of a crystal at given frequencies: those that run across its layers, and those that
decay.

Layers of balls follow each other across an axis, at one wave vector along them
(:class:`granphon.dynamics.half_space.HalfSpace`). Layer n moves by u lambda^n, where u and lambda
solve (sum over s of D_s lambda^s) u = w u. Here w = omega^2, and D_s joins a layer to the s-th
layer after it. A block is as many layers as a contact reaches across, so that contacts join a block
to its two neighbours alone. The eigenproblem for lambda has twice as many unknowns as a block has
motions. A wave with |lambda| = 1 runs; any other decays, towards higher layers if |lambda| < 1.
Energy flows towards higher layers where dw/dk = -2 Im(u^H A u lambda) is above zero, A being the
coupling of a block to the next (T. Ando, Phys. Rev. B 44, 8017, 1991).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import PrecisionError
from granphon.base.memory import require_memory
from granphon.base.text import counted
from granphon.dynamics.linalg import NO_ENERGY

#: number of complex matrices, each with two blocks as rows and as columns, held for each frequency
_MATRICES = 7.0
#: number of complex rows of C, each of two blocks, held for each contact that loses energy
_ROWS = 6.0
#: shift of lambda for which the eigenproblem is inverted: a point without symmetry, well inside the
#: unit circle
_SHIFT = 0.31 + 0.17j
#: least |1/(lambda - _SHIFT)| of a wave; a lesser one is taken for the zero of a motion that decays
#: infinitely fast
_LEAST_INVERSE = float(np.finfo(float).eps) ** 2
#: distance of lambda from the unit circle up to which a wave runs
_CIRCLE_DISTANCE = 1e-7
#: difference of the lambda of two waves up to which the two have one lambda
_EQUAL_FACTORS = 1e-7
#: angle of lambda, rad, up to which a wave is long: the error of an eigenvalue is that of rounding
#: over this angle
_LARGEST_LONG_ANGLE = 0.1
#: part of the motion of a layer that is free, from which a long wave belongs to a branch that ends
#: at zero, whose motions are all free there
_LEAST_FREE_PART = 0.5
#: steps of Newton's method for long waves: each step doubles the digits, and the longest waves that
#: are told apart start with one digit
_NEWTON_STEPS = 5
#: singular value of a coupling, over the largest, up to which it counts as zero
_COUPLING_ROUNDING = 1e-12
#: condition number of the waves of one sense above which they cannot be told apart
_LARGEST_CONDITION = 1e11
#: least |lambda| of a wave that decays: its wavenumber then still has three digits
LEAST_FACTOR = 1e-12
#: difference of the lambda of two waves below which both may be at the edge of a band: several
#: times the root of the rounding of w
_EDGE_DISTANCE = 1e-6
#: least singular value of the motions of waves of one lambda, each of length one, from which these
#: motions are independent
_LEAST_INDEPENDENCE = 1e-5
#: w over the largest entry of D up to which two waves at an edge are long, and have all digits
_LARGEST_LONG_SQUARE = 1e-12
#: problem that an error tells if waves are not told apart
_PROBLEM = "the waves at a frequency cannot be told apart"
#: reason and remedy of this error, at the edge of a band, and where a wave decays too fast
_EDGE_REASON = (
    "At the very edge of a band waves of both senses are one",
    "Shift the frequency by a millionth",
)
_DECAY_REASON = "One decays too fast from layer to layer to have digits", "Take lower frequencies"


class Couplings(NamedTuple):
    """Matrices of D, each (n, n) or (n_f, n, n), of a block: as many layers as a contact reaches
    across, with n motions.

    Attributes
    ----------
    inner : the block with itself, with contacts to both of its neighbours.
    tail : the part of ``inner`` that contacts with the next block contribute.
    head : the part of ``inner`` that contacts with the block before contribute.
    up : the block with the next one.
    down : the block with the one before; the adjoint of ``up`` if no energy is lost.
    """

    inner: Complex
    tail: Complex
    head: Complex
    up: Complex
    down: Complex


class BlochWaves(NamedTuple):
    """Waves at one frequency whose energy flows, or which decay, in one sense: towards higher
    layers or towards lower ones. Waves that run come first.

    Attributes
    ----------
    factors : (m,) lambda of each wave, from layer to layer; waves that decay infinitely fast are
        left out.
    vectors : (n, m) motions of a block in each wave; a wave that runs is scaled such that its
        dw/dk, k being per block, is plus or minus one.
    n_running : number of waves that run.
    still_motions : (n, n - m) motions of a block that reach no other block in this sense.
    """

    factors: Complex
    vectors: Complex
    n_running: int
    still_motions: Complex

    def continue_by(self, steps: int) -> Complex:
        """Return the matrix (n, n) that turns a motion of a block into the motion, in the same
        waves, of the block ``steps`` layers higher, or lower if ``steps`` is below zero. The two
        blocks have no layer in common.
        """
        basis = np.concatenate([self.vectors, self.still_motions], axis=1)
        # motions that reach no other block leave the other block at rest
        n_still = self.still_motions.shape[1]
        image_of_basis = np.pad(self.vectors * self.factors**steps, ((0, 0), (0, n_still)))
        return np.asarray(np.linalg.solve(basis.T, image_of_basis.T).T)

    def find_parts(self, motion: Complex) -> Complex:
        """Return the amplitudes (n_running, ...) of the running waves in a ``motion`` (n, ...) of a
        block, which is a sum of running waves and of waves that decay.
        """
        basis = np.concatenate([self.vectors, self.still_motions], axis=1)
        return np.asarray(np.linalg.solve(basis, motion)[: self.n_running])


def require_bloch_memory(count: int, size: int, n_contacts: int = 0) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if waves at ``count`` frequencies do not fit
    into memory.

    A block has ``size`` motions. If energy is lost, the couplings are made anew at each frequency,
    from ``n_contacts`` contacts; otherwise ``n_contacts`` is zero.
    """
    mend = (
        "Take fewer frequencies" if count > 1 else "Take a narrower block: fewer balls in a layer"
    )
    require_memory(
        f"waves of {size:,} motions at {counted(count, 'frequency', 'frequencies')}",
        count_bloch_bytes(count, size, n_contacts),
        mend,
    )


def count_bloch_bytes(count: int, size: int, n_contacts: int = 0) -> float:
    """Return the bytes that waves at ``count`` frequencies take. ``size`` and ``n_contacts`` are as
    in :func:`require_bloch_memory`.
    """
    # complex numbers have 16 bytes; matrices and rows are those of two blocks
    bytes_of_matrices = 16.0 * _MATRICES * (2 * size) ** 2
    bytes_of_rows = 16.0 * _ROWS * (2 * size) * n_contacts
    return count * (bytes_of_matrices + bytes_of_rows)


def find_bloch_waves(
    blocks: Couplings, w: Array, layer_size: int
) -> list[tuple[BlochWaves, BlochWaves]]:
    """Return a pair for each w (n_f,): the waves towards higher layers, and those towards lower
    ones. The list is empty if there is no w.

    ``w`` is in the unit of the ``blocks``, and a layer has ``layer_size`` motions. Raises
    :class:`~granphon.base.errors.PrecisionError` where waves cannot be told apart: at an edge of a
    band, where motions that reach no other layer resonate, where a wave decays so fast that it has
    no digits, and at any frequency if some motions reach the next layers alone.
    """
    size = blocks.inner.shape[-1]
    n_f = len(w)
    reach = size // layer_size
    inner = np.broadcast_to(blocks.inner, (n_f, size, size))
    up = np.broadcast_to(blocks.up, (n_f, size, size))
    down = np.broadcast_to(blocks.down, (n_f, size, size))
    steps = _list_steps(inner, up, down, w, layer_size)
    scale = float(np.max(np.abs(inner), initial=0.0))
    inverse, vectors = _solve_pencil(steps, size, scale)
    waves = []
    for n in range(n_f):
        null_spaces = [_null_space(coupling[n]) for coupling in (down, up)]
        _require_passing_on(null_spaces, inner[n], scale)
        # a motion that decays infinitely fast is no wave, and one nearly so fast has no digits
        finite_waves = _choose_finite(inverse[n], null_spaces)
        smallest_inverse = np.min(np.abs(inverse[n, finite_waves]), initial=1.0)
        if smallest_inverse < _LEAST_INVERSE:
            raise PrecisionError(_PROBLEM, *_DECAY_REASON)
        factors = _SHIFT + 1.0 / inverse[n, finite_waves]
        motions = vectors[n][:size, finite_waves]
        couplings = [step[n] for step in steps]
        couplings[reach] = couplings[reach] + w[n] * np.eye(layer_size)  # D_0 instead of D_0 - w
        factors, motions = _sharpen_long_waves(factors, motions, couplings, w[n])
        if w[n] > _LARGEST_LONG_SQUARE * scale:
            _require_senses(factors, motions)
        waves.append(_sort_senses(factors, motions, up[n], down[n], null_spaces, reach))
    return waves


def _list_steps(
    inner: Complex, up: Complex, down: Complex, w: Array, layer_size: int
) -> list[Complex]:
    """Return the 2 reach + 1 matrices D_s (n_f, layer_size, layer_size) of s = -reach ... reach,
    with D_0 replaced by D_0 - w.

    ``inner``, ``up`` and ``down`` (n_f, size, size) are those of :class:`Couplings`. A block has
    ``reach`` layers with ``layer_size`` motions each, so that size = reach * layer_size. ``w`` is
    (n_f,).
    """
    reach = inner.shape[-1] // layer_size
    # all layers are equal, so D_s is read from the rows or columns of the first layer of a block
    first_layer = slice(0, layer_size)
    other_layers = [slice(s * layer_size, (s + 1) * layer_size) for s in range(1, reach)]
    steps = [down[:, first_layer, first_layer]]
    steps += [inner[:, other_layer, first_layer] for other_layer in reversed(other_layers)]
    steps += [inner[:, first_layer, first_layer] - w[:, None, None] * np.eye(layer_size)]
    steps += [inner[:, first_layer, other_layer] for other_layer in other_layers]
    steps += [up[:, first_layer, first_layer]]
    return steps


def _choose_finite(inverse: Complex, null_spaces: list[Complex]) -> Index:
    """Return the indices (m,) of the waves that do not decay infinitely fast.

    ``inverse`` (2 size,) is 1/(lambda - :data:`_SHIFT`) of all waves. The two ``null_spaces`` are
    the motions of a block, as columns, without coupling to lower and to higher layers.

    A wave that decays infinitely fast towards lower layers has an infinite lambda, and thus an
    inverse of zero; one that does so towards higher layers has lambda = 0, and the inverse
    -1/:data:`_SHIFT`. There are as many such waves as motions without coupling to the layers on the
    other side.
    """
    to_lower, to_higher = null_spaces
    fast_upwards = np.argsort(np.abs(inverse + 1.0 / _SHIFT))[: to_lower.shape[1]]
    fast_downwards = np.argsort(np.abs(inverse))[: to_higher.shape[1]]
    fast_waves = np.concatenate([fast_upwards, fast_downwards])
    return np.setdiff1d(np.arange(len(inverse)), fast_waves)


def _solve_pencil(steps: list[Complex], size: int, scale: float) -> tuple[Complex, Complex]:
    """Return all solutions of (sum over s of D_s lambda^s) u = w u: 1/(lambda - :data:`_SHIFT`)
    (n_f, 2 size), and the motions (n_f, 2 size, 2 size) of two blocks, as columns.

    ``steps`` are D_s (n_f, layer_size, layer_size), the middle one less w, and ``scale`` is the
    largest entry of D within a block. A block has ``size`` motions.
    """
    count, layer_size, _ = steps[0].shape
    # companion form A v = lambda B v, where v (2 size,) holds the motions of all layers of two
    # blocks. The upper rows say that each layer moves by lambda times the layer before. The last
    # `layer_size` rows are the sum over s, divided by the scale: so they have no unit, and at w
    # within the bands they are of the size of the upper rows
    a = np.zeros((count, 2 * size, 2 * size), complex)
    b = np.zeros((count, 2 * size, 2 * size), complex)
    a[:, :-layer_size, layer_size:] = np.eye(2 * size - layer_size)
    b[:, :-layer_size, :-layer_size] = np.eye(2 * size - layer_size)
    a[:, -layer_size:] = -np.concatenate(steps[:-1], axis=2) / scale
    b[:, -layer_size:, -layer_size:] = steps[-1] / scale
    # (A - shift B)^-1 B has the eigenvalues 1/(lambda - shift), also finite if lambda is infinite
    inverse, vectors = np.linalg.eig(np.linalg.solve(a - _SHIFT * b, b))
    return inverse, vectors


def _require_passing_on(null_spaces: list[Complex], inner: Complex, scale: float) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if some motions are passed on to the next
    layers and no further.

    ``null_spaces`` are the motions of a block, as columns, without coupling to lower and to higher
    layers; ``inner`` (size, size) is D within the block, with entries up to ``scale``. A wave is
    passed on if inner - w couples both null spaces at full rank. Where the rank is lower at all w,
    it is lower at w = -scale too, where nothing resonates; so it is tested there.
    """
    to_lower, to_higher = null_spaces
    coupling = to_higher.conj().T @ (inner + scale * np.eye(len(inner))) @ to_lower
    if not coupling.size:
        return
    if np.linalg.matrix_rank(coupling, tol=_COUPLING_ROUNDING * scale) < min(coupling.shape):
        raise PrecisionError(
            "some motions of a layer are passed on to the next ones and no further",
            "They decay infinitely fast, at any frequency",
            "Choose another axis",
        )


def _sharpen_long_waves(
    factors: Complex, vectors: Complex, couplings: list[Complex], w: float
) -> tuple[Complex, Complex]:
    """Return the ``factors`` lambda (b,) and the ``vectors`` (n, b), motions of a block, of all
    waves; those of long running waves are computed again, with all digits. If energy is lost,
    ``factors`` and ``vectors`` are returned as they are. A long wave whose motion is mostly stiff
    keeps its factor and vector too: the edge of another band is near.

    ``couplings`` are the matrices D_s (layer_size, layer_size) of s = -reach ... reach, with D_0
    itself in the middle, and not D_0 - w; ``w`` is the eigenvalue.

    A long wave that runs has lambda = exp(i theta) with a small theta, so that the sum of D_s
    lambda^s, less w, is a difference of near-equal numbers. Free motions cost nothing if all layers
    move by the same amount: the sum of all D_s takes them to zero. This sum is left out for free
    motions. What is left is the sum of D_s (exp(i s theta) - 1), which keeps all digits. All other
    motions are stiff, and follow from the free ones at each theta. Newton's method finds theta. The
    amplitudes of the free motions stay as they are, as theta depends on the square of their error.
    """
    layer_size = len(couplings[0])
    is_running = np.abs(np.abs(factors) - 1.0) < _CIRCLE_DISTANCE
    is_long = np.abs(np.angle(factors)) < _LARGEST_LONG_ANGLE
    long_waves = np.flatnonzero(is_running & is_long)
    if not long_waves.size or _loses_energy(couplings):
        return factors, vectors
    stiffness, modes = np.linalg.eigh(np.sum(couplings, axis=0))
    is_stiff = np.abs(stiffness) > NO_ENERGY * np.max(np.abs(stiffness))
    free_motions = modes[:, ~is_stiff]
    stiff_motions = modes[:, is_stiff]
    stiffness_of_stiff = stiffness[is_stiff]
    factors = factors.copy()
    vectors = vectors.copy()
    layer_numbers = range(len(vectors) // layer_size)
    for wave in long_waves:
        layer_motion = vectors[:layer_size, wave]
        free_part = free_motions @ (free_motions.conj().T @ layer_motion)
        if np.linalg.norm(free_part) < _LEAST_FREE_PART * np.linalg.norm(layer_motion):
            continue
        start = float(np.angle(factors[wave]))
        theta, motion = _solve_theta(
            start, free_part, couplings, stiff_motions, stiffness_of_stiff, w
        )
        factors[wave] = np.exp(1j * theta)
        vectors[:, wave] = np.concatenate(
            [motion * factors[wave] ** number for number in layer_numbers]
        )
    return factors, vectors


def _loses_energy(couplings: list[Complex]) -> bool:
    """Return whether the matrices D_s, ``couplings`` of s = -reach ... reach, lose energy: without
    loss D_-s is the adjoint of D_s.
    """
    loss = max(
        np.max(np.abs(coupling - opposite_coupling.conj().T))
        for coupling, opposite_coupling in zip(couplings, couplings[::-1], strict=True)
    )
    largest_entry = np.max(np.abs(couplings[len(couplings) // 2]))  # entry of D_0
    return bool(loss > NO_ENERGY * largest_entry)


def _solve_theta(
    theta: float,
    free_part: Complex,
    couplings: list[Complex],
    stiff_motions: Complex,
    stiffness: Array,
    w: float,
) -> tuple[float, Complex]:
    """Return theta, rad, of a long wave lambda = exp(i theta), and the motion (layer_size,) of a
    layer in the wave, by Newton's method from a first ``theta``.

    ``free_part`` (layer_size,) is the part of the motion that costs nothing if all layers move by
    the same amount. ``stiff_motions`` (layer_size, m) are the other motions, as columns, and
    ``stiffness`` (m,) are their eigenvalues of the sum of all D_s. ``couplings`` are D_s
    (layer_size, layer_size), and ``w`` is the eigenvalue to be reached.
    """
    reach = len(couplings) // 2
    steps = list(zip(range(-reach, reach + 1), couplings, strict=True))
    for _ in range(_NEWTON_STEPS):
        # D(theta) - D(0), and dD/dtheta
        change = sum(coupling * np.expm1(1j * s * theta) for s, coupling in steps)
        slope = sum(coupling * 1j * s * np.exp(1j * s * theta) for s, coupling in steps)
        # the stiff rows of (D(theta) - w) motion = 0 give the amplitudes of the stiff motions
        pull = stiff_motions.conj().T @ change
        stiff_matrix = np.diag(stiffness - w) + pull @ stiff_motions
        stiff_amplitudes = np.linalg.solve(stiff_matrix, -pull @ free_part)
        motion = free_part + stiff_motions @ stiff_amplitudes
        # motion^H (D(theta) - w) motion, which vanishes at the theta of the wave
        residual = (
            (motion.conj() @ change @ motion).real
            + stiffness @ np.abs(stiff_amplitudes) ** 2
            - w * np.linalg.norm(motion) ** 2
        )
        theta -= float(residual / (motion.conj() @ slope @ motion).real)
    return theta, motion


def _require_senses(factors: Complex, vectors: Complex) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if the motions of running waves of one
    lambda are linearly dependent. A wave counts as running if |lambda| is 1 within
    :data:`_EDGE_DISTANCE`, and two lambda as one if they differ by less than this.

    The motions become dependent at the edge of a band, where the waves of both senses become one.
    At a distance Delta w from the edge, the lambda of both senses differ by the root of Delta w.
    Therefore the rounding of w would decide, near the edge, whether the waves run, and how fast.

    ``factors`` (b,) are the lambda of the waves, and ``vectors`` (n, b) their motions.
    """
    running_waves = np.flatnonzero(np.abs(np.abs(factors) - 1.0) < _EDGE_DISTANCE)
    for number, wave in enumerate(running_waves):
        wave_and_next = running_waves[number:]
        neighbours = wave_and_next[np.abs(factors[wave_and_next] - factors[wave]) < _EDGE_DISTANCE]
        motions = vectors[:, neighbours] / np.linalg.norm(vectors[:, neighbours], axis=0)
        # more vectors than components are always dependent
        if neighbours.size > len(motions):
            raise PrecisionError(_PROBLEM, *_EDGE_REASON)
        least_singular_value = np.linalg.svd(motions, compute_uv=False)[-1]
        if least_singular_value < _LEAST_INDEPENDENCE:
            raise PrecisionError(_PROBLEM, *_EDGE_REASON)


def _null_space(coupling: Complex) -> Complex:
    """Return an orthonormal basis (n, m) of the motions that a ``coupling`` (n, n) takes to
    zero.
    """
    _, singular_values, right_vectors = np.linalg.svd(coupling)
    return np.asarray(
        right_vectors[singular_values <= _COUPLING_ROUNDING * singular_values[0]].conj().T
    )


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
    are the motions, as columns, without coupling to lower and to higher layers. Raises what
    :func:`_normalise_running` and :func:`_require_basis` raise.
    """
    is_running = np.abs(np.abs(factors) - 1.0) < _CIRCLE_DISTANCE
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    flux = _normalise_running(factors, vectors, np.flatnonzero(is_running), up, down, reach)
    senses = []
    for sign, still_motions in zip((1.0, -1.0), null_spaces, strict=True):
        running_waves = np.flatnonzero(is_running & (sign * flux > 0.0))
        running_waves = running_waves[np.argsort(np.angle(factors[running_waves]), kind="stable")]
        # |lambda| in the sense of the waves; a lambda of zero has no finite inverse
        with np.errstate(divide="ignore"):
            decay = np.abs(factors) ** sign
        decaying_waves = np.flatnonzero(~is_running & (decay < 1.0))
        decaying_waves = decaying_waves[np.argsort(-decay[decaying_waves], kind="stable")]
        numbers = np.concatenate([running_waves, decaying_waves])
        waves = BlochWaves(factors[numbers], vectors[:, numbers], running_waves.size, still_motions)
        _require_basis(waves, decay[decaying_waves] ** reach)
        senses.append(waves)
    upward, downward = senses
    return upward, downward


def _normalise_running(
    factors: Complex, vectors: Complex, running_waves: Index, up: Complex, down: Complex, reach: int
) -> Array:
    """Return the flux (b,) of each wave of norm one, dw/dk with k per block; zero for waves that
    decay. Change the ``vectors`` (n, b) of the ``running_waves``, in place: each is scaled such
    that its flux is one or minus one, and waves with one lambda become combinations of these waves
    without mutual flux.

    ``running_waves`` are the indices of the waves that run; the other arguments are those of
    :func:`_sort_senses`. Raises :class:`~granphon.base.errors.PrecisionError` if more waves have
    one lambda than a block has motions.
    """
    flux = np.zeros(len(factors))
    ungrouped_waves = running_waves  # waves that belong to no group of one lambda yet
    while ungrouped_waves.size:
        is_equal = np.abs(factors[ungrouped_waves] - factors[ungrouped_waves[0]]) < _EQUAL_FACTORS
        group = ungrouped_waves[is_equal]
        ungrouped_waves = np.setdiff1d(ungrouped_waves, group)
        if group.size > len(vectors):
            raise PrecisionError(
                _PROBLEM, "Near zero waves of both senses are one", "Give a higher frequency"
            )
        basis = np.linalg.qr(vectors[:, group])[0]
        phase = factors[group[0]] ** reach
        flux_form = basis.conj().T @ (1j * (phase * up - down / phase)) @ basis
        flux[group], turn = np.linalg.eigh(0.5 * (flux_form + flux_form.conj().T))
        vectors[:, group] = basis @ turn / np.sqrt(np.abs(flux[group]))
    return flux


def _require_basis(waves: BlochWaves, decays: Array) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` unless the waves of one sense, with the
    motions that reach no other block, are a basis of the motions of a block.

    ``decays`` (m,) are the factors by which the m waves that decay change from block to block.
    """
    unit_vectors = waves.vectors / np.linalg.norm(waves.vectors, axis=0)
    basis = np.concatenate([unit_vectors, waves.still_motions], axis=1)
    is_square = basis.shape[0] == basis.shape[1]
    if is_square and not np.linalg.cond(basis) > _LARGEST_CONDITION:
        return
    if np.any(decays < LEAST_FACTOR):
        raise PrecisionError(_PROBLEM, *_DECAY_REASON)
    raise PrecisionError(
        _PROBLEM,
        "At the edge of a band waves of both senses are one, and at some frequencies motions of a"
        " layer stay in it",
        "Shift the frequency by a millionth",
    )
