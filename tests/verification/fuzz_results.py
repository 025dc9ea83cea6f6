"""Damage results folders in every way and see that the commands that read them stay calm.

Every input is a small results folder with one to four changes: to the text or the bytes of a
CSV, to the tree of a record, a kept cell, a reference or a journal (sealed anew by turns), or
to what kind of thing a file is: a link, a pipe, a device, a folder.  One of the commands then
reads it.  It must end with a documented exit code within two seconds of processor time, print
at most one line per complaint and no control character, raise nothing, and leave what stands
outside the results folder as it was.

    python tests/verification/fuzz_results.py 20000 --seed 1 --processes 2
"""

import argparse
import contextlib
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from newmark_cli.cli import main as newmark_study
from newmark_cli.running import sealed

STUDY = """\
study: quick
description: two problems
figures:
  - {name: mine, quantity: lambda, measure: correction}
cases:
  - problem: pendulum
    form: [u-lambda, v-lambda]
    preconditioning: [none, optimal]
    h: [1e-2, 5e-3, 2e-3]
    steps: 5
    measure: [correction, condition, history]
  - problem: arm.yaml
    form: u-lambda
    preconditioning: optimal
    h: [1e-2, 5e-3]
    t_end: 0.05
    measure: [error, invariant]
expect:
  - {measure: correction, quantity: lambda, preconditioning: none, slope: -2, within: 0.3}
  - {measure: condition, problem: pendulum, form: u-lambda, h: 5e-3, at_least: 1, at_most: 1e6}
  - {measure: error, integrator: {method: newmark}, slope: 2}
"""
ARM = """\
gravity: [0, -9.81]
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0], mass: 2}
bars:
  arm: {from: O, to: A, length: 1}
"""
SECRET = "a secret of somebody's"
#: Processor time that no command may take, nor twice as much as on undamaged results.
SECONDS = 2.0
_HANG = 30.0
CODES = (0, 1, 2)
#: Commands, and how often each is chosen; those that draw take a second.
COMMANDS: tuple[tuple[tuple[str, ...], int], ...] = (
    (("check",), 12),
    (("check", "quick", "--all", "--json"), 4),
    (("check", "--strict", "--junit", "results/slopes.xml"), 4),
    (("verify",), 12),
    (("info", "--cells", "--config"), 8),
    (("show",), 8),
    (("compare", "results", "as-it-was"), 8),
    (("compare", "as-it-was", "results"), 4),
    (("tables",), 2),
    (("run", "quick.yaml", "--dry-run", "-v"), 10),
    (("run", "quick.yaml"), 12),
    (("merge", "quick.yaml", "--from", "as-it-was"), 6),
    (("merge", "quick.yaml", "--from", "results", "--results", "other"), 6),
    (("prune", "--dry-run"), 6),
    (("prune",), 6),
    (("plot", "quick", "--format", "png", "--measure", "correction", "--quantity", "lambda"), 1),
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 3.5, -0.0, 1e308, -1e308, 5e-324, 10**30, 10**400, float("nan"),
    float("inf"), float("-inf"), "", "x", "0", "1e999", "nan", "\x1b[31mred\x1b[0m", "a\nb", "\r",
    "\u2028", "\u202eevil", "\x00", "\ud800", "x" * 100_000, "../../outside.txt", "/etc/passwd",
    "=cmd|' /C calc'!A1", "$\\input{/etc/passwd}$", "<script>alert(1)</script>", [], {}, [[]], [{}],
    [None] * 3, {"a": {"b": {}}}, [1, "a", None], {"": 0}, [[0, [1, 2]]], [[1, [[2]]]],
    "ok", "failed", "pendulum", "u-lambda", "correction", "lambda", "2006-11-21T00:00:00+00:00",
)  # fmt: skip
CELLS = (
    "", "0", "-1", "1e999", "nan", "inf", "-inf", "x", "1e-2", "1E3", "٣", " 1", "1_0", "0x1",
    "\x1b[2J", "\u2028", "a\x0bb", "\x85", '"', '""', "'", "=1+1", "u-lambda", "correction",
    "condition", "ok", "failed", "10" * 200, "lambda", "none", "optimal", "h^-16", "\0", "λ",
    "ok,ok",
)  # fmt: skip


class Hang(BaseException):
    """A command took too long to wait for."""


@dataclass
class Tally:
    """What the commands did with the inputs.

    Attributes:
        codes: Command and exit code → inputs.
        findings: What went wrong → inputs.
        examples: What went wrong → seed and changes of the first such input.
        slowest: Processor time (s), and seed and changes, of the slowest input.
    """

    codes: Counter[str] = field(default_factory=Counter)
    findings: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)
    slowest: tuple[float, str] = (0.0, "")

    def add(self, other: "Tally") -> None:
        """Take in what another process found."""
        self.codes += other.codes
        self.findings += other.findings
        self.examples = other.examples | self.examples
        self.slowest = max(self.slowest, other.slowest)


# -- changes ------------------------------------------------------------------------------


def spots(tree: Any) -> list[tuple[Any, Any]]:
    """Every (parent, key or index) of a tree of JSON."""
    found, stack = [], [tree] if isinstance(tree, dict | list) else []
    while stack:
        node = stack.pop()
        children = node.items() if isinstance(node, dict) else enumerate(node)
        for key, child in children:
            found.append((node, key))
            if isinstance(child, dict | list):
                stack.append(child)
    return found


def is_small(path: Path) -> bool:
    """Whether a path is a regular file that can be read and copied, and not a sparse one."""
    return path.is_file() and not path.is_symlink() and path.stat().st_size < 10_000_000


def change_tree(chance: random.Random, path: Path) -> str:
    """Another value, key or length somewhere in a JSON file; its seal fits by turns."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return "no tree"
    places = spots(tree)
    # Long lists must not hide the keys of the top.
    place = chance.choice(places[: chance.choice((8, 30, len(places)))] or [({"a": 1}, "a")])
    node, key = place
    value = chance.choice(VALUES)
    match chance.randrange(7):
        case 0 if key in node or isinstance(node, list):
            del node[key]
        case 1 if isinstance(node, dict):
            node[str(chance.choice(("x", "", "\x1b[1m", "study", "sha256", "\ud800")))] = value
        case 2 if isinstance(node, dict) and key in node:
            node[f"{key}x"] = node.pop(key)
        case 3:
            for _ in range(chance.choice((10, 60, 200))):
                value = [value]
            node[key] = value
        case 4:
            tree = chance.choice(VALUES)
        case _:
            node[key] = value
    if isinstance(tree, dict) and "sha256" in tree and path.parent.name in ("cells", "references"):
        tree.pop("sha256")
        if chance.random() < 0.8:
            tree["sha256"] = sealed._digest(tree)
    path.write_bytes(json.dumps(tree).encode("utf-8", "surrogatepass"))
    return f"{key!r}: {str(value)[:40]!r}"


def change_table(chance: random.Random, path: Path) -> str:
    """Another cell, row, column or order in a CSV."""
    try:
        lines = [line.split(",") for line in path.read_text(encoding="utf-8").split("\n")]
    except (OSError, UnicodeDecodeError):
        return "no table"
    row = chance.randrange(len(lines))
    column = chance.randrange(len(lines[row]))
    value = chance.choice(CELLS)
    match kind := chance.randrange(9):
        case 0:
            del lines[row]
        case 1:
            lines.insert(row, list(lines[row]))
        case 2:
            other = chance.randrange(len(lines))
            lines[row], lines[other] = lines[other], lines[row]
        case 3:
            for line in lines:
                del line[column : column + 1]
        case 4:
            lines[0][column % len(lines[0])] = value
        case 5:
            lines = lines[:row]
        case _:
            lines[row][column] = value
    path.write_text("\n".join(",".join(line) for line in lines), encoding="utf-8", newline="")
    return f"{kind} {row} {column} {value!r}"


def change_bytes(chance: random.Random, path: Path) -> str:
    """Other bytes, less of them, or very many."""
    try:
        data = bytearray(path.read_bytes())
    except OSError:
        return "no bytes"
    i = chance.randrange(len(data) + 1)
    j = min(len(data), i + chance.choice((1, 10, 100)))
    match kind := chance.randrange(6):
        case 0:
            data[i:j] = chance.randbytes(j - i)
        case 1:
            del data[i:]
        case 2:
            data[i:i] = b"[" * 100_000
        case 3:
            data[i:j] = data[i:j] * 1000
        case 4:
            data = bytearray()
        case 5:
            with path.open("r+b") as file:
                file.truncate(1 << 41)  # sparse: larger than memory
            return "sparse"
    path.write_bytes(data)
    return f"bytes {kind} {i} {j}"


def change_kind(chance: random.Random, path: Path) -> str:
    """Something else in the place of a file."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(exist_ok=True)
    kind = chance.choice(
        ("gone", "fifo", "link", "dangling", "loop", "zero", "tty", "folder", "up")
    )
    match kind:
        case "fifo":
            os.mkfifo(path)
        case "link":
            path.symlink_to(path.resolve().parents[1] / "outside.txt")
        case "dangling":
            path.symlink_to(path.resolve().parents[1] / "made.txt")
        case "loop":
            path.symlink_to(path.name)
        case "zero":
            path.symlink_to("/dev/zero")
        case "tty":
            path.symlink_to("/dev/tty")
        case "folder":
            path.mkdir()
        case "up":
            path.symlink_to("..")
    return kind


def change_name(chance: random.Random, path: Path) -> str:
    """A file more, under a name that means something."""
    name = chance.choice(
        (
            "a b.csv", "evil\x1b[31m.csv", "\udcff.csv", "x\ny.csv", "slopes.json", "quick2.json",
            ".replacing-quick", ".unfinished-quick", ".unfinished-../x", ".lock-1-of-2", "-x.csv",
            ".replacing-" + "x" * 200, "cells.json", ".quick.csv.abcd1234", "=1.csv", "$x.csv",
        )
    )  # fmt: skip
    target = path.parent / name.replace("/", "-")
    journal = {"quick.csv": chance.choice((".quick.csv.abcd1234", "", "../../outside.txt", 7))}
    text = json.dumps(journal) if "replacing" in name else '{"cells": [1, {}]}'
    with contextlib.suppress(OSError):
        if chance.random() < 0.5 and is_small(path):
            shutil.copyfile(path, target)
        else:
            target.write_text(text)
    return f"name {name!r}"


def damage(chance: random.Random, folder: Path) -> str:
    """One to four changes to a results folder; says which."""
    changes = []
    for _ in range(chance.choice((1, 1, 1, 2, 3, 4))):
        files = sorted(p for p in folder.rglob("*") if p.is_file() and not p.is_symlink())
        named = [
            p for p in (folder / "quick.csv", folder / "quick.json", folder / "history/quick.csv")
            if p in files
        ]  # fmt: skip
        places = [*named, *named, *files, folder / ".lock", folder / "cells", folder / "history"]
        path = chance.choice(places)
        suffixes: dict[str, tuple[Callable[[random.Random, Path], str], ...]] = {
            ".json": (change_tree,) * 6,
            ".csv": (change_table,) * 6,
        }
        change = chance.choice(
            (change_bytes, change_kind, change_name, *suffixes.get(path.suffix, ()))
        )
        if not is_small(path) and change is not change_name:
            change = change_kind
        changes.append(f"{path.relative_to(folder)}: {change(chance, path)}")
    return "; ".join(changes)


# -- the inputs ---------------------------------------------------------------------------


def prepared(home: Path) -> Path:
    """A folder with a study, its results, and something outside of them."""
    home.mkdir(parents=True)
    (home / "quick.yaml").write_text(STUDY)
    (home / "arm.yaml").write_text(ARM)
    (home / "outside.txt").write_text(SECRET)
    for words in (("run", "quick.yaml", "-q"), ("check",)):
        with contextlib.chdir(home), contextlib.redirect_stdout(io.StringIO()):
            code = called(words)
        assert code in (0, 1), (words, code)
    shutil.copytree(home / "results", home / "as-it-was")
    return home


def called(words: tuple[str, ...]) -> int:
    """The exit code of a command."""
    try:
        newmark_study(words)
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def outside(home: Path) -> dict[str, tuple[int, int, bytes]]:
    """Whatever stands in a folder besides the results."""
    return {
        str(path): (path.lstat().st_mode, path.lstat().st_mtime_ns, path.read_bytes())
        for path in sorted(home.rglob("*"))
        if path.is_file() and path.relative_to(home).parts[0] not in ("results", "other")
    }


@contextlib.contextmanager
def in_time() -> Iterator[None]:
    """Raise `Hang` in what does not come back."""

    def hang(number: int, frame: object) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, _HANG)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def tried(home: Path, template: Path, seed: str, tally: Tally) -> None:
    """One input, noted."""
    chance = random.Random(seed)
    for name in ("results", "other"):
        shutil.rmtree(home / name, ignore_errors=True)
    shutil.copytree(template / "results", home / "results")
    changes = damage(chance, home / "results")
    words = chance.choices([c for c, _ in COMMANDS], [w for _, w in COMMANDS])[0]
    before = outside(home)
    printed, complained = io.StringIO(), io.StringIO()
    findings, code = [], -1
    start = time.process_time()
    try:
        with (
            in_time(), contextlib.chdir(home), contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(complained), warnings.catch_warnings(),
        ):  # fmt: skip
            warnings.simplefilter("error")
            code = called(words)
    except Hang:
        findings.append(f"hang in {words[0]}")
    except BaseException as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        findings.append(f"{type(error).__name__} in {Path(last.filename).name}:{last.name}")
    seconds = time.process_time() - start
    errors = complained.getvalue()
    if seconds > max(SECONDS, 2 * usual_seconds(home, template, words)):
        findings.append(f"more than {SECONDS:g} s in {words[0]}")
    if not findings and code not in CODES:
        findings.append(f"exit code {code}: {errors[:200]}")
    if code == 2 and not errors:
        findings.append("refused without a word")
    if "Traceback" in errors or "Warning" in errors:
        findings.append("traceback or warning on stderr")
    if not all(c.isprintable() or c == "\n" for c in printed.getvalue() + errors):
        findings.append(f"control character printed by {words[0]}")
    if SECRET in printed.getvalue() + errors:
        findings.append(f"a secret printed by {words[0]}")
    if outside(home) != before:
        findings.append(f"something outside changed by {words[0]}")
        for path in home.iterdir():
            if path.name not in ("results", "other"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        for path in template.iterdir():
            if path.name != "results":
                (shutil.copytree if path.is_dir() else shutil.copy2)(path, home / path.name)
    tally.codes[f"{words[0]} {code}"] += 1
    told = f"{seed} | {' '.join(words)} | {changes}"
    tally.slowest = max(tally.slowest, (seconds, told))
    for finding in findings:
        tally.findings[finding] += 1
        tally.examples.setdefault(finding, told)


def usual_seconds(home: Path, template: Path, words: tuple[str, ...]) -> float:
    """How long a command takes on undamaged results, imports and all, on this machine."""
    shutil.rmtree(home / "results")
    shutil.copytree(template / "results", home / "results")
    start = time.process_time()
    with (
        contextlib.chdir(home), contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):  # fmt: skip
        called(words)
    return time.process_time() - start


def work(template: Path, seeds: list[str]) -> Tally:
    """Try inputs in a folder of this process."""
    tally = Tally()
    home = template.parent / f"home-{os.getpid()}"
    if not home.exists():
        shutil.copytree(template, home)
    for seed in seeds:
        tried(home, template, seed, tally)
    return tally


def main() -> int:
    """Try as many inputs as asked for; 1 if something was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("inputs", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1, help="of their own; 0 for this one")
    parser.add_argument("--only", help="try this one input again, by its seed")
    given = parser.parse_args()
    total = Tally()
    with tempfile.TemporaryDirectory() as scratch:
        template = prepared(Path(scratch) / "template")
        seeds = [given.only] if given.only else [f"{given.seed}-{i}" for i in range(given.inputs)]
        parts = [seeds[i : i + 50] for i in range(0, len(seeds), 50)]
        if given.processes == 0:
            total.add(work(template, seeds))
        else:
            with ProcessPoolExecutor(given.processes, get_context("forkserver")) as pool:
                for tally in pool.map(work, [template] * len(parts), parts):
                    total.add(tally)
    print(f"{len(seeds)} inputs, seed {given.seed}")
    for code, count in sorted(total.codes.items()):
        print(f"  {code}: {count}")
    print(f"slowest: {total.slowest[0]:.2f} s: {total.slowest[1]}")
    print(f"findings: {sum(total.findings.values())}")
    for finding, count in total.findings.most_common():
        print(f"  {count} times {finding}\n    {total.examples[finding]}")
    return 1 if total.findings else 0


if __name__ == "__main__":
    sys.exit(main())
