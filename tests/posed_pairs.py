"""Pairs as DATA.md poses them, in world axes, for referees that trust neither the kernels nor FCL; and their ledgers.

Nothing is read from a data folder: the pairs are those of the frozen draw, made again in memory.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eigenbench.generators.building import Block, Maker, build
from eigenbench.generators.compiled import sources_digest
from eigenbench.generators.shapes import Measures, moved
from eigenbench.generators.stock import load_stock
from eigenbench.records import Recipe
from eigenbench.shard_format import REASONS
from eigenbench.tasks import find_task

Points = NDArray[np.float64]
REASON_NAMES = {code: name for name, code in REASONS.items()}
_AT_ONCE = 250


@dataclass(frozen=True)
class PosedPair:
    """One pair in the world frame, metres; `thing + witness` is the placed object."""

    block: Block
    row: int

    def of(self, field: str) -> Any:
        """Return the row's value of a target field."""
        return self.block.targets[field][self.row]

    @property
    def number(self) -> int:
        """Index of the pair in its split."""
        return self.block.first + self.row

    @property
    def name(self) -> str:
        """Say which object is before which environment."""
        return f"{self.of('obj_shape').decode()} in {self.of('env_shape').decode()}"

    @property
    def category(self) -> str:
        """Category of the environment."""
        return str(self.of("env_category").decode())

    def cloud(self, field: str) -> Points:
        """Return `env_points` or `obj_points`, (m, 3)."""
        return self.block.inputs[field][self.row].astype(np.float64)

    @property
    def reason(self) -> str:
        """Name of the reason, `fits` where positive."""
        return REASON_NAMES[int(self.of("reason"))]

    @property
    def witness(self) -> Points:
        """Return where the object's centre is put, (3,), NaN where negative."""
        return np.asarray(self.of("witness"), dtype=np.float64)

    @property
    def env_size(self) -> float:
        """Diameter of the environment's enclosing ball, m: its own, or 1 of a source without unit, times env_scale."""
        library = self.block.maker.stock.of("environment")
        return float(self.of("env_scale")) * (float(library.diameters[self.env_index]) if library.metric else 1.0)

    @property
    def env_index(self) -> int:
        """Index of the environment in its library."""
        return int(self.block.rows.env_index[self.row])

    @cached_property
    def environment(self) -> Points:
        """Triangles (f, 3, 3) of the environment, its exact box about the origin."""
        triangles = self.block.maker.stock.of("environment").triangles(self.env_index)
        return self._about_its_middle(triangles * self.env_size, "env_rotation")[0]

    @cached_property
    def thing(self) -> Points:
        """Triangles (f, 3, 3) of the object, its exact box about the origin."""
        triangles = self.block.maker.stock.of("object").triangles(int(self.block.rows.obj_index[self.row]))
        return self._about_its_middle(triangles * float(self.of("obj_scale")), "obj_rotation")[0]

    @cached_property
    def measures(self) -> Measures:
        """The environment's cavities, top and handle gap as the pair holds them, of a task that turns no scene."""
        library = self.block.maker.stock.of("environment")
        triangles = library.triangles(self.env_index) * self.env_size
        _, centre = self._about_its_middle(triangles, "env_rotation")
        return moved(library.measures[self.env_index], centre / self.env_size, self.env_size, np.asarray)

    def _about_its_middle(self, triangles: Points, rotation: str) -> tuple[Points, Points]:
        w, x, y, z = self.of(rotation).tolist()
        turned = Rotation.from_quat([x, y, z, w]).apply(triangles.reshape(-1, 3))
        centre = (turned.min(axis=0) + turned.max(axis=0)) / 2
        return (turned - centre).reshape(-1, 3, 3), centre


def pairs_of(
    task: str, split: str, shapes: str = "default", seed: int = 0, clouds: bool = False
) -> Iterator[PosedPair]:
    """Give the pairs of a split in order, without end; without clouds unless asked for."""
    recipe = Recipe(task, split, 1_000_000, seed=seed)
    maker = Maker.of(recipe, load_stock(shapes, split, find_task(task)))
    first = 0
    while True:
        block = build(maker, first, _AT_ONCE, clouds=clouds)
        for row in range(_AT_ONCE):
            yield PosedPair(block, row)
        first += _AT_ONCE


def indexed(triangles: Points) -> tuple[Points, NDArray[np.int64]]:
    """Return triangles (f, 3, 3) as vertices and faces, equal corners shared."""
    vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return np.ascontiguousarray(vertices), faces.reshape(-1, 3)


def _digest_of_referees() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.name in ("convex_parts.py", "posed_pairs.py") or path.name.startswith("referee_"):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


class Ledger:
    """Findings, one JSON object a line, so that an interrupted run goes on where it stopped.

    A ledger of other sources, of the generators or of the referees, or of other arguments is begun afresh.
    """

    def __init__(self, path: Path, **about: Any) -> None:
        self.path, self.rows = path, {}
        head = {"sources": sources_digest(), "referee": _digest_of_referees(), **about}
        lines = path.read_text().splitlines() if path.is_file() else []
        if lines and json.loads(lines[0]) == head:
            self.rows = {row["key"]: row for row in map(json.loads, lines[1:])}
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(head) + "\n")

    def __contains__(self, key: str) -> bool:
        """Say whether something was found already."""
        return key in self.rows

    def add(self, key: str, **finding: Any) -> None:
        """Write a finding at once."""
        self.rows[key] = {"key": key, **finding}
        with self.path.open("a") as handle:
            handle.write(json.dumps(self.rows[key]) + "\n")


def as_markdown(rows: list[dict[str, Any]]) -> str:
    """Return rows of equal keys as a Markdown table."""
    head = list(rows[0])
    lines = [head, ["---"] * len(head), *([str(row[k]) for k in head] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
