"""Dumps of LIGGGHTS: one of atoms, one of ``compute pair/gran/local``, and one of
``compute wall/gran/local`` where balls touch walls of meshes, at the same time step.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.base.arrays import Index
from granphon.base.errors import InputError, brief
from granphon.base.scales import Units
from granphon.base.validation import texts
from granphon.networks.building import Source
from granphon.networks.dumps import Dump, Frame
from granphon.networks.lammps import (
    Scales,
    Springs,
    add_wall,
    find_frames,
    join_vectors,
    make_source,
    note_atoms,
    note_columns,
    note_pairs,
    read_balls,
    read_contacts,
    read_ids,
    read_names,
    require_columns,
)
from granphon.networks.sources import Balls, Contacts

#: the columns that each keyword of the two computes gives, in the order in which LIGGGHTS writes
#: them, whatever the order of the keywords; those of "history" depend on the contact law
_KEYWORDS = {
    "pos": ("x1", "y1", "z1", "x2", "y2", "z2"),
    "vel": ("vx1", "vy1", "vz1", "vx2", "vy2", "vz2"),
    "id": ("i", "j", "periodic"),
    "force": ("fx", "fy", "fz"),
    "force_normal": ("fnx", "fny", "fnz"),
    "force_tangential": ("ftx", "fty", "ftz"),
    "torque": ("tqx", "tqy", "tqz"),
    "torque_normal": ("tnx", "tny", "tnz"),
    "torque_tangential": ("ttx", "tty", "ttz"),
    "history": (),
    "contactArea": ("area",),
    "delta": ("delta",),
    "contactPoint": ("cx", "cy", "cz"),
    "ms_id": ("clump1", "clump2"),
    "heatFlux": ("heat",),
}  # fmt: skip
#: what the computes give without keywords
_DEFAULT_KEYWORDS = ("pos", "vel", "id", "force", "torque", "history", "contactArea")
#: columns of contacts with walls that are read
_COLUMNS_OF_WALLS = ("mesh", "ball", *_KEYWORDS["pos"], "fx", "fy", "fz")


def read_liggghts(
    dump: Any,
    pairs: Any,
    walls: Any,
    *,
    keywords: str | Sequence[str] | None,
    units: str | Units | None,
    columns: Sequence[str] | None,
    step: int | None,
    springs: Springs,
    frozen: Mapping[str, Any] | None,
) -> Source:
    """Return the balls and contacts of dumps of one time step and one box, in SI units; see
    ``ContactNetwork.from_liggghts`` for the arguments and errors.

    Contacts with walls, if their dump is given, are the second list of contacts, and each mesh that
    a ball touches is one more body.
    """
    atoms, contact_frame = find_frames(dump, pairs, step)
    scales = Scales.find(units, [atoms, contact_frame])
    if columns is not None:
        contact_frame = replace(contact_frame, names=read_names(columns, contact_frame))
    else:
        contact_frame = _name_columns(contact_frame, keywords)
    balls = read_balls(atoms, scales, frozen)
    lists = [read_contacts(contact_frame, scales, springs)]
    notes = [*note_pairs(contact_frame, springs), *note_atoms(atoms, (), frozen)]
    if walls is not None:
        wall_frame = _name_columns(Dump.open(walls, "entries").find(atoms.step), keywords)
        wall_frame = replace(wall_frame, names=_rename_wall(wall_frame.names))
        wall_contacts = _read_walls(wall_frame, balls, scales, springs)
        for label in np.unique(wall_contacts.j).tolist():
            balls = add_wall(balls, label, f"mesh {-label - 1}")
        lists.append(wall_contacts)
        notes.append(note_columns(wall_frame, (*_COLUMNS_OF_WALLS, "delta")))
    else:
        notes.append("Contacts with walls are not in a dump of pairs: walls=FILE reads them.")
    source = make_source(atoms, scales, balls, lists, notes)
    # By the law "liggghts" the slip of the past is kept, and tangential forces grow as the shear
    # stiffness that the program computes from the material. A stiffness that the user gives is that
    # of Hooke's law, and does not grow.
    return source if springs.shear is not None else replace(source, tangential_law="liggghts")


def _name_columns(frame: Frame, keywords: str | Sequence[str] | None) -> Frame:
    """Return the ``frame`` with the names of columns that follow from the ``keywords`` of the
    compute; None is for a compute without keywords, whose default ones hold.

    Without keywords, a frame whose columns have names of their own, not "c_ID[1]" and so on, is
    returned as it is. InputError for what are no words, for an unknown keyword, for one that is
    given twice, for none, and for a frame with another number of columns than the keywords give.
    """
    are_numbered = all(re.fullmatch(r"c_.+\[\d+\]", name) for name in frame.names)
    if keywords is None and not are_numbered:
        return frame
    words = keywords.split() if isinstance(keywords, str) else keywords
    keywords_of_dump = _DEFAULT_KEYWORDS if words is None else texts("keywords", words)
    are_known = set(keywords_of_dump) <= set(_KEYWORDS)
    are_distinct = len(set(keywords_of_dump)) == len(keywords_of_dump)
    if not are_known or not are_distinct or not keywords_of_dump:
        mend = f"Give those of the compute, each once: {', '.join(_KEYWORDS)}"
        raise InputError(f"keywords are {brief(keywords)}", mend=mend)
    n_known = sum(len(_KEYWORDS[word]) for word in keywords_of_dump)
    has_history = "history" in keywords_of_dump
    # the history of a contact has as many columns as the contact model of the program needs
    n_history = len(frame.names) - n_known if has_history else 0
    if n_history < 0 or n_known + n_history != len(frame.names):
        fault = (
            f"{frame.name} has {len(frame.names)} columns, and {' '.join(keywords_of_dump)} of"
            f" compute pair/gran/local gives {n_known}{' or more' if has_history else ''}"
        )
        raise InputError(fault, mend="Give the keywords of the compute: keywords='pos id force'")
    names = list[str]()
    # the program writes columns in its own order, whatever that of the keywords
    for keyword, columns in _KEYWORDS.items():
        if keyword == "history" and has_history:
            names += [f"history{number}" for number in range(1, n_history + 1)]
        elif keyword in keywords_of_dump:
            names += columns
    return replace(frame, names=tuple(names))


def _rename_wall(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns of contacts with walls, from the ``names`` that the same
    keywords give to pairs: the three columns of "id" are there the mesh, its triangle and the ball,
    in place of two balls and a flag.
    """
    wall_names = dict(zip(_KEYWORDS["id"], ("mesh", "triangle", "ball"), strict=True))
    return tuple(wall_names.get(name, name) for name in names)


def _read_walls(frame: Frame, balls: Balls, scales: Scales, springs: Springs) -> Contacts:
    """Return the contacts of ``balls`` with the walls of meshes, in SI units, from a frame of
    ``compute wall/gran/local``: mesh m has the label -1 - m. InputError for a frame without the
    columns that are needed, for ids that are no whole numbers, and without a ball.
    """
    mend = "Write pos, id and force in compute wall/gran/local"
    require_columns(frame, _COLUMNS_OF_WALLS, mend)
    columns = frame.read([name for name in (*_COLUMNS_OF_WALLS, "delta") if name in frame.names])
    labels = read_ids(frame, "ball", columns)
    indices = _find_indices(balls, labels)
    # from the centre of the ball to the place of the contact on the wall
    places_on_wall = join_vectors(columns, ("x1", "y1", "z1"))
    centres = join_vectors(columns, ("x2", "y2", "z2"))
    with np.errstate(all="ignore"):  # a place out of range makes a normal of nan, told as a fault
        between = scales.length * (places_on_wall - centres)
        distance = np.linalg.norm(between, axis=1)
        normal = between / distance[:, None]
    # the column has more digits of an overlap than places with few digits leave
    has_overlap = "delta" in frame.names
    overlap = scales.length * columns["delta"] if has_overlap else balls.radii[indices] - distance
    return Contacts(
        frame.name,
        labels,
        -1 - read_ids(frame, "mesh", columns),
        normal=normal,
        force=-scales.force * join_vectors(columns, ("fx", "fy", "fz")),
        overlap=overlap,
        # LIGGGHTS lets forces of walls act at half of the overlap, and LAMMPS at the radius
        arm_i=balls.radii[indices] - 0.5 * overlap,
        arm_j=-0.5 * overlap,
        lines=frame.first + 1 + np.arange(frame.count),
        **springs.of(frame.count),
    )


def _find_indices(balls: Balls, labels: Index) -> Index:
    """Return the index (m,) of the ball with each of the ``labels`` (m,). For a label that no ball
    has, the index of any ball is returned, as the contact is refused later. InputError without a
    ball.
    """
    assert balls.labels is not None
    if not balls.labels.size:
        raise InputError(f"{balls.name} has no balls", "Contacts with walls need them")
    order = np.argsort(balls.labels, kind="stable")
    ranks = np.searchsorted(balls.labels[order], labels)
    is_inside = ranks < len(order)
    return np.where(is_inside, order[np.where(is_inside, ranks, 0)], 0)
