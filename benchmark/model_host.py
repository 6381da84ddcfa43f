"""The model's process: locks itself in, loads the model file, answers batches of clouds until told to stop.

Started by `eigenbench.hosting` as `python -P -m eigenbench.model_host READ_FD WRITE_FD`. It is given
clouds and the task's name: no order, no seed, and no label but those of `adapt` and `fit`.
"""

import importlib.util
import os
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from eigenbench.protocol import Channel, ChannelClosed, Header, pack_arrays, unpack_arrays
from eigenbench.sandbox import enter


def main() -> None:
    """Serve one harness over the two file descriptors named on the command line."""
    channel = Channel(int(sys.argv[1]), int(sys.argv[2]))
    try:
        order, _ = channel.receive()
        try:
            reached = enter(order)
        except OSError as error:
            channel.send({"kind": "error", "phase": "isolation", **_describe(error, "")})
            return
        channel.send({"kind": "isolation", **reached})
        _serve(channel, order)
    except ChannelClosed:
        return


def _serve(channel: Channel, order: Header) -> None:
    phase = "import"
    try:
        builder = _import_builder(order)
        phase = "build"
        model = _build(builder, order)
        channel.send({"kind": "ready", **_capabilities(model)})
        while True:
            header, body = channel.receive()
            phase = header["kind"]
            clouds = unpack_arrays(header["arrays"], body)
            if phase == "predict":
                started = time.perf_counter()
                answer, arrays = _predict(model, clouds)
                answer["seconds"] = time.perf_counter() - started
                listed, payload = pack_arrays(arrays)
                channel.send({"kind": "answer", "arrays": listed} | answer, payload)
            else:
                _learn(model, header, clouds)
                channel.send({"kind": "done"})
    except ChannelClosed:
        raise
    except BaseException as error:
        # SystemExit and KeyboardInterrupt too: whatever a model raises is reported, not obeyed.
        channel.send({"kind": "error", "phase": phase, **_describe(error, order["model"])})


def _describe(error: BaseException, model: str) -> Header:
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if model and Path(f.filename) == Path(model)]
    return {
        "type": type(error).__name__,
        "message": " ".join(str(error).split())[:500],
        "line": own[-1].lineno if own else None,
        "traceback": "".join(traceback.format_exception(error))[-20_000:],
    }


def _import_builder(order: Header) -> Any:
    path = Path(order["model"])
    taken = _is_taken(path.stem)
    sys.path.insert(_place(sys.path, taken), str(path.parent))
    sys.argv = [str(path)]
    name = f"submitted {path.stem}" if taken else path.stem  # a name that no import can ask for
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        msg = f"{path.name} is not a Python file"
        raise ImportError(msg)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    names = [order["name"]] if order["name"] else ["build", "Model"]
    for wanted in names:
        if hasattr(module, wanted):
            return getattr(module, wanted)
    msg = f"it defines no {' and no '.join(names)}"
    raise AttributeError(msg)


def _is_taken(name: str) -> bool:
    """Say whether an import of that name means something else than the model: `random.py`, `torch.py`."""
    try:
        return name in sys.modules or importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):  # "model.v2" has no parent, "__main__" no specification
        return False


def _place(folders: list[str], taken: bool) -> int:
    """Return where a model's folder goes in `sys.path`: behind Python's own, and behind packages if its name is theirs.

    So files beside a model are found before installed packages, but nothing there stands for a module of Python's.
    """
    packages = (k for k, folder in enumerate(folders) if Path(folder).name in ("site-packages", "dist-packages"))
    return len(folders) if taken else next(packages, len(folders))


def _build(builder: Any, order: Header) -> Any:
    from eigenbench.tasks import find_task

    if isinstance(builder, type):
        model = builder()
    else:
        model = builder(find_task(order["task"]), checkpoint=order["checkpoint"], device=order["device"])
    if not callable(getattr(model, "predict", None)):
        msg = f"{type(model).__name__} has no method predict(env, obj)"
        raise AttributeError(msg)
    own = getattr(model, "tasks", None)
    if own is not None and order["task"] not in own:
        msg = f"it is for {', '.join(map(str, own))}, not for {order['task']}"
        raise ValueError(msg)
    return model


def _capabilities(model: Any) -> Header:
    return {
        "arrays": str(getattr(model, "arrays", "numpy")),
        "grounded": bool(getattr(model, "grounded", False)),
        "can": [name for name in ("adapt", "fit") if callable(getattr(model, name, None))],
    }


def _learn(model: Any, header: Header, clouds: dict[str, Any]) -> None:
    """Run `adapt` on labelled pairs in memory, or `fit` on a folder of them."""
    if header["kind"] == "adapt":
        env, obj = _own(model, clouds["env"]), _own(model, clouds["obj"])
        model.adapt(env, obj, _own(model, clouds["label"] != 0))
        return
    from eigenbench.dataset import load
    from eigenbench.hosting import Budget

    model.fit(load(header["folder"]), Budget(header["pairs"], header["seconds"]))


def _own(model: Any, values: Any) -> Any:
    """Return an array as the kind that the model asks for; a frame is its own memory, so the model may change it."""
    if getattr(model, "arrays", "numpy") != "torch":
        return values
    import torch

    return torch.from_numpy(values)


def _predict(model: Any, clouds: dict[str, Any]) -> tuple[Header, dict[str, Any]]:
    from eigenbench.records import Prediction

    env, obj = _own(model, clouds["env"]), _own(model, clouds["obj"])
    answer = Prediction.of(model.predict(env, obj))
    arrays = {}
    narrow = []
    for name in ("probability", "env_lengths", "obj_lengths", "vectors", "planes"):
        value = getattr(answer, name)
        if value is not None:
            arrays[name], was = _as_floats(name, value)
            narrow += [f"{name} {was}"] if was not in ("float32", "float64") else []
    groups = None if answer.groups is None else [[int(s) for s in group] for group in answer.groups]
    return {"groups": groups, "narrow": narrow}, arrays


def _as_floats(name: str, value: Any) -> tuple[Any, str]:
    """Return a tensor, list or array as float32 or float64, and what it was; narrower numbers are widened."""
    import numpy as np

    was = ""
    if hasattr(value, "detach"):
        value = value.detach().cpu()
        if str(value.dtype) == "torch.bfloat16":
            value, was = value.float(), "bfloat16"
        value = value.numpy()
    values = np.asarray(value)
    if values.dtype.kind not in "fiub":
        msg = f"{name} has type {values.dtype}; it must be numbers"
        raise TypeError(msg)
    was = was or str(values.dtype)
    return values if values.dtype in (np.float32, np.float64) else values.astype(np.float64), was


if __name__ == "__main__":
    main()
    os._exit(0)
