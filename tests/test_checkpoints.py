"""Checkpoints: what is read, what is refused, and that nothing dangerous ever runs outside the sandbox."""

import contextlib
import json
import os
import pickle
import struct
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
from hostile_runs import levels
from material import answer, model

import eigenbench
from eigenbench.errors import ModelError, UsageError
from eigenbench.pickles import BadCheckpoint, check_checkpoint
from eigenbench.tasks import TASKS

STRONGEST = [level for level, reason in levels().items() if not reason][-1]


class Bomb:
    """Touches a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return (os.system, (f"touch {self.mark}",))


def safetensors(path: Path, metadata: dict | None = None) -> Path:
    """Write one float32 tensor `w` = [1, 2] by the format's definition: length, JSON header, bytes."""
    header = {"w": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}
    text = json.dumps(header | ({"__metadata__": metadata} if metadata else {})).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + struct.pack("<2f", 1, 2))
    return path


@pytest.fixture
def mark(tmp_path) -> Path:
    return tmp_path / "ran"


def bombs(folder: Path, mark: Path) -> list[Path]:
    """Write the same bomb as a bare pickle of each protocol, in a torch archive, a nested one, an object array."""
    paths = []
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        paths.append(folder / f"bare{protocol}.pt")
        paths[-1].write_bytes(pickle.dumps({"w": Bomb(mark)}, protocol))
    for name in ("archive/data.pkl", "data.pkl"):
        paths.append(folder / f"{name.replace('/', '-')}.pt")
        with zipfile.ZipFile(paths[-1], "w") as archive:
            archive.writestr(name, pickle.dumps(OrderedDict(w=Bomb(mark)), 2))
    paths.append(folder / "objects.npz")
    np.savez(paths[-1], w=np.array([Bomb(mark)], dtype=object))
    paths.append(folder / "hidden.weights")  # no suffix gives it away
    paths[-1].write_bytes(pickle.dumps(Bomb(mark), 2))
    return paths


def test_bombs_are_found_and_never_run(tmp_path, mark):
    """Every form of the same malicious pickle is refused unread, by the harness and by the loader."""
    for path in bombs(tmp_path, mark):
        with pytest.raises(
            BadCheckpoint, match=r"would call (posix|os)\.system|hides what it would call|pickled objects"
        ):
            check_checkpoint(path)
        with pytest.raises(ModelError, match=rf"Checkpoint {path.name} .*Save the weights alone: as safetensors"):
            eigenbench.load_checkpoint(path)
        with pytest.raises(ModelError, match=f"Checkpoint {path.name}"):
            answer(model(tmp_path, "return {}"), checkpoint=str(path))
    assert not mark.exists()


def test_a_bomb_in_a_folder_is_found(tmp_path, mark):
    """A folder of weights is looked through file by file."""
    folder = tmp_path / "weights" / "deep"
    folder.mkdir(parents=True)
    safetensors(folder / "good.safetensors")
    check_checkpoint(tmp_path / "weights")
    (folder / "bad.bin").write_bytes(pickle.dumps(Bomb(mark), 2))
    with pytest.raises(BadCheckpoint, match="would call posix.system"):
        check_checkpoint(tmp_path / "weights")


@pytest.mark.skipif(STRONGEST not in ("landlock", "bubblewrap"), reason="this machine has no sandbox")
def test_a_bomb_that_a_model_unpickles_itself_is_contained(tmp_path, mark):
    """A model is code and may unpickle what it likes; what that runs is locked in with it."""
    folder = tmp_path / "submission"
    folder.mkdir()
    (folder / "weights.dat").write_bytes(b"\n" + pickle.dumps(Bomb(mark)))
    body = "import pickle; from pathlib import Path; pickle.loads(Path(__file__).with_name('weights.dat').read_bytes()[1:]); return {'probability': np.full(len(env), 0.5)}"
    answer(model(tmp_path, body))
    assert not mark.exists()
    answer(model(tmp_path, body), isolation="none")
    assert mark.exists()


def test_torch_files(tmp_path):
    """State dicts of both torch formats are read; a pickled module and TorchScript are refused."""
    torch = pytest.importorskip("torch", reason="torch is an extra")
    layer = torch.nn.Linear(3, 2)
    for new in (True, False):
        path = tmp_path / f"state{new}.pt"
        state = layer.state_dict() | {"half": torch.ones(2).half(), "step": 5, "ids": torch.arange(3)}
        torch.save(state, path, _use_new_zipfile_serialization=new)
        got = eigenbench.load_checkpoint(path)
        assert torch.equal(got["weight"], layer.weight)
        assert got["step"] == 5
        torch.save(layer, path, _use_new_zipfile_serialization=new)
        with pytest.raises(ModelError, match="is a pickle that would call torch.nn.modules.linear.Linear"):
            eigenbench.load_checkpoint(path)
    torch.save(torch.ones(3), tmp_path / "tensor.pt")
    with pytest.raises(ModelError, match="holds a Tensor, expected a dictionary"):
        eigenbench.load_checkpoint(tmp_path / "tensor.pt")


def test_everything_that_torch_reads_as_weights_passes(tmp_path):
    """What the rule here calls harmless is what torch's own restricted reader allows: tested on many types."""
    torch = pytest.importorskip("torch", reason="torch is an extra")
    numbers = [torch.float32, torch.float64, torch.float16, torch.bfloat16, torch.int64, torch.uint8, torch.bool]
    state = {str(t): torch.ones(2).to(t) for t in numbers} | {"types": numbers, "size": torch.Size([1])}
    state |= {
        "parameter": torch.nn.Parameter(torch.ones(2)),
        "place": torch.device("cpu"),
        "z": 1j,
        "b": b"x",
        "s": {1},
    }
    path = tmp_path / "many.pt"
    torch.save(state, path)
    torch.load(path, weights_only=True)
    assert set(eigenbench.load_checkpoint(path)) == set(state)


def test_safetensors(tmp_path):
    """The format's definition is read; weights for another task are refused."""
    pytest.importorskip("safetensors", reason="safetensors is in the extra torch")
    pytest.importorskip("torch", reason="torch is an extra")
    path = safetensors(tmp_path / "w.safetensors", {"task": "tube"})
    assert eigenbench.load_checkpoint(path, task="tube")["w"].tolist() == [1, 2]
    assert eigenbench.load_checkpoint(path)["w"].tolist() == [1, 2]
    with pytest.raises(ModelError, match="was trained for the task 'tube', not for 'fit'"):
        eigenbench.load_checkpoint(path, task="fit")


def test_weights_for_the_same_question(tmp_path):
    """What learnt in many rooms may be asked about one, and the other way round; no other tasks share weights."""
    pytest.importorskip("safetensors", reason="safetensors is in the extra torch")
    pytest.importorskip("torch", reason="torch is an extra")
    for made_for in (*TASKS, "box-110000", "elsewhere"):
        path, taken = safetensors(tmp_path / f"{made_for}.safetensors", {"task": made_for}), set()
        for task in (*TASKS, "box-110000"):
            with contextlib.suppress(ModelError):
                eigenbench.load_checkpoint(path, task=task)
                taken.add(task)
        rooms = {"navigation", "navigation-paper"}
        assert taken == (rooms if made_for in rooms else {made_for} - {"elsewhere"})


@pytest.mark.parametrize("length", [0x80, 0x280, 0x380, 0x580, 0x680, 0xFF80])
def test_a_header_length_that_looks_like_a_pickle(tmp_path, length):
    """A safetensors file whose first byte happens to be a pickle's mark is none: no operation of a pickle is 0."""
    path = tmp_path / "w.safetensors"
    text = json.dumps({"w": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}).encode().ljust(length)
    path.write_bytes(struct.pack("<Q", length) + text + struct.pack("<2f", 1, 2))
    check_checkpoint(path)
    with path.open("rb") as file, pytest.raises((pickle.UnpicklingError, ValueError)):
        pickle.load(file)


def test_numpy_archives(tmp_path):
    """Arrays of numbers are read without torch."""
    np.savez(tmp_path / "w.npz", w=np.arange(3))
    assert eigenbench.load_checkpoint(tmp_path / "w.npz")["w"].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("w.safetensors", b"", "cannot be read"),
        ("w.safetensors", b"\xff" * 40, "cannot be read"),
        ("w.safetensors", struct.pack("<Q", 2) + b"[]", "cannot be read: its header is no table"),
        ("w.safetensors", struct.pack("<Q", 20) + b"{", "cannot be read"),
        ("w.pt", b"", "is a damaged pickle"),
        ("w.pt", b"not a pickle", "is a damaged pickle"),
        ("w.pt", b"PK\x03\x04" + b"x" * 100, "is a damaged archive"),
        ("w.pt", pickle.dumps({"a": 1}, 2)[:-3], "is a damaged pickle"),
        ("w.npz", b"PK\x03\x04", "is a damaged archive"),
        ("w.txt", b"0.5", "is of no known kind; known: .safetensors"),
    ],
)
def test_unreadable_checkpoints(tmp_path, name, content, message):
    """What is cut short, empty or something else is named, never a traceback of a library."""
    if name.endswith("safetensors"):
        pytest.importorskip("safetensors", reason="safetensors is in the extra torch")
        pytest.importorskip("torch", reason="torch is an extra")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ModelError, match=f"Checkpoint {name} {message}"):
        eigenbench.load_checkpoint(tmp_path / name)


def test_missing_checkpoints(tmp_path):
    """A file that is not there, and a folder in its place, are named by the harness and by the loader."""
    with pytest.raises(ModelError, match="nowhere.pt does not exist"):
        eigenbench.load_checkpoint(tmp_path / "nowhere.pt")
    with pytest.raises(ModelError, match="is a folder; name a file"):
        eigenbench.load_checkpoint(tmp_path)
    with pytest.raises(UsageError, match="nowhere.pt does not exist or cannot be read"):
        answer(model(tmp_path, "return {}"), checkpoint=str(tmp_path / "nowhere.pt"))


def test_a_model_reads_its_checkpoint_in_the_sandbox(tmp_path):
    """The loader works where the model runs, and its errors come out as one sentence."""
    text = (
        "import eigenbench\ndef build(task, checkpoint, device):\n    return Model(eigenbench.load_checkpoint(checkpoint, task.name))\n"
        "class Model:\n    def __init__(self, weights):\n        self.p = float(weights['p'])\n"
        "    def predict(self, env, obj):\n        return {'probability': [self.p] * len(env)}\n"
    )
    np.savez(tmp_path / "w.npz", p=0.75)
    got, _ = answer(model(tmp_path, text), checkpoint=str(tmp_path / "w.npz"))
    assert (got.arrays["probability"] == 0.75).all()
    (tmp_path / "w.txt").write_text("0.5")
    with pytest.raises(
        ModelError, match=r"failed in build: ModelError: Checkpoint w.txt is of no known kind.*, line 3"
    ):
        answer(model(tmp_path, text), checkpoint=str(tmp_path / "w.txt"))


def test_a_model_for_another_task(tmp_path):
    """A model that says which tasks it is for is refused elsewhere, with their names."""
    text = "class Model:\n    tasks = ('fit', 'top')\n    def predict(self, env, obj):\n        return {'probability': [0.5] * len(env)}\n"
    with pytest.raises(ModelError, match="failed in build: ValueError: it is for fit, top, not for tube"):
        answer(model(tmp_path, text))
    answer(model(tmp_path, text.replace("'top'", "'tube'")))
