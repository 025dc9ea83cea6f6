"""Damage of what is kept on disk: does a wrong number load, or does anything crash?

    python damage.py OUT [--flips 1000] [--seed 1]

Runs small studies in OUT, then flips one bit in each kept file of a kind and runs the study again,
in a process of its own: kept cells, references, own machine code, and code that numba compiled.
Cuts each file at half, too, and empties it.  The CSV must be the same to the byte, the exit code 0,
stderr that of a run without damage, and each damaged file replaced.  Prints for each kind how many
bits were flipped and what went wrong, and exits with 1 if anything did.

Numba reads a function that others include only when it compiles these.  All of its files are
damaged together three times, which compiles the march anew, for a minute; other flips are in
those that are read anyway.
"""

import argparse
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

SCRIPT = Path(sys.executable).with_name("newmark-study")
FORMS = "[u-lambda, v-lambda, a-lambda, u-v-lambda, u-a-lambda, v-a-lambda, u-v-a-lambda]"
STUDIES = {
    "cells": f"study: cells\nproblem: pendulum\nform: {FORMS}\npreconditioning: [none, optimal]\n"
    "h: [0.1, 0.05, 0.04, 0.025, 0.02, 0.0125, 0.01]\nt_end: 0.2\n",
    "errors": "study: errors\nproblem: double-pendulum\nform: u-lambda\npreconditioning: none\n"
    f"h: {[k / 1000 for k in range(10, 30)]}\nsteps: 2\nmeasure: error\n",
    # The elimination of each mechanism is machine code of our own.
    "code": "study: code\nproblem: [double-pendulum, slider-crank, four-bar, andrews]\n"
    "form: u-lambda\npreconditioning: optimal\nlinear_solver: static-lu\nh: 1e-4\nsteps: 2\n",
}
#: Bytes of a file that takes long to compile.
LARGE = 100_000


@dataclass
class Kind:
    """Files that are damaged together.

    Attributes:
        name: What they are.
        study: The study that reads them.
        share: Of all flips.
        files: The files, as they are now.
        slow: Whether large ones take long to make, and are flipped only once.
        cells: Whether the study's kept cells stay.
        told: What a run without damage tells.
    """

    name: str
    study: str
    share: float
    files: Callable[[], list[Path]]
    slow: bool = False
    cells: bool = False
    told: set[str] = field(default_factory=set)


def run(out: Path, study: str) -> subprocess.CompletedProcess[str]:
    """Run a study of OUT in a process of its own."""
    return subprocess.run(
        [SCRIPT, "run", f"{study}.yaml"], cwd=out, text=True, capture_output=True,
        env=os.environ | {"NUMBA_CACHE_DIR": str(out / "code")}, check=False,
    )  # fmt: skip


def lines(done: subprocess.CompletedProcess[str]) -> set[str]:
    """What a run has told, but for that of compiling."""
    return {line for line in done.stderr.splitlines() if "compiling" not in line}


def wrongs(
    out: Path, kind: Kind, damaged: dict[Path, bytes], right: bytes, read: set[Path] | None = None
) -> Iterator[str]:
    """What goes wrong in a run with damaged files; ``read`` becomes those that were replaced."""
    whole = {file: file.read_bytes() for file in damaged}
    if not kind.cells:
        shutil.rmtree(out / "results/cells")
    if kind.slow:  # own machine code is made from some of numba's
        for file in (out / "code").rglob("*.o"):
            file.unlink()
    for file, content in damaged.items():
        file.write_bytes(content)
    done = run(out, kind.study)
    told = sorted(lines(done) ^ kind.told)
    if done.returncode or told:
        yield f"exit code {done.returncode}: {told}"
    if (out / f"results/{kind.study}.csv").read_bytes() != right:
        yield "another CSV"
    for file, content in damaged.items():
        if file.read_bytes() != content:
            if read is not None:
                read.add(file)
        elif read is None:
            yield f"not replaced: {file.relative_to(out)}"
        else:
            file.write_bytes(whole[file])


def flipped(content: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(8 * len(content))
    changed = bytearray(content)
    changed[place // 8] ^= 1 << place % 8
    return bytes(changed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--flips", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    out, chance = given.out.absolute(), random.Random(given.seed)
    out.mkdir(parents=True, exist_ok=True)
    for folder in ("code", "results"):
        shutil.rmtree(out / folder, ignore_errors=True)
    for study, text in STUDIES.items():
        (out / f"{study}.yaml").write_text(text)

    def below(folder: str, pattern: str) -> Callable[[], list[Path]]:
        return lambda: sorted((out / folder).rglob(pattern))

    # While there is compiled code of one study only, that study reads all of it.
    kinds = (
        Kind("own machine code", "code", 0.12, below("code", "*.o")),
        Kind("code of numba", "code", 0.08, below("code", "*.nbc"), slow=True),
        Kind("kept cells", "cells", 0.4, below("results/cells", "*.json"), cells=True),
        Kind("references", "errors", 0.4, below("results/references", "*.json")),
    )
    failed = False
    for kind in kinds:
        shutil.rmtree(out / "results", ignore_errors=True)
        done = run(out, kind.study)
        if done.returncode:
            raise SystemExit(f"{kind.study}: {done.stderr}")
        kind.told = lines(done)
        right, used = (out / f"results/{kind.study}.csv").read_bytes(), kind.files()
        if not used:
            raise SystemExit(f"{kind.name}: the study {kind.study} keeps none")
        damaged = {file: flipped(file.read_bytes(), chance) for file in used}
        wrong, flips, most = (
            [*wrongs(out, kind, damaged, right)],
            len(used),
            round(kind.share * given.flips),
        )
        again = used
        if kind.slow:
            small = [file for file in used if file.stat().st_size < LARGE]
            damaged, read = {file: flipped(file.read_bytes(), chance) for file in small}, set()
            wrong += wrongs(out, kind, damaged, right, read)
            again, flips = sorted(read), flips + len(read)
        while flips < most:
            some = chance.sample(again, min(len(again), most - flips))
            damaged = {file: flipped(file.read_bytes(), chance) for file in some}
            wrong += wrongs(out, kind, damaged, right)
            flips += len(some)
        for kept in (lambda size: size // 2, lambda size: 0):
            damaged = {}
            for file in used:
                content = file.read_bytes()
                damaged[file] = content[: kept(len(content))]
            wrong += wrongs(out, kind, damaged, right)
        failed |= bool(wrong)
        print(
            f"{kind.name}: {flips} bits flipped in {len(used)} files, each cut and emptied; "
            f"{len(wrong)} wrong",
            *wrong[:10], sep="\n  ", flush=True,
        )  # fmt: skip
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
