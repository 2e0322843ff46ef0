"""Cuts of a network: a number of its layers, one above the other, and the floors on which the lower
and the upper face stand.

A ``network`` is a :class:`~granphon.networks.network.ContactNetwork`, which stands above this
module.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from granphon.balls.ball import Body, Wall, find_wall, name_walls
from granphon.balls.contact_model import STIFFNESSES, ContactModel
from granphon.balls.layers import Layers, find_faces
from granphon.balls.neighbours import TOUCH, require_joined
from granphon.balls.on_site import turn_on_site
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError
from granphon.base.results import read_only
from granphon.base.text import counted
from granphon.networks.demands import NUMBERS_OF_BALLS

#: difference of the radii of balls that name no kind, over their mean, below which the balls are of
#: one kind
_MOST_SPREAD = 0.25
#: greatest difference of the heights of outermost points in one face, over the spread of radii: up
#: to 5 are there in samples of 48 x 48 balls at low load, and at a spread of 5 % of the radius the
#: next row is 34 away. Balls of a deeper row that have lost no contact stand on no floor anyway.
_MOST_SPREADS_OF_FACE = 8.0
#: greatest relative difference of two stiffnesses that count as the same: a file may round numbers
_STIFFNESS_TOLERANCE = 1e-6


def cut_network(
    network: Any, layers: Layers, count: int, edges: Sequence[str | Wall]
) -> dict[str, Any]:
    """Return the fields of a cut of a network that may differ from those of the network, by name.

    The cut has ``count`` layers, whose vectors are ``layers``; ``edges`` say how the lower and the
    upper face are held. Errors are those of
    :meth:`granphon.networks.network.ContactNetwork.cut`.
    """
    model: ContactModel | None = network.contact_model
    if model is not None:
        edges = name_walls(edges, model.named_kinds, model.walls)
    stack = _LayerStack.of(network, layers, count)
    n_periods = len(layers.cell)
    balls = stack.make_balls()
    contacts = stack.make_contacts()
    walls, clamped_faces = _hold_faces(stack, balls, contacts, edges)
    is_still = np.isinf(balls["masses"])
    contacts = _leave_out_still(contacts, is_still)
    _require_motion(contacts, is_still, clamped_faces, count)
    _require_joined_cut(network, contacts, is_still, n_periods)
    cell = np.zeros((3, 3))
    cell[:n_periods, : network.dimension] = layers.cell
    kinds = network.kinds
    if kinds:
        kinds = kinds * count + tuple(wall.name for wall in walls)
    if model is not None:
        elastic_walls = [wall for wall in walls if isinstance(wall, Wall)]
        model = replace(model, walls=tuple(dict.fromkeys([*model.walls, *elastic_walls])))
    on_site = turn_on_site(network.on_site, stack.turn, network.named_motions)
    if on_site is not None:  # walls have no springs
        on_site = np.pad(np.tile(on_site, (count, 1)), ((0, len(walls)), (0, 0)))
    return {
        **balls,
        **contacts,
        "cell": cell,
        "pbc": (n_periods > 0, n_periods > 1, False),
        "left_out": network.left_out * count,
        "labels": None,
        "lattice": None,
        "shape": None,
        "kinds": kinds,
        "contact_model": model,
        "on_site": on_site,
    }


def find_sources(network: Any, layers: Layers, count: int, cut: Any) -> Index:
    """Return, for each contact (m,) of a ``cut`` of a ``network``, the index of the contact of the
    network of which it is a copy; -1 for contacts with the walls of the cut, which come last.

    The cut has ``count`` layers, whose vectors are ``layers``.
    """
    # the same steps as in cut_network keep the same contacts in the same order
    stack = _LayerStack.of(network, layers, count)
    is_between = stack.has_i & stack.has_j
    contacts = {name: getattr(stack, name)[is_between] for name in ("i", "j", "row")}
    rows: Index = _leave_out_still(contacts, ~cut.moving)["row"]
    return np.pad(rows, (0, cut.n_contacts - len(rows)), constant_values=-1)


def change_wall(network: Any, wall: Wall) -> dict[str, Any]:
    """Return the fields of a network that change, by name, if ``wall`` takes the place of its only
    wall of a known material. Both walls have one name. Contacts keep their forces, and get the
    stiffnesses of balls on the new wall.

    InputError if the network names no kinds, and also has contacts with other flat walls, and as
    :func:`name_kinds`.
    """
    model = network.contact_model
    is_wall = np.isinf(network.radii)
    if network.kinds:
        is_wall &= np.array(network.kinds) == wall.name
    contacts = np.flatnonzero(is_wall[network.j])
    balls = network.i[contacts]
    kinds = name_kinds(network, balls, model, f"face at {wall.name}")
    press = partial(
        model.press_on_wall, kinds, network.radii[balls], network.normal_force[contacts]
    )
    if not network.kinds:
        # without names only the stiffness tells a contact with this wall from other contacts
        stiffness = press(network.wall)["normal_stiffness"]
        if not np.allclose(
            network.normal_stiffness[contacts], stiffness, rtol=_STIFFNESS_TOLERANCE, atol=0.0
        ):
            fault = f"not all flat walls of the network are the wall {wall.name!r}"
            why = "Which of them are is not known, as the network names no kinds"
            raise InputError(fault, why, "Give the kinds of the balls before the network is cut")
    pressed = press(wall)
    stiffnesses = {name: getattr(network, name).copy() for name in STIFFNESSES}
    for name, values in stiffnesses.items():
        values[contacts] = pressed[name]
    return {"contact_model": replace(model, walls=(wall,)), **stiffnesses}


def _hold_faces(
    stack: _LayerStack, balls: dict[str, Any], contacts: dict[str, Any], edges: Sequence[str | Wall]
) -> tuple[list[Body], list[Index]]:
    """Hold the two faces of a stack as ``edges`` say, by changing the fields of ``balls`` and
    ``contacts`` in place: clamped balls get an infinite mass, and walls and their contacts are
    added.

    Returns the walls, and for each clamped face the indices of its balls. InputError for a floor
    that cannot be found (:meth:`_LayerStack.find_floor`).
    """
    axis = len(stack.layers.cell)  # the axis across the layers follows the periods
    spread = _find_spread(stack.network)
    lower_edge, upper_edge = edges
    heights = balls["positions"][:, axis]
    # balls whose radii differ by the spread stand at different heights in one face
    tolerance = _MOST_SPREADS_OF_FACE * spread
    lower_face, upper_face = find_faces(
        heights, balls["radii"], (lower_edge, upper_edge), stack.network.n_balls, tolerance
    )
    walls = list[Body]()
    clamped_faces = list[Index]()
    for side, edge, face in ((-1.0, lower_edge, lower_face), (1.0, upper_edge, upper_face)):
        if edge == "clamped":
            balls["masses"][face] = np.inf
            clamped_faces.append(face)
        elif (wall := find_wall(edge)) is not None:
            floor = stack.find_floor(side, face, wall, allows_unpressed=bool(spread))
            floor.add_to(balls, contacts, axis)
            walls.append(wall)
    return walls, clamped_faces


def _require_joined_cut(
    network: Any, contacts: Mapping[str, Any], is_still: Flags, n_periods: int
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless contacts join all balls of a cut that
    move to each other, or to bodies that do not move.

    ``contacts`` are the fields of the contacts of the cut, of which ``n_periods`` periods are
    left. ``is_still`` has a flag for each ball of the cut, and is true if the ball does not move.
    """
    n_rattlers = network.rattlers.size
    why = ""
    mend = "Give more layers"
    if n_rattlers:
        why = f"Of its balls {n_rattlers} in each cell carry no load and hang on nothing"
        # such balls are no part of the whole, whatever the number of layers
        mend = "Leave them out: network.without_rattlers()"
    require_joined(
        contacts["i"],
        contacts["j"],
        contacts["shift"][:, :n_periods],
        len(is_still),
        n_periods,
        "the cut network",
        why=why,
        mend=mend,
        held=is_still,
    )


def _find_spread(network: Any) -> float:
    """Return the greatest difference between the radii of two balls of one kind, m.

    Balls of one kind whose radii differ lie off the sites of their lattice, and are of one face all
    the same. The difference counts as zero if balls name no kinds and differ by a quarter of the
    mean radius or more: such balls are taken to be of several kinds, each of which has its sites.
    """
    kinds = np.array(network.kinds or [""] * network.n_balls)
    is_ball = np.isfinite(network.radii)  # a flat wall has an infinite radius
    spread = 0.0
    for kind in set(kinds[is_ball].tolist()):
        radii = network.radii[is_ball & (kinds == kind)]
        spread = max(spread, float(np.ptp(radii)))
    if network.kinds or spread < _MOST_SPREAD * float(np.mean(network.radii[is_ball])):
        return spread
    return 0.0


def _find_forces(network: Any, contacts: Index) -> Array:
    """Return the static forces (m, 3), N, of balls i on balls j of some ``contacts`` (m,), indices
    in the network.
    """
    forces = network.normal_force[contacts, None] * network.normal[contacts]
    if network.tangential_force is not None:
        forces += network.tangential_force[contacts]
    return np.asarray(forces)


def _press_on_floor(
    network: Any, balls: Index, force: Array, wall: Body, face: str
) -> dict[str, Any]:
    """Return the fields (m,), by name, SI, of the contacts of ``balls`` (m,) of a cut with a
    ``wall``, each under its own ``force`` (m,), N.

    ``face`` names the face of these balls in messages. InputError if the network has no contact
    model, for balls of an unknown material, for a force that the law of their contacts does not
    bear, and for a ball without a force.
    """
    model: ContactModel | None = network.contact_model
    if model is None:
        fault = f"there is no floor for the balls of the {face}, whose materials are not known"
        mend = (
            "Give the material where the network is read, as from_table(..., material=...);"
            " or clamp the face"
        )
        raise InputError(fault, "Its stiffness is that of a ball on a flat wall", mend)
    originals = balls % network.n_balls  # indices of the balls of the network that are copied
    names = name_kinds(network, originals, model, face)
    radii = network.radii[originals]
    try:
        contacts = model.press_on_wall(names, radii, force, wall)
    except InputError as error:
        reason = str(error).rstrip(".")
        fault = f"there is no floor for the balls of the {face}: {reason}"
        raise InputError(fault) from error
    is_loose = ~(contacts["normal_stiffness"] > 0.0)
    if np.any(is_loose):
        fault = f"a floor bears no load of ball {balls[is_loose][0]} of the {face}"
        why = "Without a force its contact has no stiffness"
        raise InputError(fault, why, "Press the network, or clamp the face")
    # Where the network has overlaps, the arms end in the middle of the overlap with the plane;
    # where overlaps are neglected, they end where the undeformed ball touches the plane.
    overlap = contacts.pop("overlap")
    arm_i = contacts.pop("arm")
    arm_j = np.zeros(len(balls))
    if network.prestress or model.own_radii:
        arm_i = radii - 0.5 * overlap
        arm_j = -0.5 * overlap
    return contacts | {"normal_force": force, "arm_i": arm_i, "arm_j": arm_j}


def name_kinds(network: Any, balls: Index, model: ContactModel, face: str) -> list[str]:
    """Return the names (m,) of the kinds of ``balls`` (m,), indices in the network; an empty list
    where the network or the contact model names none, as there is one kind alone.

    InputError for balls whose material is not known; ``face`` names their face in the message.
    """
    if not network.kinds and len(model.kinds) > 1:
        materials = counted(len(model.kinds), "material")
        fault = f"the balls of the {face} name no kinds, and are of {materials}"
        why = "Which of them stand on the floor is not known"
        raise InputError(fault, why, "Keep the kinds of the network")
    if not network.kinds or not model.names:
        return []
    names = [network.kinds[ball] for ball in balls.tolist()]
    other_names = sorted(set(names) - set(model.names))
    if other_names:
        fault = f"no material is known of balls of the kind {other_names[0]!r}"
        raise InputError(fault, f"Materials are known of {', '.join(model.names)}")
    return names


@dataclass(frozen=True, eq=False)
class _LayerStack:
    """Layers of a network, one above the other, with their contacts.

    Attributes
    ----------
    network : the network of n balls; a layer is a copy of its cell.
    layers : the vectors of the layers; p periods are left.
    count : the number of layers.
    turn : (3, 3) the axes of the cut as rows: the p periods that are left span the first ones.
    positions : (n count, 3) centres of the balls, layer by layer, along the axes of the cut, m.
    i, j : (m,) the two balls of each contact, also of the contacts that the cut has opened: balls
        of layers below the cut have numbers below zero, and balls of layers above it have numbers
        from n count on.
    row : (m,) index of the contact of the network of which each contact is a copy.
    shift : (m, p) whole cells by which ball j is displaced.
    """

    network: Any
    layers: Layers
    count: int
    turn: Array
    positions: Array
    i: Index
    j: Index
    row: Index
    shift: Index

    @classmethod
    def of(cls, network: Any, layers: Layers, count: int) -> Self:
        """Return a stack of ``count`` layers of a ``network``; InputError if a contact reaches
        across all of them.
        """
        n = network.n_balls
        d = network.dimension
        p = len(layers.cell)
        layer_step = np.zeros(3)  # from one layer to the next, along the axes of the cut, m
        layer_step[:d] = layers.stack
        turn = np.eye(3)
        turn[:d, :d] = layers.turn
        sites = network.positions.copy()
        shift = network.shift[:, np.flatnonzero(network.pbc)]
        sites[:, :d], shift = layers.gather(
            sites[:, :d], network.i, network.j, shift, np.isinf(network.radii)
        )
        _cells, rise = layers.split(shift)  # rise: layers from ball i to ball j
        # contacts within a layer do not count: a large cell, as that of a sample, is a layer of
        # many rows, which hang together by themselves
        lengths_across = np.abs(network.vector @ turn.T[:, p])[rise != 0]
        longest = float(np.max(lengths_across, initial=0.0))
        _require_short(longest, float(layer_step[p]), count)
        # Contacts that are cut lead to balls of layers beyond the two faces, as many as a contact
        # rises. Balls are numbered from the lowest of these, and then from the lower face.
        n_beyond = int(np.max(np.abs(rise), initial=0))
        i, j, row, inner_shift = layers.unfold(network.i, network.j, shift, n, count + 2 * n_beyond)
        heights = np.arange(count)[:, None, None] * layer_step
        positions = ((sites @ turn.T)[None] + heights).reshape(-1, 3)
        return cls(
            network=network,
            layers=layers,
            count=count,
            turn=turn,
            positions=positions,
            i=i - n_beyond * n,
            j=j - n_beyond * n,
            row=row,
            shift=inner_shift,
        )

    @cached_property
    def has_i(self) -> Flags:
        """(m,) whether ball i of each contact is in the layers."""
        return read_only((self.i >= 0) & (self.i < len(self.positions)))

    @cached_property
    def has_j(self) -> Flags:
        """(m,) whether ball j of each contact is in the layers."""
        return read_only((self.j >= 0) & (self.j < len(self.positions)))

    def make_balls(self) -> dict[str, Any]:
        """Return the fields of the balls of all layers, by name."""
        fields: dict[str, Any] = {
            name: np.tile(getattr(self.network, name), self.count) for name in NUMBERS_OF_BALLS
        }
        return fields | {"positions": self.positions}

    def make_contacts(self) -> dict[str, Any]:
        """Return the fields of the contacts whose two balls are in the layers, by name; vectors are
        along the axes of the cut.
        """
        is_kept = self.has_i & self.has_j
        rows = self.row[is_kept]
        fields: dict[str, Any] = {}
        for name in self.network.contact_fields:
            values = getattr(self.network, name)[rows]
            is_vector = name in ("normal", "tangential_force", "contact_torque")
            fields[name] = values @ self.turn.T if is_vector else values
        # a network has shifts along three vectors, of which the first p are periods here
        padding = ((0, 0), (0, 3 - self.shift.shape[1]))
        return fields | {
            "i": self.i[is_kept],
            "j": self.j[is_kept],
            "shift": np.pad(self.shift[is_kept], padding),
        }

    def find_floor(self, side: float, face: Index, wall: Body, allows_unpressed: bool) -> _Floor:
        """Return the floor, a ``wall``, on which the balls of a ``face``, (m,) indices, stand: the
        lower face (``side`` -1) or the upper one (+1).

        Each ball presses on the floor with the force of the contacts that the ball has lost there.
        The part of the force along the floor is kept if the network has tangential forces, and is
        zero otherwise.

        With ``allows_unpressed``, which is for faces of balls of different sizes, a ball of the
        face that has lost no contact stands on no floor. InputError for such a ball without
        ``allows_unpressed``, if no ball of the face has lost a contact, and as
        :func:`_press_on_floor`.
        """
        p = self.shift.shape[1]  # the axis across the layers
        leads_beyond = np.minimum(self.i, self.j) < 0
        if side > 0.0:
            leads_beyond = np.maximum(self.i, self.j) >= len(self.positions)
        ball_inside = np.where(self.has_i, self.i, self.j)
        is_cut = (self.has_i | self.has_j) & leads_beyond
        cut_contacts = np.flatnonzero(is_cut & np.isin(ball_inside, face))
        balls = ball_inside[cut_contacts]
        pressed_balls = np.intersect1d(face, balls)
        unpressed_balls = np.setdiff1d(face, balls)
        if unpressed_balls.size and (not allows_unpressed or not pressed_balls.size):
            raise InputError(
                f"ball {unpressed_balls[0]} of the {_name_face(side)} has lost no contact there",
                "Nothing says with which force it stands on a floor",
                "Cut elsewhere, or clamp it",
            )
        # forces of balls i on balls j along the axes of the cut
        forces = _find_forces(self.network, self.row[cut_contacts]) @ self.turn.T
        # the floor takes the place of the lost ball: where ball i is left, ball i presses on the
        # floor as on the lost ball j; where ball j is left, ball j presses with the opposite force
        signs = np.where(self.has_i, 1.0, -1.0)[cut_contacts]
        floor_forces = np.zeros((len(pressed_balls), 3))  # sums over the contacts of each ball
        np.add.at(floor_forces, np.searchsorted(pressed_balls, balls), signs[:, None] * forces)
        normal_force = side * floor_forces[:, p]
        springs = _press_on_floor(self.network, pressed_balls, normal_force, wall, _name_face(side))
        tangential_force = np.zeros(floor_forces.shape)
        if self.network.tangential_force is not None:
            axes_along = np.arange(3) != p
            tangential_force[:, axes_along] = floor_forces[:, axes_along]
        return _Floor(side, pressed_balls, springs | {"tangential_force": tangential_force})


@dataclass(frozen=True, eq=False)
class _Floor:
    """A flat wall below (``side`` -1) or above (+1) a cut, on which ``balls`` (m,), indices in the
    cut, stand; ``springs`` has the fields of their contacts by name, (m,) or (m, 3), but for ends,
    normals, torques and shifts.
    """

    side: float
    balls: Index
    springs: dict[str, Any]

    def add_to(self, balls: dict[str, Any], contacts: dict[str, Any], axis: int) -> None:
        """Add the plane, which lies across an ``axis``, as the last ball to the fields of
        ``balls``, and its contacts to the fields of ``contacts``, both in place.

        The plane goes through the mean of the outermost points of the balls that stand on it.
        """
        n_contacts = len(self.balls)
        plane = len(balls["masses"])  # the index of the plane
        axis_vector = np.eye(3)[axis]
        fields = self.springs | {
            "i": self.balls,
            "j": np.full(n_contacts, plane),
            "normal": np.tile(self.side * axis_vector, (n_contacts, 1)),
            "contact_torque": np.zeros((n_contacts, 3)),
            "shift": np.zeros((n_contacts, 3), np.intp),
        }
        for name in tuple(contacts):
            contacts[name] = np.concatenate([contacts[name], fields[name]])
        heights = balls["positions"][self.balls, axis]
        outermost_heights = heights + self.side * balls["radii"][self.balls]
        point = axis_vector * np.mean(outermost_heights)
        for name in NUMBERS_OF_BALLS:
            balls[name] = np.append(balls[name], np.inf)
        balls["positions"] = np.concatenate([balls["positions"], point[None]])


def _require_short(longest: float, height: float, count: int) -> None:
    """Raise InputError if a contact between layers reaches across all of ``count`` layers.

    ``longest`` is the greatest length, across the layers, of such a contact, and ``height`` that of
    one layer, m.
    """
    if longest >= (1.0 - TOUCH) * count * height:
        least_count = int((1.0 + TOUCH) * longest / height) + 1
        fault = f"some contacts reach across {counted(count, 'layer')}"
        raise InputError(fault, "None of them would be left", f"Give {least_count} layers or more")


def _leave_out_still(contacts: Mapping[str, Any], is_still: Flags) -> dict[str, Any]:
    """Return the fields of the ``contacts``, by name, without contacts of two balls that do not
    move. ``is_still`` has a flag for each ball, and is true if the ball does not move.
    """
    is_kept = ~(is_still[contacts["i"]] & is_still[contacts["j"]])
    return {name: values[is_kept] for name, values in contacts.items()}


def _require_motion(
    contacts: Mapping[str, Any], is_still: Flags, clamped_faces: Sequence[Index], count: int
) -> None:
    """Raise InputError if no ball of a cut of ``count`` layers moves, or if the balls of a clamped
    face touch none that moves.

    ``contacts`` are the fields of the contacts of the cut, by name, without contacts of two balls
    that do not move. ``is_still`` has a flag for each ball of the cut, and is true if the ball does
    not move. ``clamped_faces`` are the indices of the balls of each clamped face.
    """
    if np.all(is_still):
        fault = f"no ball moves in {counted(count, 'layer')} with these edges"
        raise InputError(fault, mend="Give more layers")
    for face in clamped_faces:
        is_at_face = np.isin(contacts["i"], face) | np.isin(contacts["j"], face)
        if not np.any(is_at_face):
            fault = "the clamped balls of an edge touch none that moves"
            raise InputError(fault, mend="Give more layers")


def _name_face(side: float) -> str:
    """Return the words for the face on a ``side``, -1 or +1."""
    return "lower face" if side < 0.0 else "upper face"
