"""Break the core in one place after another and see that a test fails each time.

Mutations: one more power of h in every entry of Table 2, every weight of every
form halved, every sign in the three assemblers turned; the coefficients of
integrators, the updates of compensated evaluation and the derivatives of constraints
changed, and those of formulations and projections, and the exponents that theory gives
formulations. Each runs in a copy of the project, with the tests that should notice it.

    python tests/verification/mutations.py
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from newmark_cli.newmark.forms import FORMS, eliminate
from newmark_cli.newmark.integrator import FIELDS, Newmark

ROOT = Path(__file__).parents[2]
CORE = Path("newmark_cli/newmark")


class Mutation(NamedTuple):
    """One change: where, what, and who should notice."""

    name: str
    file: Path
    position: int
    old: str
    new: str
    tests: tuple[str, ...]


#: (text, what stands in its place)
Changes = tuple[tuple[str, str], ...]


def table_2() -> Iterator[Mutation]:
    """Every factor of Table 2 times h."""
    file = CORE / "scaling.py"
    text = (ROOT / file).read_text()
    begin, end = text.index("TABLE_2: "), text.index("BESIDE_TABLE_2: ")
    form = side = ""
    pattern = re.compile(r'"([\w-]+)": (?:"([^"]+)"|\{)')
    for match in pattern.finditer(text, begin, end):
        key, factor = match.groups()
        if key in FORMS:
            form = key
        elif factor is None:
            side = key
        else:
            yield Mutation(
                f"Table 2, {form}, {side} {key}: {factor} times h",
                file, match.start(2), factor, f"({factor})*h", ("tests/test_scaling.py",),
            )  # fmt: skip


def weights() -> Iterator[Mutation]:
    """Every weight of every form that is not 0, halved."""
    file = CORE / "forms.py"
    anchor = "    return Elimination(\n"
    position = (ROOT / file).read_text().index(anchor)
    for name, form in FORMS.items():
        found = eliminate(form, Newmark().relations(0.1)).weights
        for i, field in enumerate(FIELDS):
            for k, kept in enumerate(form.kept):
                if found[i, k] != 0:
                    change = f"    if form.name == {name!r}:\n        found[{i}, {k}] /= 2\n"
                    yield Mutation(
                        f"form {name}, weight ∂{field}/∂{kept} halved",
                        file, position, anchor, change + anchor, ("tests/test_forms.py",),
                    )  # fmt: skip


def signs() -> Iterator[Mutation]:
    """Every sign in the literal assembler, in the kernel's and in the sparse one."""
    engines = (
        "tests/test_engines.py",
        "-k",
        "assembled or residual or converge_alike or quadratic or per_step",
    )
    for file, start, stop, tests, changes in (
        (CORE / "jacobian.py", "def four_field", "def form_blocks", ("tests/test_condition.py",
         "-k", "assembled"), (
            ('"u": terms.X', '"u": -terms.X'), ('"v": terms.Y', '"v": -terms.Y'),
            ('"a": relations.acc', '"a": -relations.acc'), ("-terms.G,", "terms.G,"),
            ('"v": identity', '"v": -identity'), ("-relations.v_from_a", "relations.v_from_a"),
            ('"u": identity', '"u": -identity'), ("-relations.u_from_a", "relations.u_from_a"),
            ("terms.G.T", "-terms.G.T"),
        )),
        (CORE / "linear/assembly.py", "def constants", "def _sums", engines, (
            ("factor * mass", "-factor * mass"),
            ("diagonal = np.full(n, factor", "diagonal = np.full(n, -factor"),
            ("(pattern.x_rows, k * n + pattern.x_columns, of_x, factor)",
             "(pattern.x_rows, k * n + pattern.x_columns, of_x, -factor)"),
            ("(pattern.y_rows, k * n + pattern.y_columns, of_y, factor)",
             "(pattern.y_rows, k * n + pattern.y_columns, of_y, -factor)"),
            ("factor = tables.left[row] * weight", "factor = -tables.left[row] * weight"),
            ("factor = -(tables.left[0]", "factor = (tables.left[0]"),
        )),
        (CORE / "kernel.py", "def _assemble_residual", "def solve_in_place", engines, (
            ("+= coefficients[e] * sources", "-= coefficients[e] * sources"),
            ("force[i] - dynamics", "-force[i] - dynamics"),
            ("force[i] - dynamics", "force[i] + dynamics"),
            ("rhs[mass_rows[e]] -=", "rhs[mass_rows[e]] +="),
            ("-left[1 + r] * residual", "left[1 + r] * residual"),
            ("-left[1 + extra] * phi", "left[1 + extra] * phi"),
        )),
        (CORE / "scipy_march.py", "def residual", "def march", engines, (
            ("+ self.dynamic_history", "- self.dynamic_history"),
            ("- force,", "+ force,"),
            ("+ self.row_history", "- self.row_history"),
        )),
        (CORE / "linear/sparse.py", "class SparseSystem", "def scaled_entries",
         ("tests/test_sparse.py",), (
            ("relations.acceleration[0] *", "-relations.acceleration[0] *"),
            ("[1.0, -rel", "[-1.0, -rel"),
            ("-relations.v_from_a", "relations.v_from_a"),
            ("-relations.u_from_a", "relations.u_from_a"),
            ("g_sources, -1.0", "g_sources, 1.0"),
            ("self._x.values(values.x)", "-self._x.values(values.x)"),
            ("self._y.values(values.y)", "-self._y.values(values.y)"),
            ("self._g.values(values.g)", "-self._g.values(values.g)"),
        )),
    ):  # fmt: skip
        yield from _changes(file, start, stop, tests, changes)


def integrators() -> Iterator[Mutation]:
    """Coefficients of every integrator."""
    tests = ("tests/test_integrators.py", "-k", "not orders and not accuracy")
    for start, changes in (
        ("def _alpha_relations", (
            ("v_from_a=gamma * h", "v_from_a=gamma * h / 2"),
            ("u_from_a=beta * h**2", "u_from_a=beta * h**2 / 2"),
            ("(1 - gamma) * h", "(1 + gamma) * h"), ("(0.5 - beta)", "(0.5 + beta)"),
            ("[1 - alpha_m,", "[1 + alpha_m,"), ("0.0, alpha_m,", "0.0, -alpha_m,"),
            ("-alpha_f]", "alpha_f]"), ("/ (1 - alpha_f)", "/ (1 + alpha_f)"),
            ("NEW_A, TRUE_ACCELERATION]", "TRUE_ACCELERATION, NEW_A]"),
            ("[0, 1, 2, 2]", "[0, 1, 2, 1]"),
        )),
        ("class Newmark", (
            ("2 * self.beta", "3 * self.beta"), ("else 1", "else 2"),
            ("v_from_a=gamma * h", "v_from_a=gamma * h / 2"),
            ("u_from_a=beta * h**2", "u_from_a=beta * h**2 / 2"),
            ("(1 - gamma) * h", "(1 + gamma) * h"), ("(0.5 - beta)", "(0.5 + beta)"),
        )),
        ("class GeneralizedAlpha", (
            ("self.rho < 1", "self.rho <= 1"), ("2 * self.rho - 1", "2 * self.rho + 1"),
            ("self.rho / (", "1 / ("), ("+ alpha_f - alpha_m", "- alpha_f + alpha_m"),
            ("+ 0.5) ** 2 / 4", "+ 0.5) ** 2 / 2"),
        )),
        ("class HHT", (
            ("self.alpha > 0", "self.alpha >= 0"), ("(1 + self", "(1 - self"),
            ("0.5 + self.alpha", "0.5 - self.alpha"), ("0.0, self.alpha\n", "self.alpha, 0.0\n"),
        )),
        ("def _alpha_symbols", (("(1 - alpha_f) /", "(1 + alpha_f) /"),)),
        ("class BDF1", (
            ('"gamma": 1.0', '"gamma": 2.0'), ("v_from_a=h", "v_from_a=h / 2"),
            ("u_from_a=h**2", "u_from_a=h**2 / 2"), ("[1.0, h]", "[1.0, 0.0]"),
        )),
        ("class BDF2", (
            ('"beta": 4 / 9', '"beta": 1.0'), ("v_from_a=2 / 3", "v_from_a=1 / 3"),
            ("u_from_a=4 / 9", "u_from_a=2 / 9"), ("0.0, 1 / 3]", "0.0, -1 / 3]"),
            ("h, 1 / 3", "h, -1 / 3"), ("-h / 9", "h / 9"), ("h**2 / 2", "h**2"),
            ("0, h]]", "0, -h]]"),
        )),
    ):  # fmt: skip
        yield from _changes(CORE / "integrator.py", start, "#: Integrators by", tests, changes)


def static() -> Iterator[Mutation]:
    """Static elimination: order, units, analysis, loops, generated code and refusals."""
    tests = ("tests/test_static.py",)
    yield from _changes(CORE / "static_elimination.py", "def analyse", "def eliminate", tests, (
        ("for k in range(least, j)", "for k in range(least, j - 1)"),
        ("range(j + 1, most + 1)", "range(j + 1, most)"),
        ("there[lower_rows[e]] = j", "pass"), ("most = max(most, lower_rows[e])", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "static_elimination.py", "def eliminate", "@intrinsic", tests, (
        ("+= coefficients[e] * sources", "-= coefficients[e] * sources"),
        ("column[lower_rows[i]] -= lower[i]", "column[lower_rows[i]] += lower[i]"),
        ("reciprocal > 0 and", "reciprocal != 0 and"), ("and largest <= limit", ""),
        ("rhs[row_order[j]] * row_units[j]\n    for j in range(size):\n        solved",
         "rhs[row_order[j]]\n    for j in range(size):\n        solved"),
        ("solution[lower_rows[e]] -= lower[e] * solved", "pass"),
        ("= solved * column_units[j]", "= solved"),
        ("solution[upper_rows[e]] -= upper[e] * solved", "pass"),
        ("rhs[column_order[j]] * column_units[j]", "rhs[column_order[j]]"),
        ("value -= upper[e] * solution", "value += upper[e] * solution"),
        ("value -= lower[e] * solution", "value += lower[e] * solution"),
        ("= value * row_units[j]", "= value"),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/generated.py", "def _module", "return module", tests, (
        ("build.fadd(so_far, term)", "build.fsub(so_far, term)"),
        ("build.fsub(so_far, product)", "build.fadd(so_far, product)"),
        ('good = build.and_(good, build.fcmp_ordered(">", pivot, above))', "pass"),
        ("build.fmul(b, value(work, j))", "b"),
        ("else build.fmul(solved, value(work, size + j))", "else solved"),
        ("build.fmul(solution[j], inverse[j])", "solution[j]"),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/static.py", "def units", "return (", tests, (
        ("np.sign(left[0]", "-np.sign(left[0]"), ("change[2]) * mass", "change[2]) * mass**2"),
        ("of_constraints / (left[-1]", "-of_constraints / (left[-1]"),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/ordering.py", "def _least_work", "return np.array", tests, (
        # That a field waits for its coordinate's others follows from least work in all that
        # is known; the rule says so for good.
        ("wait(highest + i, fields * n + k)", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/ordering.py", "def _bands", "def _least", tests, (
        ("np.maximum.at(met", "np.minimum.at(met"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _march", "class _Compiled", tests, (
        ("multipliers[k] = before_step[k]", "pass"), ("pivoted[s] = 1", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "compiled_march.py", "def march", "def arguments", tests, (
        ("one, pivoted[done] = slice(done, done + 1), 1", "one = slice(done, done + 1)"),
        ("self.pivoted += int", "self.pivoted = int"),
    ))  # fmt: skip
    yield from _changes(CORE / "compiled_march.py", "def _after", "def march", tests, (
        ("record.steps[k:] - done", "record.steps[k:]"),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/choice.py", "def choose", "class Stagnation", tests, (
        ("SPARSE if formulated or not problem.compiled else STATIC", "STATIC"),
        ("SPARSE if formulated or not problem.compiled else STATIC", "SPARSE"),
    ))  # fmt: skip


def straight() -> Iterator[Mutation]:
    """Code made for one mechanism: what it calls, and what it depends on."""
    tests = ("tests/test_specialised.py",)
    yield from _changes(CORE / "specialised.py", "def digest", "def module", tests, (
        ("self.elimination.digest() if self.elimination else", "\"\" if self.elimination else"),
        ("{self.compensated} ", ""), ("array.tobytes()", "b''"),
    ))  # fmt: skip
    yield from _changes(CORE / "specialised.py", "def _text", "def _call", tests, (
        ("llvm.memset.p0.i64(ptr %force, i8 0", "llvm.memset.p0.i64(ptr %force, i8 64"),
        ("self._call(names[2], _INCREASED, number)", "''"),
        ("ptr %sources, i64 {self.shapes['x'][0]}", "ptr %sources, i64 0"),
        ("ptr %y, i64 {self.shapes['y'][0]}", "ptr %y, i64 1"),
    ))  # fmt: skip


def known_exchanges() -> Iterator[Mutation]:
    """Partial pivoting by code: what it compares, what it is made of, when it is looked up."""
    tests = ("tests/test_exchanges.py",)
    yield from _changes(CORE / "linear/generated.py", "def _came_before", "return module", tests, (
        ("standing[k], standing[at] = standing[at], standing[k]", "pass"),
        ('build.fcmp_ordered(">=", pivot, rest)', 'build.fcmp_ordered(">", pivot, rest)'),
        ("if row in before[j]", "if False"), ("if row not in before[j]", "if False"),
        ('pivot, above))', 'pivot, rest))'),
    ))  # fmt: skip
    yield from _changes(CORE / "linear/exchanges.py", "class Exchanges", "def row_order", tests, (
        ("and self.given_up < _PATIENCE", ""), ("(1 + self.looks)", "1"),
        ("self.given_up += int(given_up.sum())", "pass"),
        ("self.compiled >= self._steps", "0 > self._steps"),
        ("if not written.is_made():", "if True:"),
        ("> generated.OPERATIONS_AT_MOST", "< 0"),
        ("dense.constant[keys]", "dense.constant[keys[::-1]]"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _march", "class _Compiled", tests, (
        ("given_up >= patience", "False"),
    ))  # fmt: skip


def increments() -> Iterator[Mutation]:
    """Updates of compensated evaluation, in both engines, and the stop at a tolerance."""
    tests = ("tests/test_compensated.py", "-k", "not measured")
    stops = ("tests/test_tolerance.py", "-k", "rule")
    precision = ("tests/test_precision.py", "-k", "computes or elements")
    yield from _changes(CORE / "scheme.py", "def marched", "def elimination", tests, (
        ("v_past[:2] = ", "v_past[:1] = "), ("u_past[:2] = ", "v_past[:2] = "),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _take_increments", "def _increase_phi", tests, (
        ("+ iterate.moving[0, i]", "- iterate.moving[0, i]"),
        ("(state.lows[0, i] + iterate.shift[i])", "iterate.shift[i]"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _increase_phi", "def _assemble", tests, (
        ("half * (g_old[e] + g_new[e])", "g_new[e]"), ("phi_old[k]", "0"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _carry_over", "def _march", tests, (
        ("state.phi[k] = values.phi[k]", "pass"), ("iterate.g_old[e] = values.g[e]", "pass"),
        ("_add_exactly(state.past[0], state.lows[0], iterate.shift, new_past[0])", "pass"),
        ("_add_exactly(state.past[1], state.lows[1], iterate.moving[1], new_past[1])", "pass"),
        ("low[i] + increment[i]", "increment[i]"), ("(high[i] - (", "(high[i] + ("),
        ("+ (added - of_added)", "- (added - of_added)"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _increase_phi", "def _assemble", precision, (
        ("phi.dtype.type(0.5)", "0.5"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "            if to_tolerance:", "else:", stops, (
        ("limit = absolute", "limit = 0.0"), ("norm <= limit", "norm > limit"),
        ("limit += relative", "limit -= relative"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "class _Compensated", "def march", tests, (
        ("(self.h * lows[1] + moving[0])", "(self.h * lows[1] - moving[0])"),
        ("(lows[0] + self.shift(moving))", "self.shift(moving)"),
        ("0.5 * (self.g + g)", "g"), ("self.state.phi + self", "self"),
        ("self.state.phi[:] = self.phi(moving, g)", "pass"), ("self.g = g\n", "pass\n"),
        ("lows[field] + increment", "increment"), ("(high - (new", "(high + (new"),
        ("+ (added - of_added)", "- (added - of_added)"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "def _limit", "return", stops, (
        ("/ scheme.right[:p, None]", "* scheme.right[:p, None]"),
        ("/ scheme.right[p]", "* scheme.right[p]"),
    ))  # fmt: skip


def rows() -> Iterator[Mutation]:
    """Signs and factors of Φ' and Φ'', of their tangents, projections and corrected starts."""
    problems, own = Path("newmark_cli/problems"), "tests/test_constraint_rows.py"
    elements = Path("newmark_cli/mechanisms/elements.py")
    yield from _changes(elements, "def constraint_derivatives", "def potential", (
        own, "-k", "mpmath",
    ), (
        ("= -_law(t, reals, e, 1)", "= _law(t, reals, e, 1)"),
        ("= -_law(t, reals, e, 2)", "= _law(t, reals, e, 2)"),
        ("wx += a * v[i] - b", "wx += a * v[i] + b"), ("wy += b *", "wy -= b *"),
        ("ax += a * w[i] - b", "ax += a * w[i] + b"), ("ay += b *", "ay -= b *"),
        ("= -turn * along", "= turn * along"), ("-faster * along", "faster * along"),
        ("- turn * turn * across", "+ turn * turn * across"), ("- two * turn", "- turn"),
        ("= -turn * cosine", "= turn * cosine"), ("-turn * sine\n", "turn * sine\n"),
        ("turn * turn * sine -", "turn * sine -"), ("- faster * cosine", "+ faster * cosine"),
        ("-turn * turn * cosine", "turn * turn * cosine"), ("- faster * sine", "+ faster * sine"),
        ("a * wx + b * wy", "a * wx - b * wy"), ("a * wy - b * wx", "a * wy + b * wx"),
        ("a * ax + b * ay", "a * ax - b * ay"), ("a * ay - b * ax", "a * ay + b * ax"),
    ))  # fmt: skip
    yield from _changes(elements, "def constraint_derivatives", "def potential", (
        own, "-k", "overwritten",
    ), (
        ("rate_values[g + k] = zero", "pass"), ("acceleration_values[g + k] = zero", "pass"),
    ))  # fmt: skip
    yield from _changes(elements, "def constraint_derivatives", "def potential", (
        "tests/test_precision.py", "-k", "constraint_rows",
    ), (("u.dtype.type(2)", "2.0"),))  # fmt: skip
    yield from _changes(problems / "constraint_rows.py", "def by_differences", "def of_quad", (
        own, "-k", "crank",
    ), (
        ("& {\"constraint_rate\", \"curvature\"}", "& {\"constraint_rate\"}"),
        ("wanted - {\"constraint_rate\"}", "wanted - {\"curvature\"}"),
        ("phi_of(states[k], times[k])", "phi_of(states[k], t)"),
    ))  # fmt: skip
    yield from _changes(problems / "differences.py", "def states_along", "def steps_along", (
        own, "-k", "surface",
    ), (
        ("for shift in (h, -h)", "for shift in (h, 0.0)"),
        ("t if way == 2 else t + shift", "t + shift"),
        ("t if way == 2 else t + shift", "t if way > 0 else t + shift"),
        ("0.0 if way == 0 else", "0.0 if way < 2 else"), ("w if way == 2 else v", "v"),
        ("turned[k] + drifted[k]", "turned[k] - drifted[k]"),
        ("drifted[k] + bent[k]", "drifted[k] - bent[k]"), ("turned[e] + bent", "turned[e] - bent"),
        ("way += 2 * STEPS", "way += STEPS"), ("flat[2 * STEPS :]", "flat"),
        ("(2 * steps[k])", "steps[k]"), ("+ (values[2 * k + 1, i]", "- (values[2 * k + 1, i]"),
        ("(steps[k] * steps[k])", "steps[k]"),
    ))  # fmt: skip
    yield from _changes(problems / "differences.py", "def directions", "def _products", (
        own, "-k", "quadratic_constraints",
    ), (
        ("copy_vector(w", "copy_vector(v"), ("gradients[1:] - gradients[0]", "gradients[1:]"),
        ("_products(changes, v)[0]", "2 * _products(changes, v)[0]"),
        ("flatten(changes[1], q", "flatten(changes[0], q"),
    ))  # fmt: skip
    yield from _changes(problems / "differences.py", "def states_around", "def size_of", (
        "tests/test_python_problems.py", "-k", "by_differences_is_good or tangents_by",
    ), (
        ("+= shift * size", "+= 2 * shift * size"), ("(-2, -1, 1, 2)", "(-1, -2, 1, 2)"),
        ("(of_v, pace, y_values)", "(of_v, step, y_values)"), ("-8.0, 8.0", "8.0, -8.0"),
        ("(12 * size)", "(6 * size)"), ("first += 4 * n", "first += 4"),
        ("* multipliers[c]", "* multipliers[0]"),
    ))  # fmt: skip
    yield from _changes(problems / "index_1.py", "def projected", "def nearest", (
        own, "-k", "projection",
    ), (
        ("-self.rate(t, u, v)", "self.rate(t, u, v)"),
        ("problem.along(values.g, v) + rate", "problem.along(values.g, v)"),
        ("* self._unit", "/ self._unit"),
    ))  # fmt: skip
    yield from _changes(problems / "starting.py", "def corrected_velocity", "def _projected", (
        "tests/test_corrected_start.py", "-k", "jerk or order_two",
    ), (
        ("= -(h**2)", "= h**2"), (" / 12", " / 6"), ("-3 * turned", "-2 * turned"),
        ("turned - extra", "turned + extra"), ("(2 * step)", "step"),
    ))  # fmt: skip


def formulations() -> Iterator[Mutation]:
    """Signs, weights and factors of formulations, projections and what is reported."""
    own = "tests/test_formulations.py"
    literal = (own, "-k", "equations or weights or least or directions")
    python = (own, "-k", "python_runs")
    carried, total = (own, "-k", "carried_sums"), (own, "-k", "records_total")
    stopping = (own, "-k", "until_it_grows")
    march = (own, "-k", "reported or projections or balances")
    yield from _changes(CORE / "formulation.py", "def weights", "#: Corrections", literal, (
        ("/ (h if", "* (h if"), ("(1.0, 0.0, 0.0)", "(-1.0, 0.0, 0.0)"),
        ("(0.0, 1.0, 0.0)", "(0.0, 2.0, 0.0)"), ("(0.0, 0.0, 1.0)", "(0.0, 1.0, 1.0)"),
        ("rate**2", "rate"), ("2 * rate", "rate"), ("2 * rate, 1.0", "2 * rate, -1.0"),
    ))  # fmt: skip
    yield from _changes(CORE / "forms.py", "def eliminate", "    return Elim", literal, (
        ("u_past, [1.0]", "u_past, [-1.0]"), ("found[field] - known", "found[field] + known"),
        ("known + from_a", "known - from_a"),
    ))  # fmt: skip
    yield from _changes(CORE / "forms.py", "def eliminate", "    return Elim", python, (
        ("* found[a] - known", "* found[a] + known"),
    ))  # fmt: skip
    yield from _changes(CORE / "jacobian.py", "    del blocks", "def form_blocks", literal, (
        ("terms.X + product", "terms.X - product"),
        ("through - directions", "through + directions"),
        ("through = through + product(", "through = through - product("),
    ))  # fmt: skip
    yield from _changes(CORE / "constraints.py", "class Constraining", "def tables", literal, (
        ("s0 * g + s1 * r", "s0 * g - s1 * r"), ("+ s2 * q, s1", "- s2 * q, s1"),
        ("s1 * g + 2", "s1 * g - 2"), ("2 * s2 * r", "s2 * r"), ("s2 * self.inertia * g", "s2 * g"),
        ("value * to_acceleration", "value"), ("terms.values * g", "g"),
    ))  # fmt: skip
    yield from _changes(CORE / "constraints.py", "def projector", "class Constraining", literal, (
        ("Factors(part).inverse()", "part"), ("return 1 / spectral", "return spectral"),
        ("1 / diagonal", "diagonal"), ("1 / float(eigsh", "float(eigsh"),
    ))  # fmt: skip
    yield from _changes(CORE / "constraints.py", "def pushed", "def tangents_at", python, (
        ("directions * eta", "directions / eta"), ("s0 * phi + s1", "s0 * phi - s1"),
        ("+ s2 * second", "- s2 * second"),
    ))  # fmt: skip
    sparse = CORE / "linear/sparse.py"
    yield from _changes(sparse, "class _Products", "class SparseSystem", literal, (
        ("constraining.penalty * weights", "-constraining.penalty * weights"),
        ("weights[0, k])", "weights[-1, k])"), ("self._of_x, to_u)", "self._of_x, -to_u)"),
        ("self._of_y, to_v)", "self._of_y, to_u)"), ("constraining.inertia * to_a", "to_a"),
        ("in (to_u, to_v, to_a)", "in (to_v, to_u, to_a)"), ("[(eta, -1.0)]", "[(eta, 1.0)]"),
        ("factors[first] * directions", "factors[first] / directions"),
        ("values.g[first] * values", "values.g[first] + values"),
    ))  # fmt: skip
    yield from _changes(CORE / "scaling.py", "BESIDE_TABLE_2:", "#: Entries of Table 2 as", march, (
        ('"beta*h/gamma"', '"beta*h^2"'), ('"Ca": "beta*h^2"', '"Ca": "beta*h"'),
        ('"B": "beta*h^2"', '"B": "1"'), ('"eta": "1"', '"eta": "h"'),
    ))  # fmt: skip
    yield from _changes(CORE / "scaling.py", "BESIDE_TABLE_2:", "#: Entries of Table 2 as", (
        "tests/test_formulation_theory.py", "-k", "scaling_of",
    ), (
        ('"beta*h/gamma"', '"beta*h"'), ('"Ca": "beta*h^2"', '"Ca": "h^2"'),
        ('"B": "beta*h^2"', '"B": "h^2"'), ('"eta": "1"', '"eta": "beta"'),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _begin_step", "def _norms_of", python, (
        ("extra.projector_values[e] * g", "g"), ("else work.rate[k]", "else 0"),
        ("half * (iterate.g_old[e] + v", "half * (v"),
        ("half * (work.r_old[e] + work.r", "half * (work.r"),
        ("mean_g * iterate.moving[1, i] +", "mean_g * iterate.moving[1, i] -"),
        ("+= values.g[e] * state", "-= values.g[e] * state"),
        ("value = s0 *", "value = -s0 *"), ("value += s1", "value -= s1"),
        ("value += s2", "value -= s2"), ("+= s2 * (g * acc", "-= s2 * (g * acc"),
        ("s0 * g + s1", "s0 * g - s1"), ("+ s2 * q", "- s2 * q"), ("s1 * g + two", "s1 * g - two"),
        ("two * s2 * r", "s2 * r"), ("s2 * extra.inertia * g", "s2 * g"),
        ("= -tables.left[1 + kept", "= tables.left[1 + kept"),
        ("extra.inertia * extra.eta[2]", "extra.eta[2]"),
        ("-= tables.left[0] * pushed", "+= tables.left[0] * pushed"),
        ("-= tables.left[1 + r] * extra", "+= tables.left[1 + r] * extra"),
        ("weights[0, k] * work.tan", "-weights[0, k] * work.tan"),
        ("tangent += weights[1, k]", "tangent -= weights[1, k]"),
        ("tangent += weights[2, k]", "tangent -= weights[2, k]"),
        ("+= factor * tangent", "-= factor * tangent"),
        ("entries[extra.g_places[e]] -= factor", "entries[extra.g_places[e]] += factor"),
        ("product = extra.penalty *", "product = -extra.penalty *"),
        ("of_dynamics * to_u * val", "-of_dynamics * to_u * val"),
        ("of_dynamics * to_v * val", "-of_dynamics * to_v * val"),
        ("of_dynamics * extra.inertia", "of_dynamics"),
        ("of_dynamics * extra.inertia", "-of_dynamics * extra.inertia"),
        ("right * extra.rows_eta", "-right * extra.rows_eta"),
        ("to_u * work.tangents[kind, 0, e] +", "to_u * work.tangents[kind, 0, e] -"),
        ("of_row * tangent", "-of_row * tangent"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _norms_of_blocks", "# -- at the end", python, (
        ("change += tables.weights", "change -= tables.weights"),
        ("change += extra.eta[f]", "change -= extra.eta[f]"),
        ("multipliers[k] += tables", "multipliers[k] -= tables"),
        ("work.eta[k] += tables.right[p + 1]", "work.eta[k] -= tables.right[p + 1]"),
        ("moving[f, i] += extra.eta[f]", "moving[f, i] -= extra.eta[f]"),
        ("= -misfit[k]", "= misfit[k]"),
        ("problem.mass_values[e] / extra", "-problem.mass_values[e] / extra"),
        ("work.matrix[i, k] -= g", "work.matrix[i, k] += g"),
        ("work.matrix[k, i] += g", "work.matrix[k, i] -= g"),
        ("work.rhs[i] /= extra.unit", "work.rhs[i] *= extra.unit"),
        ("work.rhs[n + k] *= extra", "work.rhs[n + k] /= extra"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "            else:\n                if extra.penalty",
        "    return COMPLETED", python, (
        ("multipliers[k] - extra.penalty", "multipliers[k] + extra.penalty"),
        ("-extra.penalty * phi", "extra.penalty * phi"),
        ("/ tables.right[p]) ** 2", "* tables.right[p]) ** 2"),
        ("moving[0, i] += work.rhs", "moving[0, i] -= work.rhs"),
        ("moving[1, i] += work.rhs", "moving[1, i] -= work.rhs"),
        ("work.rhs[n + k] = -curv", "work.rhs[n + k] = curv"),
        ("accelerations[i] += diff", "accelerations[i] -= diff"),
        ("moving[2, i] += difference", "moving[2, i] = work.rhs[i]"),
        ("state.impulse[k] = work", "state.impulse[k] = -work"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "before = number(", "_predict", python, (
        ("(first + s)", "(first + s + 1)"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _rate_of_constraints", "work.rate[k]", carried, (
        ("state.psi[k] if", "-state.psi[k] if"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "# G and Φ at the end", "past[field, i]", carried, (
        ("state.psi[k] = work.psi[k]", "pass"), ("r_old[e] = r[e]", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "record.multipliers[kept, k] +=", "COMPLETED", total, (
        ("+= state.impulse", "-= state.impulse"), ("/ extra.acting", "* extra.acting"),
    ))  # fmt: skip
    yield from _changes(CORE / "kernel.py", "def _take_norms", "def _solve_saddle", stopping, (
        ("settled < 2", "settled < 1"), (">= work.last", "> 2 * work.last"),
        ("if work.done[b] == 0", "if True"), ("work.last[b] = work.now[b]", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "class _Formulated", "def march", python, (
        ("0.5 * (self.carried.g + g)", "g"), ("0.5 * (self._r_old + found.r)", "found.r"),
        ("multipliers - constraining.penalty", "multipliers + constraining.penalty"),
        ("constraining.inertia * constraining.eta", "constraining.eta"),
        ("+ factor * push", "- factor * push"), ("+ found.curvature", "- found.curvature"),
        ("update = -self", "update = self"), ("constraining.eta[field] * pushed", "pushed"),
        ("self.eta += scheme", "self.eta -= scheme"),
        ("+= constraining.eta[field] * self", "-= constraining.eta[field] * self"),
        ("fields[0], -phi)", "fields[0], phi)"), ("wanted = -self", "wanted = self"),
        ("fields[3] += difference", "fields[3] -= difference"),
        ("moving[2] += difference", "moving[2] = implied"),
        ("return found.rate + along", "return along"), ("second = self", "second = -self"),
        ("pushed + algebra.product", "pushed - algebra.product"),
        ("moving[0] += change", "moving[0] -= change"),
        ("moving[1] += change", "moving[1] -= change"), ("[:] = impulse", "[:] = -impulse"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "def march", "def _limit", carried, (
        ("state.psi[:] = extra.rate(t, moving)", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "def _rate", "def linearised", carried, (
        ("self.state.psi + change", "change"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "if scheme.total", "COMPLETED", total, (
        ("+= state.impulse", "-= state.impulse"), ("/ scheme.acting", "* scheme.acting"),
    ))  # fmt: skip
    yield from _changes(CORE / "scipy_march.py", "def _take_norms", "def project", stopping, (
        ("settled >= 2", "settled >= 1"), (">= self._last", "> 2 * self._last"),
        ("|= found", "= found"), ("norms[~self._done] = found[~self._done]", "norms[:] = found"),
        ("self._last = found", "pass"),
    ))  # fmt: skip
    yield from _changes(CORE / "scheme.py", "def acting", "def formulated", total, (
        ("relations.v_from_a + of_past.sum()", "relations.v_from_a"),
    ))  # fmt: skip
    yield from _changes(CORE / "march.py", "def initial_state", "class Stretch", (
        "tests/test_formulations_accuracy.py", "-k", "velocities_miss and carries",
    ), (
        ("index_1.rate(problem.t0, problem.u0, v)", "psi"),
    ))  # fmt: skip
    yield from _changes(CORE / "march.py", "def multipliers", "def _recovered", march, (
        ("multipliers + self.state", "multipliers - self.state"),
    ))  # fmt: skip
    yield from _changes(CORE / "march.py", "def advance", "def _marched", (
        own, "-k", "same_bits",
    ), (("looks[k] * self.scheme", "begin * self.scheme"),))  # fmt: skip
    yield from _changes(Path("newmark_cli/problems/index_1.py"), "def accelerations", "def rate", (
        own, "-k", "reported",
    ), (("-curvature", "curvature"), ("solution[n:] * self._unit", "solution[n:]")))  # fmt: skip


def formulation_orders() -> Iterator[Mutation]:
    """Exponents that theory gives formulations: of J⁻¹, J, residuals, scalings, errors."""
    own = "tests/test_formulation_orders.py"
    derived = (own, "-k", "derived")
    file = CORE / "orders.py"
    blocks = (own, "-k", "test_blocks or test_corrections or fixed")
    text = (ROOT / file).read_text()
    begin, end = text.index("INVERSES: "), text.index("def min_plus")
    table, pattern = "", re.compile(r'"([\w-]+(?: \w+)?)": (?:_inverse|"([-\d ]+)")')
    seen = set()
    for match in pattern.finditer(text, begin, end):
        name, orders = match.groups()
        if orders is None:
            table = name
        elif (table, name) not in seen:
            # The first of each is that in general position; an entry of it, each row another.
            seen.add((table, name))
            entries = list(re.finditer(r"-?\d+", orders))
            entry = entries[len(seen) % len(entries)]
            yield Mutation(
                f"orders of J⁻¹, {table}, {name}, entry {len(seen) % len(entries)}: one more",
                file, match.start(2) + entry.start(), entry[0], str(int(entry[0]) + 1), blocks,
            )  # fmt: skip
    yield from _changes(file, "def form_orders", "def derive_scaling", blocks, (
        ("[-2.0, -1.0, 0.0]", "[-1.0, -1.0, 0.0]"), ("[-2.0, -1.0, 0.0]", "[-2.0, 0.0, 0.0]"),
        ("min(in_kept[-1], 0.0)", "in_kept[-1]"), ("np.array([0, _INF, _INF])", "np.zeros(3)"),
        ("np.array([0, 0, _INF])", "np.zeros(3)"), ("np.zeros(3)", "np.array([1, 0, 0])"),
        ("return -2.0 if", "return -1.0 if"), ("velocity = 1.0 if", "velocity = 0.0 if"),
        ("min(0.0, a) if compen", "1.0 if compen"),
        ("_penalty(formulation) + position)", "_penalty(formulation))"),
        ("rate = -1.0 if", "rate = 0.0 if"), ("2 * rate + position", "rate + position"),
    ))  # fmt: skip
    yield from _changes(file, "def form_orders", "def derive_scaling", (
        own, "-k", "test_blocks",
    ), (
        ("_RATE_ORDERS, _INF)\n        weights", "0, _INF)\n        weights"),
        ("else min(0.0, v)\n", "else 0.0\n"),
    ))  # fmt: skip
    yield from _changes(file, "def _reaction", "def condition", blocks, (
        ("self.penalty + self", "self"), ("0.0 if self.differenced", "1.0 if self.differenced"),
    ))  # fmt: skip
    yield from _changes(file, "# −r in shrink", "anchored_left", derived, (
        ("-_RATE_ORDERS", "_RATE_ORDERS"),
    ))  # fmt: skip
    yield from _changes(CORE / "scaling.py", "def sensitivity", "def _check", derived, (
        ("w_a, w_a, ONE), strict", "w_a, w_a, w_a), strict"), ('"Cv": w_v**-1', '"Cv": w_v'),
        ('"Ca": w_a**-1', '"Ca": w_v**-1'), ('"B": w_a**-1', '"B": ONE'),
    ))  # fmt: skip
    yield from _changes(CORE / "scaling.py", '"partial": Variant', "PAPER_VARIANTS", (
        own, "-k", "partial",
    ), (('{"D": "h"}', '{"D": "h^2"}'), ('"1/h"', '"1"')))  # fmt: skip
    yield from _changes(CORE / "truncation.py", "def order", "return ROUNDING if exact", (
        "tests/test_formulation_theory.py", "-k",
        "multipliers or reduced or test_augmented or (test_drift and not judged) or rate_of",
    ), (
        ('!= "penalty"', '== "penalty"'), ("and not self.integrator.damped", ""),
        ("and not self.projection.level\n", "\n"), ("self.start == CORRECTED and", ""),
        ("and self.integrator == Newmark()", ""), ("and self.compensated", ""),
        ("if self.projection.accelerations or", "if"), ("if not self.by_position", "if False"),
        ("return 1.0", "return 2.0"), ("if self.integrator.damped else UNKNOWN", ""),
        ('or "C" in rows', ""), ("or self.projection.level == 2", ""), ("order + 1.0", "order"),
        ('"Cv" in rows or', ""), ("UNKNOWN if self.alternates else", ""),
        ('("Ca",) and not self.projection.level', '("Ca",)'),
    ))  # fmt: skip


def _changes(
    file: Path, start: str, stop: str, tests: tuple[str, ...], changes: Changes
) -> Iterator[Mutation]:
    """Each change at its first place after ``start``, before ``stop``."""
    text = (ROOT / file).read_text()
    begin = text.index(start)
    for old, new in changes:
        position = text.index(old, begin, text.index(stop, begin))
        label = f"{file.name}, {start.strip()}: {old.strip()} → {new.strip()}"
        yield Mutation(label, file, position, old, new, tests)


def passes(tests: tuple[str, ...], copy: Path) -> bool:
    """Whether the tests pass in the copy as it is."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider", *tests],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        timeout=900,
    )
    return done.returncode == 0


def notices(mutation: Mutation, copy: Path) -> bool:
    """Whether the tests fail with the mutation in place."""
    target = copy / mutation.file
    original = target.read_text()
    end = mutation.position + len(mutation.old)
    assert original[mutation.position : end] == mutation.old
    mutated = original[: mutation.position] + mutation.new + original[end:]
    # A syntax error would be noticed by any test.
    compile(mutated, mutation.file, "exec")
    target.write_text(mutated)
    try:
        return not passes(mutation.tests, copy)
    finally:
        target.write_text(original)


def everything() -> tuple[Mutation, ...]:
    """All mutations; raises ValueError where one does not find its place."""
    return (
        *table_2(),
        *weights(),
        *signs(),
        *integrators(),
        *static(),
        *straight(),
        *known_exchanges(),
        *increments(),
        *rows(),
        *formulations(),
        *formulation_orders(),
    )


def main() -> None:
    """Try all mutations, print a line for each, exit with 1 when one survives."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="only mutations whose name has this text")
    options = parser.parse_args()
    chosen = [m for m in everything() if options.only in m.name]
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".*", "__pycache__", "results", "build")
        )
        for tests in dict.fromkeys(mutation.tests for mutation in chosen):
            if not passes(tests, copy):
                sys.exit(f"{' '.join(tests)} fails without any mutation")
        for number, mutation in enumerate(chosen, start=1):
            noticed = notices(mutation, copy)
            print(f"{number:3} {'noticed ' if noticed else 'SURVIVED'} {mutation.name}", flush=True)
            if not noticed:
                survivors.append(mutation.name)
    print(f"{len(chosen)} mutations, {len(survivors)} survived")
    sys.exit(1 if survivors else 0)


if __name__ == "__main__":
    main()
