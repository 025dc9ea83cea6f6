"""The numerical core: what a scheme is, how it marches, and what theory says of it.

It knows no file, no command, and no problem by name.  To read it, begin with what is decided
before a march:

- `forms`, `integrator`, `formulation`, `scaling`: the paper's choices, each a registry;
  `monomial` and `steps` read factors and step sizes from text;
- `scheme`: all of these at one step size, as numbers;
- `constraints`, `jacobian`, `linear`: constraint rows, J̄ in double precision, and solvers.

Then the march itself:

- `march`: one march that can be observed; cells, drawings and the library take it;
- `engine` hands a problem and a scheme to the `kernel` as `march_data`; the kernel calls
  what is not compiled through `callbacks`;
- `carrying` changes the step size, `gaps` watches rows that were released, `kept` and `trajectory`
  hold what is passed, `newton_systems` the systems that were solved.

Theory and measures need a scheme or a march, and nothing needs them here:

- `orders`, `truncation`, `balance`: orders in h, of errors too, and condition numbers;
- `floor`, `noise`, `twins`, `perturbation`: rounding, as it is measured;
- `invariants`, `statistics`, `operations`: what must stay, what a cell reports, and work.
"""
