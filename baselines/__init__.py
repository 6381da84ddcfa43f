"""ANSWERS the benchmark: reference models and their training, one file per model.

Comes in: a dataset folder. Goes out: a run folder that is itself a submission.
No baseline has been written yet; `examples/` holds three models that need no training.
"""
