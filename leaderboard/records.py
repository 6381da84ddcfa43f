"""The records of a board: what each kind must hold, checked field by field before anything trusts it.

A record is one JSON file. Kinds: `board` opens the chain and fixes the data, `entry` is a submission, `badge` says who
confirmed an entry and how, `challenge` doubts one, `answer` decides a challenge, `withdrawal` takes an entry back.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from eigenbench.errors import DataError, printable
from eigenbench.headline import HEADLINE

BOARD_VERSION = 1
BADGES = ("self-reported", "rescored", "re-run")
"""What is known of an entry, the least first: its submitter says so, its numbers follow from its predictions, somebody
else ran the model."""
LEAST_EQUAL = 0.99
"""Share of the decisions in which another run of the same model must agree to confirm an entry: machines round
differently, which moves the pairs nearest to a model's boundary and no others."""
MAX_SEEDS = 10
_NAME, _LINE, _TEXT, _LINKS, _PARAMETERS = 80, 300, 2000, 8, 10**15
_TASK_NAME = re.compile(r"[a-z0-9-]{1,40}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_LINK = re.compile(r"https://[A-Za-z0-9.-]+\.[A-Za-z]{2,}(:\d{1,5})?(/[!#-;=?-~]*)?")

Check = Callable[[Any], bool]
Rule = tuple[Check, str]
"""A test of a value, and what it demands in words."""
Schema = Mapping[str, Rule]


@dataclass(frozen=True, slots=True)
class Record:
    """One link of the chain.

    Attributes
    ----------
    number : its place, 0 is the board itself
    kind : one of `KINDS`
    previous : sha256 of the file of the record before, empty for the first
    date : when it was written, UTC, ISO 8601
    body : what the kind demands (`KINDS`)
    board_version : version of this format
    """

    number: int
    kind: str
    previous: str
    date: str
    body: dict[str, Any]
    board_version: int = BOARD_VERSION

    def content(self) -> bytes:
        """Return the bytes of its file."""
        return (json.dumps(asdict(self), indent=1, allow_nan=False) + "\n").encode()


def sha256(content: bytes) -> str:
    """Return the sha256 of a file's content."""
    return hashlib.sha256(content).hexdigest()


def read_record(content: bytes, place: str) -> Record:
    """Return the record that a file holds; DataError names the place, the field, its value and the rule."""
    try:
        found = json.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        msg = f"{place} is no JSON: {error}. Restore it from the board's history."
        raise DataError(msg) from error
    version = found.get("board_version") if isinstance(found, dict) else None
    if version != BOARD_VERSION:
        msg = f"{place} has board version {_shown(version)}, this eigenbench reads {BOARD_VERSION}."
        raise DataError(msg)
    _check(found, _RECORD, place)
    if found["kind"] not in KINDS:
        msg = f"{place} is of kind {_shown(found['kind'])}; known: {', '.join(KINDS)}."
        raise DataError(msg)
    check_body(found["kind"], found["body"], place)
    return Record(**found)


def check_body(kind: str, body: Any, place: str) -> None:
    """Check what a record of a kind holds; DataError names the place, the field, its value and the rule."""
    _check(body, KINDS[kind], place)


def _check(found: Any, schema: Schema, place: str) -> None:
    if not isinstance(found, dict):
        msg = f"{place} is {_shown(found)}, it must be an object."
        raise DataError(msg)
    for name, (is_good, rule) in schema.items():
        if name not in found:
            msg = f"{place} lacks '{name}'; it must be {rule}."
            raise DataError(msg)
        if not is_good(found[name]):
            msg = f"{place}: '{name}' is {_shown(found[name])}; it must be {rule}."
            raise DataError(msg)
    if unknown := set(found) - set(schema):
        msg = f"{place} has an unknown field '{printable(min(unknown))[:60]}'; known: {', '.join(schema)}."
        raise DataError(msg)


def _shown(value: Any) -> str:
    shown = printable(repr(value))
    return shown if len(shown) <= 100 else shown[:100] + "..."


def _text(longest: int, *, empty: bool = False) -> Rule:
    def is_good(value: Any) -> bool:
        return isinstance(value, str) and (empty or bool(value.strip())) and len(value) <= longest

    return is_good, f"a text of {'up to' if empty else '1 to'} {longest} characters"


def _whole(low: int, high: int) -> Rule:
    return lambda v: type(v) is int and low <= v <= high, f"a whole number from {low} to {high}"


def _or_none(rule: Rule) -> Rule:
    is_good, words = rule
    return lambda v: v is None or is_good(v), f"{words}, or null"


def _list_of(rule: Rule, low: int, high: int) -> Rule:
    is_good, words = rule
    return (
        lambda v: isinstance(v, list) and low <= len(v) <= high and all(map(is_good, v)),
        f"a list of {low} to {high}, each {words}",
    )


def _object(schema: Schema) -> Rule:
    def is_good(value: Any) -> bool:
        same = isinstance(value, dict) and value.keys() == schema.keys()
        return same and all(check(value[name]) for name, (check, _) in schema.items())

    return is_good, "an object of " + ", ".join(f"{name} ({words})" for name, (_, words) in schema.items())


def _map_of(key: Check, rule: Rule, what: str) -> Rule:
    is_good, words = rule
    return (
        lambda v: isinstance(v, dict) and bool(v) and all(key(k) and is_good(x) for k, x in v.items()),
        f"an object by {what}, each {words}",
    )


def _is_date(value: Any) -> bool:
    try:
        return isinstance(value, str) and datetime.fromisoformat(value).utcoffset() is not None
    except ValueError:
        return False


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < 1e12  # NaN and infinity are not below


def _matches(pattern: re.Pattern[str], words: str) -> Rule:
    return lambda v: isinstance(v, str) and pattern.fullmatch(v) is not None, words


_TASK = _matches(_TASK_NAME, "a task's name")
_SHA = _matches(_DIGEST, "64 digits 0-9 a-f")
LINK = _matches(_LINK, "an address that begins with https://")
_FLAG: Rule = (lambda v: isinstance(v, bool), "true or false")
_NUMBER: Rule = (_is_number, "a number")
_ENTRY = _whole(1, 10**6)
_MODEL: Schema = {
    "name": _text(_NAME),
    "authors": _text(_LINE),
    "links": _list_of((lambda v: LINK[0](v) and len(v) <= _LINE, LINK[1]), 0, _LINKS),
    "parameters": _or_none(_whole(0, _PARAMETERS)),
    "note": _text(_TEXT, empty=True),
}
_RUN: Schema = {
    "result": _SHA,
    "pack": _SHA,
    "predictions": _SHA,
    "model_folder": _or_none(_SHA),
    "weights": _or_none(_SHA),
    "isolation": _text(40),
    "seconds": _or_none(_NUMBER),
}
_INTERVAL: Schema = {
    "value": _or_none(_NUMBER),
    "low": _or_none(_NUMBER),
    "high": _or_none(_NUMBER),
    "deviation": _or_none(_NUMBER),
}
_SPLIT: Schema = {"digest": _SHA, "pairs": _whole(1, 10**9)}
_BY: Schema = {"by": _text(_LINE), "reason": _text(_TEXT)}
_RECORD: Schema = {
    "board_version": _whole(BOARD_VERSION, BOARD_VERSION),
    "number": _whole(0, 10**6),
    "kind": _text(20),
    "previous": (lambda v: v == "" or _SHA[0](v), "64 digits 0-9 a-f, or empty in the first record"),
    "date": (_is_date, "a date with its zone, ISO 8601"),
    "body": (lambda v: isinstance(v, dict), "an object"),
}


def _scores() -> Rule:
    is_good, words = _map_of(lambda k: k in HEADLINE, _object(_INTERVAL), "headline metric")
    return (
        lambda v: is_good(v) and "accuracy" in v and v["accuracy"]["value"] is not None,
        f"{words}; accuracy among them",
    )


KINDS: dict[str, Schema] = {
    "board": {
        "name": _text(_NAME),
        "data_version": _text(20),
        "data": _map_of(lambda k: _TASK[0](k), _object(_SPLIT), "task"),
    },
    "entry": {
        "task": _TASK,
        "model": _object(_MODEL),
        "model_digest": _SHA,
        "data": _object({"version": _text(20), **_SPLIT}),
        "runs": _list_of(_object(_RUN), 1, MAX_SEEDS),
        "replicates": _SHA,
        "scores": _scores(),
    },
    "badge": {
        "entry": _ENTRY,
        "badge": (lambda v: v in BADGES[1:], " or ".join(BADGES[1:])),
        "by": _text(_LINE),
        "equal_decisions": _or_none(_NUMBER),
        "hardware": _or_none(_text(_LINE)),
        "predictions": _list_of(_SHA, 0, MAX_SEEDS),
    },
    "challenge": {"entry": _ENTRY, **_BY, "links": _MODEL["links"]},
    "answer": {"challenge": _ENTRY, "upheld": _FLAG, **_BY},
    "withdrawal": {"entry": _ENTRY, **_BY},
}
"""The fields of every kind's body."""
