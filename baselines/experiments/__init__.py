"""ANSWERS the benchmark: the paper's experiments, one command each, and the table of what came of them.

Comes in: train and test splits as `generate` writes them. Goes out: trained run folders and their evaluations, a small
JSON file a row, docs/results.md.
`python -m eigenbench.baselines.experiments list` names the rows. Read row.py first, then trained.py, efficiency.py,
ceilings.py, few_shot.py, turned.py and dnf.py; table.py and new_tasks.py put the rows beside the paper's values,
curves.py draws those of part b.
"""
