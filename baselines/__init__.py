"""ANSWERS the benchmark: the paper's models and their training, one file per model.

Comes in: a train split. Goes out: a run folder that is itself a submission.
Read pointnet.py (the backbone) and layers.py first, then direct.py, implicit.py, grounded.py; fast_points.py and
compiled.py are the backbone's fast form; models.py names the models and reads them back; training.py trains,
settling.py and run_folder.py are its beginning and its disk, schedule.py and symmetry.py say for how long and on
what; learner.py and fitting.py train without a disk. canonical.py is grounded.py for turned scenes, masked.py the
multi-task setting, suite.py its pairs, scratch.py Direct on a new task alone; navigation.py drives a robot by any.
experiments/ runs them all.
`examples/` holds models that need no training.
"""
