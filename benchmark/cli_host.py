"""Options of the commands that run a model: its limits, device, weights, isolation. Part of the composition root."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eigenbench.host_options import HostOptions

Timeout = Annotated[float, typer.Option(help="Seconds for one call of predict.")]
BuildTimeout = Annotated[float, typer.Option(help="Seconds for import and build.")]
Memory = Annotated[float, typer.Option(help="Memory of all the model's processes, GiB.")]
Scratch = Annotated[float, typer.Option(help="Disk for all that the model writes, GiB.")]
Processes = Annotated[int, typer.Option(help="Processes and threads of the model at a time.")]
Device = Annotated[str, typer.Option(help="Passed to build: cpu, cuda, ...")]
Checkpoint = Annotated[str | None, typer.Option(help="Passed to build: the file of the model's weights.")]
Isolation = Annotated[str, typer.Option(help="auto, none, rlimits, landlock or bubblewrap.")]


def host_options(
    timeout: float,
    build_timeout: float,
    memory: float,
    scratch: float,
    processes: int,
    device: str,
    checkpoint: str | None,
    isolation: str,
) -> "HostOptions":
    """Return how the model is run, from the options of a command."""
    from eigenbench.host_options import HostOptions

    return HostOptions(
        isolation=isolation,
        timeout=timeout,
        build_timeout=build_timeout,
        memory_gib=memory,
        scratch_gib=scratch,
        processes=processes,
        device=device,
        checkpoint=checkpoint,
    )
