"""Which shapes there are, and picking some of them: by role, category, split and index.

Within a role and category the index counts the training shapes first, then the test shapes.
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from eigenbench.errors import ShapeError, UsageError, choose
from eigenbench.generators.holdings import COUNTS, ROLES, indices
from eigenbench.generators.shapes import Shape
from eigenbench.generators.sources import load_shapes
from eigenbench.tasks import SPLITS


@dataclass(frozen=True, slots=True)
class Shelf:
    """All shapes of a source: how many, and how to get one.

    Attributes
    ----------
    counts : shapes by (role, category) and split; categories without shapes are left out
    shapes : those that had to be read, by (role, category); empty where they are made on demand
    refused : reason by shape
    measuring : whether shapes that come without measures are measured when they are fetched
    """

    counts: dict[tuple[str, str], dict[str, int]]
    shapes: dict[tuple[str, str], list[Shape]]
    refused: dict[str, str]
    measuring: bool = False

    def shape(self, role: str, category: str, index: int) -> Shape:
        """Return one shape; a mug without a handle stays as it is."""
        from eigenbench.generators.catalogue import make_shape  # here, since counting needs neither
        from eigenbench.generators.measuring import measured

        if (role, category) not in self.shapes:
            return make_shape(role, category, index)
        shape = self.shapes[role, category][index]
        if self.measuring:
            with contextlib.suppress(ShapeError):
                return measured(shape, role)
        return shape

    def rows(self) -> list[dict[str, str | int]]:
        """Return role, category, split and count of all that there is, by role, category and split."""
        return [
            {"role": role, "category": category, "split": split, "count": splits[split]}
            for (role, category), splits in self.counts.items()
            for split in SPLITS
            if splits.get(split)
        ]


@dataclass(frozen=True, slots=True)
class Selection:
    """Some shapes of one role and category, made or read when they are asked for.

    Attributes
    ----------
    shelf : where they come from
    role, category : of all of them
    indices : which
    """

    shelf: Shelf
    role: str
    category: str
    indices: tuple[int, ...]

    @property
    def splits(self) -> dict[str, int]:
        """Number of shapes of the category per split, selected or not."""
        return self.shelf.counts[self.role, self.category]

    def split_of(self, index: int) -> str:
        """Return the split of the shape with an index."""
        return "train" if index < self.splits.get("train", 0) else "test"

    def shapes(self) -> Iterator[tuple[int, Shape]]:
        """Give (index, shape) of each."""
        for index in self.indices:
            yield index, self.shelf.shape(self.role, self.category, index)


def open_source(source: str, *, measuring: bool = False) -> Shelf:
    """Return the shapes of a source; those of `default` are counted, not made.

    With `measuring`, shapes of a user's folder are measured as they are fetched.

    UsageError for an unknown source, ShapeError where it holds no usable shape.
    """
    if source == "default":
        keys = [(r, c) for r in ROLES for c in sorted({*COUNTS[r]["train"], *COUNTS[r]["test"]})]
        return Shelf({(r, c): {s: len(indices(r, s, c)) for s in SPLITS} for r, c in keys}, {}, {})
    counts: dict[tuple[str, str], dict[str, int]] = {}
    shapes: dict[tuple[str, str], list[Shape]] = {}
    refused: dict[str, str] = {}
    troubles = []
    for role, split in ((r, s) for r in ROLES for s in SPLITS):
        try:
            found, bad = load_shapes(source, role, split)
        except ShapeError as error:
            troubles.append(error)
            refused |= error.refused
            continue
        refused |= bad
        for shape in found:
            key = role, shape.category
            shapes.setdefault(key, []).append(shape)
            counts.setdefault(key, {}).setdefault(split, 0)
            counts[key][split] += 1
    if not shapes:
        raise next((t for t in troubles if t.refused), troubles[0])
    return Shelf(
        dict(sorted(counts.items(), key=lambda c: (ROLES.index(c[0][0]), c[0][1]))), shapes, refused, measuring
    )


def select(
    shelf: Shelf,
    role: str | None = None,
    category: str | None = None,
    split: str | None = None,
    chosen: Sequence[int] = (),
    count: int | None = None,
) -> list[Selection]:
    """Return shapes of each role and category that fit; None means any.

    Of each the `chosen` indices are taken, else `count` shapes, evenly spread, else all.

    UsageError for an unknown role, category or split, a combination that nothing fits, indices without
    one category or outside it, a count below 1.
    """
    keys = _keys(shelf, role, category, split)
    if chosen and len(keys) > 1:
        options = ", ".join(f"{r} {c}" for r, c in keys)
        msg = f"An index needs one role and category, but these fit: {options}. Name a category, and `--role`."
        raise UsageError(msg)
    if count is not None and count < 1:
        msg = f"Number of shapes is {count}; at least 1 is needed."
        raise UsageError(msg)
    return [Selection(shelf, *key, _indices(shelf.counts[key], key, split, chosen, count)) for key in keys]


def _keys(shelf: Shelf, role: str | None, category: str | None, split: str | None) -> list[tuple[str, str]]:
    if role is not None:
        choose("role", role, ROLES)
    if split is not None:
        choose("split", split, SPLITS)
    if category is not None:
        choose("category", category, sorted({c for r, c in shelf.counts if role in (None, r)}))
    keys = [
        (r, c)
        for (r, c), splits in shelf.counts.items()
        if role in (None, r) and category in (None, c) and (split is None or splits.get(split))
    ]
    if not keys:
        wanted = ", ".join(f"{k} {v}" for k, v in (("role", role), ("category", category), ("split", split)) if v)
        msg = f"There is no shape of {wanted}; `eigenbench shapes list` shows what there is."
        raise UsageError(msg)
    return keys


def _indices(
    splits: dict[str, int], key: tuple[str, str], split: str | None, chosen: Sequence[int], count: int | None
) -> tuple[int, ...]:
    train, test = (splits.get(s, 0) for s in SPLITS)
    every = {None: range(train + test), "train": range(train), "test": range(train, train + test)}[split]
    for index in chosen:
        if index not in every:
            of = f"{key[0]} {key[1]}" + (f", {split}," if split else "")
            msg = f"Index {index} is out of range: {of} has the indices {every.start} to {every.stop - 1}."
            raise UsageError(msg)
    shown = len(every) if count is None else min(count, len(every))
    return tuple(chosen) or tuple(every[k * len(every) // shown] for k in range(shown))
