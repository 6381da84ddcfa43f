"""Training: what is held out, exact resume, run folders as submissions, and every refusal."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

import eigenbench
from eigenbench.baselines.fitting import fitted
from eigenbench.baselines.models import load_model
from eigenbench.baselines.run_folder import CHECKPOINT
from eigenbench.baselines.schedule import PAPER, Schedule
from eigenbench.baselines.training import train
from eigenbench.cli import app
from eigenbench.errors import DataError, ModelError, UsageError
from eigenbench.frozen_subsets import nested_subset
from eigenbench.learning import DataEfficiency
from eigenbench.subset_split import write_subset
from eigenbench.tasks import TASKS
from eigenbench.validation_pairs import split_rows

SHORT = Schedule(epochs=2, batches=3, batch_size=4, points=16)


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


@pytest.mark.parametrize("model", ["implicit", "direct", "grounded", "canonical"])
def test_run_folder_is_a_submission(small, few, trained, tmp_path, model):
    """Evaluated in isolation, each model passes the checks, and its run says what its own weights say."""
    run = trained if model == "implicit" else train(model, "tube", small, tmp_path / model, SHORT)
    done = eigenbench.evaluate(run / "model.py", few, tmp_path / "evaluation", report=False)
    batch = eigenbench.load(few).read(range(50))
    env, obj = (torch.from_numpy(batch[f"{side}_points"]) for side in ("env", "obj"))
    found = load_model(run / "model.safetensors", TASKS["tube"]).predict(env, obj)
    with np.load(done.folder / "predictions.npz") as stored:
        for name in ("probability", "env_lengths", "vectors", "planes"):
            assert (name in stored) == (name in found)
            if name in found:
                assert np.allclose(stored[name], found[name].numpy(), rtol=1e-4, atol=1e-5)


@pytest.fixture(scope="module")
def few(test_split, tmp_path_factory):
    """Return a split of the first fifty test pairs."""
    folder = tmp_path_factory.mktemp("few") / "test"
    write_subset(eigenbench.load(test_split), np.arange(50), folder)
    return folder


def test_run_is_fitted_anew_for_data_efficiency(small, few, trained, tmp_path):
    """On a subset a fresh model is trained by the run's schedule, in isolation: what `fitted` gives here."""
    asked = DataEfficiency(small / "tube" / "train", (60,))
    done = eigenbench.evaluate(
        trained / "model.py", few, tmp_path / "run", data_efficiency=asked, report=False, checks=False
    )
    section = done.result["data_efficiency"]
    assert section["provided"]
    assert [size["pairs"] for size in section["sizes"]] == [60]
    train_split = eigenbench.load(small / "tube" / "train")
    rows = nested_subset("tube", 0, train_split.column("pair_id"), 60)
    write_subset(train_split, rows, tmp_path / "train")
    net = fitted("implicit", eigenbench.load(tmp_path / "train"), SHORT).eval()
    batch = eigenbench.load(few).read(range(50))
    with torch.inference_mode():
        env = net.answer(*(torch.from_numpy(batch[f"{side}_points"]) for side in ("env", "obj")))["env_lengths"]
    with np.load(done.folder / "subset-000000060-00.npz") as stored:
        assert np.allclose(stored["env_lengths"], env.numpy(), rtol=1e-4, atol=1e-5)


def test_fit_refuses_one_pair_and_names_divergence(small, tmp_path):
    """A single pair has no batch norm; a diverging fit says so."""
    train_split = eigenbench.load(small / "tube" / "train")
    for count, schedule, error in (
        (1, SHORT, "needs two"),
        (8, replace(SHORT, batches=50, learning_rate=1e38, averaging=0.0), "8 pairs diverged"),
    ):
        write_subset(train_split, np.arange(count), tmp_path / str(count))
        with pytest.raises((DataError, ModelError), match=error):
            fitted("direct", eigenbench.load(tmp_path / str(count)), schedule)


def test_too_little_memory_is_told(small, tmp_path, monkeypatch):
    """Torch's own words for it become an error with the next step; the checkpoint stays."""

    def no_room(*_):
        msg = "[enforce fail] DefaultCPUAllocator: can't allocate memory"
        raise RuntimeError(msg)

    monkeypatch.setattr("eigenbench.baselines.implicit.Implicit.loss", no_room)
    with pytest.raises(ModelError, match=r"Too little memory for batches of 4.*--batch-size, and --resume"):
        train("implicit", "tube", small, tmp_path / "run", SHORT)


def test_paper_schedule_trains_as_well(small, tmp_path):
    """All points, no mean of the weights, no stretches: the same code, and resumed the same."""
    schedule = replace(PAPER, epochs=1, batches=2, batch_size=2)
    run = train("implicit", "tube", small, tmp_path / "run", schedule)
    names = load_file(run / CHECKPOINT)
    assert not any(name.startswith("mean.") for name in names)
    train("implicit", "tube", small, run, schedule, resume=True)


def test_validation_shares_no_shape_with_training(every_task):
    """No object and no environment shape is on both sides, unless there is but one (the room of `navigation-paper`)."""
    for name, folder in every_task.items():
        dataset = eigenbench.load(folder)
        kept, held = split_rows(dataset, 8)
        assert 1 <= len(held) <= 8
        assert not set(kept) & set(held)
        for side in ("obj_shape", "env_shape"):
            shapes = dataset.column(side)
            common = set(shapes[kept]) & set(shapes[held])
            assert common <= {b"primitive"} or len(set(shapes)) == 1, name


def test_command_trains(small, tmp_path):
    """`eigenbench train` runs, prints epochs, and writes the run folder."""
    out = tmp_path / "run"
    options = ["--epochs", "1", "--batches", "2", "--batch-size", "4", "--points", "16", "--out", str(out), "--json"]
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
    for told in ("{", '{"points": 5000}', '{"pace": 1}'):
        save_file(weights, path, {"task": "tube", "model": "implicit", "schedule": told})
        with pytest.raises(ModelError, match="name a schedule that cannot be read"):
            load_model(path, TASKS["tube"])
    path.write_bytes((trained / "model.safetensors").read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(path, TASKS["tube"])


def test_damaged_run_cannot_be_resumed(small, trained, tmp_path):
    """A cut checkpoint is named."""
    (tmp_path / CHECKPOINT).write_bytes((trained / CHECKPOINT).read_bytes()[:3000])
    with pytest.raises(ModelError, match=r"checkpoint.safetensors"):
        train("implicit", "tube", small, tmp_path, SHORT, resume=True)
