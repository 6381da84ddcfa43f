"""Which runs have the same answers? By the digest that they claim, and by what their packs hold, whatever they claim.

An entry's record says which digest its predictions had, and nothing in a pack can prove that. So packs are compared
too: decisions, ranking, groups, lengths and vectors of the analysis pairs, probabilities. Numbers count to single
precision, so that a run told in another type is still the same run; and an array that one of both leaves out tells
nothing apart.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.errors import DataError
from eigenbench.frozen_subsets import ANALYSIS_PAIRS
from eigenbench.leaderboard.chain import MAX_PACK, pack_name, read_file
from eigenbench.leaderboard.packing import Pack, read_pack
from eigenbench.leaderboard.standing import Entry


@dataclass(frozen=True, slots=True)
class Answers:
    """What tells a run's answers from those of another.

    Attributes
    ----------
    claimed : the digest of its predictions, by its result
    held : digest of what every pack of its kind holds, empty if its pack cannot be read
    more : digests of what a pack may hold beside that, each empty where it does not
    """

    claimed: str
    held: str = ""
    more: tuple[str, ...] = ()

    def same(self, other: "Answers") -> bool:
        """Say whether two runs of a task have the same answers."""
        if self.claimed == other.claimed:
            return True
        if not self.held or self.held != other.held:
            return False
        return all(a == b or not a or not b for a, b in zip(self.more, other.more, strict=True))


def answers_of(claimed: str, pack: Pack) -> Answers:
    """Return what tells a run's answers from others, from the digest that it claims and its pack."""
    held = hashlib.sha256(repr(pack.groups).encode())
    held.update(np.packbits(pack.decision).tobytes() + pack.order.astype("<u4").tobytes())
    optional = {"vectors": pack.analysis.get("vectors"), "probability": pack.probability}
    if pack.groups is None:  # a probability decided, so every such pack has one
        held.update(_digest(optional.pop("probability")).encode())
    else:
        held.update("".join(_digest(pack.analysis[side]) for side in ("env_lengths", "obj_lengths")).encode())
    return Answers(claimed, held.hexdigest(), tuple(map(_digest, optional.values())))


def _digest(values: NDArray[Any] | None) -> str:
    """Return the sha256 of numbers in single precision, both zeros the same; empty of none."""
    if values is None:
        return ""
    single = values.astype("<f4") + np.float32(0)
    return hashlib.sha256(f"{single.shape}".encode() + single.tobytes()).hexdigest()


def answers_in(entry: Entry) -> list[Answers]:
    """Return the answers of an entry's runs, read from its packs; DataError if one cannot be read."""
    found = []
    for k, claimed in enumerate(entry.predictions):
        path = entry.folder / pack_name(k)
        pack = read_pack(
            read_file(path, MAX_PACK), f"{entry.folder.name}/{path.name}", entry.body["data"]["pairs"], ANALYSIS_PAIRS
        )
        found.append(answers_of(claimed, pack))
    return found


def answers_claimed(entry: Entry) -> list[Answers]:
    """Return the answers of an entry's runs as far as its record tells them."""
    return [Answers(claimed) for claimed in entry.predictions]


def one_twice(answers: Sequence[Answers]) -> tuple[int, int] | None:
    """Return the first two runs, from 0, that have the same answers; None if all differ."""
    for k, one in enumerate(answers):
        for j in range(k):
            if answers[j].same(one):
                return j, k
    return None


def check_not_there(task: str, own: Sequence[Answers], entries: Sequence[Entry]) -> None:
    """Refuse answers that an earlier entry on their task has, unless that was withdrawn undoubted; DataError."""
    for entry in entries:
        if entry.task != task or entry.released:
            continue
        try:
            there = answers_in(entry)
        except DataError:  # `verify` says so; what that entry claims still counts
            there = answers_claimed(entry)
        if any(a.same(b) for a in own for b in there):
            hint = {
                "refuted": "A challenge to it was upheld, so they cannot come again.",
                "withdrawn": "A challenge to it is open: they may come again once it is dismissed.",
            }.get(entry.status, "An entry can be withdrawn first.")
            msg = (
                f"Entry {entry.number} ('{entry.body['model']['name']}') has the same predictions on {task}: it is "
                f"there already. {hint}"
            )
            raise DataError(msg)
