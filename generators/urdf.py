"""The closed pose of an articulated shape: the few parts of URDF that PartNet-Mobility uses.

Conventions: http://wiki.ros.org/urdf/XML/joint. A transform is (4, 4), named target_from_source.
"""

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import ShapeError

Matrix = NDArray[np.float64]

JOINT_KINDS = ("fixed", "continuous", "revolute", "prismatic", "floating", "planar")
QUARTER = 1e-6
"""A rotation whose entries are all this close to -1, 0 or 1 is a quarter turn, written with few digits."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint: `parent_from_joint` at value 0, the axis in the joint's frame, limits where stated and finite."""

    name: str
    kind: str
    parent: str
    child: str
    parent_from_joint: Matrix
    axis: NDArray[np.float64]
    lower: float | None
    upper: float | None


@dataclass(frozen=True, slots=True)
class Part:
    """One mesh file, and where it lies: `root_from_mesh` (4, 4), scale included."""

    file: str
    root_from_mesh: Matrix


@dataclass(frozen=True, slots=True)
class ClosedPose:
    """An articulated shape, closed.

    Attributes
    ----------
    parts : mesh files in the root's frame, each placement once
    root_from_body : (3, 3) rotation of the links that hang at the root at their zero, the identity where none does
    notes : what was mended
    """

    parts: tuple[Part, ...]
    root_from_body: Matrix
    notes: tuple[str, ...]


def read_closed_pose(path: Path) -> ClosedPose:
    """Read a URDF file and close all its joints; ShapeError with the reason if it is not one tree of meshes."""
    try:
        robot = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError, ValueError, LookupError) as error:
        msg = f"{path.name} cannot be read: {error}"
        raise ShapeError(msg) from error
    notes: list[str] = []
    links = _read_links(robot)
    joints = [_read_joint(element, notes) for element in robot.findall("joint")]
    root = _find_root(links, joints)
    poses = {root: np.eye(4)}
    while reached := [j for j in joints if j.parent in poses and j.child not in poses]:
        for joint in reached:
            poses[joint.child] = poses[joint.parent] @ joint.parent_from_joint @ motion(joint, closed_value(joint))
    if lost := [name for name in links if name not in poses and _shown(links[name])]:
        msg = f"{path.name}: link {lost[0]} does not hang at {root}: its joints form a loop"
        raise ShapeError(msg)
    parts = {
        (part.file, part.root_from_mesh.tobytes()): part
        for name, pose in poses.items()
        for element in _shown(links[name])
        for part in [_read_part(element, pose, name)]
    }
    if not parts:
        msg = f"{path.name} shows no mesh"
        raise ShapeError(msg)
    return ClosedPose(tuple(parts.values()), _root_rotation(root, joints), tuple(notes))


def closed_value(joint: Joint) -> float:
    """Return the value at which a joint is closed: its lower limit, in radians or metres.

    So O2O-Afford and Where2Act close their joints. Zero is merely the pose in which a shape was drawn: in real data it
    can lie outside the limits, or within them with the door ajar. Without a lower limit it is 0, or the upper limit if
    that is below; a joint that turns or floats freely stays at 0.
    """
    if joint.kind not in ("revolute", "prismatic"):
        return 0.0
    if joint.lower is not None:
        return joint.lower
    return 0.0 if joint.upper is None else min(0.0, joint.upper)


def motion(joint: Joint, value: float) -> Matrix:
    """Return the (4, 4) motion of a joint: a turn about its axis (Rodrigues' formula) or a slide along it."""
    moved = np.eye(4)
    if value != 0.0 and joint.kind == "prismatic":
        moved[:3, 3] = value * joint.axis
    elif value != 0.0:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        moved[:3, :3] += math.sin(value) * cross + (1 - math.cos(value)) * (cross @ cross)
    return moved


def rotation(roll: float, pitch: float, yaw: float) -> Matrix:
    """Return the (3, 3) rotation by roll about x, then pitch about y, then yaw about z, all fixed axes."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    turned: Matrix = about_z @ about_y @ about_x
    whole = np.round(turned) + 0.0
    return whole if np.abs(turned - whole).max() < QUARTER else turned


def _read_links(robot: Element) -> dict[str, Element]:
    links: dict[str, Element] = {}
    for link in robot.findall("link"):
        name = _attribute(link, "name")
        if name in links:
            msg = f"two links are named '{name}'"
            raise ShapeError(msg)
        links[name] = link
    return links


def _find_root(links: dict[str, Element], joints: list[Joint]) -> str:
    """Return the one link that no joint moves; links without geometry and joints do not count."""
    for joint in joints:
        if missing := [end for end in (joint.parent, joint.child) if end not in links]:
            msg = f"{joint.name} joins link {missing[0]}, which does not exist"
            raise ShapeError(msg)
    moved = Counter(j.child for j in joints)
    if doubled := [name for name, count in moved.items() if count > 1]:
        msg = f"link {doubled[0]} hangs at {moved[doubled[0]]} joints; a tree has one"
        raise ShapeError(msg)
    parents = {j.parent for j in joints}
    roots = [name for name, link in links.items() if name not in moved and (name in parents or _shown(link))]
    if len(roots) != 1:
        msg = f"has {len(roots)} root links ({', '.join(roots[:4])}); a tree has one" if roots else "has no root link"
        raise ShapeError(msg)
    return roots[0]


def _root_rotation(root: str, joints: list[Joint]) -> Matrix:
    turns = [j.parent_from_joint[:3, :3] for j in joints if j.parent == root] or [np.eye(3)]
    if any(not np.allclose(turn, turns[0], atol=QUARTER) for turn in turns):
        msg = f"the joints at {root} are turned differently, so its up axis is unknown"
        raise ShapeError(msg)
    return turns[0]


def _shown(link: Element) -> list[Element]:
    """Return the visuals of a link; its collision shapes where it has none."""
    return link.findall("visual") or link.findall("collision")


def _read_joint(element: Element, notes: list[str]) -> Joint:
    name, kind = element.get("name", "a joint"), element.get("type", "")
    if kind not in JOINT_KINDS:
        msg = f"{name} has type '{kind}'; known: {', '.join(JOINT_KINDS)}"
        raise ShapeError(msg)
    parent, child = (_attribute(_child(element, end, name), "link") for end in ("parent", "child"))
    axis = np.array(_numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0), name))
    length = float(np.linalg.norm(axis))
    if kind in ("revolute", "prismatic") and not length > 0:
        msg = f"{name} has an axis without direction"
        raise ShapeError(msg)
    lower, upper = _limits(element.find("limit"), name, notes)
    return Joint(name, kind, parent, child, _placement(element, name), axis / (length or 1.0), lower, upper)


def _limits(element: Element | None, name: str, notes: list[str]) -> tuple[float | None, float | None]:
    """Return the limits of a joint; a lower one above the upper one tells nothing, so that both are noted as none."""
    lower, upper = (_limit(element, side, name, notes) for side in ("lower", "upper"))
    if lower is not None and upper is not None and lower > upper:
        notes.append(f"{name}: lower limit {lower:g} is above upper limit {upper:g}; both were ignored")
        return None, None
    return lower, upper


def _limit(element: Element | None, side: str, name: str, notes: list[str]) -> float | None:
    """Return a joint limit, None if there is none; a malformed one counts as none, and is noted."""
    text = None if element is None else element.get(side)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        notes.append(f"{name}: {side} limit '{text[:40]}' is not a number and was ignored")
    return value if math.isfinite(value) else None


def _read_part(element: Element, root_from_link: Matrix, link: str) -> Part:
    mesh = element.find("geometry/mesh")
    if mesh is None:
        msg = f"link {link} shows something that is no mesh file"
        raise ShapeError(msg)
    scale = np.diag([*_numbers(mesh, "scale", (1.0, 1.0, 1.0), link), 1.0])
    return Part(_attribute(mesh, "filename"), root_from_link @ _placement(element, link) @ scale)


def _placement(element: Element, owner: str) -> Matrix:
    """Return the (4, 4) transform of an element's `origin`."""
    origin = element.find("origin")
    placed = np.eye(4)
    placed[:3, :3] = rotation(*_numbers(origin, "rpy", (0.0, 0.0, 0.0), owner))
    placed[:3, 3] = _numbers(origin, "xyz", (0.0, 0.0, 0.0), owner)
    return placed


def _numbers(
    element: Element | None, attribute: str, default: tuple[float, float, float], owner: str
) -> tuple[float, float, float]:
    """Return three numbers; ShapeError if they are malformed: unlike a limit, a place cannot be guessed."""
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    try:
        x, y, z = (float(word) for word in text.split())
    except ValueError as error:
        msg = f"{owner} has {attribute}='{text[:60]}'; expected three numbers"
        raise ShapeError(msg) from error
    if not all(math.isfinite(value) for value in (x, y, z)):
        msg = f"{owner} has {attribute}='{text[:60]}'; expected finite numbers"
        raise ShapeError(msg)
    return x, y, z


def _child(element: Element, tag: str, owner: str) -> Element:
    found = element.find(tag)
    if found is None:
        msg = f"{owner} has no {tag}"
        raise ShapeError(msg)
    return found


def _attribute(element: Element, name: str) -> str:
    value = element.get(name)
    if not value:
        msg = f"an element <{element.tag}> has no {name}"
        raise ShapeError(msg)
    return value
