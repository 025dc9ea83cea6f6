"""Where the work of a run is done: threads while it is young, then processes beside it."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from newmark_cli.mechanisms.spec import Shipped
from newmark_cli.problems.reference import NoReference
from newmark_cli.running import executors, runner
from newmark_cli.running.executors import Places
from newmark_cli.running.references import References
from newmark_cli.study import config
from newmark_cli.support import apart

STUDY = """\
study: places
problem: [pendulum, slider-crank]
form: [u-lambda, v-lambda]
preconditioning: optimal
h: [1e-2, 5e-3]
t_end: 0.2
measure: [correction, error, invariant]
twins: 1
"""


@pytest.fixture
def old(monkeypatch):
    """Runs are never young."""
    monkeypatch.setattr(executors, "_YOUNG", 0.0)


def test_one_at_a_time_is_here(old):
    """While one piece of work is in this process, the next is beside it; then here again."""
    places, inside, left = Places(), threading.Event(), threading.Event()

    def here():
        inside.set()
        assert left.wait(60)
        return os.getpid()

    with_threads = threading.Thread(target=lambda: found.append(places.call(here, lambda: 0)))
    found = []
    with_threads.start()
    assert inside.wait(60)
    assert places.call(lambda: 1, lambda: apart.call(os.getpid, (), owner="x")) != os.getpid()
    left.set()
    with_threads.join()
    assert found == [os.getpid()]
    assert places.call(lambda: 1, lambda: 2) == 1


def test_a_young_run_starts_no_process():
    """Both pieces of work are here, though they overlap."""
    places, both = Places(), threading.Barrier(2)

    def here(_):
        both.wait(60)
        return os.getpid()

    def work(item):
        return places.call(lambda: here(item), lambda: 0)

    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(work, [1, 2])) == [os.getpid()] * 2


def test_the_same_bytes_from_processes(old, tmp_path, monkeypatch):
    """References and cells are the same to the last bit wherever they are computed."""
    (tmp_path / "places.yaml").write_text(STUDY)
    study = config.find(str(tmp_path / "places.yaml"))
    begun = []
    perform_apart = executors.perform_apart
    monkeypatch.setattr(
        executors, "perform_apart", lambda *given: begun.append(1) or perform_apart(*given)
    )
    for jobs in (1, 2):
        runner.run_studies([study], tmp_path / str(jobs), runner.Options(jobs=jobs))
        assert bool(begun) == (jobs == 2)
    files = ["places.csv", *(f"references/{p.name}" for p in (tmp_path / "1/references").iterdir())]
    assert len(files) == 2
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes()


def test_work_of_an_ended_run_ends():
    """A reference stops soon after its run has ended; one beyond its time says so."""
    places = Places()
    spec = Shipped("slider-crank")
    with pytest.raises(NoReference, match=r"no reference at t = 0\.4: took longer than 1e-09 s"):
        runner._solution(spec, 0.4, 1e-9, places)
    places.stop()
    with pytest.raises(NoReference, match=r"no reference at t = 0\.4: Stopped"):
        runner._solution(spec, 0.4, None, places)


def test_a_reference_is_computed_once_whoever_asks(tmp_path):
    """Threads that need the same one wait for it; why there is none is remembered."""
    begun, spec = [], Shipped("slider-crank")

    def solve(spec, t):
        begun.append(t)
        if t > 0.1:
            raise NoReference("too long")
        return runner._solution(spec, t, None, Places())

    references = References(tmp_path, solve)
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda _: references.of(spec, 0.1), range(4)))
        tried = [threads.submit(references.of, spec, 0.2) for _ in range(4)]
    assert all(one is found[0] for one in found)
    assert {str(one.exception()) for one in tried} == {"too long"}
    assert begun == [0.1, 0.2]
