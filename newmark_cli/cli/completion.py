"""Completion of arguments in shells, from names alone: nothing heavy is imported.

The names stand in ``names.json`` beside this file, as `newmark-study list --json`
prints them; a test holds the two together.
"""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from newmark_cli.support.errors import visible

Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def complete(*sections: str, files: bool = False) -> Completer:
    """Values that a parameter may have.

    Args:
        sections: Sections of `newmark-study list` whose names it may be.
        files: Whether it may be a YAML file.
    """

    def items(
        context: click.Context, parameter: click.Parameter, begun: str
    ) -> list[CompletionItem]:
        names = json.loads(Path(__file__).with_name("names.json").read_text(encoding="utf-8"))
        # A name of two sections is offered once, as what it is in the first.
        known: dict[str, str] = {}
        for section in sections:
            known = known | {n: text for n, text in names[section].items() if n not in known}
        found = [
            CompletionItem(name, help=text or None)
            for name, text in known.items()
            if name.startswith(begun)
        ]
        if files:
            found += map(CompletionItem, _yaml_files(begun))
            # None: the shell's own completion of files finds the way into folders.
            return found or [CompletionItem(begun, type="file")]
        return found

    return items


def _yaml_files(begun: str) -> Iterator[str]:
    """YAML files whose path begins so, hidden ones only when their dot is given."""
    folder, slash, start = begun.rpartition("/")
    try:
        entries = sorted(os.listdir(folder + slash or "."))
    except OSError:
        return
    for name in entries:
        hidden = name.startswith(".") and not start.startswith(".")
        # What a shell cannot be told in a line is left to its own completion of files.
        spoken = name == visible(name)
        if spoken and name.startswith(start) and name.endswith((".yaml", ".yml")) and not hidden:
            yield f"{folder}{slash}{name}"
