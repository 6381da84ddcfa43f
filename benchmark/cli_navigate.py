"""The command `eigenbench navigate`. Part of the composition root."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from eigenbench.cli_host import (
    BuildTimeout,
    Checkpoint,
    Device,
    Isolation,
    Memory,
    Processes,
    Scratch,
    Timeout,
    host_options,
)
from eigenbench.console import Json, kept_told, progress_on
from eigenbench.errors import UsageError, printable

MOST_STARTS = 10_000


def navigate(
    model: Annotated[str, typer.Argument(help="model.py, or model.py:name for another builder.")],
    rooms: Annotated[
        str, typer.Option(help="Which test rooms: many, or paper for the one of the paper's size.")
    ] = "many",
    count: Annotated[int | None, typer.Option(help="How many of them; default 20, or all if they are fewer.")] = None,
    scene: Annotated[
        list[Path] | None, typer.Option(help="A room of your own instead: a GLB file, metres; may be repeated.")
    ] = None,
    starts: Annotated[int, typer.Option(help="Robots of each room, each alone in it.")] = 8,
    steps: Annotated[int, typer.Option(help="Steps of each robot, unless it is stuck before.")] = 200,
    seed: Annotated[int, typer.Option(help="Of sizes, starts and the random policy.")] = 0,
    diameter: Annotated[float | None, typer.Option(help="Of every robot, m; default: drawn for each.")] = None,
    height: Annotated[float | None, typer.Option(help="Of every robot, m; default: drawn for each.")] = None,
    bumper: Annotated[bool, typer.Option("--bumper", help="A collision turns the robot; else it stays.")] = False,
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/navigate-<model>-<time>.")] = None,
    batch_size: Annotated[int, typer.Option(help="Views per call of predict.")] = 256,
    timeout: Timeout = 120.0,
    build_timeout: BuildTimeout = 30.0,
    memory: Memory = 4.0,
    scratch: Scratch = 1.0,
    processes: Processes = 128,
    device: Device = "cpu",
    checkpoint: Checkpoint = None,
    isolation: Isolation = "auto",
    checks: Annotated[bool, typer.Option(help="Check the model on some views first.")] = True,
    report: Annotated[bool, typer.Option(help="Write navigation.html into the run folder.")] = True,
    as_json: Json = False,
) -> None:
    """Let a model, shut off from the truth, drive robots through rooms. Run again with its --out, it goes on."""
    from eigenbench.loop_files import PAGE
    from eigenbench.loop_tables import print_loop
    from eigenbench.navigation import navigate as run

    options = host_options(timeout, build_timeout, memory, scratch, processes, device, checkpoint, isolation)
    course = _course(rooms, count, scene or [], starts, seed, (diameter, height))
    with kept_told(), progress_on(as_json) as progress:
        done = run(
            model,
            course,
            out,
            steps=steps,
            bumper=bumper,
            batch_size=batch_size,
            options=options,
            checks=checks,
            report=report,
            progress=progress,
        )
    if as_json:
        print(json.dumps({"run": str(done.folder), **done.result}))
        return
    print_loop(done.result)
    print(printable(f"run: {done.folder}"))
    if report:
        print(printable(f"page: {done.folder / PAGE}"))


def _course(
    rooms: str, count: int | None, scenes: list[Path], starts: int, seed: int, size: tuple[float | None, float | None]
) -> Any:
    """Return what is driven; UsageError or ShapeError where it cannot be."""
    from eigenbench.fleets import draw_fleet
    from eigenbench.generators.driven_rooms import robot_cloud, rooms_digest, scene_rooms, size_law, unseen_rooms
    from eigenbench.navigation import Course
    from eigenbench.tasks import find_task

    if scenes and count is not None:
        msg = "--count chooses among the built-in rooms; with --scene every file named is a room. Pass one of them."
        raise UsageError(msg)
    for name, value, most in (("starts", starts, MOST_STARTS), ("seed", seed, 2**63 - 1)):
        least = int(name == "starts")
        if not least <= value <= most:
            msg = f"The option --{name} is {value}; it must be from {least} to {most:,}."
            raise UsageError(msg)
    law = size_law(*size)
    found = scene_rooms(scenes) if scenes else unseen_rooms(rooms, count)
    fleet = draw_fleet(found, starts, seed, law, robot_cloud)
    about = {
        "rooms": "scene" if scenes else rooms,
        "scenes": [str(path) for path in scenes],
        "count": len(found),
        "starts": starts,
        "seed": seed,
        "diameter": size[0],
        "height": size[1],
        "rooms_digest": rooms_digest(found),
    }
    return Course(fleet, seed, about, find_task("navigation"))
