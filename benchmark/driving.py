"""The closed loop of navigation: robots that see, decide and move, all of them a step at a time.

The paper's policy: forward by 0.2 m where the model says that the robot passes, else clockwise by 20 degrees. World
frame of a room: z up, the floor at z = 0, metres; a pose is (x, y, heading), heading in radians from x towards y. Robot
frame: origin on the floor under the robot's axis, x forward, y left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

FORWARD = 0.2
"""One step of the paper's robot, m."""
TURN = -float(np.radians(20.0))
"""One turn of the paper's robot, rad; clockwise seen from above is negative."""
FULL_TURN = 18
"""Turns that lead back to the first heading. A robot that did not leave its place in so many steps is stuck: a policy
without a memory has seen all that it will ever see."""

ENDED, TURNED, WENT, COLLIDED = range(4)
"""What a robot did in a step: nothing, since its run has ended; turned; went forward; touched something and stayed."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Clouds = NDArray[np.float32]


class Room(Protocol):
    """A room as the loop needs it. Poses (n, 3); sizes (n, 2) are the robots' diameters and heights, m.

    Attributes
    ----------
    name, kind : which room it is, and of what kind
    floor : (k, 2) corners of its floor, m
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def floor(self) -> Floats: ...  # noqa: D102

    def places(self, size: Floats) -> Floats:
        """Return places (m, 2) on a grid, m, where a robot of size (diameter, height) can start."""

    def free(self, poses: Floats, sizes: Floats) -> Bools:
        """Say (n,) whether a robot can stand there, touching nothing."""

    def passes(self, poses: Floats, sizes: Floats) -> Bools:
        """Say (n,) whether a robot can go forward by 0.2 m from there, touching nothing."""

    def views(self, poses: Floats) -> Clouds:
        """Return (n, M, 3): what the depth camera sees there, in the robot's frame; a function of the pose alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Fleet:
    """K robots, each alone in its room.

    Attributes
    ----------
    rooms : the rooms
    room : (K,) number of each robot's room
    starts : (K, 3) first poses
    sizes : (K, 2) diameter and height, m
    clouds : (K, N, 3) the robots' own surfaces, robot frame
    """

    rooms: Sequence[Room]
    room: NDArray[np.int64]
    starts: Floats
    sizes: Floats
    clouds: Clouds

    def __len__(self) -> int:
        """Return K."""
        return len(self.room)

    def passes(self, robots: NDArray[np.int64], poses: Floats) -> Bools:
        """Say (n,) of some robots at poses (n, 3) whether they can go forward."""
        return np.asarray(self._by_room(robots, lambda room, k: room.passes(poses[k], self.sizes[robots[k]])), np.bool_)

    def views(self, robots: NDArray[np.int64], poses: Floats) -> Clouds:
        """Return (n, M, 3), what some robots see at poses (n, 3)."""
        return np.asarray(self._by_room(robots, lambda room, k: room.views(poses[k])), np.float32)

    def _by_room(
        self, robots: NDArray[np.int64], ask: Callable[[Room, NDArray[np.int64]], NDArray[Any]]
    ) -> NDArray[Any]:
        """Return the rooms' answers (n, ...), in the robots' order; each room is asked once."""
        room = self.room[robots]
        order = np.argsort(room, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(room[order])) + 1)
        answers = np.concatenate([ask(self.rooms[int(room[k[0]])], k) for k in groups])
        found = np.zeros_like(answers)
        found[order] = answers
        return found


class Moment:
    """One step of the robots that still drive: who and where they are; what they see and what is true, when asked.

    Attributes
    ----------
    step : its number, from 0
    robots : (n,) their numbers in the fleet
    poses : (n, 3)
    """

    def __init__(self, fleet: Fleet, step: int, robots: NDArray[np.int64], poses: Floats) -> None:
        self.fleet, self.step, self.robots, self.poses = fleet, step, robots, poses

    @cached_property
    def views(self) -> Clouds:
        """What each robot sees, (n, M, 3)."""
        return self.fleet.views(self.robots, self.poses)

    @cached_property
    def passes(self) -> Bools:
        """Whether each robot can go forward, (n,): the truth."""
        return self.fleet.passes(self.robots, self.poses)


Decide = Callable[[Moment], Bools]
"""A policy: which of the robots (n,) shall go forward."""


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """What K robots did in T steps.

    Attributes
    ----------
    poses : (T + 1, K, 3); a robot whose run has ended stays
    moves : (T, K) int8, of `ENDED`, `TURNED`, `WENT`, `COLLIDED`
    passes : (T, K) the truth in every step, False once a run has ended
    """

    poses: Floats
    moves: NDArray[np.int8]
    passes: Bools

    @property
    def ended(self) -> Bools:
        """Which robots (K,) stood still for a full turn at last: stuck."""
        return stood_still(self.moves)


def stood_still(moves: NDArray[np.int8]) -> Bools:
    """Say (K,) which robots did not leave their place in the last `FULL_TURN` steps of moves (T, K)."""
    driven = (moves != ENDED).sum(axis=0)
    places = np.arange(len(moves))[:, None]
    last = np.where(moves == WENT, places, -1).max(axis=0, initial=-1)
    return np.asarray(driven - 1 - last >= FULL_TURN)


def drive(
    fleet: Fleet,
    decide: Decide,
    steps: int,
    *,
    bumper: bool = False,
    tell: Callable[[int], None] | None = None,
) -> Paths:
    """Let all robots drive, each until it is stuck, at most for `steps` steps.

    A robot that goes forward where it cannot collides: it stays where it is. So it does for ever under a policy without
    a memory, which sees the same again, unless it has a `bumper`: then a collision turns it as a negative would.
    `tell` is called with the number of steps done.
    """
    count = len(fleet)
    poses = np.repeat(fleet.starts[None], steps + 1, axis=0)
    moves, passes = np.zeros((steps, count), np.int8), np.zeros((steps, count), np.bool_)
    still = np.zeros(count, np.int64)
    for step in range(steps):
        robots = np.flatnonzero(still < FULL_TURN)
        poses[step + 1] = poses[step]
        if len(robots):
            moment = Moment(fleet, step, robots, poses[step, robots])
            move = _moves(np.asarray(decide(moment), np.bool_), moment.passes)
            moves[step, robots], passes[step, robots] = move, moment.passes
            poses[step + 1, robots] = moved(moment.poses, move, bumper=bumper)
            still[robots] = np.where(move == WENT, 0, still[robots] + 1)
        if tell:
            tell(step + 1)
    return Paths(poses, moves, passes)


def moved(poses: Floats, moves: NDArray[np.int8], *, bumper: bool = False) -> Floats:
    """Return poses (n, 3) after moves (n,); headings stay in [-pi, pi)."""
    ahead = np.where(moves == WENT, FORWARD, 0.0)
    turns = (moves == TURNED) | (bumper & (moves == COLLIDED))
    heading = poses[:, 2]
    new = np.stack([poses[:, 0] + ahead * np.cos(heading), poses[:, 1] + ahead * np.sin(heading), heading], axis=1)
    new[turns, 2] = (heading[turns] + TURN + np.pi) % (2 * np.pi) - np.pi
    return new


def _moves(forward: Bools, passes: Bools) -> NDArray[np.int8]:
    return np.where(forward, np.where(passes, WENT, COLLIDED), TURNED).astype(np.int8)


def oracle(moment: Moment) -> Bools:
    """Return the truth: the policy of a model that is never wrong."""
    return moment.passes


def coin(seed: int) -> Decide:
    """Return the policy that goes forward in every second step, at random: a function of seed, step and robot alone."""

    def decide(moment: Moment) -> Bools:
        tossed = np.random.default_rng([seed, moment.step]).random(len(moment.fleet)) < 0.5
        return np.asarray(tossed[moment.robots])

    return decide
