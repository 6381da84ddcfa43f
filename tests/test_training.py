"""Training: what is held out, exact resume, run folders as submissions, and every refusal."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

import eigenbench
from eigenbench.baselines.models import load_model
from eigenbench.baselines.run_folder import CHECKPOINT
from eigenbench.baselines.training import Schedule, train
from eigenbench.cli import app
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.tasks import TASKS
from eigenbench.validation_pairs import split_rows

SHORT = Schedule(epochs=2, batches=3, batch_size=4)


@pytest.fixture(scope="module")
def trained(small, tmp_path_factory):
    """Return the run folder of an implicit model that saw a few batches."""
    return train("implicit", "tube", small, tmp_path_factory.mktemp("runs") / "implicit", SHORT)


def stop_after(batches):
    """Return a progress callback that interrupts, as Ctrl-C does, after some batches."""
    left = iter(range(batches - 1))

    def bar(*_):
        if next(left, None) is None:
            raise KeyboardInterrupt

    return bar


@pytest.mark.parametrize("batches", [1, 2, 4, 5])
def test_resumed_run_is_the_uninterrupted_one(small, trained, tmp_path, monkeypatch, batches):
    """Interrupted anywhere, within an epoch or past one, it ends with the same weights, bit for bit."""
    monkeypatch.setattr("eigenbench.baselines.training.STEPS_A_CHECKPOINT", 2)
    run = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train("implicit", "tube", small, run, SHORT, progress=stop_after(batches))
    train("implicit", "tube", small, run, SHORT, resume=True)
    for file in ("model.safetensors", CHECKPOINT):
        ours, whole = load_file(run / file), load_file(trained / file)
        assert ours.keys() == whole.keys()
        assert all(torch.equal(ours[name], whole[name]) for name in ours)
    told = [json.loads((folder / "train.json").read_text())["history"] for folder in (run, trained)]
    assert [(e["loss"], e["validation_accuracy"]) for e in told[0]] == [
        (e["loss"], e["validation_accuracy"]) for e in told[1]
    ]


def test_finished_run_is_not_trained_again(small, trained):
    """Resuming a finished run does nothing; another seed gives other weights."""
    before = (trained / "model.safetensors").read_bytes()
    train("implicit", "tube", small, trained, SHORT, resume=True, progress=stop_after(1))
    assert (trained / "model.safetensors").read_bytes() == before
    other = train("implicit", "tube", small, trained.parent / "other", replace(SHORT, epochs=1, seed=1))
    assert (other / "model.safetensors").read_bytes() != before


@pytest.mark.parametrize("model", ["implicit", "direct", "grounded"])
def test_run_folder_is_a_submission(small, trained, test_split, tmp_path, model):
    """Evaluated in isolation, each model passes the checks, and its run says what its own weights say."""
    run = trained if model == "implicit" else train(model, "tube", small, tmp_path / model, SHORT)
    done = eigenbench.evaluate(run / "model.py", test_split, tmp_path / "evaluation")
    dataset = eigenbench.load(test_split)
    batch = dataset.read(range(50))
    env, obj = (torch.from_numpy(batch[f"{side}_points"]) for side in ("env", "obj"))
    found = load_model(run / "model.safetensors", TASKS["tube"]).predict(env, obj)
    with np.load(done.folder / "predictions.npz") as stored:
        for name in ("probability", "env_lengths", "vectors", "planes"):
            assert (name in stored) == (name in found)
            if name in found:
                assert np.allclose(stored[name][:50], found[name].numpy(), rtol=1e-4, atol=1e-5)


def test_validation_shares_no_shape_with_training(every_task):
    """No object and no environment shape is on both sides; the choice does not depend on the pairs' order."""
    for name, folder in every_task.items():
        dataset = eigenbench.load(folder)
        kept, held = split_rows(dataset, 8)
        assert 1 <= len(held) <= 8
        assert not set(kept) & set(held)
        for side in ("obj_shape", "env_shape"):
            shapes = dataset.column(side)
            common = set(shapes[kept]) & set(shapes[held])
            assert common <= {b"primitive"}, name


def test_command_trains(small, tmp_path):
    """`eigenbench train` runs, prints epochs, and writes the run folder."""
    out = tmp_path / "run"
    options = ["--epochs", "1", "--batches", "2", "--batch-size", "4", "--out", str(out), "--json"]
    app(["train", "--model", "direct", "--task", "tube", "--data", str(small), *options], standalone_mode=False)
    assert {p.name for p in out.iterdir()} == {"model.py", "model.safetensors", "train.json", CHECKPOINT}


def test_refusals_say_what_to_do(small, trained, tmp_path):
    """Wrong names, data, folders and settings are told before anything is trained."""
    new = tmp_path / "run"
    with pytest.raises(UsageError, match="Did you mean 'implicit'"):
        train("implicitt", "tube", small, new, SHORT)
    with pytest.raises(DataError, match="holds pairs of the task 'tube', not of 'fit'"):
        train("implicit", "fit", small / "tube" / "train", new, SHORT)
    with pytest.raises(DataError, match="is the test split"):
        train("implicit", "tube", small / "tube" / "test", new, SHORT)
    with pytest.raises(DataError, match="does not exist"):
        train("implicit", "tube", tmp_path / "nowhere", new, SHORT)
    with pytest.raises(UsageError, match="exists already. Pass --resume"):
        train("implicit", "tube", small, trained, SHORT)
    with pytest.raises(UsageError, match="was begun with seed 0 instead of 1"):
        train("implicit", "tube", small, trained, replace(SHORT, seed=1), resume=True)
    with pytest.raises(UsageError, match="Device 'tpu0' cannot be used"):
        train("implicit", "tube", small, new, SHORT, device="tpu0")
    for bad in ({"epochs": 0}, {"batch_size": 1}, {"learning_rate": -1.0}, {"form": "slow"}):
        with pytest.raises(UsageError, match=r"must be|Unknown form"):
            Schedule(**bad)
    with pytest.raises(DataError, match="less than one batch"):
        train("implicit", "tube", small, new, replace(SHORT, batch_size=400))
    assert not new.exists() or not any(new.iterdir())


def test_diverging_loss_stops_with_the_last_checkpoint(small, tmp_path, monkeypatch):
    """A loss that is no number ends the run, names the place, and leaves the checkpoint before it."""
    monkeypatch.setattr("eigenbench.baselines.training.STEPS_A_CHECKPOINT", 1)
    with pytest.raises(ModelError, match=r"diverged in epoch 1, step \d.*lower --learning-rate"):
        train("implicit", "tube", small, tmp_path / "run", replace(SHORT, batches=50, learning_rate=1e38))


def test_bad_checkpoints_are_told(trained, tmp_path):
    """Weights of another task, another architecture or of no model are refused, as is a cut file."""
    weights = load_file(trained / "model.safetensors")
    with pytest.raises(ModelError, match="trained for the task 'tube', not for 'fit'"):
        load_model(trained / "model.safetensors", TASKS["fit"])
    path = tmp_path / "weights.safetensors"
    save_file(weights, path, {"task": "tube", "model": "direct"})
    with pytest.raises(ModelError, match="of another architecture"):
        load_model(path, TASKS["tube"])
    save_file(weights, path, {"task": "tube"})
    with pytest.raises(ModelError, match="known: implicit, direct, grounded"):
        load_model(path, TASKS["tube"])
    path.write_bytes((trained / "model.safetensors").read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(path, TASKS["tube"])


def test_damaged_run_cannot_be_resumed(small, trained, tmp_path):
    """A cut checkpoint is named."""
    (tmp_path / CHECKPOINT).write_bytes((trained / CHECKPOINT).read_bytes()[:3000])
    with pytest.raises(ModelError, match=r"checkpoint.safetensors"):
        train("implicit", "tube", small, tmp_path, SHORT, resume=True)
