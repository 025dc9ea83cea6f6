"""What the files of runs say: the table of docs/comparison.md, and two figures."""

import math
import re
from importlib import metadata

import common
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import newmark_cli as newmark
from newmark_cli.problems import multipliers, reference

PAGE = common.HERE.parents[1] / "docs" / "comparison.md"
FIGURES = PAGE.parent / "figures"
BEGIN, END = "<!-- peers: begin -->", "<!-- peers: end -->"
QUANTITIES = {"u": "u", "v": "v", "lambda": "λ"}
TITLES = {
    "thrown-pendulum": "Thrown pendulum",
    "slider-crank": "Slider-crank",
    "andrews": "Andrews' mechanism",
    "heavy-top": "Heavy top",
}
#: What `advise` is asked for where it knows the method: end of the label → integrator, formulation.
ADVISED = {
    "generalized-α 0.9, index 3": ("generalized-alpha rho=0.9", "index-3"),
    "trapezoidal, index 3": ("newmark", "index-3"),
    "trapezoidal, index 2": ("newmark", "index-2"),
    "trapezoidal, index 2, tolerance 1e-13": ("newmark", "index-2"),
}
WRONG = (0.01, 1.0)
#: Ratio of two errors that have the same two digits.
TWO_DIGITS = 1.01
PACKAGES = ("exudyn", "scikit-sundae", "solve-dae", "scipy-dae", "mujoco", "openseespy")
AGREEMENT = """\
Step sizes (s) down to which errors of u, v and λ in Exudyn agree to two digits with those of this
package, and for each smaller one its error of λ over the nearest in the band of a march and its
three twins; 1 is inside:"""
HEADER = (
    "code and settings", "least error of u", "of v", "of λ", "λ 1 %, 100 % wrong below",
    "`advise`", "smallest tolerance", "beyond it",
)  # fmt: skip


def read(folder, name):
    """Runs of a problem in all codes, with columns for the errors of u, v and λ."""
    paths = sorted(folder.glob(f"*-{name}.csv"))
    if not paths:
        return pd.DataFrame()
    problem, t_end = common.load(name)
    frames = [pd.read_csv(path, dtype={"message": str}) for path in paths]
    runs = pd.concat(frames, ignore_index=True).reindex(columns=common.columns(problem))
    return measured(runs, problem, t_end)


def measured(runs, problem, t_end):
    """The same with errors as the measure `error` has them, of what a code gives."""
    at = reference.solution(problem, t_end)
    names = dict.fromkeys(("u", "v"), problem.coordinate_names)
    names["lambda"] = problem.constraint_names
    values = {"u": at.u, "v": at.v, "lambda": at.multipliers}
    scales = {"u": np.abs(at.u).max(), "v": np.abs(at.v).max(), "lambda": at.scales}
    errors = {}
    for quantity, each in names.items():
        found = runs[[f"{quantity}[{name}]" for name in each]].to_numpy(float)
        relative = np.abs(multipliers.relative(found - values[quantity], scales[quantity]))
        errors[quantity] = np.nanmax(np.where(np.isnan(found), -1.0, relative), axis=1)
    errors = pd.DataFrame(errors)
    return runs.assign(**errors.where(errors >= 0))


def crossed(steps, errors, limit):
    """Step size below which rounding makes an error larger than a limit.

    Between two step sizes it is interpolated in logarithms, from that of the least error down.

    Returns:
        NaN where the limit is not passed, infinity where it is at every step size.
    """
    steps, errors = np.asarray(steps, float), np.asarray(errors, float)
    kept = np.isfinite(errors)
    order = np.argsort(-steps[kept])
    h, e = steps[kept][order], errors[kept][order]
    if len(e) == 0 or e.min() > limit:
        return math.inf if len(e) else math.nan
    for k in range(int(np.argmin(e)) + 1, len(e)):
        if e[k] > limit:
            share = math.log(limit / e[k - 1]) / math.log(e[k] / e[k - 1])
            return float(h[k - 1] * (h[k] / h[k - 1]) ** share)
    return math.nan


def rows(runs, predicted):
    """Rows of the table, one for each series that is no twin."""
    shown = runs[~runs["series"].str.contains(", twin ")]
    return [row(label, each, predicted) for label, each in shown.groupby("series", sort=False)]


def row(label, runs, predicted):
    """One row: texts in the order of HEADER."""
    axis = "h" if runs["h"].notna().any() else "tolerance"
    least = [best(runs, axis, quantity) for quantity in QUANTITIES]
    tight = runs.sort_values(axis)
    ended = tight[tight["message"].isna()]
    if axis == "h":
        limits = [crossed(runs["h"], runs["lambda"], limit) for limit in WRONG]
        wrong = ", ".join(map(limit_text, limits)) if runs["lambda"].notna().any() else "–"
        return [label, *least, wrong, predicted(label), "–", beyond_step(tight)]
    smallest = f"{ended[axis].min():.0e}" if len(ended) else "none"
    return [label, *least, "–", "–", shorter(smallest), beyond_tolerance(tight)]


def best(runs, axis, quantity):
    """Least error and where it is."""
    if not runs[quantity].notna().any():
        return "–"
    at = runs.loc[runs[quantity].idxmin()]
    return shorter(f"{at[quantity]:.1e} at {at[axis]:.0e}")


def limit_text(limit):
    """A step size at which λ is wrong."""
    if math.isinf(limit):
        return "every h"
    return "none" if math.isnan(limit) else shorter(f"{limit:.1e}")


def beyond_step(tight):
    """What a code says at its smallest step sizes."""
    least = tight.iloc[0]
    if isinstance(least["message"], str):
        return quoted(least["message"])
    if least["lambda"] > WRONG[1]:
        return shorter(f"silence: λ wrong by {least['lambda']:.1e}")
    failed = tight["message"].dropna()
    return quoted(failed.iloc[0]) if len(failed) else "nothing"


def beyond_tolerance(tight):
    """What a code says at the largest tolerance that it does not meet."""
    failed = tight[tight["message"].notna()]
    return quoted(failed.iloc[-1]["message"]) if len(failed) else "nothing"


def quoted(message):
    """The first words of a message, without the numbers of one run."""
    words = re.split(r" at t = | t = |: /|: \[|: \w+/", message)[0].replace("|", "∣")
    return f"“{words[:70].strip(' .')}”"


def shorter(text):
    """1e-07 as 1e-7."""
    return re.sub(r"e([-+])0", lambda found: "e" + found[1].replace("+", ""), text)


def advice(name):
    """Label → what `advise` predicts for it, for codes that keep accelerations."""
    path, t_end = common.PROBLEMS[name]
    known = {}

    def predicted(label):
        _, _, method = label.partition(", ")
        if not label.startswith(("Exudyn", "newmark-study")) or method not in ADVISED:
            return "–"
        if method not in known:
            integrator, formulation = ADVISED[method]
            found = newmark.advise(
                str(path), h=[1e-4, 1e-6], form="a-lambda", integrator=integrator,
                formulation=formulation, t_end=t_end,
            ).noise  # fmt: skip
            known[method] = noise(found)
        return known[method]

    return predicted


def noise(found):
    """The step sizes of a `Noise`."""
    if not found.carried:
        return "–"
    limits = (found.carried[limit] for limit in WRONG)
    shown = {None: "every h", 0.0: "below 1e-9"}
    return ", ".join(shown.get(h) or shorter(f"{h:.1e}") for h in limits)


def table(name, runs):
    """The table of one problem in Markdown."""
    lines = [HEADER, ["---"] * len(HEADER), *rows(runs, advice(name))]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def agreement(every):
    """Where Exudyn has this package's errors, in Markdown: the truncation, and the rounding."""
    lines = [["problem and method", *QUANTITIES.values(), "λ below, over the band"], ["---"] * 5]
    for name, runs in every.items():
        for method in ADVISED:
            theirs = runs[runs["series"] == f"Exudyn, {method}"].sort_values("h", ascending=False)
            ours = f"newmark-study, {method.partition(', tol')[0]}"
            own = runs["series"].str.partition(", twin ")[0] == ours
            bands = runs[own].groupby("h")[[*QUANTITIES]].agg(["min", "max"])
            theirs = theirs[theirs["h"].isin(bands.index)].set_index("h")
            given = theirs.filter(like="lambda[").notna().all(axis=None)  # or others than ours
            if not theirs.empty and given:
                lines.append([f"{TITLES[name]}, {method}", *agreed(theirs, bands)])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def agreed(theirs, bands):
    """Step sizes down to which errors agree, and the ratios of λ below."""
    for quantity in QUANTITIES:
        low, high = (bands.loc[theirs.index, (quantity, end)] for end in ("min", "max"))
        ratio = (theirs[quantity] / theirs[quantity].clip(low, high)).to_numpy()
        same = int(np.argmax(np.append(np.abs(np.log(ratio)) > math.log(TWO_DIGITS), True)))
        yield shorter(f"{theirs.index[same - 1]:.0e}") if same else "–"
    yield ", ".join(f"{each:.2g}" for each in ratio[same:]) or "–"


def versions():
    """The codes that are installed, with versions."""
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            found.append(f"{package} (not installed)")
    return ", ".join(found)


def replaced(page, text):
    """A page with the text between its markers."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{text}\n{END}{after}"


def write(folder, head):
    """Write tables and figures of the files in a folder."""
    every = {name: read(folder, name) for name in TITLES}
    every = {name: runs for name, runs in every.items() if len(runs)}
    parts = [head]
    for name, runs in every.items():
        t_end = common.PROBLEMS[name][1]
        parts.append(f"**{TITLES[name]}**, errors at t = {t_end:g} s:\n\n{table(name, runs)}")
    parts.append(f"{AGREEMENT}\n\n{agreement(every)}")
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(page, "\n\n".join(parts)), encoding="utf-8")
    for axis, file in (("h", "peers-h.png"), ("tolerance", "peers-work.png")):
        drawn(every, axis).savefig(FIGURES / file, dpi=110)


def drawn(every, axis) -> Figure:
    """Error of λ over h, with bands of twins, or over counted calls."""
    across = min(len(every), 2)
    figure, panels = plt.subplots(
        -(-len(every) // 2),
        across,
        figsize=(5.5 * across, 9.5),
        layout="constrained",
        squeeze=False,
    )
    styles, codes = {}, {}
    for panel, (name, runs) in zip(panels.flat, every.items(), strict=False):
        runs = runs[runs[axis].notna() & runs["lambda"].notna()]
        for label, each in runs.groupby("series", sort=False):
            if ", twin " in label:
                continue
            code = label.partition(",")[0]
            codes.setdefault(code, [f"C{len(codes)}", 0])
            if label not in styles:
                styles[label] = codes[code][0], "osv^D*PX"[codes[code][1] % 8]
                codes[code][1] += 1
            style = styles[label]
            abscissa = each["h"] if axis == "h" else each["calls"]
            ours = label.startswith("newmark-study")
            panel.loglog(abscissa, each["lambda"], "--" if ours else "-", color=style[0],
                         marker=style[1], markersize=4, linewidth=1, label=label)  # fmt: skip
            if ours:
                of_it = runs["series"].str.partition(", twin ")[0] == label
                twins = runs[of_it].groupby("h")["lambda"]
                panel.fill_between(twins.min().index, twins.min(), twins.max(),
                                   color=style[0], alpha=0.2, linewidth=0)  # fmt: skip
        panel.set_title(TITLES[name], fontsize=10)
        panel.set_xlabel("h (s)" if axis == "h" else "evaluations of F")
        panel.set_ylabel("relative error of λ")
        panel.grid(alpha=0.3)
        panel.set_ylim(1e-15, 1e8 if axis == "h" else 1)
    shown = {t: h for p in panels.flat for h, t in zip(*p.get_legend_handles_labels(), strict=True)}
    figure.legend(shown.values(), shown, loc="outside lower center", ncols=3, fontsize=7)
    return figure
