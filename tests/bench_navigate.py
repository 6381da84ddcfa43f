"""Steps a second of `navigate` besides the model's time, in furnished rooms, and where they go.

python tests/bench_navigate.py
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from eigenbench.driving import drive, oracle
from eigenbench.fleets import draw_fleet
from eigenbench.floor_cells import free_floor
from eigenbench.generators.driven_rooms import robot_cloud, size_law, unseen_rooms
from eigenbench.navigation import Course, navigate
from eigenbench.tasks import find_task

ROOMS, STARTS, STEPS, REPEATS = 20, 4, 100, 3
MODEL = """
import numpy as np
class Model:
    def predict(self, env, obj):
        near = (np.abs(env[..., 1]) < 0.3) & (env[..., 2] > 0.02) & (env[..., 0] > 0)
        depth = np.where(near, env[..., 0], 3.0).min(1)
        return {"env_lengths": depth[:, None], "obj_lengths": np.full((len(env), 1), 0.6)}
"""


def main() -> None:
    """Run and print the best of a few repeats."""
    start = time.perf_counter()
    rooms = unseen_rooms("many", ROOMS)
    print(f"{ROOMS} rooms made or read     {time.perf_counter() - start:8.2f} s")
    fleet = draw_fleet(rooms, STARTS, 0, size_law(None, None), robot_cloud)
    course = Course(fleet, 0, {"rooms": "many"}, find_task("navigation"))
    every = np.arange(len(fleet))
    fleet.views(every, fleet.starts)
    best: dict[str, float] = {}
    for _ in range(REPEATS):
        start = time.perf_counter()
        fleet.views(every, fleet.starts)
        views = len(fleet) / (time.perf_counter() - start)
        start = time.perf_counter()
        driven = drive(fleet, oracle, STEPS)
        steps = (driven.moves != 0).sum() / (time.perf_counter() - start)
        start = time.perf_counter()
        for k in range(len(fleet)):
            free_floor(fleet.rooms[int(fleet.room[k])], fleet.starts[k], fleet.sizes[k])
        floors = len(fleet) / (time.perf_counter() - start)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "model").mkdir()
            path = Path(folder) / "model" / "model.py"
            path.write_text(MODEL)
            start = time.perf_counter()
            found = navigate(path, course, Path(folder) / "run", steps=STEPS)
            seconds = time.perf_counter() - start - found.result["seconds"]["model"]
            with np.load(found.folder / "paths.npz") as paths:
                asked = int((paths["model_moves"] != 0).sum())
        rates = {
            "views": views,
            "steps of the oracle": steps,
            "free floors": floors,
            "steps of navigate": asked / seconds,
        }
        best = {name: max(rate, best.get(name, 0.0)) for name, rate in rates.items()}
    for name, rate in best.items():
        print(f"{name:25} {rate:10,.0f} /s")
    print("navigate: all that it does but the model's own time: process, views, both other policies, scores, page")


if __name__ == "__main__":
    main()
