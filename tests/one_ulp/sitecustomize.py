"""Every march of the suite starts one unit in the last place away: ``pytest --one-ulp SEED``.

Python imports this module as it starts wherever the folder is on its path, so that
commands and the processes that they start have it, too.
"""

import importlib.util
import os
import sys

MARCH = "newmark_cli.newmark.march"


def perturb(march):
    """Let a module's `initial_state` round u and v differently, by the seed of the suite."""
    import numpy as np

    exact = march.initial_state

    def initial_state(problem, scheme):
        state = exact(problem, scheme)
        random = np.random.default_rng(int(os.environ["ONE_ULP"]))
        change = np.zeros_like(state.fields)
        signs = random.choice([-1, 1], change[:2].shape).astype(change.dtype)
        change[:2] = np.finfo(change.dtype).eps * signs * state.fields[:2]
        carried = scheme.relations.start @ change[:3].astype(float)
        return state._replace(
            fields=state.fields + change, past=state.past + carried.astype(change.dtype)
        )

    march.initial_state = initial_state


class _Finder:
    def find_spec(self, name, path=None, target=None):
        """The module's own loader, after which it is changed."""
        if name != MARCH:
            return None
        sys.meta_path.remove(self)
        found = importlib.util.find_spec(name)
        load = found.loader.exec_module

        def exec_module(module):
            load(module)
            perturb(module)

        found.loader.exec_module = exec_module
        return found


if "ONE_ULP" in os.environ:
    if MARCH in sys.modules:
        perturb(sys.modules[MARCH])
    else:
        sys.meta_path.insert(0, _Finder())
