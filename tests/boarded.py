"""What tests of boards are made of: runs without a model, a board on small splits, and ways to forge it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.dataset import Dataset, load
from eigenbench.generators.generation import generate
from eigenbench.leaderboard.boards import open_board, read_manifests
from eigenbench.leaderboard.chain import RECORD, append_record, read_chain
from eigenbench.leaderboard.records import Record, sha256
from eigenbench.leaderboard.submission import About, submit
from eigenbench.results import RESULT_VERSION, Predictions, predictions_digest, write_run
from eigenbench.scoring import Truth, score_predictions

NAME = '"><script>window.bad=1</script><b onmouseover=alert(1)>\u202e&'
ABOUT = About(NAME, "A. Author & <i>others</i>", ("https://example.org/code?a=1&b='<>'".replace("<>", "%3C"),), 12)
PAIRS = 600


def make_data(out: Path, *tasks: str, pairs: int = PAIRS) -> Path:
    """Generate small test splits and return their root."""
    generate(",".join(tasks), "test", pairs, out, workers=1, audit=0.0)
    return out


def noisy(split: Path, noise: float, seed: int = 0, *, lengths: bool = True, vectors: bool = False) -> Predictions:
    """Return predictions that follow the truth with relative noise: lengths, or a probability alone."""
    dataset = load(split)
    rng = np.random.default_rng(seed)
    env, obj = (dataset.column(f"{side}_lengths") for side in ("env", "obj"))
    env, obj = (v * np.exp(noise * rng.normal(size=v.shape)) for v in (env, obj))
    slack = (np.log(env) - np.log(obj)).min(axis=1)
    arrays = {"probability": (1 / (1 + np.exp(-8 * slack))).astype(np.float32)}
    if lengths:
        arrays |= {"env_lengths": env.astype(np.float32), "obj_lengths": obj.astype(np.float32)}
    if vectors:
        arrays["vectors"] = np.nan_to_num(
            dataset.column("directions") + noise * rng.normal(size=(*env.shape, 3)), nan=1.0
        )
    return Predictions(arrays)


def make_run(folder: Path, split: Path, predictions: Predictions, **changes: Any) -> Path:
    """Write a run folder as `evaluate` does, scored, of a model that never was; `changes` are of its result."""
    dataset: Dataset = load(split)
    result = {
        "model": {"file": "model.py", "name": "", "digest": sha256(b"model"), "folder_digest": sha256(b"folder")}
        | {"checkpoint_digest": sha256(str(folder).encode())},
        "result_version": RESULT_VERSION,
        "eigenbench": "0.1.0",
        "data_version": dataset.manifest.recipe.data_version,
        "date": "2026-11-22T12:00:00+00:00",
        "data": {
            **{k: getattr(dataset.manifest.recipe, k) for k in ("task", "split", "pairs", "data_version")},
            "digest": dataset.manifest.digest,
        },
        "predictions_digest": predictions_digest(predictions),
        "isolation": {"level": "landlock"},
        "hardware": {"machine": "x86_64", "cpu": "a processor", "cores": 2},
        "python": "3.11",
        "seconds": {"model": 1.5, "harness": 0.5},
        "checks": [{"name": "honesty: lengths", "passed": True, "seen": ""}],
        "scores": score_predictions(predictions, Truth.of(dataset)),
    }
    write_run(folder, predictions, dataset.column("pair_id"), result | changes)
    return folder


def make_board(folder: Path, data: Path, runs: list[Path]) -> Path:
    """Open a board on all test splits of `data` and submit each run as an entry of its own."""
    open_board(folder, "test board", read_manifests([data]))
    for k, run in enumerate(runs):
        submit([run], folder, replace(ABOUT, name=f"model {k}") if k else ABOUT, [data])
    return folder


def edit_record(board: Path, number: int, change: dict[str, Any], *, mend: bool = False) -> None:
    """Change a record's body in place; with `mend` also all hashes after it, as a careful forger would."""
    links = read_chain(board)
    previous = links[number - 1].digest if number else ""
    for link in links[number:]:
        record = link.record
        body = record.body | (change if record.number == number else {})
        edited = Record(record.number, record.kind, previous if mend else record.previous, record.date, body)
        (link.folder / RECORD).write_bytes(edited.content())
        previous = sha256(edited.content())
        if not mend:
            return


def replace_file(board: Path, number: int, name: str, content: bytes, change: dict[str, Any]) -> None:
    """Change a file of an entry and, with all hashes mended, what its record says of it."""
    (board / f"{number:05d}" / name).write_bytes(content)
    edit_record(board, number, change, mend=True)


def put_result(board: Path, number: int, content: bytes) -> None:
    """Replace the result of an entry's first run, with all digests mended."""
    runs = body_of(board, number)["runs"]
    runs[0]["result"] = sha256(content)
    replace_file(board, number, "run-1.json", content, {"runs": runs})


def put_pack(board: Path, number: int, content: bytes) -> None:
    """Replace the pack of an entry's first run, with all digests mended."""
    runs = body_of(board, number)["runs"]
    runs[0]["pack"] = sha256(content)
    replace_file(board, number, "run-1.npz", content, {"runs": runs})


def result_of(board: Path, number: int) -> dict[str, Any]:
    """Return the result of an entry's first run."""
    found = json.loads((board / f"{number:05d}" / "run-1.json").read_text())
    assert isinstance(found, dict)
    return found


def body_of(board: Path, number: int) -> dict[str, Any]:
    """Return a record's body."""
    found = json.loads((board / f"{number:05d}" / RECORD).read_text())["body"]
    assert isinstance(found, dict)
    return found


def append_copy(board: Path, number: int, **change: Any) -> None:
    """Append an entry again, files and all, as one who writes into the folder can."""
    links = read_chain(board)
    folder = links[number].folder
    files = {p.name: p.read_bytes() for p in folder.iterdir() if p.name != RECORD}
    append_record(board, links, "entry", links[number].record.body | change, files)
