"""The commit that the code is of: asked of git, or stamped where git cannot be asked.

Nothing but the standard library is imported: `hatch_build.py` runs this file to stamp
what it builds, before anything is installed.
"""

import json
import os
import subprocess
from pathlib import Path
from typing import TypedDict

#: Where a wheel and an sdist keep the stamp, in the package.
STAMP = "_commit.json"

#: Seconds that git may take; without an answer the commit is not known.
_PATIENCE = 10


class Source(TypedDict):
    """The commit, None where it is not known, and whether the code differs from it."""

    commit: str | None
    modified: bool | None


def asked(package: Path) -> Source | None:
    """Commit of the checkout that holds a package; None outside of one.

    ``modified`` says whether the package or the shipped configs differ from the commit.
    """
    # A package that was installed below some other project's checkout is not tracked there.
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    commit = _git(package, "rev-parse", "HEAD")
    if commit is None:
        return None
    changes = _git(package, "status", "--porcelain", "--", ".", "../configs")
    return Source(commit=commit, modified=None if changes is None else bool(changes))


def stamped(package: Path) -> Source | None:
    """The commit stamped into a package when it was built; None without a stamp."""
    try:
        stamp = json.loads((package / STAMP).read_text(encoding="utf-8"))
        return Source(commit=str(stamp["commit"]), modified=stamp["modified"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _git(folder: Path, *arguments: str) -> str | None:
    # A hook's GIT_DIR would answer for another repository.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            env=environment | {"GIT_OPTIONAL_LOCKS": "0"},
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=_PATIENCE,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
