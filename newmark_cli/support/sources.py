"""Sources of the package: digests that tell whether what was made from them is out of date."""

import hashlib
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

#: The package.
PACKAGE = Path(__file__).parents[1]
#: What decides in `newmark_cli.support` how code is compiled.
_COMPILING = ("cached_code.py", "machine_code.py")
#: An import from a module of the package, or of modules from one of its folders.
_IMPORT = re.compile(rb"^ *from newmark_cli([.\w]*) import (\([^)]*\)|.*)", re.MULTILINE)


#: Content of a file: read once, as the code that is imported.
_read = cache(Path.read_bytes)


def digest(files: Iterable[Path]) -> str:
    """Hexadecimal digest of files and their names, in their order."""
    sha256 = hashlib.sha256()
    for file in files:
        content = _read(file)
        sha256.update(f"{file.name} {len(content)} ".encode() + content)
    return sha256.hexdigest()


@cache
def stamp(path: Path) -> str:
    """Hexadecimal digest of a file and what it imports of the numerical core, directly or not.

    Compiled code includes functions and constants of all these files.
    """
    found, new = {path}, [path]
    while new:
        others = set(_imported(new.pop())) - found
        found |= others
        new += others
    return digest(sorted(found))


def _imported(path: Path) -> Iterator[Path]:
    for module, names in _IMPORT.findall(_read(path)):
        place = PACKAGE.joinpath(*module.decode().split("."))
        candidates = [place.with_suffix(".py")]
        if place.is_dir():
            parts = re.findall(r"\w+", names.decode())
            candidates = [place / f"{name}.py" for name in ("__init__", *parts)]
        for file in filter(Path.is_file, candidates):
            if file.parent.name != "support" or file.name in _COMPILING:
                yield file
