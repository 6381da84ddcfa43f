"""A survey of shapes: measure every mesh as if it came without annotations, and compare with the truth.

For the built-in shapes the truth is known, so the survey gives the error of each measure; for a user's
meshes it tells what was found, or why one is refused.
"""

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment, nnls
from scipy.spatial import ConvexHull, QhullError

from eigenbench.errors import ShapeError, printable
from eigenbench.generators.catalogue import make_shape
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.measuring import measured
from eigenbench.generators.selection import Selection
from eigenbench.generators.shapes import Cavity, Measures, Points, Shape, Top, measures_to_json
from eigenbench.generators.solids import Mesh, is_closed, loop_area
from eigenbench.generators.workers import run_jobs, worker_count

Progress = Callable[[str, int, int], None]

CHUNK = 4
"""Shapes in one job."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What was measured on one shape.

    Attributes
    ----------
    role, split, category, name : of the shape
    faces, closed, extents : of its mesh; closed: every edge is met by two faces in opposite directions
    ball, circle : diameter of the smallest enclosing ball, and of the circle round the xy silhouette
    found : measures of the mesh, as its role asks
    truth : what the shape was built with, None for a user's mesh
    errors : by measure, relative; see `errors_of`
    seconds : spent on it
    refused : why it cannot be used, None if it can
    """

    role: str
    split: str
    category: str
    name: str
    faces: int = 0
    closed: bool = False
    extents: tuple[float, ...] = ()
    ball: float = 0.0
    circle: float = 0.0
    found: Measures = field(default_factory=Measures)
    truth: Measures | None = None
    errors: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    refused: str | None = None

    def row(self) -> dict[str, Any]:
        """Return all of it as plain values, for JSON; an infinite error is None."""
        plain = {k: getattr(self, k) for k in self.__slots__ if k not in ("found", "truth", "errors")}
        plain["errors"] = {k: _finite(error) for k, error in self.errors.items()}
        truth = None if self.truth is None else measures_to_json(self.truth)
        return {**plain, "found": measures_to_json(self.found), "truth": truth}


@dataclass(frozen=True, slots=True)
class _Job:
    """Shapes of one role and category to measure: split, index, and the shape unless it is built in."""

    role: str
    category: str
    items: tuple[tuple[str, int, Shape | None], ...]


def survey(
    selections: Sequence[Selection], workers: int | None = None, progress: Progress | None = None
) -> list[Finding]:
    """Measure all selected shapes, in their order; the truth of the built-in ones does not enter."""
    jobs = []
    for s in selections:
        items = [
            (s.split_of(i), i, s.shelf.shapes[s.role, s.category][i] if s.shelf.shapes else None) for i in s.indices
        ]
        jobs += [_Job(s.role, s.category, tuple(items[k : k + CHUNK])) for k in range(0, len(items), CHUNK)]
    total = sum(len(j.items) for j in jobs)
    place = {(j.role, j.category, i): k for k, (j, i) in enumerate((j, i) for j in jobs for _, i, _ in j.items)}
    findings: dict[int, Finding] = {}
    for job, done in run_jobs(_measure_all, jobs, worker_count(workers)):
        findings |= {place[job.role, job.category, i]: f for (_, i, _), f in zip(job.items, done, strict=True)}
        if progress is not None:
            progress("measuring", len(findings), total)
    return [findings[k] for k in sorted(findings)]


def _measure_all(job: _Job) -> tuple[_Job, list[Finding]]:
    return job, [_measure(job, *item) for item in job.items]


def _measure(job: _Job, split: str, index: int, given: Shape | None) -> Finding:
    """Measure one shape."""
    _warm_up(job.role)
    shape = make_shape(job.role, job.category, index) if given is None else given
    about = Finding(job.role, split, job.category, shape.name, len(shape.mesh.faces))
    start = time.perf_counter()
    try:
        found = measured(replace(shape, measures=Measures()), job.role).measures
        hull = hull_of(shape.mesh)
    except ShapeError as error:
        return replace(about, refused=str(error), seconds=time.perf_counter() - start)
    ball, circle = enclosing_ball(hull), enclosing_ball(np.ascontiguousarray(hull[:, :2]))
    errors = {"ball": excess(hull, *ball), "circle": excess(hull[:, :2], *circle)}
    if given is None and job.role != "object":  # of objects nothing else is measured
        errors |= errors_of(found, shape.measures)
    return replace(
        about,
        closed=is_closed(shape.mesh),
        extents=tuple(np.ptp(hull, axis=0).tolist()),
        ball=2 * ball[1],
        circle=2 * circle[1],
        found=found,
        truth=shape.measures if given is None else None,
        errors=errors,
        seconds=time.perf_counter() - start,
    )


@cache
def _warm_up(role: str) -> None:
    """Compile or fetch the kernels that measure a role, so that it does not count as the first shape's time."""
    shape = make_shape(role, "mug" if role == "mug" else "box", 0)
    with contextlib.suppress(ShapeError):
        measured(shape, role)
    enclosing_ball(hull_of(shape.mesh))


def hull_of(mesh: Mesh) -> Points:
    """Return the vertices of a mesh's convex hull; ShapeError if it is flat."""
    try:
        return np.ascontiguousarray(mesh.vertices[ConvexHull(mesh.vertices).vertices])
    except QhullError as error:
        msg = "is flat: its vertices lie in one plane or line"
        raise ShapeError(msg) from error


def excess(points: Points, centre: Points, radius: float) -> float:
    """Return by what share a ball of (n, d) points can exceed the smallest one.

    From the dual problem (Gaertner and Schoenherr, "An efficient, exact, and generic quadratic programming
    solver for geometric optimization", 2000): no ball with the points is smaller than
    sqrt(sum w |p - c|^2 - |sum w (p - c)|^2), whatever the weights w >= 0 of sum 1.
    """
    away = (points - centre) / radius
    touching = away[np.linalg.norm(away, axis=1) > 1 - 1e-6]
    if not len(touching):
        return np.inf
    weights = nnls(np.vstack([touching.T, np.ones(len(touching))]), np.append(np.zeros(points.shape[1]), 1.0))[0]
    weights /= weights.sum()
    least = np.sqrt(max(weights @ np.sum(touching**2, axis=1) - np.sum((weights @ touching) ** 2), 0.0))
    return float(max(np.linalg.norm(away, axis=1).max(), 1.0) / least - 1.0) if least > 0 else np.inf


def errors_of(found: Measures, truth: Measures) -> dict[str, float]:
    """Return the relative error of each measure that the truth has; infinite where something was not found.

    `cavity` : the largest error of an extent of a cavity, over that extent, cavities matched by their boxes
    `inhabited` : share of the cavities of which it is not seen whether something reaches into them
    `top` : the larger of the errors of the outline's extents and area; `gap` : of the handle gap's radius
    """
    errors: dict[str, float] = {}
    if truth.cavities or found.cavities:
        errors["cavity"], errors["inhabited"] = _cavity_errors(found.cavities, truth.cavities)
    if truth.top is not None or found.top is not None:
        errors["top"] = _top_error(found.top, truth.top)
    if truth.handle is not None:
        errors["gap"] = np.inf if found.handle is None else abs(found.handle.radius / truth.handle.radius - 1.0)
    return errors


def _cavity_errors(found: tuple[Cavity, ...], truth: tuple[Cavity, ...]) -> tuple[float, float]:
    if len(found) != len(truth):
        return np.inf, 1.0
    sizes = np.array([c.sizes for c in truth])
    corners = np.array([[c.low, c.high] for c in truth]), np.array([[c.low, c.high] for c in found])
    apart = np.abs(corners[0][:, None] - corners[1][None]).max(axis=(2, 3))
    rows, columns = linear_sum_assignment(apart)
    errors = np.abs(np.array([found[k].sizes for k in columns]) / sizes[rows] - 1.0)
    unseen = np.mean([truth[i].inhabited != found[k].inhabited for i, k in zip(rows, columns, strict=True)])
    return float(errors.max()), float(unseen)


def _top_error(found: Top | None, truth: Top | None) -> float:
    if found is None or truth is None:
        return np.inf
    extents = np.abs(np.ptp(found.outline, axis=0) / np.ptp(truth.outline, axis=0) - 1.0)
    return float(max(extents.max(), abs(loop_area(found.outline) / loop_area(truth.outline) - 1.0)))


BOUNDS = {"cavity": 0.01, "inhabited": 0.0, "top": 0.01, "gap": 0.02, "ball": 1e-6, "circle": 1e-6}
"""What each error should stay below."""


def summarise(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return the distribution of each error over the shapes that have that measure.

    Keys: measure, shapes, median, p99 (99th percentile), worst, bound, within (share at or below the bound); an
    infinite error is None.
    """
    rows = []
    for measure, bound in BOUNDS.items():
        errors = np.array([f.errors[measure] for f in findings if measure in f.errors])
        if not len(errors):
            continue
        median, p99 = np.quantile(errors, [0.5, 0.99], method="higher")
        within = float(np.mean(errors <= bound))
        numbers = {"median": median, "p99": p99, "worst": errors.max(), "bound": bound, "within": within}
        rows.append({"measure": measure, "shapes": len(errors), **{k: _finite(float(v)) for k, v in numbers.items()}})
    return rows


def _finite(value: float) -> float | None:
    """Return a number that JSON can hold."""
    return value if np.isfinite(value) else None


def as_markdown(findings: Sequence[Finding]) -> str:
    """Return what was measured as a Markdown table, one row a shape; lengths over the shape's longest side."""
    head = ("role", "shape", "faces", "closed", "measured, in shares of the longest side", "s")
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for f in findings:
        cells = (
            f.role,
            printable(f"{f.category}/{f.name}").replace("|", "\\|"),
            f"{f.faces:,}",
            "yes" if f.closed else "no",
            in_words(f),
            f"{f.seconds:.2f}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def in_words(finding: Finding) -> str:
    """Say what was measured on a shape, lengths as shares of its longest side."""
    if finding.refused is not None:
        return f"refused: {finding.refused}"
    longest = max(finding.extents)
    words = []
    if finding.role == "environment":
        words = [_cavities_in_words(finding.found.cavities, longest), _top_in_words(finding.found.top, longest)]
    if finding.found.handle is not None:
        words.append(f"handle gap {2 * finding.found.handle.radius / longest:.3f}")
    words.append(f"ball {finding.ball / longest:.3f}, circle {finding.circle / longest:.3f}")
    return "; ".join(words)


def _cavities_in_words(cavities: tuple[Cavity, ...], longest: float) -> str:
    if not cavities:
        return "no interior"
    x, y, z = (size / longest for size in cavities[0].sizes)
    kind = "drum" if cavities[0].axis is not None else "box"
    inside = ", inhabited" if cavities[0].inhabited else ""
    number = "1 cavity" if len(cavities) == 1 else f"{len(cavities)} cavities, the largest"
    return f"{number} a {kind} {x:.3f} x {y:.3f} x {z:.3f}{inside}"


def _top_in_words(top: Top | None, longest: float) -> str:
    if top is None:
        return "no top"
    x, y = np.ptp(top.outline, axis=0) / longest
    return f"top {x:.3f} x {y:.3f}, {len(top.outline)} corners"
