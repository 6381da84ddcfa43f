"""Honesty of a run itself: no model hides what it told in the run by behaving where it is checked."""

import numpy as np
import pytest
from hostile_runs import FACES, HOSTILE, UNSEEN, faces_of
from material import EXAMPLES, model
from test_checking import ANSWER, LENGTHS

import eigenbench
from eigenbench.told_apart import AGAIN, ENV_APART, MOST_PAIRS, OBJ_APART, mixed_rows

AFTER = (AGAIN, ENV_APART, OBJ_APART)


def after(result: dict) -> dict[str, bool | None]:
    """Return what each check after the run said."""
    return {f["name"]: f["passed"] for f in result["checks"] if f["name"] in AFTER}


@pytest.mark.parametrize(
    ("pairs", "batch"), [(300, 37), (300, 150), (300, 256), (300, 999), (3, 8), (2, 1), (9000, 9000)]
)
def test_no_environment_meets_its_own_object(pairs, batch):
    """As many rows as a batch has, each once a side; with two batches or more no object of these environments at all."""
    order = np.random.default_rng(pairs).permutation(pairs)
    env, obj = mixed_rows(order, batch)
    assert len(env) == len(obj) == min(batch, pairs, MOST_PAIRS)
    assert len(set(env)) == len(env) == len(set(obj))
    assert (env != obj).all()
    assert 2 * len(env) > pairs or not set(env) & set(obj)


def test_one_pair_has_no_other_partner():
    """Then there is nothing to mix."""
    env, obj = mixed_rows(np.zeros(1, dtype=np.int64), 256)
    assert env.tolist() == obj.tolist() == [0]


@pytest.mark.parametrize("batch", [37, 256])
@pytest.mark.parametrize("name", ["bounding_box", "constant", "object_only"])
def test_honest_models_pass(test_split, tmp_path, name, batch):
    """The examples pass all that applies to them, of whatever batches a run is made."""
    done = eigenbench.evaluate(EXAMPLES / f"{name}.py", test_split, tmp_path / "run", batch_size=batch, report=False)
    found = after(done.result)
    assert set(found) == set(AFTER)
    assert found[AGAIN] is True
    assert not [f for f in done.result["checks"] if f["passed"] is False]
    if name == "constant":
        assert found[ENV_APART] is found[OBJ_APART] is None
    assert done.result["seconds"]["harness"] > 0


@pytest.mark.parametrize("face", FACES)
def test_two_faces(test_split, tmp_path, face):
    """Whatever a model shows before its run: the lengths of the run are found out, unless it may do what it does."""
    before, found = faces_of(face, test_split, tmp_path / "run")
    assert before == (face == "by_scale")
    assert found == (face not in UNSEEN)


def test_side_that_moves_is_named(test_split, tmp_path):
    """An environment's lengths that follow the object, an object's that follow the environment."""
    for face, failed in (("by_size", ENV_APART), ("by_object", OBJ_APART)):
        path = f"{HOSTILE / 'faces.py'}:{face}"
        result = eigenbench.evaluate(path, test_split, tmp_path / face, batch_size=100, report=False).result
        assert after(result)[failed] is False


def test_noise_of_a_process(test_split, tmp_path):
    """A model that draws anew in each process is not the one that was scored."""
    text = "import numpy as np\nR = np.random.default_rng().uniform(0.5, 2)\nclass Model:\n    def predict(self, env, obj):\n"
    body = text + "        " + (LENGTHS + "e = e * R; " + ANSWER).replace("; ", "\n        ") + "\n"
    result = eigenbench.evaluate(model(tmp_path, body), test_split, tmp_path / "run", report=False).result
    assert after(result)[AGAIN] is False


def test_other_answers_than_in_the_run(test_split, tmp_path):
    """A process that answers in another form is found out, not compared."""
    text = (
        "import os\nimport numpy as np\nS = 1 + os.urandom(1)[0] % 16\nclass Model:\n    def predict(self, env, obj):\n"
    )
    body = text + "        one = np.ones((len(env), S))\n        return {'env_lengths': one, 'obj_lengths': one}\n"
    failed = []
    for k in range(8):  # two draws may agree by chance
        result = eigenbench.evaluate(model(tmp_path, body), test_split, tmp_path / f"run{k}", report=False).result
        failed = [f for f in result["checks"] if f["passed"] is False]
        if failed:
            break
    assert failed[0]["name"] == AGAIN
    assert failed[0]["seen"].startswith("now it gives {'env_lengths': (")
