"""Completion of arguments in shells, from names alone: nothing heavy is imported.

The names stand in ``names.json`` beside this file, as `newmark-study list --json`
prints them; a test holds the two together.
"""

import glob
import json
from collections.abc import Callable
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from newmark_cli.support.errors import visible

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def complete(*sections: str, files: bool = False) -> Completer:
    """Values of a parameter: names of sections of `newmark-study list`, or YAML files."""

    def items(
        context: click.Context, parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        listed = json.loads(Path(__file__).with_name("names.json").read_text(encoding="utf-8"))
        # A name of two sections is offered once, as what it is in the first.
        known: dict[str, str] = {}
        for section in sections:
            known = known | {n: text for n, text in listed[section].items() if n not in known}
        matching = [
            CompletionItem(name, help=text or None)
            for name, text in known.items()
            if name.startswith(begun)
        ]
        if files:
            # What a shell cannot be told in a line is left to its own completion of files.
            names = sorted(glob.glob(glob.escape(begun) + "*"))
            yaml = (name for name in names if name.endswith((".yaml", ".yml")))
            matching += (CompletionItem(name) for name in yaml if name == visible(name))
            # None: the shell's own completion of files finds the way into folders.
            return matching or [CompletionItem(begun, type="file")]
        return matching

    return items
