"""Problems: what the core asks of them, and those that are no mechanisms.

- `problem`: the contract, M v' = f + Gλ, u' = v, 0 = Φ, and the tables that a march reads;
- `python_problem`: a problem in Python, compiled or plain, and forces on mechanisms,
  `differences` for derivatives that are not given, `agreement` for those that are, and `user_code`
  for the file that they stand in; `linear`: a problem from its matrices;
- `index_1`, `residual_form`: the equations in other forms; `starting`, `multipliers`: starts and λ;
- `reference`: what errors are measured against, by `dormand_prince`, up to a position that is
  `singular`; `redundancy`: constraints that depend on each other;
- `algebra`: dense linear algebra with the same bits on every processor.
"""
