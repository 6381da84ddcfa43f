"""DEFINES the benchmark: tasks, file format, datasets, model interface, metrics, command line.

`benchmark/` in the source tree is this package, `eigenbench`; `generators/`, `baselines/` and
`leaderboard/` beside it are its sub-packages. Read in the order of the data:
tasks -> shard_format -> shards -> dataset -> hosting -> asking -> scoring -> evaluation -> tables, then cli.

Importing it loads nothing heavy; each public name is fetched when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eigenbench._version import DATA_VERSION, __version__

if TYPE_CHECKING:
    from eigenbench.checking import check
    from eigenbench.checkpoints import load_checkpoint
    from eigenbench.comparison import compare
    from eigenbench.dataset import load
    from eigenbench.evaluation import evaluate
    from eigenbench.records import Prediction
    from eigenbench.scoring import score
    from eigenbench.tasks import TASKS
    from eigenbench.verification import verify

_PUBLIC = {
    "TASKS": "eigenbench.tasks",
    "Prediction": "eigenbench.records",
    "check": "eigenbench.checking",
    "compare": "eigenbench.comparison",
    "evaluate": "eigenbench.evaluation",
    "generate": "eigenbench.generators.generation",
    "load": "eigenbench.dataset",
    "load_checkpoint": "eigenbench.checkpoints",
    "score": "eigenbench.scoring",
    "verify": "eigenbench.verification",
}

__all__ = [
    "DATA_VERSION",
    "TASKS",
    "Prediction",
    "__version__",
    "check",
    "compare",
    "evaluate",
    "generate",
    "load",
    "load_checkpoint",
    "score",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Fetch a public name from its module the first time it is used."""
    if name not in _PUBLIC:
        msg = f"module 'eigenbench' has no attribute {name!r}"
        raise AttributeError(msg)
    value = getattr(import_module(_PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
