"""Forces and terms that a code has besides, lacks, or takes otherwise, told with their size."""

import numpy as np
import pandas as pd
import pytest
from judged_tables import BENCH, CART, judged, of_motion
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import newmark_cli as newmark
from newmark_cli.codes.file_numbers import file_of
from newmark_cli.codes.further_forces import further_forces, rates
from newmark_cli.codes.minimal_coordinates import couplings, terms

PUSHED = {
    **CART,
    "forces": {"push": {"at": "P", "force": [2, 1]}},
    "dampers": {"oil": {"from": "W", "to": "P", "damping": 0.7}},
}


def push_along_the_rod(t, u, v):
    x, y = (u[2:] - u[:2]) / 0.5
    return np.array([0, 0, 2 * x - y - 2, 2 * y + x - 1])


def against_all_of_a_velocity(t, u, v):
    """Besides what is along the line from W to P."""
    line = np.array([u[2] + 1, u[3]]) / np.hypot(u[2] + 1, u[3])
    return -0.7 * np.array([0, 0, *(v[2:] - line * (line @ v[2:]))])


@pytest.mark.parametrize(
    ("force", "among", "said"),
    [
        (lambda t, u, v: np.array([-1.5 * np.tanh(v[0] / 1e-3), 0, 0, 0]), [""],
         "dry friction of C, 1.5 N: this alone"),
        (lambda t, u, v: np.array([0, 0, 0, 5.0]), [""],
         "a further force on P along y, 5 N: this alone"),
        (lambda t, u, v: np.array([0, 0, 0, 0.6 * 9.81]), ["weight", "mass"],
         "the weight of points.P left out"),
        (push_along_the_rod, ["push", "mass"], "forces.push in axes of rod: this alone"),
        (against_all_of_a_velocity, ["push", "damp", "oil"],
         "dampers.oil against all of the velocity between its ends: this alone"),
        (lambda t, u, v: np.array([-30 * (u[0] + 0.2) * u[0], 0, 0, 0]), ["springs", "stiffness"],
         "springs.coil times the vector between its ends, which is not of length 1: this alone"),
    ],
)  # fmt: skip
def test_a_further_force_and_other_axes_of_one_are_told(force, among, said):
    mechanism = PUSHED if "push" in among else CART
    (fault,) = judged(of_motion(mechanism, force), mechanism, among).faults
    assert said in fault.text


SPUN = {
    "dimensions": 3,
    "bodies": {"rod": {"position": [0, 0, 0], "mass": 2, "inertia": [0.01, 0.03, 0.035],
                       "centre": [0.2, 0, 0.02], "angular_velocity": [1.0, 2.0, 0.5]}},
    "joints": {"ball": {"type": "spherical", "from": "ground", "to": "rod", "at": [0, 0, 0]}},
    "torques": {"jet": {"on": "rod", "torque": [0.2, 0.5, 0.1], "frame": "body"}},
    "gravity": [0, 0, -9.81],
    "project_velocities": True,
}  # fmt: skip


def of_rod(**keys):
    return {**SPUN, "bodies": {"rod": SPUN["bodies"]["rod"] | keys}}


def twice_from_its_origin():
    term = 2 * (0.2**2 + 0.02**2)
    J = {"xx": 0.01 + 2 * 0.02**2, "yy": 0.03 + term, "zz": 0.035 + 2 * 0.2**2,
         "xz": -2 * 0.2 * 0.02}  # fmt: skip
    return of_rod(inertia=J)


@pytest.mark.parametrize(
    ("other", "among", "said"),
    [
        ({**SPUN, "gravity": [0, -9.81, 0]}, ["gravity"],
         "gravity turned by -90° about x, to [0, -9.81, 0]"),
        ({**SPUN, "torques": {"jet": SPUN["torques"]["jet"] | {"frame": "global"}}}, ["jet"],
         "torques.jet in global axes"),
        (twice_from_its_origin(), ["inertia"],
         "bodies.rod.inertia with 1 times its parallel-axis term besides"),
    ],
)  # fmt: skip
def test_vectors_and_tensors_in_space_are_told_as_wholes(other, among, said):
    (fault,) = judged(of_motion(other), SPUN, among).faults
    assert said in fault.text


def test_angular_velocities_along_the_axes_of_a_body_are_turned_back():
    table = of_motion(SPUN)
    axes, rates = (
        table[[f"{part}[rod.d{i}.{x}]" for i in (1, 2, 3) for x in "xyz"]]
        .to_numpy()
        .reshape(-1, 3, 3)
        for part in "uv"
    )
    omega = np.cross(axes, rates).sum(axis=1) / 2
    for k, x in enumerate("xyz"):
        table[f"output[rod.omega.{x}]"] = (axes[:, k] * omega).sum(axis=1)
    said = judged(table, SPUN)
    assert said.notes == [
        "your code: vectors are taken to be in axes of bodies: rod.omega along those of rod"
    ]
    assert said.faults == ()
    (of_omega,) = (one for one in said.slopes if one.quantity == "omega")
    assert of_omega.values.max() < 1e-9


def test_products_of_inertia_are_told_together():
    of_other_sign, mine = (
        of_rod(inertia={"xx": 0.03, "yy": 0.04, "zz": 0.05, "xy": 0.002 * sign, "xz": 0.003 * sign})
        for sign in (-1, 1)
    )
    (fault,) = judged(of_motion(of_other_sign), mine, ["inertia"]).faults
    assert "every product of bodies.rod.inertia with its sign turned" in fault.text


def test_another_interpolation_of_a_load_is_told():
    table = {"times": [0, 0.1, 0.25, 0.4], "values": [0, 6, -2, 5]}
    loaded = {**CART, "forces": {"push": {"at": "P", "force": [{"table": table}, 1]}}}

    def push(t, u, v):
        cubic = CubicSpline(table["times"], table["values"])(t)
        return np.array([0, 0, np.interp(t, table["times"], table["values"]) - cubic, 0])

    (fault,) = judged(of_motion(loaded, push), loaded, ["interpolation"]).faults
    assert "forces.push.force.0: interpolation linear in place of cubic: this" in fault.text


def test_viscous_friction_of_a_body_is_told():
    def push(t, u, v):
        axes, rates = u.reshape(4, 3)[1:], v.reshape(4, 3)[1:]
        moment = -0.05 * np.cross(axes, rates).sum(axis=0) / 2
        return np.concatenate([np.zeros(3), (np.cross(moment, axes) / 2).ravel()])

    (fault,) = judged(of_motion(SPUN, push), SPUN, ["friction", "mass"]).faults
    assert "viscous friction of rod, 0.05 N m s/rad" in fault.text


def test_a_centre_that_is_counted_from_a_joint_is_told():
    place = [0.1, 0.05, 0]
    ball = {**SPUN["joints"]["ball"], "at": {"ground": place, "rod": place}}
    mine, other = (
        {**of_rod(velocity=[0.025, -0.05, 0.15], centre=centre), "joints": {"ball": ball}}
        for centre in ([0.2, 0, 0.02], [0.3, 0.05, 0.02])
    )
    (fault,) = judged(of_motion(other), mine, ["centre", "gravity"]).faults
    assert "bodies.rod.centre counted from joints.ball: this alone" in fault.text


def test_a_parallel_axis_term_that_leaves_less_than_no_inertia_is_told():
    """θ'' = −m g c cos θ / J, where J lacks m c²."""
    crank = {"from": "O", "to": "A", "mass": 1.0, "length": 0.3, "centre": [0.1, 0],
             "inertia": 0.004}  # fmt: skip
    file = {"points": {"O": {"fixed": [0, 0]}, "A": {"at": [0.3, 0]}}, "bodies": {"crank": crank},
            "gravity": [0, -9.81]}  # fmt: skip
    t = np.linspace(0, 0.4, 9)
    solved = solve_ivp(lambda _, y: [y[1], -0.981 * np.cos(y[0]) / 0.004], (0, 0.4), [0.0, 0.0],
                       "DOP853", rtol=1e-12, atol=1e-12, t_eval=t)  # fmt: skip
    (angle, rate), names = solved.y, ("A.x", "A.y")
    parts = {"u": (np.cos(angle), np.sin(angle)),
             "v": (-rate * np.sin(angle), rate * np.cos(angle))}  # fmt: skip
    columns = {f"{part}[{name}]": 0.3 * of for part, both in parts.items()
               for name, of in zip(names, both, strict=True)}  # fmt: skip
    table = pd.concat([pd.DataFrame({"t": t, "h": h, **columns}) for h in (0.01, 0.005, 0.0025)])
    (fault,) = judged(table, file, ["inertia"]).faults
    assert "bodies.crank.inertia with -1 times its parallel-axis term besides" in fault.text


def top_of_few_terms(J, mass, centre, omega, t, turns):
    """Directors and their rates, (k, 9) each: J ω' = r × m g about the joint, by Runge–Kutta."""

    def rate(_, y):
        axes, turn = y[:9].reshape(3, 3), y[9:]
        moment = np.cross(centre @ axes, [0, 0, -9.81 * mass])
        there = axes if turns else np.eye(3)
        return np.concatenate(
            [np.cross(turn, axes).ravel(), np.linalg.solve(J, there @ moment) @ there]
        )

    start = np.concatenate([np.eye(3).ravel(), omega])
    solved = solve_ivp(rate, (0, t[-1]), start, "DOP853", rtol=1e-12, atol=1e-12, t_eval=t)
    return solved.y[:9].T, np.array(
        [np.cross(y[9:], y[:9].reshape(3, 3)).ravel() for y in solved.y.T]
    )


@pytest.mark.parametrize(("turns", "said"), [
    (True, "the gyroscopic moment ω × J ω about the joint left out: this alone"),
    (False, "J about the joint that does not turn with the bodies, as at the start, without ω × J "
     "ω: this alone"),
])  # fmt: skip
def test_terms_of_eulers_equations_left_out_are_named(turns, said):
    """Of a top about its joint, whose place is given on the body, too."""
    mechanism = BENCH.MECHANISMS["gyro"]
    ((ball, joint),) = mechanism["joints"].items()
    at = {"ground": joint["at"], "rotor": [0, 0, 0]}
    mechanism = {**mechanism, "joints": {ball: {**joint, "at": joint["at"] if turns else at}}}
    body = mechanism["bodies"]["rotor"]
    mass, centre = body["mass"], np.array(body["centre"])
    J = np.diag(body["inertia"]) + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    t = np.array([0, 0.1, 0.2, 0.3])
    axes, rates = top_of_few_terms(J, mass, centre, body["angular_velocity"], t, turns)
    rows = [[h, t[k], *axes[k], *rates[k]] for h in (0.01, 0.005, 0.0025) for k in range(4)]
    names = [f"rotor.d{i}.{x}" for i in (1, 2, 3) for x in "xyz"]
    table = pd.DataFrame(rows, columns=["h", "t", *(f"{p}[{x}]" for p in "uv" for x in names)])
    for name in (f"{part}[rotor.origin.{x}]" for part in "uv" for x in "xyz"):
        table[name] = 0.0
    (fault,) = judged(table, mechanism, ["gyroscopic", "inertia", "J about"]).faults
    assert said in fault.text


def projected(document, h, t_end, lacks):
    """Rows of Heun's rule for M a = f + G λ, Gᵀa = −κ, projected after each step."""
    problem = newmark.problem(document)
    inverse = np.linalg.inv(problem.M)

    def accelerations(t, u, v):
        G = problem.gradient(t, u)
        curvature = (1 - lacks) * problem.constraint_derivatives(t, u, v)[1]
        free = inverse @ problem.free_values(t, u, v).force
        return free - inverse @ G @ np.linalg.solve(G.T @ inverse @ G, G.T @ free + curvature)

    u, v, rows = problem.u0.copy(), problem.v0.copy(), []
    for k in range(1, round(t_end / h) + 1):
        t = k * h
        a = accelerations(t - h, u, v)
        further = accelerations(t, u + h * v, v + h * a)
        u, v = u + h * v + h * h / 2 * a, v + h / 2 * (a + further)
        for _ in range(4):
            G, phi = problem.gradient(t, u), problem.constraint_values(t, u)
            u = u - inverse @ G @ np.linalg.solve(G.T @ inverse @ G, phi)
        G = problem.gradient(t, u)
        v = v - inverse @ G @ np.linalg.solve(G.T @ inverse @ G, G.T @ v)
        rows.append({"h": h, "t": t}
                    | {f"u[{name}]": x for name, x in zip(problem.coordinate_names, u, strict=True)}
                    | {f"v[{name}]": x for name, x in zip(problem.coordinate_names, v, strict=True)}
                    )  # fmt: skip
    every = round(0.04 / h)
    return rows[every - 1 :: every]


def test_errors_of_order_1_without_centrifugal_terms_are_no_weights_that_are_off():
    """Without them a projection makes the motion right, but with order 1."""
    undamped, sizes = {**CART, "dampers": {}}, (0.01, 0.005, 0.0025, 0.00125)
    tables = [
        pd.DataFrame([row for h in sizes for row in projected(undamped, h, 0.4, lacks)])
        for lacks in (0, 1)
    ]
    right, wrong = (judged(table, undamped) for table in tables)
    assert [one.name for one in right.findings] == []
    (note,) = wrong.findings
    assert (note.name, note.fault) == ("κ", False)
    assert note.evidence["left"] < 0.1


def across(angle):
    """Unit vectors along an angle, and of what turns with it."""
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


def two_bars(document, lengths, relative):
    """A mechanism of two bars in two angles: its document, and u and v at q and q'."""

    def places(q, w):
        one, other = (q[0], q[0] + q[1]) if relative else q
        turned = (w[0], w[0] + w[1]) if relative else w
        (e1, n1), (e2, n2) = across(one), across(other)
        u, v = lengths[0] * e1, lengths[0] * turned[0] * n1
        return np.array([[*u, *(u + lengths[1] * e2)], [*v, *(v + lengths[1] * turned[1] * n2)]])

    return document, places


M, L, J, G = (1.4, 0.6), (0.5, 0.4), (0.05, 0.03), 9.81
POINTS = {"O": {"fixed": [0, 0]}, "A": {"at": [L[0], 0], "velocity": [0, L[0]]},
          "B": {"at": [L[0], -L[1]], "velocity": [2 * L[1], L[0]]}}  # fmt: skip
PENDULUMS = {
    "points": {**POINTS, "A": POINTS["A"] | {"mass": M[0]}, "B": POINTS["B"] | {"mass": M[1]}},
    "bars": {"upper": {"from": "O", "to": "A", "length": L[0]},
             "lower": {"from": "A", "to": "B", "length": L[1]}},
    "gravity": [0, -G],
}  # fmt: skip
ARM = {
    "points": POINTS,
    "bodies": {
        name: {"from": one, "to": other, "length": L[k], "mass": M[k], "inertia": J[k],
               "centre": [L[k] / 2, 0]}
        for k, (name, one, other) in enumerate([("upper", "O", "A"), ("fore", "A", "B")])
    },
}  # fmt: skip
ROLLING = {**CART, "dampers": {}}


def on_a_cart(q, w):
    e, n = across(q[1])
    at, speed = np.array([q[0], 0]), np.array([w[0], 0])
    return np.array([[*at, *(at + 0.5 * e)], [*speed, *(speed + 0.5 * w[1] * n)]])


@pytest.mark.parametrize(
    ("mechanism", "name", "row", "by_hand"),
    [
        (two_bars(PENDULUMS, L, relative=False),
         "the rate of the angle of lower squared in the equation of the angle of upper", 0,
         lambda q, w: M[1] * L[0] * L[1] * np.sin(q[0] - q[1]) * w[1] ** 2),
        (two_bars(ARM, L, relative=True),
         "the rates of the angle of upper and the angle of fore on upper in the equation of the "
         "angle of upper", 0,
         lambda q, w: -M[1] * L[0] * L[1] * np.sin(q[1]) * w[0] * w[1]),
        ((ROLLING, on_a_cart),
         "the rate of the angle of rod squared in the equation of the distance of C", 0,
         lambda q, w: -0.6 * 0.5 * np.cos(q[1]) * w[1] ** 2),
    ],
)  # fmt: skip
def test_terms_of_equations_in_angles_are_those_of_textbooks(mechanism, name, row, by_hand):
    """As a force, one acts along its own coordinate only."""
    document, places = mechanism
    problem = newmark.problem(document)
    q, w = np.array([0.3, -1.1]), np.array([1.2, -0.7])
    u, v = places(q, w)
    along = [(places(q + e, w)[0] - places(q - e, w)[0]) / 2e-6 for e in 1e-6 * np.eye(2)]
    found = dict(terms(problem, [*rates(problem, document)]))
    expected = np.where(np.arange(2) == row, by_hand(q, w), 0)
    force = found[f"the term with {name}"](0.0, u, v)
    np.testing.assert_allclose(along @ force, expected, rtol=1e-7, atol=1e-8)


def test_a_coupling_in_the_matrix_of_masses_is_that_of_a_textbook():
    document, places = two_bars(PENDULUMS, L, relative=False)
    problem, q = newmark.problem(document), np.array([0.3, -1.1])
    along = [places(q, w)[1] for w in np.eye(2)]
    (name, coupling), *_ = couplings(problem, [*rates(problem, document)])
    assert (
        name == "the coupling of the angle of upper and the angle of lower in the matrix of masses"
    )
    by_hand = M[1] * L[0] * L[1] * np.cos(q[0] - q[1])
    found = along @ coupling(0.0, places(q, q)[0]) @ np.transpose(along)
    np.testing.assert_allclose(found, [[0, by_hand], [by_hand, 0]], rtol=1e-9, atol=1e-12)


def test_a_sign_in_equations_written_by_hand_is_told():
    """Of a textbook's double pendulum; with the right sign nothing is."""
    document, places = two_bars(PENDULUMS, L, relative=False)
    mass = M[0] + M[1]

    def table(sign):
        def rate(t, y):
            q, w = y[:2], y[2:]
            c, s = (M[1] * L[0] * L[1] * of(q[0] - q[1]) for of in (np.cos, np.sin))
            inertia = np.array([[mass * L[0] ** 2, c], [c, M[1] * L[1] ** 2]])
            weight = -G * np.array([mass * L[0], M[1] * L[1]]) * np.cos(q)
            moment = weight - [sign * s * w[1] ** 2, -s * w[0] ** 2]
            return np.concatenate([w, np.linalg.solve(inertia, moment)])

        t = np.linspace(0, 0.3, 7)
        start = [0, -np.pi / 2, 1, 2]
        y = solve_ivp(rate, (0, 0.3), start, "DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y.T
        states = np.array([places(row[:2], row[2:]).ravel() for row in y])
        names = newmark.problem(document).coordinate_names
        columns = [f"{part}[{name}]" for part in "uv" for name in names]
        frame = pd.DataFrame(states, columns=columns).assign(t=t)
        return pd.concat([frame.assign(h=h) for h in (0.01, 0.005, 0.0025)])

    assert judged(table(1), document).faults == ()
    (fault,) = judged(table(-1), document, ("the term with", "the coupling of")).faults
    assert ("the rate of the angle of lower squared in the equation of the angle of upper with its "
            "sign turned: this alone") in fault.text  # fmt: skip


def test_forces_between_two_bodies_have_a_share_on_each():
    """Of a spring between points, and of a damper between two bodies, by hand."""
    between = {
        "torsion_dampers": {"grease": {"from": "upper", "to": "fore", "damping": 0.3}},
        "springs": {"coil": {"from": "A", "to": "B", "stiffness": 30, "rest_length": 0.3}},
    }
    document, places = two_bars({**ARM, **between}, L, relative=False)
    problem = newmark.problem(document)
    q, w = np.array([0.3, -1.1]), np.array([1.2, -0.7])
    axes = ("A.x", "A.y", "B.x", "B.y")
    u, v = (
        np.array([{**dict(zip(axes, at, strict=True)), "upper.angle": of[0], "fore.angle": of[1]}[x]
                  for x in problem.coordinate_names])
        for at, of in zip(places(q, w), (q, w), strict=True)
    )  # fmt: skip
    found = {
        one.name: dict(zip(problem.coordinate_names, one.of(0.0, u, v), strict=True))
        for one in further_forces(problem, 1.0, 1.0, file_of(problem, document))
    }
    on_b = found["springs.coil does not act on B"]
    pulled = 30 * 0.1 * across(-1.1)[0]
    np.testing.assert_allclose([on_b["B.x"], on_b["B.y"]], pulled, rtol=1e-7)
    assert on_b["A.x"] == on_b["A.y"] == 0
    turned = found["torsion_dampers.grease does not act on fore"]
    assert turned["fore.angle"] == pytest.approx(0.3 * (-0.7 - 1.2), rel=1e-7)
    assert turned["upper.angle"] == pytest.approx(0, abs=1e-9)


def test_a_motion_that_is_driven_late_is_told():
    """Its law at t − h: Φ is met at that time only."""

    def driven(h):
        law = {"value": 0.0, "amplitude": 0.1, "frequency": 7, "phase": 0.4 - 7 * h}
        return {**CART, "motions": {"drive": {"slider": "rail", "distance": law}},
                "assemble": True, "project_velocities": True}  # fmt: skip

    tables = [of_motion(driven(h)).query("h == @h and t > 0") for h in (0.01, 0.005, 0.0025)]
    faults = judged(pd.concat(tables), driven(0), ("the acceleration",)).faults
    (late,) = (fault for fault in faults if fault.name == "late")
    assert late.evidence["shift"] == -1
    assert "the law of motions.drive is taken there" in late.text


def test_centrifugal_terms_of_one_constraint_left_out_of_the_multipliers_are_told():
    table, problem = of_motion(PENDULUMS), newmark.problem(PENDULUMS)
    u, v = (table[[f"{part}[{name}]" for name in problem.coordinate_names]] for part in "uv")
    inverse = np.linalg.inv(problem.M)
    for row in range(len(table)):
        t, at, rate = table["t"].iloc[row], u.iloc[row].to_numpy(), v.iloc[row].to_numpy()
        x = problem.evaluate(t, at, rate, np.zeros(2))
        kappa = [0, np.sum((rate[2:] - rate[:2]) ** 2)]  # of the lower bar, ½ (|Δ|² − L²)
        implied = np.linalg.solve(x.G.T @ inverse @ x.G, -x.G.T @ inverse @ x.force - kappa)
        for name, value in zip(problem.constraint_names, implied, strict=True):
            table.iloc[row, table.columns.get_loc(f"lambda[{name}]")] = value
    (fault,) = judged(table, PENDULUMS, ("κ of",)).faults
    assert "κ of bars.upper in λ left out: this alone" in fault.text
