"""Damage configs and mechanism files in every way and see that `validate` stays calm.

Every input is one of the project's own files, changed one to four times, by turns as a
tree of YAML nodes or as bytes.  Within a second of processor time `validate` must print
one line and end with code 0, or print some different complaints, each of which names the
file, in the order of lines, and end with code 2; raise nothing, and load no Python file.

    python tests/verification/fuzz.py 100000 --seed 1 --processes 2
"""

import argparse
import contextlib
import io
import multiprocessing
import os
import random
import re
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
from pathlib import Path

import yaml

from newmark_cli.cli import main as newmark_study
from newmark_cli.documents import MOST_REPORTED
from newmark_cli.problems import python_problem

ROOT = Path(__file__).parents[2]
FILES = (
    *sorted((ROOT / "configs").glob("*.yaml")),
    *sorted((ROOT / "newmark_cli/mechanisms/shipped").glob("*.yaml")),
    *sorted((ROOT / "docs/examples").glob("*.yaml")),
)
#: What no shipped file has: scalings of one's own, families, code, references.
EVERYTHING = """\
study: everything
form: [u-lambda, u-v-a-lambda]
preconditioning: [none, {name: mine, left: {D: beta*h^2, C: 1}, right: {u: 2, lambda: 1/(h*h)}}]
h: &steps [1e-1, 1e-2, 1e-3]
t_end: 3
integrator: [{}, {method: hht, alpha: 0.1}, {method: newmark, beta: 0.3025, gamma: 0.6}]
evaluation: [direct, compensated]
cases:
  - problem: [pendulum, hoist.yaml, {chain: {links: 7}}, {four-bars: {windows: 2}}]
    precision: [float64, float32]
    linear_solver: dense-lu
    h: *steps
  - {problem: four-bar, form: u-lambda, preconditioning: optimal, linear_solver: [gmres, minres],
     evaluation: direct, krylov: {tolerance: 1e-6, limit: 99}, measure: krylov}
  - {problem: andrews, steps: 3, stop: {absolute: 1e-8, relative: 1e-6}, measure: tolerance}
expect:
  - {measure: condition, problem: [pendulum, hoist.yaml], slope: -4, within: 0.1}
  - {measure: krylov_iterations, integrator: {method: hht, alpha: 0.1}, linear_solver: gmres,
     preconditioning: optimal, h: 1e-2, at_most: 99, at_least: 1}
  - {measure: correction, quantity: [u, lambda], preconditioning: mine, form: u-lambda,
     integrator: newmark beta=0.25 gamma=0.5, problem: {chain: {links: 7}}, slope: 0}
"""
CODE = """\
study: code
problem: {python: "trap.py:trap", args: {size: 1.5, on: true, word: x}}
form: u-lambda
preconditioning: none
h: 1e-3
steps: 10
"""
MOTIONS = """\
points:
  A: {fixed: [0, 0]}
  B: {at: [1, 0]}
  C: {at: [1, 1], velocity: [0, 0], mass: 2}
bodies:
  arm: {from: A, to: B, length: 1, mass: 1, centre: [0.5, 0], inertia: 0.1}
motions:
  turn: {body: arm, angle: {rate: 2, acceleration: 1, amplitude: 0.1, frequency: 5, phase: 0}}
  lift: {point: C, x: {value: 1}, y: {rate: 0.5}}
project_velocities: true
"""
TRAP = "raise SystemExit('code was run')\n"
SECONDS = 1.0
_LINE = re.compile(r"newmark-study: m\.yaml, line (\d+)")
_HANG = 5.0

NUMBERS = (
    "0", "-0", "1", "-1", "-1e-9", "0.5", "1e-4", "1e-8", "1E+3", "1e9", "1e16", "1e30", "1e-30",
    "1e100", "-1e100", "1e-100", "1e154", "1e155", "1e-155", "1e200", "1e-200", "1e300", "1e307",
    "1.7976931348623157e308", "2.2250738585072014e-308", "5e-324", "1e309", "1e-400", "-.inf",
    ".inf", ".nan", "nan", "inf", "1000000", "1000001", "20000000", "20000001", "1000000000",
    "9223372036854775807", "9223372036854775808", "9" * 400, "0." + "3" * 400, "0x10", "0o17",
    "1_000", "1,5", "1e", "1e+", "+.5", "1.", "1e1e1", "1:30", "2001-01-01", "1/3",
)  # fmt: skip
WORDS = (
    "", "~", "null", "true", "yes", "off", "none", "optimal", "u-lambda", "pendulum", "andrews",
    "chain", "pendulum.yaml", "hoist.yaml", "missing.yaml", "m.yaml", ".yaml", "/dev/null.yaml",
    "../x.yaml", "/proc/self/mem", "trap.py", "trap.py:trap", "slopes", "a b", "a/b", "a,b", "-",
    "ünïcödé", "λ", "日本語", "🌀", "e\u0301", "\u202eevil", "\u200b", "\ufeff", "\u2028", "\x85",
    "\x00", "\x00.yaml", "\x07", "\x1b[31m", "\n", "a\nb", "a\r\nb", "\t",
    "'", '"', "%", "{}", "{0}", "%s", "{message}", "${HOME}", "`true`", "~/x.yaml", "A", "B", "O",
    "__class__", "beta*h^2", "1/(beta*h^2)", "h^-16", "h^17", "(2^16)^16", "1e300^16", "h^2^2",
    "1or h", "1 if h", "h(1)", "1(h)", "((((h))))", "(" * 99 + "h" + ")" * 99, "0", "1/0", "0^-1",
    "1e-200*1e-200", "1/(1e-200*1e-200)", "0x1p3", "True", "beta:h", "1_0", "h" * 201, "lambda",
)  # fmt: skip
#: YAML that no tree of nodes writes; stands in place of a value.
RAW = (
    "!!python/object/apply:os.system ['touch code-was-run']", "!!python/name:os.system ''",
    "!!python/object/new:trap.trap []", "!!binary aGVsbG8=", "!!set {a, b}", "!!omap [a: 1]",
    "!!float '1'", "!!int '3'", "!!str 3", "!!null ''", "!foo bar", "*nowhere", "&x *x",
    "&x [*x, *x]", "&x {a: *x}", "{<<: {a: 1}, b: 2}", "{? [a, b] : c}", "{? {a: b} : c}",
    "{[a]: b}", "[1, 2", "{a: 1", "]", "}", "|", ">-", "'", '"', "@x", "`x`", "%x", "- x", "? x",
    "# x", "--- x", "\n---\na: 1\n", "\n...\n", "!", "&", "*", "<<", "=", "\t", "[,]", "{,}",
    "'1e-1'", '"1e-1"', '"\\ud800"', '"\\ud800.yaml"', '"\\0.yaml"', '"\\0"', '"\\U0001F300"',
    '"\\xff"', '"\\U7fffffff"',
)  # fmt: skip
_PLACE = "xPLACEx"

Spot = tuple[yaml.Node, int]


class Hang(BaseException):
    """`validate` took too long to wait for."""


@dataclass
class Tally:
    """What `validate` did with the inputs.

    Attributes:
        codes: Exit code → inputs.
        findings: What went wrong → inputs.
        examples: What went wrong → the first such input.
        seconds: Processor time of each input.
        slowest: Processor time and content of the slowest input.
        loaded: Times that a Python file would have been loaded.
    """

    codes: Counter[int] = field(default_factory=Counter)
    findings: Counter[str] = field(default_factory=Counter)
    examples: dict[str, bytes] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)
    slowest: tuple[float, bytes] = (0.0, b"")
    loaded: int = 0

    def add(self, other: "Tally") -> None:
        """Take in what another process found."""
        self.codes += other.codes
        self.findings += other.findings
        self.examples = other.examples | self.examples
        self.seconds += other.seconds
        self.slowest = max(self.slowest, other.slowest)
        self.loaded += other.loaded


# -- mutators of trees --------------------------------------------------------------------


def scalar(text: str) -> yaml.ScalarNode:
    """A scalar that is written plain where YAML allows it."""
    return yaml.ScalarNode(_RESOLVER.resolve(yaml.ScalarNode, text, (True, False)), text)


_RESOLVER = yaml.resolver.Resolver()


def spots(root: yaml.Node) -> list[Spot]:
    """Every (parent, index) of a tree; shared nodes once."""
    found: list[Spot] = []
    seen = set()
    stack = [root]
    while stack:
        node = stack.pop()
        if id(node) in seen or isinstance(node, yaml.ScalarNode):
            continue
        seen.add(id(node))
        for i, child in enumerate(node.value):
            found.append((node, i))
            stack.append(child[1] if isinstance(node, yaml.MappingNode) else child)
    return found


def get(spot: Spot) -> yaml.Node:
    """The value at a spot."""
    node, i = spot
    child = node.value[i]
    return child[1] if isinstance(node, yaml.MappingNode) else child


def text(spot: Spot) -> str:
    """The scalar at a spot; nothing where there is none."""
    node = get(spot)
    return node.value if isinstance(node, yaml.ScalarNode) else ""


def put(spot: Spot, value: yaml.Node) -> None:
    """Replace the value at a spot."""
    node, i = spot
    node.value[i] = (node.value[i][0], value) if isinstance(node, yaml.MappingNode) else value


def sequence(items: list[yaml.Node]) -> yaml.SequenceNode:
    """A list in brackets."""
    return yaml.SequenceNode("tag:yaml.org,2002:seq", items, flow_style=True)


def mapping(items: list[tuple[yaml.Node, yaml.Node]]) -> yaml.MappingNode:
    """A mapping in braces."""
    return yaml.MappingNode("tag:yaml.org,2002:map", items, flow_style=True)


class Trees:
    """Changes to a tree of nodes, drawn from a random generator.

    Attributes:
        raw: Text that stands in for placeholders once the tree is written.
    """

    def __init__(self, chance: random.Random, corpus: list[str]) -> None:
        self.chance = chance
        self.corpus = corpus
        self.raw: list[str] = []

    def mutate(self, root: yaml.Node) -> None:
        """One change somewhere."""
        places = spots(root)
        if places:
            change = self.chance.choice(self.CHANGES)
            change(self, self.chance.choice(places), places)

    def delete(self, spot: Spot, places: list[Spot]) -> None:
        """Drop an entry."""
        del spot[0].value[spot[1]]

    def repeat(self, spot: Spot, places: list[Spot]) -> None:
        """Write an entry again, at times very often."""
        times = self.chance.choice((1, 1, 2, 10, 1000, 30_000))
        node, i = spot
        if isinstance(node, yaml.MappingNode) and self.chance.random() < 0.8:
            key, value = node.value[i]
            node.value[i:i] = [(scalar(f"{key.value[:40]}{k}"), value) for k in range(times)]
        else:
            node.value[i:i] = [node.value[i]] * times

    def spread(self, spot: Spot, places: list[Spot]) -> None:
        """A list of many different numbers or words."""
        count = self.chance.choice((3, 300, 3000, 50_000))
        form = self.chance.choice(("1e-{}", "{}", "0.{}", "1.{}e-3", "x{}.yaml", "x{}"))
        put(spot, sequence([scalar(form.format(k + 1)) for k in range(count)]))

    def swap(self, spot: Spot, places: list[Spot]) -> None:
        """Exchange two values."""
        other = self.chance.choice(places)
        mine, theirs = get(spot), get(other)
        put(spot, theirs)
        put(other, mine)

    def retype(self, spot: Spot, places: list[Spot]) -> None:
        """Another kind of value."""
        value = get(spot)
        put(
            spot,
            self.chance.choice(
                (
                    scalar(self.chance.choice(WORDS)), scalar(self.chance.choice(NUMBERS)),
                    sequence([value]), sequence([]), mapping([]), sequence([value, value]),
                    mapping([(scalar("a"), value)]), mapping([(scalar("python"), value)]),
                    yaml.ScalarNode("tag:yaml.org,2002:str", "1", style="'"),
                )
            ),
        )  # fmt: skip

    def number(self, spot: Spot, places: list[Spot]) -> None:
        """An extreme number in place of a number, if there is one."""
        numbers = [p for p in places if re.fullmatch(r"[-+\d.eE]+", text(p))]
        put(self.chance.choice(numbers or [spot]), scalar(self.chance.choice(NUMBERS)))

    def nudge(self, spot: Spot, places: list[Spot]) -> None:
        """Another ordinary number in place of a number, if there is one."""
        numbers = [p for p in places if re.fullmatch(r"-?\d+(\.\d+)?(e-?\d)?", text(p))]
        if numbers:
            chosen = self.chance.choice(numbers)
            factor = self.chance.choice((0.1, 0.5, 2, 10, -1, 1e3, self.chance.random()))
            put(chosen, scalar(f"{factor * float(text(chosen)):.12g}"))

    def known(self, spot: Spot, places: list[Spot]) -> None:
        """A key of this kind of file, with a value that it may have."""
        other = yaml.compose(self.chance.choice(self.corpus), Loader=yaml.CSafeLoader)
        root = places[0][0]
        if isinstance(root, yaml.MappingNode):
            keys = {key.value for key, _ in root.value}
            fresh = [pair for pair in other.value if pair[0].value not in keys]
            root.value += self.chance.sample(fresh, min(len(fresh), self.chance.randrange(1, 3)))

    def word(self, spot: Spot, places: list[Spot]) -> None:
        """A strange word in place of a word, if there is one."""
        words = [p for p in places if isinstance(get(p), yaml.ScalarNode)]
        put(self.chance.choice(words or [spot]), scalar(self.chance.choice(WORDS)))

    def long(self, spot: Spot, places: list[Spot]) -> None:
        """A long text in place of a value or key."""
        text = self.chance.choice("x1-.(\x7fλ") * self.chance.choice((100, 300, 10_000, 1_000_000))
        node, i = spot
        if isinstance(node, yaml.MappingNode) and self.chance.random() < 0.3:
            node.value[i] = (scalar(text), node.value[i][1])
        else:
            put(spot, scalar(text))

    def rename(self, spot: Spot, places: list[Spot]) -> None:
        """Another key, or one with a slip."""
        mappings = [p for p in places if isinstance(p[0], yaml.MappingNode)]
        if not mappings:
            return
        node, i = self.chance.choice(mappings)
        key = str(node.value[i][0].value)
        others = [str(n.value[k][0].value) for n, k in mappings]
        cut = self.chance.randrange(len(key) + 1)
        slip = key[:cut] + key[cut + 1 :]
        new = self.chance.choice((slip, *(self.chance.choice(x) for x in (others, WORDS, NUMBERS))))
        node.value[i] = (scalar(new), node.value[i][1])

    def graft(self, spot: Spot, places: list[Spot]) -> None:
        """A value or an entry of another file."""
        other = yaml.compose(self.chance.choice(self.corpus), Loader=yaml.CSafeLoader)
        source = self.chance.choice(spots(other))
        node, i = spot
        if type(node) is type(source[0]) and self.chance.random() < 0.5:
            node.value.insert(i, source[0].value[source[1]])
        else:
            put(spot, get(source))

    def alias(self, spot: Spot, places: list[Spot]) -> None:
        """The node of another place, an enclosing one included: *a."""
        put(spot, get(self.chance.choice(places)) if self.chance.random() < 0.7 else places[0][0])

    def bomb(self, spot: Spot, places: list[Spot]) -> None:
        """References to references: a power of ten of values."""
        node, width = get(spot), self.chance.choice((2, 10))
        for _ in range(self.chance.randrange(2, 30)):
            node = (
                sequence([node] * width)
                if self.chance.random() < 0.8
                else mapping([(scalar(f"k{i}"), node) for i in range(width)])
            )
        put(spot, node)

    def deep(self, spot: Spot, places: list[Spot]) -> None:
        """Brackets in brackets, closed or not."""
        depth = self.chance.choice((10, 60, 200, 1000, 5000, 200_000))
        begin, end = self.chance.choice(
            (("[", "]"), ("{a: ", "}"), ("[", ""), ("- ", ""), ("? ", ""), ("&a [", "]"))
        )
        self.place(spot, begin * depth + "1" + end * depth)

    def insert_raw(self, spot: Spot, places: list[Spot]) -> None:
        """YAML that no tree writes."""
        self.place(spot, self.chance.choice(RAW))

    def place(self, spot: Spot, text: str) -> None:
        """Text that stands in the file as it is."""
        put(spot, scalar(f"{_PLACE}{len(self.raw)}{_PLACE}"))
        self.raw.append(text)

    CHANGES: tuple[Callable[["Trees", Spot, list[Spot]], None], ...] = (
        delete, delete, repeat, repeat, spread, swap, swap, retype, retype, number, number, number,
        number, nudge, nudge, nudge, known, known, word, word, long, rename, rename, graft, graft,
        alias, bomb, deep, insert_raw,
    )  # fmt: skip


def damaged_tree(chance: random.Random, corpus: list[str]) -> bytes:
    """One of the files with one to four changes to its tree."""
    root = yaml.compose(chance.choice(corpus), Loader=yaml.CSafeLoader)
    trees = Trees(chance, corpus)
    for _ in range(chance.choice((1, 1, 1, 2, 3, 4))):
        trees.mutate(root)
    # Nodes that end up inside themselves are written as anchors; far too many are not.
    written = yaml.serialize(root, Dumper=yaml.CSafeDumper, allow_unicode=True, width=10**6)
    for i, raw in enumerate(trees.raw):
        written = written.replace(f"{_PLACE}{i}{_PLACE}", raw)
    return written.encode()


def damaged_bytes(chance: random.Random, corpus: list[str]) -> bytes:
    """One of the files with one to four changes to its bytes."""
    data = bytearray(chance.choice(corpus).encode())
    other = chance.choice(corpus).encode()
    for _ in range(chance.choice((1, 1, 2, 3, 4))):
        i = chance.randrange(len(data) + 1)
        j = min(len(data), i + chance.choice((1, 1, 2, 10, 100)))
        match chance.randrange(8):
            case 0:
                del data[i:j]
            case 1:
                data[i:j] = chance.randbytes(j - i)
            case 2:
                data[i:i] = chance.choice(b"[]{}:,&*!|>'\"%@`#-?\n\t\0\xff\x85 ").to_bytes(1, "big")
            case 3:
                del data[i:]
            case 4:
                data[i:j] = data[i:j] * chance.choice((2, 10, 1000))
            case 5:
                data[i:] = other[chance.randrange(len(other)) :]
            case 6:
                data[i:i] = chance.choice(RAW).encode()
            case _:
                data[i:j] = chance.choice(WORDS).encode()
    return bytes(data)


def inputs(numbers: range, seed: int) -> Iterator[tuple[int, bytes]]:
    """Damaged files and their numbers; the same for the same number and seed."""
    corpus = [*(file.read_text() for file in FILES), EVERYTHING, CODE, MOTIONS]
    for number in numbers:
        chance = random.Random(f"{seed} {number}")
        yield number, (damaged_tree if chance.random() < 0.8 else damaged_bytes)(chance, corpus)


# -- judging ------------------------------------------------------------------------------


def judge(number: int, file: Path, tally: Tally) -> None:
    """Run `validate` on a file and note what it does."""
    out, err = io.StringIO(), io.StringIO()
    code, finding, loaded = -1, "", tally.loaded
    begin = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, _HANG)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            newmark_study(["validate", file.name])
    except SystemExit as ending:
        code = ending.code if isinstance(ending.code, int) else -1
    except Hang:
        finding = "gave no answer"
    except BaseException as error:
        finding = located(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    seconds = time.process_time() - begin
    data = file.read_bytes()
    tally.codes[code] += 1
    tally.seconds.append(seconds)
    tally.slowest = max(tally.slowest, (seconds, data))
    if not finding and tally.loaded > loaded:
        finding = "loaded a Python file"
    finding = finding or fault(code, out.getvalue(), err.getvalue())
    if not finding and seconds > SECONDS:
        finding = f"slower than {SECONDS:g} s"
    if finding:
        print(f"input {number}: {finding}", file=sys.stderr, flush=True)
        tally.findings[finding] += 1
        tally.examples.setdefault(finding, data)


def fault(code: int, out: str, err: str) -> str:
    """What is wrong with how `validate` ended, if anything."""
    # What there is to know of a spatial mechanism stands below its line, indented.
    printed = [line for line in out.splitlines() if not line.startswith("  ")]
    complaints = err.splitlines()
    if code not in (0, 2):
        return f"exit code {code}"
    if len(printed) != (code == 0) or bool(complaints) != (code == 2):
        return f"code {code} with {len(printed)} lines, and {len(complaints)} of complaint"
    if len(complaints) > MOST_REPORTED + 1:
        return "more complaints than a terminal shows"
    if len(set(complaints)) < len(complaints):
        return "a complaint is repeated"
    if not all(line.startswith("newmark-study: m.yaml") for line in complaints):
        return "a complaint does not name the file"
    places = [int(found[1]) for line in complaints if (found := _LINE.match(line))]
    if places != sorted(places):
        return "complaints are not in the order of lines"
    for line in printed + complaints:
        if len(line) > 2000:
            return "more than 2000 characters"
        if not line.isprintable():
            return "control characters in what is printed"
    return ""


def located(error: BaseException) -> str:
    """An exception and the place in the project that it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    inner = [frame for frame in frames if "newmark_cli" in frame.filename]
    place = (inner or frames)[-1]
    text = re.sub(r"\d+|'[^']*'", "…", str(error))[:60]
    return f"{type(error).__name__} at {Path(place.filename).name}:{place.name}: {text}"


def fuzz(numbers: range, seed: int) -> Tally:
    """Judge damaged files, in a folder of their own."""
    tally = Tally()

    def trap(*arguments: object) -> None:
        tally.loaded += 1
        raise AssertionError("a Python file was about to be loaded")

    def hang(*arguments: object) -> None:
        raise Hang

    python_problem.load = trap
    signal.signal(signal.SIGPROF, hang)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        # Every time: a warning on the terminal is a second line.
        warnings.simplefilter("always")
        folder = Path(name)
        for file in FILES:
            shutil.copy(file, folder)
        (folder / "trap.py").write_text(TRAP)
        with contextlib.chdir(folder):
            warm_up()
            for number, data in inputs(numbers, seed):
                Path("m.yaml").write_bytes(data)
                judge(number, Path("m.yaml"), tally)
            litter = {file.name for file in Path().iterdir()}
            if litter != {"m.yaml", "trap.py", *(file.name for file in FILES)}:
                tally.findings["wrote files"] += 1
    return tally


def warm_up() -> None:
    """Import everything once, so that the first input is not judged for it."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        newmark_study(["validate", *(file.name for file in FILES)])


def main() -> None:
    """Fuzz, print what was found, and exit with 1 when anything was."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=1000, help="how many inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1, help="of their own; 0 for this one")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--keep", type=Path, help="folder for the first input of each finding")
    options = parser.parse_args()
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    last, count = options.first + options.count, max(options.processes, 1)
    parts = [range(options.first + k, last, count) for k in range(count)]
    tally = Tally()
    if options.processes == 0:
        tally.add(fuzz(*parts, options.seed))
    else:
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(count, mp_context=spawn) as pool:
            for part in pool.map(fuzz, parts, [options.seed] * count):
                tally.add(part)
    spent = sorted(tally.seconds)
    print(f"{len(spent)} inputs, seed {options.seed}")
    print("exit codes: " + ", ".join(f"{n} × {code}" for code, n in sorted(tally.codes.items())))
    print(
        f"processor time: mean {1e3 * sum(spent) / len(spent):.1f} ms, "
        f"99.9 % below {1e3 * spent[int(0.999 * (len(spent) - 1))]:.0f} ms, "
        f"slowest {1e3 * spent[-1]:.0f} ms"
    )
    print(f"Python files loaded: {tally.loaded}")
    print(f"findings: {sum(tally.findings.values())}")
    for finding, times in tally.findings.most_common():
        print(f"  {times} × {finding}")
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        for number, (finding, data) in enumerate(tally.examples.items()):
            stem = re.sub(r"\W+", "-", finding)[:60]
            (options.keep / f"{number}-{stem}.yaml").write_bytes(data)
        (options.keep / "slowest.yaml").write_bytes(tally.slowest[1])
    sys.exit(1 if tally.findings else 0)


if __name__ == "__main__":
    main()
