"""Selected groundings drawn per task: environments with the vectors and planes of the slots that a task's mask selects.

One SVG, a row a task and a column an environment, in an oblique view: x to the lower left, y to the right, z up.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from eigenbench.baselines.models import Trained
from eigenbench.dataset import load
from eigenbench.markup import Html, tag
from eigenbench.shards import write_text_atomically

ENVIRONMENTS = 5
COLOURS = ("#c0392b", "#1f7a3f", "#1f5fa8", "#b7791f")
VIEW = np.array([[-0.45, -0.32], [0.95, -0.14], [0.0, 1.0]])
"""World directions x, y, z on the paper, right and up."""
_CELL, _LABEL, _SHOWN = 190, 150, 400
_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 48)), np.sin(np.linspace(0, 2 * np.pi, 48))], 1)

Floats = NDArray[np.float64]


def draw_tasks(model: Trained, tasks: Mapping[Path, Sequence[int]], path: Path) -> None:
    """Draw the first environments of each split with the groundings of its selected slots, and write the SVG."""
    lines = [_line(model, split, slots, number * _CELL) for number, (split, slots) in enumerate(tasks.items())]
    width, height = _LABEL + ENVIRONMENTS * _CELL, len(tasks) * _CELL
    back = tag("rect", width=width, height=height, fill="white")
    label = "Selected groundings by task"
    size = {"viewBox": f"0 0 {width} {height}", "width": width, "height": height}
    svg = tag("svg", back, *lines, xmlns="http://www.w3.org/2000/svg", role="img", aria_label=label, **size)
    write_text_atomically(path, f"{svg}\n")


def _line(model: Trained, split: Path, slots: Sequence[int], top: int) -> Html:
    dataset = load(split)
    batch = dataset.read(range(ENVIRONMENTS), ("env_points", "obj_points"))
    clouds = batch["env_points"]
    found = model.predict(torch.from_numpy(clouds), torch.from_numpy(batch["obj_points"]))
    vectors, planes = (found[name].numpy().astype(np.float64) for name in ("vectors", "planes"))
    cells = [
        tag(
            "g",
            grounding(clouds[k].astype(np.float64), vectors[k], planes[k], slots),
            transform=f"translate({_LABEL + (k + 0.5) * _CELL:g} {top + 0.5 * _CELL:g})",
        )
        for k in range(len(clouds))
    ]
    style = {"font_family": "sans-serif", "font_size": 13}
    words = [dataset.task.name, "slots " + ", ".join(map(str, slots))]
    names = [tag("text", word, x=8, y=top + 0.5 * _CELL + 18 * k, **style) for k, word in enumerate(words)]
    return tag("g", *names, *cells)


def grounding(cloud: Floats, vectors: Floats, planes: Floats, slots: Sequence[int]) -> Html:
    """Return a cloud (M, 3) with, for each slot, its two planes as discs and its vector as a line between them.

    vectors (S, 3) unit, planes (S, 2, 3), metres; the drawing is centred on 0 and fills its cell.
    """
    middle = (cloud.min(0) + cloud.max(0)) / 2
    scale = 0.44 * _CELL / max(np.abs((cloud - middle) @ VIEW).max(), 1e-9)

    def place(points: Floats) -> Floats:
        return np.asarray((points - middle) @ VIEW * [scale, -scale])

    dots = [tag("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=0.8) for x, y in place(cloud[:_SHOWN])]
    radius = 0.25 * float(np.ptp(cloud, axis=0).max())
    marks = []
    for slot in slots:
        colour, (p, q) = COLOURS[slot % len(COLOURS)], planes[slot]
        # the planes are parallel: one disc through p, the other where the vector from p meets the plane through q
        end = p + vectors[slot] * ((q - p) @ vectors[slot])
        marks += [_polygon(place(disc(at, vectors[slot], radius)), colour) for at in (p, end)]
        (x1, y1), (x2, y2) = place(np.stack([p, end]))
        ends = {"x1": f"{x1:.1f}", "y1": f"{y1:.1f}", "x2": f"{x2:.1f}", "y2": f"{y2:.1f}"}
        marks.append(tag("line", stroke=colour, stroke_width=2, **ends))
    return tag("g", tag("g", *dots, fill="#8a949e"), *marks)


def disc(middle: Floats, normal: Floats, radius: float) -> Floats:
    """Return the rim (48, 3) of a disc about a point, at right angles to a unit normal."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    rim: Floats = middle + radius * (_CIRCLE @ np.stack([across, np.cross(normal, across)]))
    return rim


def _polygon(points: Floats, colour: str) -> Html:
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return tag("polygon", points=text, fill=colour, fill_opacity=0.18, stroke=colour, stroke_width=1)
