"""A pair as a 3-D scene: both clouds, the true lengths, a model's vectors and planes, and where the object is shown.

World frame, metres. Clouds are packed as 16-bit integers: their error is below 2e-5 of the scene's half size.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenbench.dataset import Dataset
from eigenbench.markup import Html, embedded_json, join, tag, text
from eigenbench.records import Arrays
from eigenbench.shard_format import REASONS
from eigenbench.tasks import TaskSpec

Vector = NDArray[np.float64]

_BESIDE = 1.12
"""Distance of an object that stands beside its environment, in half widths of both."""
CLOUDS = ("env_points", "obj_points")
LAYERS = {"vectors": "vectors of the model", "planes": "planes of the model", "truth": "true lengths"}


@dataclass(frozen=True, slots=True)
class Pair:
    """One row of a split, and what a model said about it.

    Attributes
    ----------
    row : index in the split
    task : its task
    clouds, targets : arrays of this row, no batch axis
    answer : the model's arrays of this row, empty without a model
    slots : {length: slot} of the model's matching
    decision : what the model decided, None without a model
    """

    row: int
    task: TaskSpec
    clouds: Arrays
    targets: dict[str, Any]
    answer: Arrays = field(default_factory=dict)
    slots: Mapping[str, int] = field(default_factory=dict)
    decision: bool | None = None


def read_pairs(
    dataset: Dataset,
    targets: Arrays,
    rows: Sequence[int],
    arrays: Arrays | None = None,
    slots: Mapping[str, int] | None = None,
    decision: NDArray[np.bool_] | None = None,
) -> list[Pair]:
    """Return the pairs at `rows`, with the model's answers where `arrays` (n, ...) holds them."""
    clouds = dataset.read(rows, CLOUDS)
    return [
        Pair(
            int(row),
            dataset.task,
            {k: v[place] for k, v in clouds.items()},
            {k: v[row] for k, v in targets.items()},
            {k: v[row] for k, v in (arrays or {}).items()},
            slots or {},
            None if decision is None else bool(decision[row]),
        )
        for place, row in enumerate(rows)
    ]


def scene_of(pair: Pair) -> dict[str, Any]:
    """Return what the viewer draws, JSON-ready.

    `place` is the witness; for a negative pair the middle of the space that decides, where its planes tell it;
    else null. `beside` stands outside of the environment.
    """
    env, obj = (pair.clouds[name].astype(np.float64) for name in CLOUDS)
    scale = float(max(np.abs(env).max(), np.abs(obj).max(), 1e-9) / 32767)
    middle = clause_middle(pair, _deciding_clause(pair))
    place = pair.targets["witness"] if bool(pair.targets["label"]) else middle
    if place is not None and not bool(pair.targets["label"]) and pair.task.family == "top":
        place = place + np.array([0.0, 0.0, env[:, 2].max() - obj[:, 2].min()])
    anchor = middle if middle is not None else place if place is not None else env.mean(axis=0)
    return {
        "env": _packed(env, scale),
        "obj": _packed(obj, scale),
        "scale": scale,
        "place": None if place is None else _plain(place),
        "beside": _plain(_beside(env, obj)),
        "truth": _true_lengths(pair, anchor),
        "model": _slots(pair, anchor),
    }


def clause_middle(pair: Pair, clause: Sequence[int]) -> Vector | None:
    """Return the middle (3,) of the space between the stored planes of a clause's lengths; None where none is stored.

    A direction without planes counts as 0, where primitives have their middle; a scene on which this is no guide (the
    handle of a mug) has no planes at all.
    """
    planes, directions = pair.targets["planes"], pair.targets["directions"]
    known = [k for k in clause if np.isfinite(planes[k]).all() and np.isfinite(directions[k]).all()]
    if not known:
        return np.zeros(3) if pair.task.family in ("sphere", "cylinder") else None
    return np.asarray(sum(directions[k] * planes[k].mean() for k in known), dtype=np.float64)


def _deciding_clause(pair: Pair) -> tuple[int, ...]:
    decides = int(pair.targets["decides"])
    return next((c for c in pair.task.clauses if decides in c), pair.task.clauses[0])


def _true_lengths(pair: Pair, anchor: Vector) -> list[dict[str, Any]]:
    """Return each stored pair of planes as the two ends of its length, drawn through the middle of its clause."""
    found = []
    for clause in pair.task.clauses:
        middle = clause_middle(pair, clause)
        middle = anchor if middle is None else middle
        for k in clause:
            planes, direction = pair.targets["planes"][k], pair.targets["directions"][k]
            if np.isfinite(planes).all() and np.isfinite(direction).all() and planes[0] != planes[1]:
                ends = [_plain(middle + direction * (offset - middle @ direction)) for offset in planes]
                found.append({"name": pair.task.lengths[k], "ends": ends})
    return found


def _slots(pair: Pair, anchor: Vector) -> list[dict[str, Any]]:
    """Return the model's vectors, anchored in the space that its matched length belongs to, and its planes."""
    vectors, planes = pair.answer.get("vectors"), pair.answer.get("planes")
    if vectors is None:
        return []
    anchors = {}
    for length, slot in pair.slots.items():
        index = pair.task.lengths.index(length)
        middle = clause_middle(pair, next((c for c in pair.task.clauses if index in c), pair.task.clauses[0]))
        anchors[slot] = anchor if middle is None else middle
    found = []
    for slot, vector in enumerate(np.asarray(vectors, dtype=np.float64)):
        if np.linalg.norm(vector) > 0:
            ends = [] if planes is None else [_plain(p) for p in planes[slot]]
            at = _plain(anchors.get(slot, anchor))
            found.append({"name": f"slot {slot}", "at": at, "vector": _plain(vector), "planes": ends})
    return found


def _beside(env: Vector, obj: Vector) -> Vector:
    """Return the translation that puts the object beside the environment, along its shorter horizontal side."""
    axis = int(np.ptp(env[:, :2], axis=0).argmin())
    gap = (np.ptp(env[:, axis]) + np.ptp(obj[:, axis])) / 2 * _BESIDE
    place = (env.max(axis=0) + env.min(axis=0)) / 2
    place[axis] -= gap
    return np.asarray(place)


def _packed(points: Vector, scale: float) -> str:
    whole = np.rint(points / scale).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode()


def _plain(values: NDArray[Any]) -> list[float]:
    return [round(float(v), 6) for v in values]


def scene_data(pairs: Sequence[Pair]) -> Html:
    """Return the data of a page's scenes, which its figures name by index."""
    return embedded_json([scene_of(p) for p in pairs], "scenes-data")


def tools(with_model: bool) -> Html:
    """Return the switches of what is drawn, and the key to the colours."""
    keys = ["environment", "object", *(["model"] if with_model else []), "truth"]
    marks = [tag("span", tag("span", class_=f"key {k}"), k) for k in keys]
    layers = [k for k in LAYERS if with_model or k == "truth"]
    boxes = [(f"show-{k}", LAYERS[k], True) for k in layers] + [("show-beside", "object beside the environment", False)]
    inputs = [tag("label", tag("input", type="checkbox", id=i, checked=on), text(words)) for i, words, on in boxes]
    hint = tag(
        "span",
        "Drag or arrow keys turn; + and - zoom, 0 resets; the wheel zooms the scene that has the focus.",
        class_="note hint",
        id="scene-hint",
    )
    return tag("div", *marks, *inputs, hint, class_="tools", role="group", aria_label="What the scenes show")


def figure(pair: Pair, index: int, *, lengths: bool = True) -> Html:
    """Return one scene with its buttons and caption; `index` is its place in the page's scene data."""
    said = _words(pair)
    buttons = [
        tag("button", shown, type="button", data_do=do, aria_label=f"{words}, pair {pair.row}", title=words)
        for do, shown, words in (
            ("out", Html("&minus;"), "zoom out"),
            ("in", "+", "zoom in"),
            ("reset", "⟲", "reset the view"),
        )
    ]
    canvas = tag(
        "canvas",
        tabindex="0",
        role="application",
        aria_label=f"3-D scene of pair {pair.row}: {said}. Arrow keys turn, plus and minus zoom.",
        data_scene=index,
    )
    caption = tag("figcaption", _caption(pair), _length_table(pair) if lengths else None)
    return tag("figure", canvas, tag("div", *buttons, class_="zoom"), caption, class_="scene")


def _words(pair: Pair) -> str:
    fits = "fits" if pair.targets["label"] else "does not fit"
    if pair.decision is None:
        return fits
    return f"{fits}; the model says it {'fits' if pair.decision else 'does not fit'}"


def _caption(pair: Pair) -> Html:
    t = pair.targets
    label, length = bool(t["label"]), pair.task.lengths[int(t["decides"])]
    head = [tag("span", f"pair {pair.row}", class_="title3"), text(" · fits" if label else " · does not fit")]
    if pair.decision is not None:
        right = pair.decision == label
        verdict = f"model: {'fits' if pair.decision else 'does not fit'}{' ✓' if right else ' ✗'}"
        head += [text(" · "), tag("span", verdict, class_="good" if right else "bad")]
    environment, thing = (t[f"{s}_category"].decode(errors="replace") for s in ("env", "obj"))
    share = abs(float(t["margin"])) / float(t["env_lengths"][int(t["decides"])])
    reason = next(k for k, code in REASONS.items() if code == int(t["reason"]))
    why = "" if label or reason.startswith("length") else f", {reason.replace('_', ' ')}"
    second = f"{thing} in {environment} · margin {float(t['margin']):+.4f} m, {share:.1%} of {length}{why}"
    return join([tag("span", *head), tag("br"), tag("span", second, class_="muted")])


def _length_table(pair: Pair) -> Html:
    """Return the lengths of both sides, true and, of the matched slots, predicted."""
    answered = "env_lengths" in pair.answer
    titles = ["true, m", "env.", "obj.", *(["slot", "says env.", "obj."] if answered else [])]
    rows = []
    for k, name in enumerate(pair.task.lengths):
        cells = [f"{float(pair.targets[f'{s}_lengths'][k]):.4f}" for s in ("env", "obj")]
        slot = pair.slots.get(name)
        if answered:
            said = [] if slot is None else [float(pair.answer[f"{s}_lengths"][slot]) for s in ("env", "obj")]
            cells += [str(slot), *(f"{v:.4g}" for v in said)] if said else ["-"] * 3
        rows.append(tag("tr", tag("th", name, scope="row"), *(tag("td", c, class_="n") for c in cells)))
    head = tag("tr", *(tag("th", t, scope="col", class_=None if k == 0 else "n") for k, t in enumerate(titles)))
    return tag("div", tag("table", tag("thead", head), tag("tbody", *rows)), class_="scroll")
