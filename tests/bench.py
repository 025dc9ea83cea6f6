"""Modules of the bench of verdicts, which are scripts beside each other."""

import importlib.util
import sys
from pathlib import Path

VERDICTS = Path(__file__).parent / "verification/verdicts"


def bench(name):
    """A module of that folder, which imports others of it."""
    if str(VERDICTS) not in sys.path:
        sys.path.append(str(VERDICTS))
    spec = importlib.util.spec_from_file_location(f"bench_{name}", VERDICTS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
