"""What several tests are made of: places, simple meshes, small models."""

from pathlib import Path

import numpy as np

from eigenbench.checking import toy_clouds
from eigenbench.generators.solids import Mesh
from eigenbench.hosting import Answer, HostedModel, HostOptions
from eigenbench.records import Arrays
from eigenbench.shards import settle, staged_shard
from eigenbench.tasks import TASKS

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
HONEST = "import numpy as np\nclass Model:\n    def predict(self, env, obj):\n        "
GOOD = "return {'probability': np.full(len(env), 0.5)}"
EVERY = (*TASKS, "box-110010")
"""Every task, and a box with a lonely floor."""
ENV, OBJ = toy_clouds(np.random.default_rng(1))


def box_mesh(x: float, y: float, z: float) -> Mesh:
    """Return a box of the given extents about the origin, outward faces."""
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * [x / 2, y / 2, z / 2]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])])
    return Mesh(corners, faces)


def write_obj(path: Path, mesh: Mesh) -> None:
    """Write a mesh as Wavefront OBJ."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


def model(tmp_path: Path, body: str, name: str = "model.py") -> Path:
    """Write a model whose predict has the given body, or a whole file if it has lines."""
    path = tmp_path / "submission" / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(body if "\n" in body else HONEST + body + "\n")
    return path


def answer(path: Path, **options) -> tuple[Answer, dict]:
    """Return a hosted model's answer for the toy clouds, and the isolation it ran under."""
    with HostedModel(path, TASKS["tube"], HostOptions(**options)) as hosted:
        return hosted.predict(ENV, OBJ), hosted.isolation


def is_watertight(mesh: Mesh) -> bool:
    """Say whether every directed edge is met by exactly one face on its other side."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    forward = np.sort(edges[:, 0] * len(mesh.vertices) + edges[:, 1])
    backward = np.sort(edges[:, 1] * len(mesh.vertices) + edges[:, 0])
    return bool(np.all(np.diff(forward) > 0) and np.array_equal(forward, backward))


def write_shard(path: Path, file: str, arrays: Arrays, about: dict) -> str:
    """Write one shard file over whatever is there, and return its content digest."""
    with staged_shard(path, file, arrays, about) as staged:
        settle(staged, TASKS["tube"], before_replacing=lambda: None)
    return staged.digest
