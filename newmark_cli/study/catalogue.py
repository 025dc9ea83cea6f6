"""All that a config can name, each with one line of text.

Nothing is built or compiled: of mechanisms and configs only the files are read.
"""

from newmark_cli.mechanisms import registry
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.newmark.forms import FORMS, Form
from newmark_cli.newmark.formulation import METHODS, PROJECTIONS, REPORTED, STARTS
from newmark_cli.newmark.integrator import INTEGRATORS
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.study import shipped
from newmark_cli.study.measures import MEASURES
from newmark_cli.support import documents


def sections() -> dict[str, dict[str, str]]:
    """Section → name → what it is, in one line."""
    return {
        "problems": {name: _problem(name) for name in registry.PROBLEMS},
        "families of problems": {
            name: f"{family.title}; size: {', '.join(family.parameters)}; {family.counts}"
            for name, family in FAMILIES.items()
        },
        "forms": {name: _form(form) for name, form in FORMS.items()},
        "integrators": {name: kind.description for name, kind in INTEGRATORS.items()},
        "preconditioning": {name: variant.description for name, variant in VARIANTS.items()},
        "formulations": {name: method.description for name, method in METHODS.items()},
        "projections": dict(PROJECTIONS),
        "multipliers": dict(REPORTED),
        "starts": dict(STARTS),
        "measures": {name: measure.about.replace("`", "") for name, measure in MEASURES.items()},
        "configs": {
            name: str(config.get("description", "")) for name, config in shipped.configs().items()
        },
    }


def _problem(name: str) -> str:
    data = documents.read(registry.file(name)).data
    n, m = registry.size(data)
    return f"{data['title']}: {data['description']}; n = {n}, m = {m}"


def _form(form: Form) -> str:
    unknowns = ", ".join(form.unknowns).replace("lambda", "λ")
    text = f"unknowns {unknowns}; rows {', '.join(form.rows)}"
    if form.eliminated:
        text += f"; {' and '.join(form.eliminated)} eliminated"
    return text + ("" if form.in_paper else "; not in the paper")
