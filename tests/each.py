"""Many cheap cases as one test, where a test of its own for each would cost more than it does."""

import functools
import inspect


def named(value):
    """What a value is called in the name of its case."""
    name = getattr(value, "label", None) or getattr(value, "name", None)
    return str(name or getattr(value, "__name__", value))


def each(names, cases):
    """Like `pytest.mark.parametrize`, but one test: it tries every case.

    Those that fail are told together, each by its name and with what failed in it.  Not for
    tests that take a fixture which must be fresh for every case.

    Args:
        names: Of the arguments, as `pytest.mark.parametrize` takes them.
        cases: A value of the argument each, or a tuple with a value of every one.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else [*names]
    cases = [case if len(names) > 1 else (case,) for case in cases]
    assert cases, "without a case nothing would be tested"

    def decorated(function):
        @functools.wraps(function)
        def test(**given):
            failures = []
            for case in cases:
                try:
                    function(**given, **dict(zip(names, case, strict=True)))
                except Exception as error:
                    error.add_note(f"case {'-'.join(map(named, case))}")
                    failures.append(error)
            if failures:
                told = "; ".join(error.__notes__[-1] for error in failures)
                raise ExceptionGroup(f"{len(failures)} of {len(cases)}: {told}", failures)

        signature = inspect.signature(function)
        left = [one for name, one in signature.parameters.items() if name not in names]
        assert len(left) == len(signature.parameters) - len(names), "names are arguments"
        test.__signature__ = signature.replace(parameters=left)
        return test

    return decorated
