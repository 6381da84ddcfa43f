"""Stored predictions and their expected scores, which the scorer must go on giving: tests/golden/.

python tests/stored_scores.py                    # writes the expected scores again; a change belongs into CHANGELOG.md
python tests/stored_scores.py --draw DATA        # draws the pairs and predictions again too, from DATA/<task>/test
"""

import argparse
import json
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from eigenbench import load
from eigenbench.geometry import matrices
from eigenbench.references import Measured
from eigenbench.results import Predictions
from eigenbench.scoring import Truth, score_predictions
from eigenbench.shape_cavities import ShapeCavities
from eigenbench.tasks import TASKS

GOLDEN = Path(__file__).parent / "golden"
TASKS_STORED = ("tube", "fit", "multitube", "tube-rotated")
PAIRS = 160
COPIED = ("pair_id", "label", "decides", "obj_shape", "obj_category", "env_shape", "env_category")
ROUNDED = ("margin", "env_lengths", "obj_lengths", "planes", "env_scale", "obj_scale", "env_rotation")


def stored(task: str) -> tuple[Predictions, Truth, dict[bytes, ShapeCavities]]:
    """Return the stored predictions and truth of a task, and the cavities of its shapes (boxes about the origin)."""
    with np.load(GOLDEN / f"{task}.npz") as file:
        arrays = dict(file)
    targets = {k: arrays[k] for k in COPIED} | {k: arrays[k].astype(np.float64) for k in ROUNDED}
    axes = list(TASKS[task].axes)
    targets["directions"] = matrices(targets["env_rotation"])[:, :, axes].transpose(0, 2, 1)
    measured = Measured(targets["env_lengths"] * 0.999, targets["obj_lengths"] * 0.985)
    fields = {k[3:]: v.astype(np.float32) for k, v in arrays.items() if k.startswith("of_")}
    groups = TASKS[task].clauses if task == "multitube" else None
    return Predictions(fields, groups), Truth(TASKS[task], targets, measured), _cavities(targets)


def _cavities(targets: dict[str, Any]) -> dict[bytes, ShapeCavities]:
    """Return, per environment shape, the deciding cavity of its first pair, a smaller one beside it, every third a drum."""
    found = {}
    for k, name in enumerate(np.unique(targets["env_shape"])):
        row = int(np.argmax(targets["env_shape"] == name))
        box = targets["planes"][row] / targets["env_scale"][row]
        beside = np.stack([box[:, 1], box[:, 1] + 0.6 * (box[:, 1] - box[:, 0])], axis=1)
        flags = np.array([k % 3 == 0, False]), np.array([k % 4 == 1, True])
        found[name] = ShapeCavities(np.stack([box, beside]), *flags, 0, np.array([[-1.0, -1, -1], [1, 1, 1]]))
    return found


def scores_of(task: str) -> dict[str, Any]:
    """Score the stored predictions now."""
    predictions, truth, cavities = stored(task)
    with patch("eigenbench.cavities.cavities_of", lambda _source: cavities):
        return json.loads(json.dumps(score_predictions(predictions, truth)))


def expected(task: str) -> dict[str, Any]:
    """Return the stored scores."""
    return json.loads((GOLDEN / f"{task}.json").read_text())


def draw(task: str, data: Path) -> None:
    """Store the first pairs of a split with predictions that are its truth, disturbed: slots in another order."""
    rng = np.random.default_rng(11)
    batch = load(data / task / "test").read(range(PAIRS), (*COPIED, *ROUNDED, "directions"))
    lengths = batch["env_lengths"].shape[1]
    slots = np.arange(lengths) if task == "multitube" else rng.permutation(lengths)
    noise = rng.normal(0, 0.06, (2, PAIRS, lengths))
    vectors = batch["directions"] + rng.normal(0, 0.2, (PAIRS, lengths, 3))
    points = batch["planes"][..., None] * batch["directions"][:, :, None] + rng.normal(0, 0.02, (PAIRS, lengths, 2, 3))
    points[: PAIRS // 8] *= 0.5
    answers = {
        "probability": 1 / (1 + np.exp(-30 * batch["margin"] - rng.normal(0, 1, PAIRS))),
        "env_lengths": (batch["env_lengths"] * np.exp(noise[0]))[:, slots],
        "obj_lengths": (0.9 * batch["obj_lengths"] * np.exp(noise[1]) + 0.02)[:, slots],
        "vectors": (vectors * rng.choice([-1, 1], (PAIRS, lengths, 1)))[:, slots],
        "planes": points[:, slots],
    }
    arrays = {k: batch[k] for k in COPIED} | {k: np.float32(batch[k]) for k in ROUNDED}
    arrays |= {f"of_{k}": np.float16(v) for k, v in answers.items()}
    np.savez_compressed(GOLDEN / f"{task}.npz", **arrays)


def first_difference(old: Any, new: Any, where: str = "", tolerance: float = 1e-9) -> str:
    """Return where `new` lacks something of `old` or differs by more than a tolerance, with both; empty if nowhere."""
    if isinstance(old, dict) and isinstance(new, dict):
        children = [(old[k], new.get(k, "missing"), f"{where}.{k}") for k in old]
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        children = [(a, b, f"{where}[{k}]") for k, (a, b) in enumerate(zip(old, new, strict=True))]
    elif isinstance(old, float) and isinstance(new, float):
        return "" if abs(old - new) <= tolerance else f"{where}: {old!r} became {new!r}"
    else:
        return "" if old == new else f"{where}: {old!r} became {new!r}"
    return next((d for child in children if (d := first_difference(*child, tolerance))), "")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", type=Path, metavar="DATA")
    asked = parser.parse_args()
    GOLDEN.mkdir(exist_ok=True)
    for name in TASKS_STORED:
        if asked.draw:
            draw(name, asked.draw)
        text = json.dumps(scores_of(name), separators=(",", ":"), allow_nan=False)
        (GOLDEN / f"{name}.json").write_text(text + "\n")
