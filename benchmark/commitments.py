"""A held-out split: its seed is known to one holder, and fixed in public by a salted hash before anything is scored.

The holder publishes the commitment, scores models, and reveals seed and salt when the split retires. Then everybody can
make the split and see that it was the one committed to. The hash is sha256 over a text that names all that decides the
split; the salt of 256 random bits keeps it from being guessed backwards.
"""

import hashlib
import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from eigenbench._version import DATA_VERSION
from eigenbench.errors import DataError, UsageError
from eigenbench.records import MAX_PAIRS
from eigenbench.tasks import find_task

_SALT_BYTES = 32
_KIND = "eigenbench held-out split"
_UNREADABLE = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True, slots=True)
class Secret:
    """All that decides a held-out split of some tasks, and the salt.

    Attributes
    ----------
    tasks : names, the same seed for each; streams differ by task, so one split tells nothing of another
    pairs : of each task
    seed : from 1 to 2^63 - 1
    salt : 64 hexadecimal digits
    data_version : whose generator makes the split
    """

    tasks: tuple[str, ...]
    pairs: int
    seed: int
    salt: str
    data_version: str = DATA_VERSION

    def __post_init__(self) -> None:
        """Refuse what decides no split."""
        for task in self.tasks:
            find_task(task)
        if not self.tasks or not 1 <= self.pairs <= MAX_PAIRS or not 1 <= self.seed < 2**63:
            msg = (
                f"A held-out split needs a task, at least 1 pair and a seed from 1 to 2^63 - 1, got {self.pairs} pairs."
            )
            raise UsageError(msg)
        if len(self.salt) != 2 * _SALT_BYTES or set(self.salt) - set("0123456789abcdef"):
            msg = f"The salt of a held-out split is {2 * _SALT_BYTES} hexadecimal digits."
            raise UsageError(msg)

    @property
    def commitment(self) -> str:
        """The sha256 that is published."""
        text = (
            f"{_KIND}\ndata version {self.data_version}\ntasks {','.join(self.tasks)}\npairs {self.pairs}\n"
            f"seed {self.seed}\nsalt {self.salt}\n"
        )
        return hashlib.sha256(text.encode()).hexdigest()


def draw_secret(tasks: tuple[str, ...], pairs: int) -> Secret:
    """Return a secret whose seed and salt come from the system's source of randomness."""
    return Secret(tasks, pairs, 1 + secrets.randbelow(2**63 - 1), secrets.token_hex(_SALT_BYTES))


def commit(secret: Secret, secret_file: Path, public_file: Path) -> None:
    """Write the secret, readable by its owner alone, and the commitment for everybody: both or neither.

    UsageError if they are one file, one exists, or one cannot be written.
    """
    if secret_file.resolve() == public_file.resolve():
        msg = f"{secret_file} would hold both the secret and what is published; pass two different files."
        raise UsageError(msg)
    for path in (secret_file, public_file):
        if path.exists():
            msg = f"{path} exists already; a secret that was committed to is never replaced. Choose another name."
            raise UsageError(msg)
    _write_new(secret_file, {"kind": _KIND, **asdict(secret)}, 0o600)
    try:
        _write_new(public_file, _published(secret), 0o644)
    except UsageError:
        secret_file.unlink()  # nothing was published, so the next try draws another
        raise


def _published(secret: Secret) -> dict[str, Any]:
    """Return what everybody may know of a secret."""
    told = {name: value for name, value in asdict(secret).items() if name not in ("seed", "salt")}
    return {"kind": _KIND, **told, "tasks": list(secret.tasks), "sha256": secret.commitment}


def _write_new(path: Path, body: dict[str, Any], mode: int) -> None:
    """Write a file that is not there yet and wait until it is on the disk; UsageError, and no file, if it fails."""
    made = False
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        made = True
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(json.dumps(body, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        if made:
            path.unlink(missing_ok=True)
        msg = f"{path} cannot be written: {error.strerror}. Choose another place; nothing was committed to."
        raise UsageError(msg) from error


def read_secret(path: Path) -> Secret:
    """Read a secret, or what its holder has revealed; DataError if the file is none."""
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        if body.pop("kind") != _KIND:
            raise KeyError(path)
        return Secret(**body | {"tasks": tuple(body["tasks"])})
    except (*_UNREADABLE, UsageError) as error:
        msg = f"{path} is not the secret of a held-out split; `eigenbench hidden commit` makes one."
        raise DataError(msg) from error


def check_commitment(secret: Secret, path: Path) -> str:
    """Return the published sha256 if it is the secret's; DataError if the secret is not what was committed to."""
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        published = str(body["sha256"])
    except _UNREADABLE as error:
        msg = f"{path} is not the commitment of a held-out split: it holds no sha256."
        raise DataError(msg) from error
    expected = _published(secret)
    if published != expected["sha256"]:
        msg = (
            f"The secret is not the one that was committed to: it hashes to {secret.commitment[:16]}..., {path} says "
            f"{published[:16]}.... Its split is not the held-out split."
        )
        raise DataError(msg)
    for name, value in expected.items():
        if body.get(name) != value:
            msg = f"{path} was altered: it says {name} {str(body.get(name))[:80]}, its sha256 is of {value}."
            raise DataError(msg)
    return published
