"""Read results next to a study that is run again and again, and see that no read is of two runs.

A writer runs one study with other step sizes each time, a reader alternates `verify` and
`check`.  None may say that a file differs from its record, is missing or is truncated.

    python tests/verification/readers.py 3000
"""

import argparse
import collections
import contextlib
import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STUDY = """\
study: quick
cases:
  - {{problem: pendulum, form: [u-lambda, v-lambda], preconditioning: [none, optimal],
     h: [{h}], steps: 3, measure: [correction, history]}}
"""
#: Words of a reader that has seen two runs.
SAID = ("differs", "truncated", "missing", "no record")
WRITER = """\
import contextlib, io, itertools, sys
from pathlib import Path
sys.path.insert(0, {here!r})
import readers
for count in itertools.count():
    with contextlib.redirect_stdout(io.StringIO()):
        code = readers.ran(count)
    assert code == 0, code
    Path("runs").write_text(str(count + 1))
"""


def called(words: tuple[str, ...]) -> int:
    """The exit code of a command in this process."""
    from newmark_cli.cli import main

    try:
        main(words)
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def ran(count: int) -> int:
    """Run the study with the step sizes of the count-th time; its exit code."""
    steps = [1e-2 / (1 + count % 7 + k) for k in range(3 + count % 3)]
    Path("quick.yaml").write_text(STUDY.format(h=", ".join(map(repr, steps))))
    return called(("run", "quick.yaml", "-q"))


def main() -> int:
    """Read as often as asked for; 1 if a read was of two runs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("reads", type=int, nargs="?", default=300)
    given = parser.parse_args()
    outcomes: collections.Counter[str] = collections.Counter()
    wrong = []
    with tempfile.TemporaryDirectory() as home, contextlib.chdir(home):
        with contextlib.redirect_stdout(io.StringIO()):
            assert ran(0) == 0
        script = WRITER.format(here=str(Path(__file__).parent))
        writer = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE)
        try:
            while not Path("runs").exists() and writer.poll() is None:
                time.sleep(0.1)
            for i in range(given.reads):
                words = ("verify",) if i % 2 == 0 else ("check", "--all")
                printed = io.StringIO()
                with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                    code = called(words)
                outcomes[f"{words[0]}: exit code {code}"] += 1
                text = printed.getvalue()
                bad = any(word in text for word in SAID)
                if bad or (words[0] == "verify" and code != 0):
                    wrong.append(text)
            alive = writer.poll() is None
        finally:
            writer.kill()
            error = writer.communicate()[1].decode()
        runs = int(Path("runs").read_text())
    for outcome, count in sorted(outcomes.items()):
        print(f"{outcome}: {count}")
    print(f"{given.reads} reads next to {runs} runs, {len(wrong)} of them of two runs")
    for text in wrong[:3]:
        print(text)
    if not alive:
        print(f"the writer ended: {error}")
    return 1 if wrong or not alive else 0


if __name__ == "__main__":
    sys.exit(main())
