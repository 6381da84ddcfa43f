"""The files of a closed-loop run: `paths.npz` and `navigation.json`, each whole or not at all, the result last."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench.driving import Paths
from eigenbench.errors import GenerationError
from eigenbench.loop_record import Driven, Told
from eigenbench.records import Arrays
from eigenbench.shards import publish, temporary_beside, write_text_atomically

NAVIGATION, PATHS, PAGE = "navigation.json", "paths.npz", "navigation.html"
NAVIGATION_VERSION = 1


def path_arrays(paths: Mapping[str, Paths], driven: Driven) -> Arrays:
    """Return every pose, move and truth by policy, and the model's answers, as they are stored."""
    arrays: Arrays = {}
    for policy, found in paths.items():
        arrays |= {f"{policy}_poses": found.poses, f"{policy}_moves": found.moves, f"{policy}_passes": found.passes}
    return arrays | {f"model_{name}": values for name, values in driven.fields.items()}


def paths_digest(paths: Mapping[str, Paths], driven: Driven) -> str:
    """Return the sha256 of names, types, shapes and bytes of `path_arrays`."""
    digest = hashlib.sha256(json.dumps(driven.groups).encode())
    for name, values in sorted(path_arrays(paths, driven).items()):
        digest.update(f"{name} {values.dtype} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def write_loop(folder: Path, told: Told, result: Mapping[str, Any]) -> None:
    """Write a run's paths, and its result last, so that a folder with a result is whole.

    GenerationError if the disk is full.
    """
    path = folder / PATHS
    temporary = temporary_beside(path)
    fleet = {"room": told.fleet.room, "starts": told.fleet.starts, "sizes": told.fleet.sizes}
    try:
        with temporary.open("wb") as handle:
            np.savez_compressed(handle, allow_pickle=False, **(fleet | path_arrays(told.paths, told.driven)))
        publish(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        msg = f"{path} cannot be written: {error.strerror}. Make room; the same command goes on."
        raise GenerationError(msg) from error
    write_text_atomically(folder / NAVIGATION, json.dumps(dict(result), indent=1, allow_nan=False) + "\n")
