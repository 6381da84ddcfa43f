"""The shapes of one role and split, normalised and packed for the kernels; built once, cached on disk."""

import contextlib
import hashlib
import json
from collections import Counter
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from platform import node
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from eigenbench.cache import cache_folder
from eigenbench.errors import DataError, GenerationError, ShapeError, UsageError
from eigenbench.generators.compiled import sources_digest
from eigenbench.generators.measures import enclosing_ball
from eigenbench.generators.measuring import measured
from eigenbench.generators.shapes import Measures, Shape, measures_from_json, measures_to_json, moved
from eigenbench.generators.sources import absolute_source, load_shapes, none_usable, parse_source
from eigenbench.generators.surface import Surface, alias_table
from eigenbench.shard_format import round_to
from eigenbench.shards import publish, temporary_beside, write_text_atomically

VERTEX_BITS = 26
"""Normalised vertices lie on a grid of 2^-26, so that a last-bit difference changes no byte."""
HULL = "QJ Pp"
"""Qhull joggles its input by about 1e-11, with a fixed seed, instead of merging the coplanar faces that furniture and
lathe-turned shapes are full of: half the time, the same extents to 1e-15, a few coplanar vertices more."""
FLAT = 1e-6
"""A shape is refused as flat if its hull's volume is below this share of its enclosing ball's."""
ROOM_ROLES = ("room", "paper_room")
"""Roles of rooms: hundreds, or one a split; they are packed as they stand."""
_NAME_BYTES, _CATEGORY_BYTES = 96, 32


@dataclass(frozen=True, slots=True, eq=False)
class Library:
    """The shapes of one role and split, each centred in its smallest enclosing ball, of diameter 1.

    Attributes
    ----------
    surface : the packed shapes, ordered by category
    names : (K,) bytes, `category/name`
    categories : (K,) bytes
    diameters : (K,) diameter of each enclosing ball before scaling, in the source's unit
    measures : of each shape, in the packed frame
    metric : the source's unit is the metre
    refused : reason by shape name
    digest : sha256 of names, categories, measures and arrays
    path : the file that holds all this, for workers
    """

    surface: Surface
    names: NDArray[np.bytes_]
    categories: NDArray[np.bytes_]
    diameters: NDArray[np.float64]
    measures: tuple[Measures, ...]
    metric: bool
    refused: dict[str, str]
    digest: str
    path: Path

    def triangles(self, shape: int) -> NDArray[np.float64]:
        """Return the (f, 3, 3) corners of a shape's faces, in its rest frame at size 1."""
        start = self.surface.face_start
        rows = self.surface.triangles[start[shape] : start[shape + 1]]
        return np.stack([rows[:, 0], rows[:, 0] + rows[:, 1], rows[:, 0] + rows[:, 2]], axis=1)

    def hull(self, shape: int) -> NDArray[np.float64]:
        """Return the (h, 3) hull vertices of a shape, in its rest frame at size 1."""
        start = self.surface.hull_start
        return self.surface.hull[start[shape] : start[shape + 1]]

    @property
    def used(self) -> dict[str, int]:
        """Number of shapes per category."""
        return {c.decode(): int(n) for c, n in sorted(Counter(self.categories.tolist()).items())}


def load_library(source: str, split: str, role: str = "object") -> Library:
    """Build or fetch the shapes of a split and role from a source, see `sources.parse_source`.

    UsageError for another source, ShapeError where no usable shape is left.
    """
    if role in ROOM_ROLES and parse_source(source).kind != "default":
        return _rooms(source, split, role)
    if parse_source(source).kind != "default":
        return _pack(*_measured(*load_shapes(source, role, split), role), metric=False)
    note = cache_folder() / "shapes" / f"default-{_default_key()}-{role}-{split}"
    if note.is_file():
        with contextlib.suppress(DataError):
            return open_library(note.parent / Path(note.read_text()).name)
    library = (
        _rooms(source, split, role) if role in ROOM_ROLES else _pack(*load_shapes(source, role, split), metric=True)
    )
    write_text_atomically(note, library.path.name)
    return library


@dataclass(frozen=True, slots=True)
class LibraryReference:
    """How a worker, perhaps on another machine, finds a library: at `path`, or made again from the rest."""

    path: Path
    source: str
    split: str
    role: str
    digest: str


def refer_to(library: Library, source: str, split: str, role: str = "object") -> LibraryReference:
    """Return the reference of what `load_library` gave for the same arguments."""
    return LibraryReference(library.path.absolute(), absolute_source(source), split, role, library.digest)


def find_library(wanted: LibraryReference) -> Library:
    """Open a library where its reference says, or in this machine's cache, or make it again.

    GenerationError if this machine does not see the shapes, or makes other ones from them.
    """
    for path in dict.fromkeys((wanted.path, _place(wanted.digest))):
        if path.is_file():
            with contextlib.suppress(DataError):
                return open_library(path)
    try:
        library = load_library(wanted.source, wanted.split, wanted.role)
    except (ShapeError, UsageError) as error:
        msg = (
            f"A worker on {node()} has no {wanted.role} shapes: {error} "
            "Every worker must see the folder of the shapes at the same path."
        )
        raise GenerationError(msg) from error
    if library.digest != wanted.digest:
        msg = (
            f"A worker on {node()} makes other {wanted.role} shapes from '{wanted.source}': digest "
            f"{library.digest[:12]} instead of {wanted.digest[:12]}. Its folder or its libraries are not the same."
        )
        raise GenerationError(msg)
    return library


def _place(digest: str) -> Path:
    """Return where the cache keeps a library."""
    return cache_folder() / "shapes" / f"{digest[:32]}.npz"


def _rooms(source: str, split: str, role: str) -> Library:
    from eigenbench.generators.room_library import load_rooms  # here, since rooms are furnished from libraries

    return pack_in_place(load_rooms(source, split, role))


def _measured(shapes: list[Shape], refused: dict[str, str], role: str) -> tuple[list[Shape], dict[str, str]]:
    """Measure shapes that come without measures; those that cannot serve in their role join `refused`."""
    kept, refused = [], dict(refused)
    for shape in shapes:
        try:
            kept.append(measured(shape, role))
        except ShapeError as error:
            refused[f"{shape.category}/{shape.name}"] = str(error)
    return kept, refused


def _default_key() -> str:
    """Return what the built-in shapes depend on: the sources that make them and their libraries."""
    digest = hashlib.sha256(sources_digest().encode())
    for package in ("numpy", "scipy", "manifold3d"):
        digest.update(version(package).encode())
    return digest.hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class _Packed:
    """One shape's rows of a `Surface`, its measures, and the diameter of its enclosing ball before scaling."""

    triangles: NDArray[np.float64]
    keep: NDArray[np.uint32]
    other: NDArray[np.int32]
    hull: NDArray[np.float64]
    measures: Measures
    diameter: float


def normalise(shape: Shape) -> _Packed:
    """Centre a shape in its smallest enclosing ball, scale that to diameter 1, and prepare its sampling.

    ShapeError if the shape has no area or is flat.
    """
    vertices, faces = shape.mesh.vertices, shape.mesh.faces
    with np.errstate(over="ignore"):
        spread = float(np.ptp(vertices, axis=0).max())
    if not 0.0 < spread < np.inf or not np.isfinite(1.0 / spread):
        msg = f"has a size of {spread:g}: its vertices coincide, or are too far apart to compute with"
        raise ShapeError(msg)
    corner = vertices.min(axis=0)
    vertices = (vertices - corner) / spread
    try:
        hull = ConvexHull(vertices, qhull_options=HULL)
    except QhullError as error:
        msg = "is flat: its vertices lie in one plane or line"
        raise ShapeError(msg) from error
    centre, radius = enclosing_ball(vertices[hull.vertices])
    if hull.volume < FLAT * 4 / 3 * np.pi * radius**3:
        msg = "is flat: its convex hull has no volume"
        raise ShapeError(msg)
    unit = round_to((vertices - centre) / (2 * radius), VERTEX_BITS)
    diameter = 2 * radius * spread
    measures = moved(shape.measures, corner + centre * spread, 1 / diameter, lambda p: round_to(p, VERTEX_BITS))
    corners = unit[faces]
    triangles = np.stack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    keep, other, area = alias_table(triangles)
    if area == 0.0:
        msg = "has zero area"
        raise ShapeError(msg)
    return _Packed(triangles, keep, other, np.unique(unit[hull.vertices], axis=0), measures, diameter)


def _pack(shapes: list[Shape], refused: dict[str, str], metric: bool) -> Library:
    """Normalise and pack shapes, which are sorted by category; the unusable join `refused`."""
    refused = dict(refused)
    kept: list[Shape] = []
    packed: list[_Packed] = []
    for shape in shapes:
        try:
            packed.append(normalise(shape))
            kept.append(shape)
        except ShapeError as error:
            refused[f"{shape.category}/{shape.name}"] = str(error)
    if not kept:
        msg = "No shape can be used"
        raise none_usable(msg, refused)
    categories = np.array([_short(s.category, _CATEGORY_BYTES) for s in kept], dtype=f"S{_CATEGORY_BYTES}")
    surface = Surface(
        np.concatenate([p.triangles for p in packed]),
        np.concatenate([p.keep for p in packed]),
        np.concatenate([p.other for p in packed]),
        _starts([len(p.triangles) for p in packed]),
        np.concatenate([p.hull for p in packed]),
        _starts([len(p.hull) for p in packed]),
        _starts([n for _, n in sorted(Counter(categories.tolist()).items())]),
    )
    return _store(
        surface,
        np.array([_short(f"{s.category}/{s.name}", _NAME_BYTES) for s in kept], dtype=f"S{_NAME_BYTES}"),
        categories,
        np.array([p.diameter for p in packed]),
        tuple(p.measures for p in packed),
        metric,
        refused,
    )


def pack_in_place(soups: dict[str, NDArray[np.float64]]) -> Library:
    """Pack triangles (f, 3, 3) by their `category/name`, sorted by it, as they stand in metres: size 1 is a metre.

    Their hulls are the corners of their boxes; no points are drawn on them.
    """
    categories = np.array([_short(name.partition("/")[0], _CATEGORY_BYTES) for name in soups], f"S{_CATEGORY_BYTES}")
    boxes = [np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))]) for corners in soups.values()]
    faces = [len(corners) for corners in soups.values()]
    surface = Surface(
        np.concatenate([np.stack([c[:, 0], c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]], axis=1) for c in soups.values()]),
        np.full(sum(faces), np.uint32(0xFFFFFFFF)),
        np.concatenate([np.arange(n, dtype=np.int32) for n in faces]),
        _starts(faces),
        np.concatenate([np.array(list(product(*box.T))) for box in boxes]),
        _starts([8] * len(boxes)),
        _starts([n for _, n in sorted(Counter(categories.tolist()).items())]),
    )
    names = np.array([_short(name, _NAME_BYTES) for name in soups], dtype=f"S{_NAME_BYTES}")
    return _store(surface, names, categories, np.ones(len(boxes)), (Measures(),) * len(boxes), True, {})


def _short(text: str, size: int) -> bytes:
    """Return a name in at most `size` bytes of UTF-8; a longer one ends in a digest of the whole."""
    name = text.encode(errors="replace")
    if len(name) <= size:
        return name
    return name[: size - 17].decode(errors="ignore").encode() + b"~" + hashlib.sha256(name).hexdigest()[:16].encode()


def _starts(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _digest(arrays: dict[str, NDArray[np.generic]]) -> str:
    digest = hashlib.sha256()
    for name, values in arrays.items():
        digest.update(f"{name} {values.dtype} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).view(np.uint8).data)
    return digest.hexdigest()


def _store(
    surface: Surface,
    names: NDArray[np.bytes_],
    categories: NDArray[np.bytes_],
    diameters: NDArray[np.float64],
    measures: tuple[Measures, ...],
    metric: bool,
    refused: dict[str, str],
) -> Library:
    """Write the packed shapes into the cache, under their digest, and return them."""
    text = json.dumps([measures_to_json(m) for m in measures]).encode()
    arrays = {**surface._asdict(), "names": names, "categories": categories, "diameters": diameters}
    arrays["measures"] = np.frombuffer(text, dtype=np.uint8)
    arrays["metric"] = np.array(metric)
    digest = _digest(arrays)
    path = _place(digest)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_beside(path)
    try:
        with temporary.open("wb") as handle:
            np.savez(handle, refused=np.array(json.dumps(refused)), **arrays)
        publish(temporary, path)
    except OSError as error:
        msg = f"Cannot write the shape cache {path}: {error.strerror}. Set EIGENBENCH_CACHE to a place with room."
        raise GenerationError(msg) from error
    finally:
        temporary.unlink(missing_ok=True)
    return Library(surface, names, categories, diameters, measures, metric, refused, digest, path)


def open_library(path: Path) -> Library:
    """Read packed shapes back; DataError if the file is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {
                k: stored[k] for k in (*Surface._fields, "names", "categories", "diameters", "measures", "metric")
            }
            refused = json.loads(str(stored["refused"]))
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
        msg = f"Shape cache {path} cannot be read: {error}. Delete it and run again."
        raise DataError(msg) from error
    digest = _digest(arrays)
    if path.stem != digest[:32]:
        msg = f"Shape cache {path} is damaged: its content has digest {digest[:32]}. Delete it and run again."
        raise DataError(msg)
    surface = Surface(**{k: arrays[k] for k in Surface._fields})
    measures = tuple(measures_from_json(m) for m in json.loads(arrays["measures"].tobytes()))
    return Library(
        surface,
        arrays["names"],
        arrays["categories"],
        arrays["diameters"],
        measures,
        bool(arrays["metric"]),
        refused,
        digest,
        path,
    )
