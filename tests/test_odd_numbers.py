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
