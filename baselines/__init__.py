"""ANSWERS the benchmark: the paper's models and their training, one file per model.

Comes in: a train split. Goes out: a run folder that is itself a submission.
Read pointnet.py (the backbone) and layers.py first, then direct.py, implicit.py, grounded.py; models.py names them and
reads them back; training.py trains, settling.py and run_folder.py are its beginning and its disk.
`examples/` holds models that need no training.
"""
