"""What a run keeps of the network of a state, or of each sample of a simulation, and its means over samples.

A block of a scene that asks for it, such as ``response``, has settings, and a row of :data:`RECORDS` with two functions. The
first takes a state, sample or network and the settings, and returns arrays by name, and for each result that a single state
has in a file of its own, a function that makes its bytes. The second takes these of all samples at one load, one of
a state without samples, and the settings, and returns observables of the catalogue by name, and notes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.sample import standard_error
from granphon.balls.loads import Load
from granphon.media.choice import ServingMedium
from granphon.media.cost import find_typical_force
from granphon.media.mean_field import AveragedLattice
from granphon.networks.network import given_network
from granphon.runs.motion_records import PreparedMotion, average_motions, record_motion
from granphon.waves.response import Response, find_peaks, require_places
from granphon.waves.settings import RESPONSES, MotionSettings, NetworkSettings, ResponseSettings, find_place
from granphon.waves.waves import Waves

Array = NDArray[Any]
Record = Mapping[str, Array]


def require_network(serving_media: Sequence[ServingMedium], wanted: NetworkSettings, key: str, most: float = np.inf) -> None:
    """Raise unless the networks of a case, repeated and cut, have what the ``key`` of the settings says of them.

    Those of packings are of equal balls at a typical force, and of arrays up to ``most`` balls; crystals that are not
    quickly loaded are left out.
    """
    wanted = replace(wanted, cut=()) if key == "repeat" else wanted
    for serving in serving_media:
        arrays = serving.arrays
        if (arrays and arrays[0].balls > most) or (state := find_typical_state(serving)) is None:
            continue
        network = state.network.repeat(arrays[0].cells) if arrays else state.network
        if isinstance(wanted, MotionSettings) and key == "drive":
            PreparedMotion(network if arrays else state, wanted)
            continue
        shaped = wanted.shape(network)
        if isinstance(wanted, ResponseSettings) and key in ("source", "receiver"):
            moved = wanted.quantity == "transmissibility" and key == "source"
            require_places(shaped, key, [find_place(one) for one in getattr(wanted, key)], moved, **_choose_plane(wanted))


def find_typical_state(serving: ServingMedium) -> Any:
    """Return a state like the first of a case: of equal balls at a typical force, or a crystal's; None if it takes long."""
    if serving.packing.kind_names:
        return serving.at(serving.load[0]) if serving.is_quick else None
    force = float(np.ravel(find_typical_force(serving.packing, serving.load))[0])
    return AveragedLattice(serving.packing).at(Load.only(force=force))[0]


def _choose_plane(wanted: ResponseSettings) -> dict[str, Any]:
    return {name: getattr(wanted, name) for name in ("direction", "polarisation", "distance")}


def _record_response(x: Any, wanted: ResponseSettings) -> tuple[dict[str, Array], dict[str, Any]]:
    """Find the response, (n_f, places of the receiver); that of a plane is the mean over its balls."""
    places = [find_place(one) for one in wanted.receiver]
    found: Response = Waves(wanted.shape(given_network(x))).response(
        wanted.frequencies, [find_place(one) for one in wanted.source], places, wanted.damping, wanted.loss_factor,
        quantity=wanted.quantity, **_choose_plane(wanted),
    )  # fmt: skip
    balls = len(found.receivers) - len(places) + 1
    starts = np.cumsum([0, *(balls if one == "plane" else 1 for one in places)])
    means = [np.mean(found.values[:, first:end], axis=1) for first, end in pairwise(starts)]
    return {"response": np.transpose(means), "response_note": np.array(" ".join(found.warnings))}, {}


def _average_responses(records: Sequence[Record], wanted: ResponseSettings) -> tuple[dict[str, Array], list[str]]:
    """Return the coherent response, the mean of complex amplitudes, and its highest peak at the first place."""
    every, name = np.array([one["response"] for one in records]), RESPONSES[wanted.quantity]
    mean = np.mean(every, axis=0)
    out = {name: np.abs(mean), "response_phase": np.unwrap(np.angle(mean), axis=0)}
    peaks = find_peaks(np.array(wanted.frequencies), mean[:, 0])
    if len(peaks.frequencies):
        highest = np.argmax(peaks.heights)
        out |= {f"peak_{one}": np.array(peaks[at][highest]) for at, one in enumerate(("frequency", name, "quality"))}
    if len(records) > 1:
        out[f"{name}_error"] = np.asarray(standard_error(every, axis=0))
    return out, list(dict.fromkeys(str(one["response_note"]) for one in records if str(one["response_note"])))


#: for each block about networks, what is kept of a network, and how that of samples is averaged
RECORDS: dict[str, tuple[Callable[..., tuple[dict[str, Array], dict[str, Any]]], Callable[..., Any]]] = {
    "response": (_record_response, _average_responses),
    "motion": (record_motion, average_motions),
}
