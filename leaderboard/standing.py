"""How the entries of a board stand: their badges, open challenges, what was withdrawn or refuted."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eigenbench.leaderboard.chain import Link
from eigenbench.leaderboard.records import BADGES, LEAST_EQUAL, Record

_SEEDS = {1: "one seed", 2: "two seeds"}


@dataclass(slots=True)
class Entry:
    """One submission and all that came after it.

    Attributes
    ----------
    number, date, folder, body : of its record
    badge : the best that it was given
    confirmed : the records of its badges
    challenges : records of the challenges to it, each with its answer or None
    withdrawn : the record that withdrew it
    """

    number: int
    date: str
    folder: Path
    body: dict[str, Any]
    badge: str = BADGES[0]
    confirmed: list[Record] = field(default_factory=list)
    challenges: list[tuple[Record, Record | None]] = field(default_factory=list)
    withdrawn: Record | None = None

    @property
    def task(self) -> str:
        """Its task."""
        return str(self.body["task"])

    @property
    def predictions(self) -> list[str]:
        """The digests of its runs' predictions."""
        return [run["predictions"] for run in self.body["runs"]]

    @property
    def status(self) -> str:
        """`refuted` (a challenge was upheld), `withdrawn`, `challenged` (one is open), or `ranked`."""
        if any(answer is not None and answer.body["upheld"] for _, answer in self.challenges):
            return "refuted"
        if self.withdrawn is not None:
            return "withdrawn"
        return "challenged" if any(answer is None for _, answer in self.challenges) else "ranked"

    @property
    def released(self) -> bool:
        """Whether its predictions may come again: it was withdrawn, and no challenge to it is open or upheld."""
        return self.status == "withdrawn" and all(answer is not None for _, answer in self.challenges)

    @property
    def seeds(self) -> str:
        """How many seeds there are, in words: fewer than three are marked."""
        count = len(self.body["runs"])
        return _SEEDS.get(count, f"{count} seeds")


def entries_of(links: Sequence[Link]) -> list[Entry]:
    """Return the entries of a chain with all that concerns them; records that concern none are passed over."""
    after = [entries for _, _, entries in standings(links)]
    return list(after[-1].values()) if after else []


def standings(links: Sequence[Link]) -> Iterator[tuple[Link, str, dict[int, Entry]]]:
    """Yield each record, its fault or empty, and the entries by number as they stand after it.

    The entries are the same objects throughout, so they are to be looked at before the next record is asked for.
    """
    entries: dict[int, Entry] = {}
    for link in links:
        fault = reference_fault(link.record.kind, link.record.body, entries)
        fault = fault or badge_fault(link.record.kind, link.record.body, entries)
        if not fault:
            _take(link, entries)
        yield link, fault, entries


def reference_faults(links: Sequence[Link]) -> Iterator[tuple[int, str]]:
    """Yield (number, fault) of records that concern no earlier entry or challenge, or one that is done with.

    And of badges that do not say what their level demands.
    """
    return ((link.record.number, fault) for link, fault, _ in standings(links) if fault)


def badge_fault(kind: str, body: dict[str, Any], entries: Mapping[int, Entry]) -> str:
    """Say why a record is no proof that an entry of `entries` was run again, empty if it is, or does not say so."""
    if kind != "badge" or body["badge"] != BADGES[-1]:
        return ""
    equal, runs = body["equal_decisions"], len(entries[body["entry"]].body["runs"])
    if equal is None or not LEAST_EQUAL <= equal <= 1:
        shown = "none" if equal is None else f"{equal:g}"
        return f"it says '{BADGES[-1]}' with {shown} of the decisions equal; that takes {LEAST_EQUAL:g} to 1"
    if len(body["predictions"]) != runs:
        return f"it says '{BADGES[-1]}' with {len(body['predictions'])} other runs, the entry has {runs}"
    return ""


def reference_fault(kind: str, body: dict[str, Any], entries: Mapping[int, Entry]) -> str:
    """Say why a record of a kind cannot follow on a board with such entries, empty if it can."""
    if kind in ("board", "entry"):
        return ""
    if kind == "answer":
        return _answer_fault(body["challenge"], entries)
    number = body["entry"]
    entry = entries.get(number)
    if entry is None:
        return f"record {number} is no entry that came before"
    if entry.withdrawn is not None:
        return f"entry {number} was withdrawn by record {entry.withdrawn.number}"
    if kind == "badge" and BADGES.index(body["badge"]) <= BADGES.index(entry.badge):
        return f"entry {number} has the badge '{entry.badge}' already"
    return ""


def _answer_fault(number: int, entries: Mapping[int, Entry]) -> str:
    for entry in entries.values():
        for challenge, answer in entry.challenges:
            if challenge.number == number:
                return "" if answer is None else f"challenge {number} was answered by record {answer.number}"
    return f"record {number} is no challenge that came before"


def _take(link: Link, entries: dict[int, Entry]) -> None:
    """Let a record act on the entries that came before it."""
    record, body = link.record, link.record.body
    if record.kind == "entry":
        entries[record.number] = Entry(record.number, record.date, link.folder, body)
    elif record.kind == "badge":
        concerned = entries[body["entry"]]
        concerned.confirmed.append(record)
        concerned.badge = body["badge"]
    elif record.kind == "challenge":
        entries[body["entry"]].challenges.append((record, None))
    elif record.kind == "withdrawal":
        entries[body["entry"]].withdrawn = record
    elif record.kind == "answer":
        for entry in entries.values():
            entry.challenges = [(c, record if c.number == body["challenge"] else a) for c, a in entry.challenges]
