"""Imported once by the server that forks processes for user code; see `support.apart`."""

import gc

from newmark_cli.newmark import compiled_march
from newmark_cli.problems import python_problem, reference
from newmark_cli.running import runner
from newmark_cli.study import compute, motion

__all__ = ["compiled_march", "compute", "motion", "reference", "runner"]

python_problem.warm()
gc.collect()
gc.freeze()  # a collection in a fork would copy every page
