"""Do objects stay where positives of `fit` and `top` put them? A drop in mujoco; a fact about the data, not a label.

The object is released at rest at its witness, in the closed environment, which does not move. The thresholds are
those of O2O-Afford (Mo et al., CoRL 2021): for 4 s it tilts at most 5 degrees and moves at most 5 mm in x and in y
(drop), then for 20 s at most 2 degrees and 0.1 mm in x, y and z (rest). Gravity 9.81 m/s^2, time step 1/500 s,
friction 4 on all surfaces. Density is even; it changes nothing.

mujoco sees hulls. The environment is cut into convex parts that fill it, see `convex_parts`. The object is its convex
hull with the mass and inertia of its mesh: on a floor it rests on the same points, but a hull may already touch what
reaches into a cavity and into a bowl; such pairs are counted as `hull touches`.

    python tests/referee_mujoco.py --task fit --task top --pairs 300 --out /tmp/referee

Interrupted runs go on where they stopped; --out receives drops.jsonl and drops.md.
"""

import argparse
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from convex_parts import convex_parts, solid_of
from numpy.typing import NDArray
from posed_pairs import Ledger, Points, PosedPair, as_markdown, indexed, pairs_of

STEP, DROP_STEPS, REST_STEPS, LOOK = 1 / 500, 2000, 10_000, 20
"""Time step, s; steps of either phase; steps between two looks at the object."""
FRICTION = 4.0
DROP_TILT, DROP_MOVE = np.radians(5.0), 5e-3
REST_TILT, REST_MOVE = np.radians(2.0), 1e-4
TOUCHING = 1e-4
"""m: where a hull reaches that far into the environment at the witness, it is not the mesh that is dropped."""
STIFF = (0.005, 1.0)
"""Time constant (s) and damping ratio of contacts: a resting object sinks by less than 0.02 mm."""


class Trial:
    """An object, mesh (vertices, faces) about its origin, at `place` among convex parts, metres."""

    def __init__(self, parts: list[Points], vertices: Points, faces: NDArray[np.int64], place: Points) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = STEP
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.impratio = 10
        spec.option.noslip_iterations = 5
        for index, corners in enumerate(parts):
            spec.add_mesh(name=f"part{index}", uservert=corners.ravel())
            _add_geom(spec.worldbody, f"part{index}")
        mesh = spec.add_mesh(name="object", uservert=vertices.ravel(), userface=faces.astype(np.int32).ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
        body = spec.worldbody.add_body(name="object", pos=place)
        body.add_freejoint()
        _add_geom(body, "object")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)

    def depth(self) -> float:
        """Return how deep the object's hull reaches into the environment, m."""
        return max(0.0, -float(min(self.data.contact.dist, default=0.0)))

    def stays(self, steps: int, tilt: float, move: Points) -> bool:
        """Say whether the object keeps its pose for some steps: within an angle and a distance (3,) of the first."""
        pose, turn = self.data.qpos[:3].copy(), self.data.qpos[3:7].copy()
        for _ in range(steps // LOOK):
            mujoco.mj_step(self.model, self.data, LOOK)
            if np.any(np.abs(self.data.qpos[:3] - pose) > move):
                return False
            if tilt_between(turn, self.data.qpos[3:7]) > tilt:
                return False
        return True


def _add_geom(body: Any, mesh: str) -> None:
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh)
    geom.friction = [FRICTION, 0.0, 0.0]
    geom.condim = 3
    geom.solref = list(STIFF)


def tilt_between(first: Points, second: Points) -> float:
    """Return the angle between the vertical axes of two poses, unit quaternions (w, x, y, z)."""
    turned = np.zeros(4)
    mujoco.mju_negQuat(turned, first)
    mujoco.mju_mulQuat(turned, second, turned)
    _w, x, y, _z = turned / np.linalg.norm(turned)
    return float(2 * np.arcsin(min(1.0, np.hypot(x, y))))


def drop(trial: Trial) -> str:
    """Return where an object's trial ends: `drop`, `rest`, or `stays` where it ends well."""
    if not trial.stays(DROP_STEPS, DROP_TILT, np.array([DROP_MOVE, DROP_MOVE, 2.0])):
        return "drop"
    return "stays" if trial.stays(REST_STEPS, REST_TILT, np.full(3, REST_MOVE)) else "rest"


@lru_cache(maxsize=256)
def _parts_at_size_1(library: Any, shape: int) -> tuple[list[Points], float]:
    parts = convex_parts(solid_of(library.triangles(shape)))
    return parts.corners, parts.excess


def trial_of(pair: PosedPair) -> tuple[Trial, float]:
    """Return a positive's trial, and the share of volume that its environment's parts have too much."""
    library = pair.block.maker.stock.of("environment")
    corners, excess = _parts_at_size_1(library, pair.env_index)
    hull = library.hull(pair.env_index)
    centre = (hull.min(axis=0) + hull.max(axis=0)) / 2
    parts = [(c - centre) * pair.env_size for c in corners]
    return Trial(parts, *indexed(pair.thing), pair.witness), excess


def judge(pair: PosedPair) -> dict[str, Any]:
    """Return what becomes of a positive."""
    start = time.perf_counter()
    trial, excess = trial_of(pair)
    depth = trial.depth()
    return {
        "name": pair.name,
        "environment": pair.category,
        "object": pair.of("obj_category").decode(),
        "hull touches": depth > TOUCHING,
        "excess": excess,
        "ends": drop(trial),
        "seconds": round(time.perf_counter() - start, 3),
    }


def run(ledger: Ledger, task: str, count: int) -> list[dict[str, Any]]:
    """Drop the first positives of the test split."""
    rows: list[dict[str, Any]] = []
    for pair in pairs_of(task, "test"):
        if len(rows) == count:
            break
        if pair.of("label"):
            key = f"{task} {pair.number}"
            if key not in ledger:
                ledger.add(key, task=task, **judge(pair))
            rows.append(ledger.rows[key])
    return rows


def summary(rows: list[dict[str, Any]]) -> str:
    """Return counts per task, and per category of either side, as Markdown."""
    table = []
    for task in dict.fromkeys(row["task"] for row in rows):
        of_task = [row for row in rows if row["task"] == task]
        table.append(_counts(f"{task}, all", of_task))
        for side in ("environment", "object"):
            for kind in sorted({row[side] for row in of_task}):
                table.append(_counts(f"{task}, {side} {kind}", [row for row in of_task if row[side] == kind]))
    return as_markdown(table)


def _counts(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    ends = [row["ends"] for row in rows]
    return {
        "positives of": name,
        "dropped": len(rows),
        "hull touches": sum(row["hull touches"] for row in rows),
        "pass 4 s": len(rows) - ends.count("drop"),
        "and 20 s more": ends.count("stays"),
    }


def main() -> None:
    """Run, print and keep the findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", action="append", help="fit or top; default both")
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("out/referee"))
    args = parser.parse_args()
    ledger = Ledger(args.out / "drops.jsonl", split="test", seed=0, mujoco=mujoco.__version__)
    rows = [row for task in args.task or ("fit", "top") for row in run(ledger, task, args.pairs)]
    text = summary(rows)
    (args.out / "drops.md").write_text(text + "\n")
    print(text)
    print(f"median {np.median([row['seconds'] for row in rows]):.2f} s a pair")


if __name__ == "__main__":
    main()
