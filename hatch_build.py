"""Build hook: stamps the commit into wheels and sdists, for the provenance of results."""

import json
import runpy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface):
    """Adds the commit as a file of the package; the source tree stays as it is."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Stamp what git says, or what the sdist says that is built from.

        An editable installation runs from the checkout and asks git itself.
        """
        package = Path(self.root, "newmark_cli")
        checkout = runpy.run_path(str(package / "study/checkout.py"))
        source = checkout["asked"](package) or checkout["stamped"](package)
        if version == "editable" or source is None:
            return
        self._folder = TemporaryDirectory()
        stamp = Path(self._folder.name, checkout["STAMP"])
        stamp.write_text(json.dumps(source) + "\n", encoding="utf-8")
        build_data.setdefault("force_include", {})[str(stamp)] = f"newmark_cli/{stamp.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the file that was included."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
