"""Results and descriptions as text for a terminal."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eigenbench.checking import Finding
from eigenbench.errors import printable
from eigenbench.manifest import MANIFEST, Manifest
from eigenbench.tasks import SPLITS
from eigenbench.terminal import NO_INTERVAL, console, print_no_intervals, show, table_of

_NAMED = 8
"""Shapes named after a reason why they are left out."""


def _percent(interval: dict[str, Any] | None) -> str:
    return _written(interval, ".2%")


def _number(interval: dict[str, Any] | None) -> str:
    return _written(interval, ".4f")


def _written(interval: dict[str, Any] | None, form: str) -> str:
    if interval is None or interval["value"] is None:
        return "not provided" if interval is None else "undefined"
    if interval["low"] is None:
        return f"{interval['value']:{form}} {NO_INTERVAL}"
    return "{value:{form}} [{low:{form}}, {high:{form}}]".format(form=form, **interval)


def print_result(result: dict[str, Any]) -> None:
    """Print a result: overall, beside its references, then per group, then the lengths."""
    scores, data = result["scores"], result["data"]
    console.print(
        f"{result['model']['file']} on {data['task']}/{data['split']}, {scores['pairs']:,} pairs, digest "
        f"{data['digest'][:16]}; decided by its {scores['decided_by']}; isolation {result['isolation']['level']}, "
        f"network {result['isolation']['network']}; 95 % intervals by crossed bootstrap"
    )
    print_no_intervals(scores["interval"])
    overall = table_of("Overall", "metric", "value [95 % interval]")
    for name in ("accuracy", "balanced_accuracy", "precision", "recall", "f1"):
        overall.add_row(name.replace("_", " "), _percent(scores[name]))
    overall.add_row("AUROC", _number(scores["auroc"]))
    for name in ("brier", "calibration_error"):
        overall.add_row(name.replace("_", " "), _number(scores.get(name)))
    if "agreement_with_own_probability" in scores:
        overall.add_row("agreement with own probability", _percent(scores["agreement_with_own_probability"]))
    show(overall)
    references = table_of("Beside it (accuracy)", "reference", "value [95 % interval]")
    for name, interval in scores["references"].items():
        references.add_row(name.replace("_", " "), _percent(interval))
    show(references)
    kinds = {"obj_category": "By object category", "env_category": "By environment category"}
    for kind, title in (kinds | {"margin": "By margin / deciding length"}).items():
        if kind == "env_category" and len(scores["by_env_category"]) == 1:
            continue
        groups = table_of(title, "group", "pairs", "accuracy [95 % interval]", "exact measurer")
        for name, group in scores[f"by_{kind}"].items():
            groups.add_row(
                name,
                f"{group['pairs']:,}",
                _percent(group["accuracy"]),
                f"{group['exact_measurer']['value']:.2%}",
            )
        show(groups)
    worst = scores["worst_obj_category"]
    console.print(f"worst object category: {worst['name']}, {_percent(worst['accuracy'])}\n")
    _print_worst(scores.get("worst_group"))  # older results lack what older versions did not score
    _print_lengths(scores)
    _print_planes(scores.get("planes"))
    _print_cavities(scores.get("cavities"))
    _print_groups(scores.get("groups"))
    _print_rotation(scores.get("rotation"))


def _print_worst(worst: dict[str, Any] | None) -> None:
    if worst is None:
        return
    of = worst["kind"].replace("_", " ")
    console.print(f"worst group: {of} {worst['name']}, {worst['pairs']:,} pairs, {_percent(worst['accuracy'])}\n")


def _print_lengths(scores: dict[str, Any]) -> None:
    lengths = scores["lengths"]
    if lengths is None:
        console.print("lengths: not provided")
        return
    for key, title in (
        ("all_pairs", "all pairs"),
        ("analysis_pairs", f"{lengths['analysis_pairs']['pairs']} pairs"),
    ):
        found = lengths[key]
        matrix = table_of(f"R2 with the human lengths, {title} (environment / object)", "slot", *lengths["names"])
        for slot in range(lengths["slots"]):
            pairs = zip(found["env_r2"][slot], found["obj_r2"][slot], strict=True)
            matrix.add_row(str(slot), *(f"{e:.3f} / {o:.3f}" for e, o in pairs))
        show(matrix)
    found = lengths["all_pairs"]
    matched = table_of("Matched slots", "length", "slot", "side", "R2 [95 % interval]", "slope")
    for name, m in found["matched"].items():
        matched.add_row(name, str(m["slot"]), "environment", _number(m["env_r2"]), f"{m['env_slope']:.3f}")
        matched.add_row("", "", "object", _number(m["obj_r2"]), f"{m['obj_slope']:.3f}")
    show(matched)
    console.print(f"the same matching in {found['match_stability']:.1%} of the bootstrap replicates")
    for slot, use in enumerate(lengths["slot_use"]):
        console.print(f"slot {slot} changes the decision in {_percent(use)}")
    for spare in found["unmatched_slots"]:
        console.print(f"slot {spare['slot']} is unmatched, nearest to {spare['best']}")
    if found["unmatched_lengths"]:
        console.print(f"lengths without a slot: {', '.join(found['unmatched_lengths'])}")
    for side, slots in lengths["constant_slots"].items():
        if slots:
            console.print(f"{side} constant in slots {slots}: R2 counted as 0")
    _print_angles(scores["angles"])


def _print_angles(angles: dict[str, Any] | None) -> None:
    if angles is None:
        console.print("angles: not provided")
        return
    if not angles["by_length"]:
        console.print("angles: no matched length has a direction")
        return
    columns = ("length", "slot", "mean [95 %]", "median", "chance", "within 10")
    table = table_of("Angle to the true direction, degrees", *columns)
    for name, a in angles["by_length"].items():
        table.add_row(
            name,
            str(a["slot"]),
            _number(a["mean_degrees"]),
            f"{a['median_degrees']:.3f}",
            f"{angles['chance_degrees']:.1f}",
            _value((a.get("within_degrees") or {}).get("10")),
        )
    show(table)


def _print_planes(planes: dict[str, Any] | None) -> None:
    if planes is None:
        console.print("planes: not provided")
        return
    table = table_of("Planes against the true faces", "length", "slot", "distance, mm", "of the length", "overlap")
    for name, p in planes["by_length"].items():
        numbers = (f"{1e3 * p['mean_error']['value']:.1f}", _value(p["relative_error"]), _value(p["overlap"]))
        table.add_row(name, str(p["slot"]), *numbers)
    show(table)


def _print_cavities(cavities: dict[str, Any] | None) -> None:
    if cavities is None:
        return
    if cavities["groups"] is None:
        console.print(printable(f"cavities: not known, since {cavities['reason']}"))
        return
    enclosed = ("largest", "another", "none")
    table = table_of("Which cavity the planes enclose", "pairs whose ...", "pairs", "accuracy [95 %]", *enclosed)
    for name, group in cavities["groups"].items():
        shares = group["enclosed"] or dict.fromkeys(enclosed)
        cells = (_percent(group["accuracy"]), *(_value(shares[k]) for k in enclosed))
        table.add_row(name, f"{group['pairs']:,}", *cells)
    show(table)


def _value(interval: dict[str, Any] | None) -> str:
    return _percent(interval).partition(" [")[0]


def _print_groups(groups: dict[str, Any] | None) -> None:
    if groups is None:
        return
    columns = ("group", "slots", "satisfied", "decides alone", "clause", "agreement [95 %]")
    table = table_of("Groups (OR of ANDs)", *columns)
    matched = {m["group"]: m for m in groups["matched"]}
    for g, slots in enumerate(groups["groups"]):
        m = matched.get(g)
        clause = ("none", "") if m is None else (", ".join(groups["clauses"][m["clause"]]), _percent(m["agreement"]))
        use = (_value(groups[k][g]) for k in ("satisfied", "use"))
        table.add_row(str(g), ", ".join(map(str, slots)), *use, *clause)
    show(table)
    deciding = groups["deciding"]
    console.print(
        f"the group of the true deciding clause has the most slack in {_percent(deciding['agreement'])}; "
        f"always the same one would in {deciding['chance']:.2%}"
    )


def _print_rotation(rotation: dict[str, Any] | None) -> None:
    if rotation is None:
        return
    title = f"Relative rotation error, degrees, {rotation['pairs']:,} pairs of scenes"
    table = table_of(title, "matching of axes", "mean [95 %]", "median", "chance")
    for name, r in rotation["rules"].items():
        numbers = (_number(r["mean_degrees"]), f"{r['median_degrees']:.3f}", f"{r['chance_degrees']:.1f}")
        table.add_row(name.replace("_", " "), *numbers)
    show(table)


def print_description(d: dict[str, Any]) -> None:
    """Print what `describe` found about one split."""
    r = d["recipe"]
    console.print(
        f"{d['folder']}: task {r['task']}, split {r['split']}, {r['pairs']:,} pairs in {d['shards']} shards, "
        f"{d['bytes'] / 1e6:,.0f} MB, data version {r['data_version']}, seed {r['seed']}, engine {r['engine']}, "
        f"protocol {r['protocol']}, shapes {d['shapes_source']}\ndigest {d['digest']}"
    )
    _print_references(d)
    a = d["audit"]
    console.print(
        f"FCL labelled {a['relabelled']} pairs again and confirmed {a['confirmed']} near witnesses: "
        f"{a['mismatches']} mismatches"
    )
    lengths = table_of(
        "Lengths, m (lowest, median, highest)", "length", "environment", "object", "decides", "of the negatives"
    )
    for name, found in d["lengths"].items():
        shares = f"{found['decides']:.1%}", _share(found["decides_negatives"])
        lengths.add_row(name, _three(found["environment"]), _three(found["object"]), *shares)
    show(lengths)
    for side in ("objects", "environments"):
        categories = table_of(side.capitalize(), "category", "shapes", "pairs", "positive")
        for name, o in d[side].items():
            categories.add_row(printable(name), str(o["shapes"]), f"{o['pairs']:,}", f"{o['positive_rate']:.1%}")
        show(categories)
    margins = table_of("Margin / deciding length", "from, to", "pairs", "positive")
    for name, m in d["margins"].items():
        margins.add_row(name, f"{m['share']:.1%}", _share(m["positive_rate"]))
    show(margins)
    console.print("reasons: " + ", ".join(f"{k} {n:,}" for k, n in d["reasons"].items() if n))
    for name, reason in d["shapes_refused"].items():
        console.print(printable(f"not used: {name}: {reason}"))
    _print_left_out(d["shapes_left_out"])
    console.print("made with " + ", ".join(f"{k} {v}" for k, v in d["versions"].items()) + "\n")


def _print_references(d: dict[str, Any]) -> None:
    """Print what a score on the split is to be read beside."""
    probes, measurer = d["probes"], d["measurer"]
    console.print(
        f"positive {d['positive_rate']:.2%}; accuracy of majority {probes['majority']:.2%}, of a probe that sees "
        f"only the object {probes['object_only']:.2%}, only the environment {probes['environment_only']:.2%} "
        f"(learned from {probes['learned_from']})"
    )
    console.print(
        f"the task's AND over the human lengths gives {d['rule_explains']:.2%} of the labels; "
        f"{d['near_boundary']:.1%} of the pairs have a margin within 10 % of the deciding length"
    )
    if measurer is not None:
        console.print(
            f"exact measurer of the clouds {measurer['exact']:.2%}, calibrated {measurer['calibrated']:.2%} "
            f"(the environment's lengths are {measurer['environment']})"
        )


def _print_left_out(left_out: dict[str, str]) -> None:
    """Print how many sound shapes the task does not draw, by reason."""
    for reason in dict.fromkeys(left_out.values()):
        names = [name for name, why in left_out.items() if why == reason]
        some = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
        console.print(printable(f"left out: {len(names)} shapes, each {reason}: {some}"))


def print_statistics(descriptions: Sequence[dict[str, Any]]) -> None:
    """Print one row a split: what the data of all tasks are like."""
    measured = any(d["measurer"] for d in descriptions)
    columns = ("split", "pairs", "positive", "object", "environment", "majority", "AND", "within 10 %")
    table = table_of(
        "Statistics (object, environment: accuracy of one-sided probes; AND: labels that the lengths' rule gives)",
        *("task", *columns, *(("measurer", "calibrated") if measured else ()), "decides, of the negatives"),
    )
    for d in descriptions:
        probes, measurer = d["probes"], d["measurer"] or {"exact": None, "calibrated": None}
        shares = [probes[k] for k in ("object_only", "environment_only", "majority")]
        shares += [d["rule_explains"], d["near_boundary"]]
        shares += [measurer["exact"], measurer["calibrated"]] if measured else []
        binding = {name: v for name, v in d["lengths"].items() if v["binds"]}
        decides = "  ".join(f"{name} {_share(v['decides_negatives'], 0)}" for name, v in binding.items())
        r = d["recipe"]
        cells = (f"{r['pairs']:,}", f"{d['positive_rate']:.2%}", *(_share(s) for s in shares))
        table.add_row(r["task"], r["split"], *cells, decides)
    show(table, keys=2)


def print_noise(rows: Sequence[dict[str, Any]]) -> None:
    """Print how one protocol's labels differ from another's, a row a split."""
    limits = list(rows[0]["lost_within"])
    near = [f"lost within {float(limit):.0%}" for limit in limits]
    table = table_of(
        f"Labels of {rows[0]['protocols'][1]} against {rows[0]['protocols'][0]}, same pairs (lost: a positive less)",
        *("task", "split", "pairs", "positives", "lost", "of pairs", "of positives", *near, "largest", "gained"),
    )
    for r in rows:
        within = [r["lost_within"][limit] for limit in limits]
        table.add_row(
            r["task"],
            r["split"],
            *(f"{r[k]:,}" for k in ("pairs", "positives", "lost")),
            f"{r['lost'] / r['pairs']:.2%}",
            _share(r["lost"] / r["positives"] if r["positives"] else None),
            *(_share(w["lost"] / w["positives"] if w["positives"] else None) for w in within),
            _share(r["largest_lost_margin"]),
            f"{r['gained']:,}",
        )
    show(table, keys=2)


def _share(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}%}"


def _three(values: Sequence[float]) -> str:
    return " ".join(f"{v:.3f}" for v in values)


def print_shapes(rows: Sequence[dict[str, Any]], refused: dict[str, str]) -> None:
    """Print how many shapes there are of each role and category, by split, with sums."""
    table = table_of("Shapes", "role", "category", "train", "test")
    for role in dict.fromkeys(r["role"] for r in rows):
        of_role = [r for r in rows if r["role"] == role]
        for category in dict.fromkeys(r["category"] for r in of_role):
            table.add_row(role, printable(category), *_by_split(r for r in of_role if r["category"] == category))
        table.add_row(role, "all", *_by_split(of_role), end_section=True)
    show(table)
    for name, reason in refused.items():
        console.print(printable(f"not used: {name}: {reason}"))


def print_errors(rows: Sequence[dict[str, Any]]) -> None:
    """Print the distribution of the relative error of each measure."""
    table = table_of("Relative errors", "measure", "shapes", "median", "99 %", "worst", "bound", "within")
    for row in rows:
        numbers = ["inf" if row[k] is None else f"{row[k]:.1e}" for k in ("median", "p99", "worst", "bound")]
        table.add_row(row["measure"], f"{row['shapes']:,}", *numbers, f"{row['within']:.2%}")
    show(table)


def _by_split(rows: Iterable[dict[str, Any]]) -> list[str]:
    counts = dict.fromkeys(SPLITS, 0)
    for row in rows:
        counts[row["split"]] += row["count"]
    return [f"{n:,}" for n in counts.values()]


def print_findings(findings: Sequence[Finding]) -> None:
    """Print the outcome of `check`, a line a finding."""
    for finding in findings:
        mark = {True: "ok  ", False: "FAIL", None: "--  "}[finding.passed]
        console.print(f"{mark}  {finding.name}: {finding.seen}")


def print_made(manifests: Mapping[Path | str, Manifest]) -> None:
    """Print what was generated, by folder or address: a line a split of one task, a table of several tasks."""
    if len({m.recipe.task for m in manifests.values()}) > 1:
        _print_table_made(manifests)
    else:
        for folder, m in manifests.items():
            _print_line_made(folder, m)
    refused = {name: reason for m in manifests.values() for name, reason in m.shapes_refused.items()}
    for name, reason in refused.items():
        console.print(printable(f"  not used: {name}: {reason}"))


def _print_line_made(folder: Path | str, m: Manifest) -> None:
    console.print(
        f"{folder}: {m.recipe.pairs:,} pairs, {m.positive_rate:.1%} positive, "
        f"{m.audit.relabelled} labels and {m.audit.confirmed} witnesses checked by FCL, "
        f"{m.audit.mismatches} mismatches, digest {m.digest[:16]}"
    )
    if count := len(m.shapes_left_out):
        console.print(
            f"  left out: {count} shape{'s' * (count > 1)} that the task does not draw; "
            f"{folder}/{MANIFEST} names each with the reason"
        )


def _print_table_made(manifests: Mapping[Path | str, Manifest]) -> None:
    columns = ("pairs", "positive", "labels", "witnesses", "mismatches", "left out", "digest")
    table = table_of("Generated (labels, witnesses: checked by FCL)", "folder", *columns)
    for folder, m in manifests.items():
        numbers = (m.audit.relabelled, m.audit.confirmed, m.audit.mismatches, len(m.shapes_left_out))
        shares = (f"{m.recipe.pairs:,}", f"{m.positive_rate:.1%}")
        table.add_row(printable(str(folder)), *shares, *(f"{n:,}" for n in numbers), m.digest[:16])
    show(table)
    if any(m.shapes_left_out for m in manifests.values()):
        console.print(f"left out: shapes that the task does not draw; each folder's {MANIFEST} names them")
