"""Figures for LaTeX: PGF, written without LaTeX.

matplotlib has LaTeX measure every text.  Here a figure is laid out already when it is written,
by the font of the other formats, so that LaTeX is needed by the document alone.
"""

import io
import re
from typing import Any
from unittest.mock import patch

from matplotlib.backends import backend_pgf
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure

from newmark_cli.report.judging.text import latex_text

#: Signs of labels that no font of LaTeX has in text.
_SIGNS = {
    "−": "-", "±": r"\pm", "·": r"\cdot", "×": r"\times", "‖": r"\|", "∞": r"\infty", "≤": r"\le",
    "≥": r"\ge", "→": r"\to", "∂": r"\partial", "…": r"\ldots", "ᵀ": r"^T", "ϕ": r"\phi",
}  # fmt: skip
_GREEK = (
    r"\alpha \beta \gamma \delta \epsilon \zeta \eta \theta \iota \kappa \lambda \mu \nu \xi \pi "
    r"\rho \sigma \tau \upsilon \phi \chi \psi \omega \Gamma \Delta \Theta \Lambda \Xi \Pi \Sigma "
    r"\Upsilon \Phi \Psi \Omega"
)
# Other Greek letters are no commands of LaTeX.
_SIGNS |= zip("αβγδεζηθικλμνξπρστυφχψωΓΔΘΛΞΠΣΥΦΨΩ", _GREEK.split(), strict=True)
_SMALL = str.maketrans("⁻⁺·⁰¹²³⁴⁵⁶⁷⁸⁹", "-+.0123456789")
_SUPERSCRIPT = re.compile("[⁻⁺⁰¹²³⁴⁵⁶⁷⁸⁹][⁻⁺·⁰¹²³⁴⁵⁶⁷⁸⁹]*")
#: A letter, which is no sign of LaTeX, and a bar above it.
_BARRED = re.compile(f"([A-Za-z{''.join(_SIGNS)}])\u0304")


def latex(label: str) -> str:
    """A label as LaTeX prints it: what stands between dollar signs is mathematics.

    A dollar sign with a backslash is one of a text.
    """
    parts = re.split(r"(?<!\\)\$([^$]*)(?<!\\)\$", label)
    return "".join(
        f"${part}$" if i % 2 else _text(part.replace(r"\$", "$")) for i, part in enumerate(parts)
    )


def _text(text: str) -> str:
    tex = latex_text(text)
    tex = _SUPERSCRIPT.sub(lambda m: rf"\ensuremath{{^{{{m[0].translate(_SMALL)}}}}}", tex)
    tex = _BARRED.sub(lambda m: rf"\ensuremath{{\bar {_sign(m[1])}}}", tex)
    return "".join(
        letter if letter.isascii() or not _sign(letter) else rf"\ensuremath{{{_sign(letter)}}}"
        for letter in tex
    )


def _sign(letter: str) -> str:
    """A letter as a math symbol; empty for a letter of text."""
    return _SIGNS.get(letter, letter if letter.isascii() else "")


class _Renderer(backend_pgf.RendererPgf):
    """matplotlib's renderer, with texts measured and written without LaTeX."""

    def get_text_width_height_descent(self, s: str, prop: Any, ismath: Any) -> Any:
        """Of the font of the other formats."""
        other: Any = RendererAgg
        return other(1, 1, self.dpi).get_text_width_height_descent(s, prop, ismath)

    def draw_text(
        self, gc: Any, x: Any, y: Any, s: str, prop: Any, angle: Any, ismath: Any = False,
        mtext: Any = None,
    ) -> None:  # fmt: skip
        """Write a line, as LaTeX prints it; of one without mathematics every sign is text."""
        draw: Any = super().draw_text
        draw(gc, x, y, latex(s) if ismath else _text(s), prop, angle, ismath, mtext)


def written(figure: Figure) -> bytes:
    """The file, which a document with the package pgf inputs."""
    content = io.StringIO()
    with patch.object(backend_pgf, "RendererPgf", _Renderer):
        figure.savefig(content, format="pgf")
    return content.getvalue().encode()
