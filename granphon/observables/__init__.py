"""What is found of a state: velocities, moduli, pulses, validity."""

from typing import Any


def __getattr__(name: str) -> Any:
    """Return ``register``, :func:`~granphon.observables.catalogue.register_observable`, which is
    imported when used.
    """
    if name != "register":
        raise AttributeError(f"module 'granphon.observables' has no attribute {name!r}")
    from granphon.observables.catalogue import register_observable

    return register_observable
