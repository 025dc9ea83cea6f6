"""How many processors the process may use: affinity, and quotas of control groups."""

import os

import pytest
from each import each

from newmark_cli.cli.commands import cli as command_line
from newmark_cli.processors import usable

#: Processors of the machine in these tests.
MACHINE = 64


@pytest.fixture(autouse=True)
def machine(monkeypatch):
    """A machine of many processors, all of which may be used."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(MACHINE)))


def write(root, files):
    """Files below a root in place of the system's."""
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")


#: Files of a system, and the processors that may be used.
SYSTEMS = {
    "nothing": ({}, MACHINE),
    "version 2": (
        {"proc/self/cgroup": "0::/jobs/mine", "sys/fs/cgroup/jobs/mine/cpu.max": "400000 100000"},
        4,
    ),
    "version 2, no limit": (
        {"proc/self/cgroup": "0::/jobs", "sys/fs/cgroup/jobs/cpu.max": "max 100000"},
        MACHINE,
    ),
    "version 2, a group above": (
        {
            "proc/self/cgroup": "0::/jobs/mine",
            "sys/fs/cgroup/jobs/mine/cpu.max": "max 100000",
            "sys/fs/cgroup/jobs/cpu.max": "250000 50000",
        },
        5,
    ),
    "version 2, in a container that sees the path of its host": (
        {"proc/self/cgroup": "0::/docker/c0ffee", "sys/fs/cgroup/cpu.max": "300000 100000"},
        3,
    ),
    "version 2, part of a processor": (
        {"proc/self/cgroup": "0::/", "sys/fs/cgroup/cpu.max": "20000 100000"},
        1,
    ),
    "version 2, one and a half": (
        {"proc/self/cgroup": "0::/", "sys/fs/cgroup/cpu.max": "150000 100000"},
        2,
    ),
    "version 1": (
        {
            "proc/self/cgroup": "5:memory:/\n4:cpu,cpuacct:/a/b\n1:name=systemd:/",
            "sys/fs/cgroup/cpu,cpuacct/a/b/cpu.cfs_quota_us": "600000",
            "sys/fs/cgroup/cpu,cpuacct/a/b/cpu.cfs_period_us": "100000",
        },
        6,
    ),
    "version 1, no limit": (
        {
            "proc/self/cgroup": "1:cpu:/",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
        },
        MACHINE,
    ),
    "version 1, whose folder has the controller's short name": (
        {
            "proc/self/cgroup": "4:cpu,cpuacct:/a",
            "sys/fs/cgroup/cpu/a/cpu.cfs_quota_us": "200000",
            "sys/fs/cgroup/cpu/a/cpu.cfs_period_us": "100000",
        },
        2,
    ),
    "both versions": (
        {
            "proc/self/cgroup": "1:cpu:/\n0::/x",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "800000",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            "sys/fs/cgroup/unified/x/cpu.max": "700000 100000",
        },
        7,
    ),
    "another controller's files": (
        {"proc/self/cgroup": "2:cpuset:/a", "sys/fs/cgroup/cpuset/a/cpu.cfs_quota_us": "100000"},
        MACHINE,
    ),
    "nonsense": (
        {"proc/self/cgroup": "what\n0::/\n:::", "sys/fs/cgroup/cpu.max": "0 0"},
        MACHINE,
    ),
}


@each("system", SYSTEMS)
def test_quotas_count(tmp_path, system):
    """The least of all limits, rounded up to whole processors, and at least one."""
    files, expected = SYSTEMS[system]
    write(tmp_path, files)
    assert usable(tmp_path) == expected


def test_affinity_counts(tmp_path, monkeypatch):
    """A process that may run on two processors uses two, whatever its quota allows.

    Where the system knows no affinity, the machine's processors count.
    """
    write(tmp_path, {"proc/self/cgroup": "0::/", "sys/fs/cgroup/cpu.max": "900000 100000"})
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 7})
    assert usable(tmp_path) == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert usable(tmp_path) == 7


def test_jobs_are_the_processors_that_may_be_used(monkeypatch):
    """``--jobs`` without a number, as `run` gets it."""
    monkeypatch.setattr("newmark_cli.cli.options.usable", lambda: 23)
    given = []
    monkeypatch.setattr(
        "newmark_cli.cli.running._run", lambda studies, folder, how, *others: given.append(how) or 0
    )
    for words in (["run", "pendulum-u"], ["run", "pendulum-u", "--jobs", "5"]):
        command_line.main(words, standalone_mode=False)
    assert [how.jobs for how in given] == [23, 5]
