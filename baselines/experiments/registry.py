"""Every experiment by the name of its row."""

from eigenbench.baselines.experiments import ceilings, dnf, efficiency, few_shot, trained, turned
from eigenbench.baselines.experiments.row import Row

ROWS: dict[str, Row] = {
    row.name: row for module in (trained, efficiency, few_shot, turned, dnf, ceilings) for row in module.rows()
}
