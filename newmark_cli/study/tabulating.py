"""What tables of a study can be made of: axes, and values of series."""

from newmark_cli.study import drawing

#: Axes that rows and columns can stand for.
AXES = (*drawing.COMPARABLE, "measure")

#: What a table can say of a series → in words.
VALUES = {
    "predicted": "predicted order",
    "tolerance": "largest difference from it that passes",
    "fitted": "fitted slope ± standard error",
    "slope": "fitted slope",
    "stderr": "its standard error",
    "points": "how many step sizes the fit is for",
    "h_from": "largest step size of the fit",
    "h_to": "smallest step size of the fit",
    "local_orders": "orders between successive step sizes",
    "verdict": "whether it is as predicted",
    "reason": "why the verdict is not a plain pass",
}
