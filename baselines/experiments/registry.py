"""Every experiment by the name of its row."""

from eigenbench.baselines.experiments import ceilings, efficiency, trained
from eigenbench.baselines.experiments.row import Row

ROWS: dict[str, Row] = {row.name: row for module in (trained, efficiency, ceilings) for row in module.rows()}
