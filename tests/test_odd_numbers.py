"""Numbers that no motion has: an answer in one line."""

from each import each


@each(
    "options, said",
    [
        ("--at 1e300", "no march to t = 1e+300 with h = "),
        ("--at 1e-300 --h 1e-300", "no march to t = 1e-300 with h = 1e-300"),
        ("--at 1 --h 1e-300", "more than 20000000 steps to t = 1 with h = 1e-300"),
        ("--at nan", "--at: must be zero or positive, given nan"),
        ("--at 1 --h nan", "--h: must be positive and at most T = 1, given nan"),
        ("--at 1 --h 0.01 --integrator newmark\\ beta=1e-308\\ gamma=1e308", "the march fails"),
    ],
)
def test_draw(cli, options, said):
    """Times and step sizes beyond what can be computed."""
    words = [word.replace("\0", " ") for word in options.replace("\\ ", "\0").split()]
    line = cli.refused("draw", "pendulum", *words)
    assert line.startswith(f"newmark-study: {said}")


@each(
    "h, t_end",
    [("1e300", "1e300"), ("5e-324", "5e-323")],
)
def test_run(cli, h, t_end):
    """A cell that does not end well says so, and the others run."""
    cli.write(
        "odd.yaml",
        "study: odd\nproblem: pendulum\nform: [u-lambda, u-v-a-lambda]\n"
        f"preconditioning: [none, optimal]\nh: {h}\nt_end: {t_end}\n",
    )
    done = cli("run", "odd.yaml", code=1)
    assert done.stdout.endswith(" -> results/odd.csv\n")
    assert all(line.startswith("newmark-study: odd: ") for line in done.stderr.splitlines())
    for command in ("check", "plot", "show", "report", "info", "verify"):
        done = cli.warm.run([command], cli.folder)
        assert done.returncode in (0, 1, 2)
        errors = done.stderr
        assert all(line.startswith("newmark-study: ") for line in errors.splitlines()), errors
        assert "internal error" not in errors
