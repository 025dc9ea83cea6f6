"""Linear solvers: which there are, and what each does with a scheme's matrix.

`assembly` decides the terms of D_L J D_R, weight × source → place; `choice` names the solvers, and
`solvers` makes one.  `dense`, `sparse` and `krylov` solve; `ordering` finds orders without row
exchanges, in which `written` eliminates.
"""
