"""Let a submitted model drive robots through rooms, shut off from the truth, beside an oracle and a random policy.

A run is a folder: `navigation.json` (the scores and all that repeats them), `paths.npz` (every pose, move and answer)
and `navigation.html` (tables, top views, a path to play). What the model answered is kept as it comes (`journal`), so
that the same command goes on after an interruption and ends with the same paths.
"""

import hashlib
import platform
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from eigenbench._version import DATA_VERSION, __version__
from eigenbench.asking import Progress, note
from eigenbench.checking import CHECKED_PAIRS, quick_check
from eigenbench.driving import FORWARD, FULL_TURN, TURN, Decide, Fleet, Floats, Paths, coin, drive, oracle
from eigenbench.errors import UsageError
from eigenbench.floor_cells import CELL, FreeFloor, free_floor
from eigenbench.free_rectangle import fit_lines
from eigenbench.hosting import HostedModel, HostOptions, split_model_name
from eigenbench.journal import Journal, begun, new_run_folder
from eigenbench.loop_files import NAVIGATION, NAVIGATION_VERSION, PAGE, paths_digest, write_loop
from eigenbench.loop_page import write_loop_page
from eigenbench.loop_record import Driven, Told
from eigenbench.loop_scores import Counts, score
from eigenbench.model_driver import ModelDriver
from eigenbench.provenance import ModelDigests, hardware, model_digests
from eigenbench.tasks import TaskSpec

POLICIES = ("model", "oracle", "random")
MAX_STEPS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What is driven.

    Attributes
    ----------
    fleet : the robots and their rooms
    seed : of starts, sizes and the random policy
    about : what rooms and robots were asked for, as it stands in the result
    task : the task that the model is built for
    """

    fleet: Fleet
    seed: int
    about: dict[str, Any]
    task: TaskSpec


@dataclass(frozen=True, slots=True)
class Navigated:
    """What `navigate` returns: the run's folder and everything in its navigation.json."""

    folder: Path
    result: dict[str, Any]


def navigate(
    model: str | Path,
    course: Course,
    out: str | Path | None = None,
    *,
    steps: int = 300,
    bumper: bool = False,
    batch_size: int = 256,
    options: HostOptions | None = None,
    checks: bool = True,
    report: bool = True,
    progress: Progress | None = None,
) -> Navigated:
    """Let `model.py[:name]` drive, score it and return the run.

    The model runs in its own process and sees clouds alone, as in `evaluate`, the robots of a step in an order drawn
    anew. Without `out` the run goes to `runs/navigate-<model>-<time>`. If `out` holds an unfinished run of the same
    model, rooms, robots and options, it goes on.

    Raises
    ------
    ModelError : the model cannot be loaded, fails, hangs or answers wrongly
    DataError : kept answers are damaged or not for these robots
    UsageError : an option is out of range, or `out` holds a whole run, or an unfinished one of something else
    """
    for name, value, most in (("steps", steps, MAX_STEPS), ("batch size", batch_size, MAX_STEPS)):
        if not 1 <= value <= most:
            msg = f"The number of {name} is {value}; it must be from 1 to {most:,}."
            raise UsageError(msg.replace("number of batch size", "batch size"))
    path, name = split_model_name(model)
    folder = _run_folder(out, path)
    options = options or HostOptions()
    options = replace(options, hidden=(*options.hidden, folder))
    digests = model_digests(path, options.checkpoint)
    request = {
        "navigation_version": NAVIGATION_VERSION,
        "eigenbench_version": __version__,
        "model_file": path.name,
        "builder_name": name,
        **{f"model_{k}": v for k, v in asdict(digests).items()},
        **{k: v for k, v in course.about.items() if not isinstance(v, dict)},
        "fleet_digest": _fleet_digest(course.fleet),
        "steps": steps,
        "bumper": bumper,
        "batch_size": batch_size,
        "device": options.device,
        "isolation": options.isolation,
    }
    with begun(folder, request) as journal:
        driven, about = _drive_model(model, course, journal, options, request, checks, progress)
        told = _told(course, driven, steps, bumper, progress)
        result = {**_provenance(request, digests, course, options, journal), **about, **told.result}
        result["seconds"] |= {k: round(v, 3) for k, v in told.seconds.items()}
        write_loop(folder, told, result)
    if report:
        write_loop_page(folder / PAGE, told, result)
    return Navigated(folder, result)


def _drive_model(
    model: str | Path,
    course: Course,
    journal: Journal,
    options: HostOptions,
    request: dict[str, Any],
    checks: bool,
    progress: Progress | None,
) -> tuple[Driven, dict[str, Any]]:
    """Let the model drive; whatever ends it, its answers so far are kept. Returns also what is known of the model."""
    started = time.perf_counter()
    fleet, steps = course.fleet, request["steps"]
    with HostedModel(model, course.task, options) as hosted:
        driver = ModelDriver(hosted, journal, request["batch_size"])
        note(driver.part, hosted, _checking(fleet) if checks else None)
        try:
            paths = drive(fleet, driver, steps, bumper=request["bumper"], tell=_teller(progress, "driving", steps))
        finally:
            driver.keep()
    seconds = time.perf_counter() - started
    about = {
        "model_capabilities": driver.part.about["capabilities"],
        "isolation": driver.part.about["isolation"],
        "checks": driver.part.about["prepared"].get("checks"),
        "seconds": {"model": round(driver.model_seconds, 3), "model_and_loop": round(seconds, 3)},
    }
    return Driven(paths, driver.fields(steps, len(fleet)), driver.groups), about


def _checking(fleet: Fleet) -> Callable[[HostedModel], dict[str, Any]]:
    def check(hosted: HostedModel) -> dict[str, Any]:
        robots = np.arange(min(len(fleet), CHECKED_PAIRS))
        views = fleet.views(robots, fleet.starts[robots])
        return {"checks": [asdict(f) for f in quick_check(hosted, views, fleet.clouds[robots])]}

    return check


def _told(course: Course, driven: Driven, steps: int, bumper: bool, progress: Progress | None) -> Told:
    """Let the other policies drive, measure what was covered, and score all."""
    fleet = course.fleet
    started = time.perf_counter()
    others: dict[str, Decide] = {"oracle": oracle, "random": coin(course.seed)}
    paths: dict[str, Paths] = {"model": driven.paths}
    for name, decide in others.items():
        paths[name] = drive(fleet, decide, steps, bumper=bumper, tell=_teller(progress, f"driving ({name})", steps))
    floors: list[FreeFloor] = []
    for k in range(len(fleet)):
        floors.append(free_floor(fleet.rooms[int(fleet.room[k])], fleet.starts[k], fleet.sizes[k]))
        if progress:
            progress("measuring floors", k + 1, len(fleet))
    reached = {name: _reached(floors, p) for name, p in paths.items()}
    counts = {name: Counts.of(p, reached[name]) for name, p in paths.items()}
    rooms = [fleet.rooms[int(k)] for k in fleet.room]
    scores = score(counts, [r.name for r in rooms], [r.kind for r in rooms])
    lines = fit_lines(driven.robot_lengths(), fleet.sizes) if driven.has_lengths else {}
    result = {
        "decided_by": "lengths" if driven.has_lengths else "probability",
        "scores": scores,
        "lines_to_metres": {side: asdict(line) for side, line in lines.items()},
        "robots": _robots(fleet, floors),
        "paths_digest": paths_digest(paths, driven),
    }
    return Told(fleet, paths, driven, floors, counts, lines, result, {"others": time.perf_counter() - started})


def _reached(floors: list[FreeFloor], paths: Paths) -> Floats:
    return np.array([floor.share(paths.poses[:, k, :2]) for k, floor in enumerate(floors)])


def _robots(fleet: Fleet, floors: list[FreeFloor]) -> list[dict[str, Any]]:
    """Return where each robot starts, how large it is and how much floor it has."""
    return [
        {
            "room": fleet.rooms[int(fleet.room[k])].name,
            "start": fleet.starts[k].tolist(),
            "diameter": float(fleet.sizes[k, 0]),
            "height": float(fleet.sizes[k, 1]),
            "free_floor_m2": round(floors[k].area, 4),
        }
        for k in range(len(fleet))
    ]


def _teller(progress: Progress | None, what: str, steps: int) -> Callable[[int], None] | None:
    return None if progress is None else lambda done: progress(what, done, steps)


def _fleet_digest(fleet: Fleet) -> str:
    digest = hashlib.sha256()
    for array in (fleet.room, fleet.starts, fleet.sizes, fleet.clouds):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _provenance(
    request: dict[str, Any], digests: ModelDigests, course: Course, options: HostOptions, journal: Journal
) -> dict[str, Any]:
    rooms = course.fleet.rooms
    return {
        "navigation_version": NAVIGATION_VERSION,
        "eigenbench": __version__,
        "data_version": DATA_VERSION,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "model": {"file": request["model_file"], "name": request["builder_name"], **asdict(digests)},
        "course": {**course.about, "fleet_digest": request["fleet_digest"]},
        "rooms": [{"name": r.name, "kind": r.kind} for r in rooms],
        "policy": {
            "forward_m": FORWARD,
            "turn_degrees": round(float(np.degrees(TURN)), 6),
            "stuck_after_steps": FULL_TURN,
            "bumper": request["bumper"],
            "steps": request["steps"],
            "cell_m": CELL,
        },
        "batch_size": request["batch_size"],
        "device": options.device,
        "limits": {k: getattr(options, k) for k in ("timeout", "build_timeout", "memory_gib")},
        "hardware": hardware(options.device),
        "python": platform.python_version(),
        "seeds": {"course": course.seed, "order": journal.seed},
        "resumed": journal.resumed,
    }


def _run_folder(out: str | Path | None, model: Path) -> Path:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    default = Path("runs") / f"navigate-{model.stem}-{stamp}"
    return new_run_folder(Path(out) if out is not None else default, model, NAVIGATION)
