"""Makes the pictures and tables of docs/statistics.md, and the tables of DATA.md, from generated data.

    python docs/make_statistics.py DATA [SAMPLED]

where DATA holds both splits of every task (`eigenbench generate --task fit --out DATA`), and SAMPLED first pairs
of the same by the other protocol (`--split test --pairs 10000 --protocol sampled --out SAMPLED`), for label noise.
Needs matplotlib (`pip install -e '.[report]'`).
"""

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eigenbench.dataset import Dataset, load
from eigenbench.description import describe
from eigenbench.geometry import matrices
from eigenbench.manifest import find_splits
from eigenbench.noise import label_noise
from eigenbench.tasks import TaskSpec

OUT = Path(__file__).parent / "statistics"
YES, NO, GREY = "#2166ac", "#d6604d", "#8c8c8c"
MARGINS = np.linspace(-0.6, 0.6, 49)
RATIOS = np.geomspace(0.25, 6, 49)
EXAMPLES, MAX_COLUMNS = 3, 4
TARGETS = ("label", "margin", "env_lengths", "obj_lengths", "decides", "binding", "obj_category", "env_category")


ROOT = Path(__file__).parent.parent
DOCUMENTS = (ROOT / "DATA.md", ROOT / "docs" / "statistics.md")


def main(folder: str, sampled: str | None = None) -> None:
    """Make every table and draw every picture from the splits at or below a folder."""
    descriptions = describe(folder, measured=True)
    for document in DOCUMENTS:
        fill(document, "statistics", statistics_table(descriptions))
        if sampled is not None:
            fill(document, "noise", noise_table(label_noise(folder, sampled)))
    splits = [load(f) for f in find_splits(Path(folder)) if f.name == "test"]
    OUT.mkdir(exist_ok=True)
    plt.rcParams |= {"font.size": 8, "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 9}
    columns = {d.task.name: {n: d.column(n) for n in TARGETS} for d in splits}
    save(panels(splits, columns, draw_margins, "margin / deciding length"), "margins.png")
    save(panels(splits, columns, draw_ratios, "environment / object, per length"), "ratios.png")
    save(panels(splits, columns, draw_decides, "share of the negatives that each length decides"), "decides.png")
    save(panels(splits, columns, draw_categories, "share that fits, by category"), "categories.png")
    save(probes([d for d in descriptions if d["recipe"]["split"] == "test"]), "probes.png")
    for dataset in splits:
        save(examples(dataset), f"examples-{dataset.task.name}.png")


def fill(document: Path, block: str, lines: list[str]) -> None:
    """Put lines between the two marks of a block of a document, if it has one."""
    begin, end = (f"<!-- {block}: {mark} -->" for mark in ("begin", "end"))
    text = document.read_text(encoding="utf-8")
    if begin in text:
        head, _, rest = text.partition(begin)
        tail = rest.partition(end)[2]
        document.write_text("\n".join([head + begin, *lines, end + tail]), encoding="utf-8")


def statistics_table(descriptions: list[dict[str, Any]]) -> list[str]:
    """Return the rows of the table of statistics, Markdown."""
    columns = ("positive", "object only", "environment only", "majority", "lengths give", "within 10 %")
    head = ("task", "split", "pairs", *columns, "measurer", "calibrated", "decides, of the negatives")
    rows = [head, ["---"] * len(head)]
    for d in descriptions:
        probes, measurer, recipe = d["probes"], d["measurer"], d["recipe"]
        shares = [d["positive_rate"], probes["object_only"], probes["environment_only"], probes["majority"]]
        shares += [d["rule_explains"], d["near_boundary"], measurer["exact"], measurer["calibrated"]]
        decides = ", ".join(f"{n} {v['decides_negatives']:.0%}" for n, v in d["lengths"].items() if v["binds"])
        cells = [f"`{recipe['task']}`", recipe["split"], f"{recipe['pairs']:,}", *(f"{100 * s:.1f}" for s in shares)]
        rows.append([*cells, decides])
    return ["| " + " | ".join(row) + " |" for row in rows]


def noise_table(noise: list[dict[str, Any]]) -> list[str]:
    """Return the rows of the table of label noise, Markdown."""
    near = [f"lost within {float(limit):.0%}" for limit in noise[0]["lost_within"]]
    head = ("task", "pairs", "positives", "lost", "of pairs", "of positives", *near, "largest missed margin", "gained")
    rows = [head, ["---"] * len(head)]
    for r in noise:
        within = [w["lost"] / max(w["positives"], 1) for w in r["lost_within"].values()]
        shares = [r["lost"] / r["pairs"], r["lost"] / r["positives"], *within, r["largest_lost_margin"] or 0.0]
        counts = [f"{r[k]:,}" for k in ("pairs", "positives", "lost")]
        rows.append([f"`{r['task']}`", *counts, *(f"{s:.2%}" for s in shares), str(r["gained"])])
    return ["| " + " | ".join(row) + " |" for row in rows]


def save(figure: Figure, name: str) -> None:
    """Write a picture with few colours, so that it stays small."""
    from PIL import Image

    figure.savefig(OUT / name, dpi=110, bbox_inches="tight")
    plt.close(figure)
    with Image.open(OUT / name) as picture:
        picture.convert("RGB").quantize(64).save(OUT / name, optimize=True)


def panels(splits: list[Dataset], columns: dict[str, Any], draw: Any, title: str) -> Figure:
    """Return one panel a task."""
    wide = min(MAX_COLUMNS, len(splits))
    high = -(-len(splits) // wide)
    figure, axes = plt.subplots(high, wide, figsize=(2.6 * wide, 1.9 * high), squeeze=False, layout="constrained")
    figure.suptitle(title, fontsize=10)
    for axis in axes.flat[len(splits) :]:
        axis.axis("off")
    for axis, dataset in zip(axes.flat, splits, strict=False):
        axis.set_title(dataset.task.name)
        draw(axis, columns[dataset.task.name], dataset)
    return figure


def draw_margins(axis: Axes, t: dict[str, Any], _dataset: Dataset) -> None:
    """Draw the signed margin over its length, positives and negatives; what is beyond the axis in its last bins."""
    relative = t["margin"] / t["env_lengths"][np.arange(len(t["margin"])), t["decides"]]
    clipped = np.clip(relative, MARGINS[0], MARGINS[-1])
    axis.hist([clipped[t["label"]], clipped[~t["label"]]], MARGINS, stacked=True, color=[YES, NO])
    axis.axvline(0, color="black", linewidth=0.6)
    axis.set_yticks([])
    axis.text(0.98, 0.95, f"{t['label'].mean():.1%} fit", transform=axis.transAxes, ha="right", va="top", color=YES)
    near = np.mean(np.abs(relative) < 0.1)
    axis.text(0.02, 0.95, f"{near:.0%} within 10 %", transform=axis.transAxes, va="top", color=GREY)


def draw_ratios(axis: Axes, t: dict[str, Any], dataset: Dataset) -> None:
    """Draw how much longer the environment is, length by length."""
    for slot, name in enumerate(dataset.task.lengths):
        if t["binding"][:, slot].any():
            ratio = np.clip(t["env_lengths"][:, slot] / t["obj_lengths"][:, slot], RATIOS[0], RATIOS[-1])
            axis.hist(ratio, RATIOS, histtype="step", label=name)
    axis.set_xscale("log")
    axis.set_xticks([0.25, 0.5, 1, 2, 4], ["1/4", "1/2", "1", "2", "4"])
    axis.minorticks_off()
    axis.axvline(1, color="black", linewidth=0.6)
    axis.set_yticks([])
    axis.legend(frameon=False, fontsize=6, handlelength=1)


def draw_decides(axis: Axes, t: dict[str, Any], dataset: Dataset) -> None:
    """Draw which length decides how many of the negatives."""
    slots = [k for k in range(len(dataset.task.lengths)) if t["binding"][:, k].any()]
    shares = [float(np.mean(t["decides"][~t["label"]] == k)) for k in slots]
    bars = axis.barh([dataset.task.lengths[k] for k in slots], shares, color=NO)
    axis.bar_label(bars, [f"{s:.0%}" for s in shares], padding=2, fontsize=7)
    axis.set_xlim(0, 1.15)
    axis.set_xticks([])
    axis.invert_yaxis()


def draw_categories(axis: Axes, t: dict[str, Any], _dataset: Dataset) -> None:
    """Draw the positive rate of each category of either side that is not drawn afresh."""
    names, rates, colours = [], [], []
    for side, colour in (("obj", YES), ("env", GREY)):
        categories = np.unique(t[f"{side}_category"])
        if len(categories) > 1:
            names += [c.decode().replace("_", " ") for c in categories]
            rates += [float(t["label"][t[f"{side}_category"] == c].mean()) for c in categories]
            colours += [colour] * len(categories)
    axis.barh([f"{k} {name}" for k, name in enumerate(names)], rates, color=colours)
    axis.set_yticks(range(len(names)), names, fontsize=6)
    axis.axvline(0.5, color="black", linewidth=0.6)
    axis.set_xlim(0, 1)
    axis.set_xticks([0, 0.5, 1], ["0", "50 %", "100 %"])
    axis.invert_yaxis()
    if not names:
        axis.text(0.5, 0.5, "one category a side", ha="center", va="center", transform=axis.transAxes, color=GREY)


def probes(descriptions: list[dict[str, Any]]) -> Figure:
    """Return how far each side alone gives the label away, beside the majority class."""
    figure, axis = plt.subplots(figsize=(9, 2.6), layout="constrained")
    places = np.arange(len(descriptions))
    for k, (name, colour) in enumerate((("majority", GREY), ("object_only", YES), ("environment_only", NO))):
        values = [d["probes"][name] for d in descriptions]
        bars = axis.bar(places + 0.27 * (k - 1), values, 0.25, color=colour, label=name.replace("_", " "))
        axis.bar_label(bars, [f"{100 * v:.0f}" for v in values], fontsize=6)
    limits = [d["probes"]["majority"] + 0.15 for d in descriptions]
    axis.hlines(limits, places - 0.45, places + 0.45, color="black", linewidth=0.8, label="majority + 15 points")
    axis.set_xticks(places, [d["recipe"]["task"] for d in descriptions], rotation=20, ha="right")
    axis.set_ylim(0.4, 0.9)
    axis.set_yticks([0.5, 0.6, 0.7, 0.8], ["50 %", "60 %", "70 %", "80 %"])
    axis.set_title("accuracy of probes that see one side only, learned from the train split, on the test split")
    axis.legend(frameon=False, ncols=4, fontsize=7, loc="upper left")
    return figure


def examples(dataset: Dataset) -> Figure:
    """Return pairs as clouds, each in two views of the scene: positives with the object at its witness, negatives.

    A negative's object is drawn where it would have to be: in the middle of the deciding planes, on top of a piece of
    furniture, beside a mug. Dashed lines are the deciding planes.
    """
    label = dataset.column("label")
    rows = [*np.flatnonzero(label)[:EXAMPLES], *np.flatnonzero(~label)[:EXAMPLES]]
    names = ("env_points", "obj_points", "witness", "margin", "decides", "label", "env_rotation", "planes")
    batch = dataset.read(rows, names)
    views = ((0, 2), (0, 1)) if dataset.task.family == "mug" else ((1, 2), (0, 2))
    figure, axes = plt.subplots(2, 2 * EXAMPLES, figsize=(11, 4.4), layout="constrained")
    figure.suptitle(f"{dataset.task.name}: fits when some translation of the object {dataset.task.fits}", fontsize=8)
    for k in range(len(rows)):
        pair = {name: values[k] for name, values in batch.items()}
        env, thing, planes = in_scene(pair, dataset.task)
        for axis, view in zip(axes[k // EXAMPLES, 2 * (k % EXAMPLES) :], views, strict=False):
            axis.scatter(*env[:, view].T, s=1.2, color=GREY, linewidths=0)
            axis.scatter(*thing[:, view].T, s=1.2, color=YES if pair["label"] else NO, linewidths=0)
            for along, offset in ((c, o) for c in range(2) for o in planes.get(view[c], ())):
                (axis.axvline if along == 0 else axis.axhline)(offset, color="black", linewidth=0.5, linestyle="--")
            axis.set_aspect("equal")
            axis.axis("off")
            said = f"{'xyz'[view[0]]} to the right, {'xyz'[view[1]]} up"
            axis.text(0.5, -0.04, said, transform=axis.transAxes, ha="center", va="top", fontsize=6, color=GREY)
        decides = dataset.task.lengths[pair["decides"]]
        said = f"{'fits' if pair['label'] else 'does not fit'}: {1000 * pair['margin']:+.0f} mm, {decides} decides"
        axes[k // EXAMPLES, 2 * (k % EXAMPLES)].text(
            0, 1.08, said, transform=axes[k // EXAMPLES, 2 * (k % EXAMPLES)].transAxes, fontsize=7
        )
    return figure


def in_scene(pair: dict[str, Any], task: TaskSpec) -> tuple[Any, Any, dict[int, list[float]]]:
    """Return the environment's cloud, the placed object's, and the offsets of the deciding planes by axis.

    All in the scene's frame, in which nothing is turned.
    """
    scene = matrices(pair["env_rotation"][None].astype(float))[0]
    env, thing = pair["env_points"] @ scene, pair["obj_points"] @ scene
    planes: dict[int, list[float]] = {}
    for slot, axis in enumerate(task.axes):
        if axis is not None:
            planes.setdefault(axis, []).extend(pair["planes"][slot])
    if pair["label"]:
        return env, thing + pair["witness"] @ scene, planes
    place = np.array([np.mean(planes.get(axis, [0.0])[:2]) for axis in range(3)])
    if task.family == "top":
        place[2] = env[:, 2].max() - thing[:, 2].min()
    if task.family == "mug":
        place[0] = env[:, 0].max() - thing[:, 0].min()
    return env, thing + place, planes


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("usage: python docs/make_statistics.py DATA [SAMPLED]")
    main(*sys.argv[1:])
