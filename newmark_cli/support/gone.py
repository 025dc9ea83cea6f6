"""Names that earlier versions had, each with what to do instead, as errors say it."""

#: Commands.
COMMANDS = {
    "export": "newmark_cli.linear_systems gives the systems and scipy.io.mmwrite writes them, see "
    "docs/linear-systems.md",
}
