"""Models that learn in the harness: `adapt` on labelled pairs, `fit` on an open folder within a budget."""

import numpy as np
import pytest
from material import ENV, OBJ, model

from eigenbench.errors import ModelError, UsageError
from eigenbench.hosting import Budget, HostedModel, HostOptions
from eigenbench.tasks import TASKS

LEARNER = """
import time
import numpy as np

class Model:
    share = 0.5

    def predict(self, env, obj):
        return {"probability": np.full(len(env), self.share)}

    def adapt(self, env, obj, label):
        assert env.shape == obj.shape == (24, 1024, 3) and env.dtype == np.float32
        assert label.dtype == bool and env.flags.writeable
        self.share = label.mean()

    def fit(self, dataset, budget):
        assert len(dataset) == budget.pairs and budget.seconds > 0
        self.share = dataset.column("label").mean()
"""


def hosted(path, **options) -> HostedModel:
    return HostedModel(path, TASKS["tube"], HostOptions(**options))


def test_adapt_then_predict(tmp_path):
    """The labels reach the model as booleans beside clouds that it may change, and predict uses what it learnt."""
    label = np.arange(24) % 4 == 0
    with hosted(model(tmp_path, LEARNER)) as learner:
        assert learner.capabilities.can == ["adapt", "fit"]
        learner.adapt(ENV, OBJ, label)
        assert np.allclose(learner.predict(ENV, OBJ).arrays["probability"], 0.25)


def test_fit_then_predict(tmp_path, small):
    """`fit` gets the opened folder as a dataset, targets included, while its neighbour stays hidden."""
    train, hidden = small / "tube" / "train", small / "tube" / "test"
    with hosted(model(tmp_path, LEARNER), readable=(train,), hidden=(hidden,)) as learner:
        learner.fit(train, Budget(300, 60.0))
        from eigenbench.dataset import load

        share = load(train).column("label").mean()
        assert np.allclose(learner.predict(ENV, OBJ).arrays["probability"], share)


def test_the_folder_of_fit_cannot_be_written(tmp_path, small):
    """The training folder is open to reading alone wherever files are guarded at all."""
    train = small / "tube" / "train"
    body = LEARNER.replace(
        "assert len(dataset)", "(dataset.folder / 'note').write_text('x')\n        assert len(dataset)"
    )
    with hosted(model(tmp_path, body), readable=(train,)) as learner:
        if learner.isolation["level"] in ("none", "rlimits"):
            pytest.skip("this machine has neither Landlock nor bubblewrap")
        with pytest.raises(ModelError, match=r"failed in fit: (PermissionError|OSError)"):
            learner.fit(train, Budget(300, 60.0))
    assert not (train / "note").exists()


@pytest.mark.parametrize(
    ("method", "body", "message"),
    [
        ("adapt", "raise ValueError('no')", r"failed in adapt: ValueError: no, line 4"),
        ("fit", "raise ValueError('no')", r"failed in fit: ValueError: no, line 4"),
        ("fit", "time.sleep(60)", r"gave no answer in fit within 1 s; raise the budget if"),
        ("adapt", "time.sleep(60)", r"gave no answer in adapt within 1 s; raise --timeout if"),
        ("adapt", "import os; os._exit(4)", r"ended its process in adapt \(exit code 4\)"),
    ],
)
def test_failures_are_named(tmp_path, small, method, body, message):
    """A failure while learning is named like one of predict, with the phase and the line."""
    text = f"import time\nclass Model:\n    def {method}(self, *given):\n        {body}\n    def predict(self, env, obj): ...\n"
    train = small / "tube" / "train"
    with hosted(model(tmp_path, text), readable=(train,), timeout=0.1) as learner:
        learn = {
            "fit": lambda: learner.fit(train, Budget(300, 1.0)),
            "adapt": lambda: learner.adapt(ENV, OBJ, np.zeros(24, bool)),
        }
        with pytest.raises(ModelError, match=message):
            learn[method]()


def test_what_was_not_offered(tmp_path, small):
    """A model without the methods, a folder that was not opened, one that is hidden, no folder, no budget."""
    train = small / "tube" / "train"
    with hosted(model(tmp_path, "return {}")) as learner:
        assert learner.capabilities.can == []
        with pytest.raises(ModelError, match="model.py has no method adapt"):
            learner.adapt(ENV, OBJ, np.zeros(24, bool))
    with (
        hosted(model(tmp_path, LEARNER)) as learner,
        pytest.raises(UsageError, match=r"is not open to the model; name it in HostOptions\(readable"),
    ):
        learner.fit(train, Budget(300, 1.0))
    with pytest.raises(UsageError, match="must stay hidden from it"):
        HostOptions(readable=(train,), hidden=(small,))
    with pytest.raises(UsageError, match="nowhere, to be opened to the model, does not exist"):
        HostOptions(readable=(tmp_path / "nowhere",))
    for pairs, seconds in ((0, 1.0), (1, 0.0), (1, float("nan"))):
        with pytest.raises(UsageError, match="The budget is"):
            Budget(pairs, seconds)
