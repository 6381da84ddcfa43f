"""Few-shot adaptation, data efficiency and comparisons of runs as text for a terminal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from eigenbench.errors import printable
from eigenbench.headline import HEADLINE
from eigenbench.terminal import NO_INTERVAL, console, print_no_intervals, show, table_of

_AS_PERCENT = ("accuracy", "balanced_accuracy")
_NAME = 26
"""Longest name of a run in a table of 80 columns."""


def print_learning(result: Mapping[str, Any]) -> None:
    """Print the checks that a model did not pass, and what a result holds of models that learnt first."""
    for finding in result.get("checks") or ():
        if finding["passed"] is False:
            console.print(printable(f"check not passed: {finding['name']}: {finding['seen']}"))
    few_shot, efficiency = result.get("few_shot"), result.get("data_efficiency")
    if few_shot is not None:
        _print_few_shot(few_shot)
    if efficiency is not None:
        _print_efficiency(efficiency)


def print_comparison(found: Mapping[str, Any]) -> None:
    """Print each run's standing and each pair's difference, metric by metric."""
    data = found["data"]
    console.print(
        f"{data['task']}/{data['split']}, {data['pairs']:,} pairs, digest {data['digest'][:16]}; intervals by paired "
        f"crossed bootstrap; p values corrected by {found['correction']}"
    )
    print_no_intervals(found["interval"])
    names = [_name_of(k + 1, r["run"]) for k, r in enumerate(found["runs"])]
    for metric, compared in found["metrics"].items():
        show(_standings(metric, compared, names))
        show(_differences(metric, compared))


def _print_few_shot(found: Mapping[str, Any]) -> None:
    if not found["provided"]:
        console.print("few-shot: not provided (the model has no adapt)")
        return
    metrics = _metrics_of(found)
    table = table_of(f"Few-shot: {found['pairs_per_draw']} pairs a draw", "draw", *map(_title, metrics), "seconds")
    for entry in found["draws"]:
        cells = [_value(m, entry.get(m)) for m in metrics]
        table.add_row(str(entry["draw"] + 1), *cells, f"{entry['learning_seconds']:.1f}")
    show(table)
    means = table_of("Mean over the draws", "metric", "mean [95 %]", "deviation of the draws")
    for metric in metrics:
        mean = found[metric]
        spread = "" if mean.get("deviation") is None else _number(metric, mean["deviation"])
        means.add_row(_title(metric), _interval(metric, mean), spread)
    show(means)


def _print_efficiency(found: Mapping[str, Any]) -> None:
    if not found["provided"]:
        console.print("data efficiency: not provided (the model has no fit)")
        return
    metrics = _metrics_of(found["sizes"][0])
    others = metrics[1:]
    table = table_of("Data efficiency, by training pairs", "pairs", "accuracy [95 %]", *map(_title, others), "seconds")
    for entry in found["sizes"]:
        seconds = sum(s["learning_seconds"] for s in entry["subsets"]) / len(entry["subsets"])
        cells = [_value(m, entry.get(m)) for m in others]
        accuracy = _interval("accuracy", entry.get("accuracy"))
        table.add_row(f"{entry['pairs']:,}", accuracy, *cells, f"{seconds:.1f}")
    show(table)
    if found["area"] is not None:
        console.print(f"mean accuracy over the logarithm of the training pairs: {found['area']:.2%}")


def _standings(metric: str, compared: Mapping[str, Any], names: Sequence[str]) -> Table:
    table = table_of(f"{_title(metric)} ({compared['better']} is better)", "run", "rank", "value [95 %]", "tied with")
    order = [k for k, r in enumerate(compared["runs"]) if r is not None]
    order.sort(key=lambda k: (compared["runs"][k]["rank"], k))
    for k in order:
        run = compared["runs"][k]
        best, worst = run["rank"]
        tied = ", ".join(str(other + 1) for other in run["tied_with"])
        rank = str(best) if best == worst else f"{best}-{worst}"
        table.add_row(names[k], rank, _interval(metric, run), tied)
    for k, run in enumerate(compared["runs"]):
        if run is None:
            table.add_row(names[k], "", "not provided", "")
    return table


def _name_of(number: int, run: str) -> str:
    """Return a run's number and folder, the folder cut in its middle where it is too long for a table."""
    name = printable(Path(run).name or run)
    if len(name) > _NAME:
        name = f"{name[: _NAME // 2 - 1]}...{name[-(_NAME // 2 - 2) :]}"
    return f"{number}: {name}"


def _differences(metric: str, compared: Mapping[str, Any]) -> Table:
    table = table_of("", "difference", f"{_title(metric)} [95 %]", "p", "p, Holm", "")
    for entry in compared["differences"]:
        a, b = entry["runs"]
        verdict = "tied" if entry["tied"] else ""
        p = (_probability(entry["p"]), _probability(entry["p_holm"]))
        table.add_row(f"{a + 1} - {b + 1}", _interval(metric, entry["difference"], signed=True), *p, verdict)
    return table


def _metrics_of(entry: Mapping[str, Any]) -> list[str]:
    wanted = ("accuracy", "auroc", "matched_r2", "angle_degrees")
    return [m for m in HEADLINE if m in wanted and m in entry]


def _title(metric: str) -> str:
    return {"auroc": "AUROC", "matched_r2": "matched R2", "angle_degrees": "angle, deg"}.get(
        metric, metric.replace("_", " ")
    )


def _interval(metric: str, interval: Mapping[str, Any] | None, *, signed: bool = False) -> str:
    if interval is None or interval["value"] is None:
        return "not provided" if interval is None else "undefined"
    if interval["low"] is None:
        return f"{_number(metric, interval['value'], signed=signed)} {NO_INTERVAL}"
    value, low, high = (_number(metric, interval[k], signed=signed) for k in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


def _value(metric: str, interval: Mapping[str, Any] | None) -> str:
    if interval is None or interval["value"] is None:
        return _interval(metric, interval)
    return _number(metric, interval["value"])


def _number(metric: str, value: float, *, signed: bool = False) -> str:
    sign = "+" if signed else ""
    return f"{value:{sign}.2%}" if metric in _AS_PERCENT else f"{value:{sign}.4f}"


def _probability(p: float) -> str:
    return "< 0.0001" if p < 1e-4 else f"{p:.4f}"
