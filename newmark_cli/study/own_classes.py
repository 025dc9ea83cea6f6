"""Integrators of a user's own, from a class in a file: loaded apart, as problems in Python are."""

from functools import lru_cache, partial
from pathlib import Path
from typing import cast

from newmark_cli.newmark import own_integrator
from newmark_cli.newmark.own_integrator import OwnIntegrator
from newmark_cli.problems import user_code
from newmark_cli.study.subjects import Surroundings
from newmark_cli.support import apart
from newmark_cli.support.errors import InputError


def loaded(name: str, around: Surroundings) -> OwnIntegrator:
    """The integrator that a class is.

    Args:
        name: ``file.py:Class``.
        around: Where the file is looked for, and whether its code may run.

    Raises:
        ValueError: When it cannot be used: which, and why.
    """
    file = name.rpartition(":")[0]
    if not around.allow_code:
        raise ValueError(f"{file} is code, which runs only with --allow-code")
    path = (around.folder / file).absolute()
    try:
        return _loaded(name, path, path.read_bytes(), around.timeout)
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror}") from None
    except (InputError, apart.ApartError) as error:
        raise ValueError(str(error)) from None


@lru_cache(maxsize=64)
def _loaded(name: str, path: Path, source: bytes, timeout: float | None) -> OwnIntegrator:
    found = apart.call(_made, (name, path, source), timeout)
    assert isinstance(found, OwnIntegrator)
    return found


def _made(name: str, path: Path, source: bytes) -> OwnIntegrator:
    """The integrator, in a process apart."""
    file, _, kind = name.rpartition(":")
    made = partial(own_integrator.of, name)
    return cast(OwnIntegrator, user_code.made_of(path, source, kind, made, file, "class "))
