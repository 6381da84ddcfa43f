"""Truths of every task: FCL's labels, draws that are functions of the pair alone, protocols, balance, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import LIBRARY_TASKS, all_tasks, block_of, contradictions, maker_of, stock_of
from material import box_mesh, write_obj
from scipy import stats

from eigenbench.errors import ShapeError, UsageError
from eigenbench.generators import relabelling
from eigenbench.generators.building import build
from eigenbench.generators.generation import generate
from eigenbench.generators.pairs import RATIO_MAX
from eigenbench.generators.relabelling import label_by_fcl
from eigenbench.manifest import read_manifest
from eigenbench.records import Recipe
from eigenbench.shard_format import CANDIDATES, REASONS
from eigenbench.tasks import TASKS, find_task

PAIRS = 400


@pytest.mark.parametrize("task", all_tasks())
@pytest.mark.parametrize(("protocol", "draws", "pairs"), [("exact", "ratio", 24), ("sampled", "ratio", 8)])
def test_fast_engine_equals_fcl(task, protocol, draws, pairs):
    """On the same placements the plain FCL sweep finds the same labels and witnesses."""
    block = block_of(task, PAIRS, protocol=protocol, draws=draws)
    assert contradictions(block, range(pairs)) == []


@pytest.mark.parametrize("task", all_tasks())
def test_fast_engine_equals_fcl_under_independent_draws(task):
    """The same where sizes do not depend on the environment, and the object may be far too large."""
    for protocol, pairs in (("exact", 8), ("sampled", 4)):
        assert contradictions(block_of(task, PAIRS, protocol=protocol, draws="independent"), range(pairs)) == []


@pytest.mark.parametrize("task", all_tasks())
def test_fcl_engine_writes_the_same_targets(task):
    """Labels, witnesses and reasons of `--engine fcl` are those of the fast engine."""
    fast, fcl = (build(maker_of(task, engine=engine), 0, 6) for engine in ("fast", "fcl"))
    label_by_fcl(fcl)
    for name, values in fast.targets.items():
        assert np.array_equal(values, fcl.targets[name], equal_nan=values.dtype.kind == "f"), name


@pytest.mark.parametrize("task", all_tasks())
def test_fcl_agrees_close_to_the_boundary(task):
    """The pairs with the smallest margins, on either side, are no exception."""
    block = block_of(task, 2000, clouds=False)
    length = block.targets["env_lengths"][np.arange(2000), block.targets["decides"]]
    order = np.argsort(np.abs(block.targets["margin"]) / length)
    chosen = [*order[block.targets["label"][order]][:4], *order[~block.targets["label"][order]][:2]]
    assert contradictions(block, chosen) == []


@pytest.mark.parametrize("task", all_tasks())
def test_a_pair_is_a_function_of_its_index_alone(task):
    """A block that starts in the middle, and one of a single pair, hold the same rows."""
    whole = block_of(task, PAIRS)
    for first, count in ((117, 60), (399, 1)):
        part = build(whole.maker, first, count)
        for arrays, all_of in ((part.inputs, whole.inputs), (part.targets, whole.targets)):
            for name, values in arrays.items():
                expected = all_of[name][first : first + count]
                assert np.array_equal(values, expected, equal_nan=values.dtype.kind == "f"), name


@pytest.mark.parametrize("task", all_tasks())
def test_targets_are_consistent(task):
    """Witness, reason and margin say what the label says; names are unique; the deciding length takes part."""
    block = block_of(task, PAIRS)
    t = block.targets
    assert np.array_equal(t["label"], t["margin"] > 0)
    assert np.array_equal(t["label"], t["reason"] == REASONS["fits"])
    assert np.array_equal(t["label"], np.isfinite(t["witness"]).all(axis=1))
    assert np.array_equal(~t["label"], np.isnan(t["witness"]).all(axis=1))
    assert t["binding"][np.arange(PAIRS), t["decides"]].all()
    assert len(np.unique(t["pair_id"])) == PAIRS
    assert np.array_equal(t["pair_id"], block.inputs["pair_id"])
    at = np.flatnonzero(t["label"])[0]
    tried = block.witnesses(at)
    assert (tried == t["witness"][at]).all(axis=1).any()
    assert len(tried) >= (1 if find_task(task).egocentric else CANDIDATES)


@pytest.mark.parametrize("task", all_tasks())
def test_sampled_protocol_loses_only_positives(task):
    """Without guided placements everything is as before, but some positives are missed."""
    exact, sampled = (block_of(task, 1000, clouds=False, protocol=p).targets for p in ("exact", "sampled"))
    lost = exact["label"] & ~sampled["label"]
    assert not (sampled["label"] & ~exact["label"]).any()
    assert lost.mean() < 0.12
    for name in set(exact) - {"label", "witness", "reason"}:
        assert np.array_equal(exact[name], sampled[name], equal_nan=exact[name].dtype.kind == "f"), name
    assert (sampled["reason"][lost] == REASONS["no_candidate"]).all()
    kept = ~lost & ~exact["label"]
    assert np.array_equal(exact["reason"][kept], sampled["reason"][kept])


@pytest.mark.parametrize("task", all_tasks())
def test_independent_draws_leave_the_environment_alone(task):
    """Object sizes have the same law whatever the environment is; labels stay consistent, their rate is another."""
    ratio, free = (block_of(task, 2000, clouds=False, draws=d).targets for d in ("ratio", "independent"))
    assert np.array_equal(free["label"], free["margin"] > 0)
    if find_task(task).ruled:
        slack = np.where(free["binding"], free["env_lengths"] - free["obj_lengths"], np.inf)
        clauses = [slack[:, list(clause)].min(axis=1) for clause in find_task(task).clauses]
        assert np.array_equal(free["label"], np.max(clauses, axis=0) > 0)
    if not find_task(task).egocentric:  # a robot must be able to stand where it starts
        assert dependence(free, "obj_scale") > 1e-4
    if task not in LIBRARY_TASKS:
        assert dependence(ratio, "obj_scale") < 1e-4
    assert abs(free["label"].mean() - ratio["label"].mean()) > 0.01


def dependence(t, name: str) -> float:
    """Return the p-value of a field having one law in large environments and in small ones."""
    length = t["env_lengths"][:, t["binding"][0]][:, 0]
    large = length > np.median(length)
    return float(stats.ks_2samp(t[name][large], t[name][~large]).pvalue)


@pytest.mark.parametrize("task", all_tasks())
def test_classes_and_lengths_are_balanced(task):
    """45 to 55 % fit; every binding length decides 15 % of the negatives, 8 % where shapes set the lengths."""
    t = block_of(task, 4000, "train", clouds=False).targets
    assert 0.45 <= t["label"].mean() <= 0.55
    binding = t["binding"][0]
    shares = np.bincount(t["decides"][~t["label"]], minlength=len(binding)) / (~t["label"]).sum()
    assert (shares[~binding] == 0).all()
    assert (shares[binding] >= (0.08 if task in LIBRARY_TASKS else 0.15)).all(), shares


@pytest.mark.parametrize("task", all_tasks())
def test_difficulty_is_spread(task):
    """10 to 15 % of the pairs, give or take two, have a margin within 10 % of the deciding length."""
    t = block_of(task, 4000, "train", clouds=False).targets
    relative = np.abs(t["margin"]) / t["env_lengths"][np.arange(4000), t["decides"]]
    assert 0.08 <= (relative < 0.1).mean() <= 0.17


@pytest.mark.parametrize("task", [name for name in all_tasks() if find_task(name).object == "object"])
def test_object_categories_are_equally_likely(task):
    """Object categories are drawn alike, to what redrawing pairs near their boundary and far from it leaves."""
    t = block_of(task, 4000, "train", clouds=False).targets
    categories = np.unique(stock_of(task, "train").objects.categories)
    counts = np.array([(t["obj_category"] == c).sum() for c in categories])
    if task in LIBRARY_TASKS:
        assert (np.abs(counts / 4000 - 1 / len(categories)) < 0.3 / len(categories)).all()
    else:
        assert stats.chisquare(counts).pvalue > 1e-4


@pytest.mark.parametrize("task", ["top", "mug"])
def test_bytes_do_not_depend_on_workers(task, tmp_path):
    """One worker and two write the same digests, of tasks that draw library environments."""
    for workers in (1, 2):
        generate(task, "test", 2600, tmp_path / str(workers), workers=workers)
    one, two = (read_manifest(tmp_path / str(w) / task / "test") for w in (1, 2))
    assert one.digest == two.digest
    assert one.audit == two.audit
    assert one.audit.mismatches == 0


@pytest.mark.parametrize("task", all_tasks())
def test_audit_names_a_wrong_pair(task):
    """A label flipped, or a witness moved: the audit says which pair and why."""
    block = block_of(task, PAIRS)
    targets = {name: values.copy() for name, values in block.targets.items()}
    wrong = replace(block, targets=targets)
    negative = np.flatnonzero(~targets["label"])[0]
    targets["label"][negative] = True
    said = relabelling.disagreement(wrong, negative, relabelling.relabel(wrong, negative))
    assert said.startswith("label is True, FCL says False")
    positive = np.flatnonzero(block.targets["label"])[0]
    targets["witness"][positive] += 10.0
    said = relabelling.disagreement(wrong, positive, relabelling.relabel(wrong, positive))
    assert said.startswith("witness is")
    assert not block.maker.family.reference(wrong.pair(positive)).is_free(
        wrong.pair(positive).posed().placement(targets["witness"][positive])
    )


@pytest.mark.parametrize("text", ["box-11111", "box-112111", "box-", "box-1111111", "box-11 111"])
def test_a_face_subset_must_be_six_digits(text):
    """A face subset that does not parse is refused with the rule and an example."""
    with pytest.raises(UsageError, match="six digits 0 or 1, in the order -x"):
        Recipe(text, "train", 10)


def test_bad_tasks_are_refused():
    """Subsets that bind nothing, and unknown names, with the next step."""
    with pytest.raises(UsageError, match="binds no axis.*Let at least one"):
        find_task("box-101010")
    with pytest.raises(UsageError, match="Unknown task 'cylindre'. Did you mean 'cylinder'"):
        find_task("cylindre")
    assert find_task("box-111111") is TASKS["box"]


def test_a_source_without_shapes_for_a_task_is_refused(tmp_path):
    """Objects alone are no source for `fit`; a plain block as environment has no cavity; the reason is given."""
    write_obj(tmp_path / "bare" / "can" / "can.obj", box_mesh(1, 1, 2))
    with pytest.raises(ShapeError, match="environment"):
        generate("fit", "train", 10, tmp_path / "out", shapes=f"meshes={tmp_path / 'bare'}", workers=1)
    for name in range(8):
        write_obj(tmp_path / "solid" / "can" / f"{name}.obj", box_mesh(1, 1, 2))
        write_obj(tmp_path / "solid" / "table" / f"{name}.obj", box_mesh(1, 1, 2 + name / 10))
    with pytest.raises(ShapeError, match="No environment of the train split .* for task 'fit': each has no cavity"):
        generate("fit", "train", 10, tmp_path / "out", shapes=f"meshes={tmp_path / 'solid'}", workers=1)
    made = generate("top", "train", 10, tmp_path / "out", shapes=f"meshes={tmp_path / 'solid'}", workers=1)
    assert [m.audit.mismatches for m in made.values()] == [0]


def test_sizes_stay_within_the_ratio_law():
    """Of what must fit one room, the size lies between 1 / RATIO_MAX and RATIO_MAX of the one that just fits."""
    for task in ("tube", "cylinder", "sphere", "box", "mug"):
        t = block_of(task, 2000, clouds=False).targets
        ratio = (t["obj_lengths"] / t["env_lengths"]).max(axis=1)
        assert 1 / RATIO_MAX - 1e-3 < ratio.min() < 0.75
        assert 1.33 < ratio.max() < RATIO_MAX + 1e-3
