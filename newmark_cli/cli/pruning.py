"""The command that removes cached cells that no study needs."""

from pathlib import Path

import click

from newmark_cli.cli import screen
from newmark_cli.cli.options import allow_code_option, complete_config, results_folder


@click.command()
@click.argument("configs", nargs=-1, metavar="[CONFIG]...", shell_complete=complete_config)
@results_folder
@click.option("--dry-run", is_flag=True, help="Report what would be removed; remove nothing.")
@allow_code_option
def prune(configs: tuple[str, ...], folder: Path, dry_run: bool, allow_code: bool) -> int:
    """Remove cached cells that no study needs.

    Keeps the cells in DIR/cells that a CSV in DIR was made from, and those of
    unfinished studies.  For each CONFIG, keeps the cells that it needs now instead of
    those of its CSV.  Also removes damaged cells, cells of another version of the
    numerical core that no CSV was made from, and old temporary files of killed runs.
    Never touches CSVs or figures.

    \b
    Example:
      newmark-study prune --dry-run
    """
    from rich.filesize import decimal

    from newmark_cli.running import prune as pruning

    studies = []
    if configs:
        from newmark_cli.study import config

        studies = [config.find(name, allow_code) for name in configs]
    pruned = pruning.prune(folder, studies, dry_run)
    verb = "would remove" if dry_run else "removed"
    for removed in pruned.removed:
        count = len(removed.files)
        kind = removed.kind.format(s="s" * (count != 1))
        screen.line(f"{verb} {count} {kind} ({decimal(removed.size)})")
    if not pruned.removed:
        screen.line("nothing to remove")
    cells = "1 cell stays" if pruned.stay == 1 else f"{pruned.stay} cells stay"
    screen.line(f"{cells} ({decimal(pruned.size)})")
    if pruned.outdated:
        are = "is" if pruned.outdated == 1 else "are"
        screen.line(
            f"{pruned.outdated} of them {are} of another numerical core: run their studies again "
            "and prune again, or name their configs"
        )
    if pruned.unfinished:
        screen.line(f"not finished, so that their cells stay: {', '.join(pruned.unfinished)}")
    return 0
