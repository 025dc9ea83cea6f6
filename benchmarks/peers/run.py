"""Run all codes on all problems, and write the table and figures of docs/comparison.md.

    pip install -e '.[peers]'
    python benchmarks/peers/run.py

Each script runs in a process of its own, and each of its runs in another, which may take
`--limit` seconds; a script may take `--script-limit`.  Files go to benchmarks/peers/results.
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib import util
from pathlib import Path

import common
import report

SCRIPTS = sorted(path.stem for path in common.HERE.glob("with_*.py"))


def environment():
    """Of the scripts: one thread each, and the libraries of OpenSees."""
    found = util.find_spec("openseespylinux")
    folders = [str(Path(found.origin).parent / "lib")] if found and found.origin else []
    folders += filter(None, [os.environ.get("LD_LIBRARY_PATH")])
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**os.environ, **one, "LD_LIBRARY_PATH": os.pathsep.join(folders)}


def run(script, name, options):
    """Run a script on a problem; what went wrong is printed, rows until then are kept."""
    out = options.results / f"{script.removeprefix('with_')}-{name}.csv"
    command = [sys.executable, str(common.HERE / f"{script}.py"), name, "--out", str(out)]
    limit = options.limit * (4 if script == "with_newmark_study" else 1)  # four marches a run
    begun = time.perf_counter()
    try:
        ended = subprocess.run(
            [*command, "--limit", str(limit)], env=environment(), cwd=common.HERE,
            timeout=options.script_limit, stderr=subprocess.PIPE, text=True, errors="replace",
            check=False,
        )  # fmt: skip
        lines = ended.stderr.strip().splitlines()
        how = "" if ended.returncode == 0 else (lines or [f"exit code {ended.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        how = f"stopped after {options.script_limit:g} s"
    print(f"{script:20} {name:16} {time.perf_counter() - begun:6.1f} s  {how}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, default=common.HERE / "results")
    parser.add_argument("--scripts", nargs="*", choices=SCRIPTS, default=SCRIPTS)
    parser.add_argument("--problems", nargs="*", choices=common.PROBLEMS, default=common.PROBLEMS)
    parser.add_argument("--limit", type=float, default=common.LIMIT)
    parser.add_argument("--script-limit", type=float, default=600.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--report", action="store_true", help="of the files that there are")
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    begun = time.perf_counter()
    head = options.results / "head.txt"
    if not options.report:
        with ThreadPoolExecutor(options.jobs) as pool:
            for name in options.problems:
                for script in options.scripts:
                    pool.submit(run, script, name, options)
        date = f"{datetime.now(UTC):%d %B %Y}".lstrip("0")
        text = f"{report.versions()}, Python {platform.python_version()}, {date}."
        head.write_text(text + "\n", encoding="utf-8")
        print(f"{time.perf_counter() - begun:.0f} s in all")
    report.write(options.results, head.read_text(encoding="utf-8").strip())


if __name__ == "__main__":
    main()
