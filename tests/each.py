"""Many cheap cases as one test, where a test of its own for each would cost more than it does."""

import contextlib
import dataclasses
import functools
import inspect


def named(value):
    """What a value is called in the name of its case."""
    name = getattr(value, "label", None) or getattr(value, "name", None)
    return str(name or getattr(value, "__name__", value))


def each(names, cases):
    """Like `pytest.mark.parametrize`, but one test: it tries every case.

    Those that fail are told together, each by its name and with what failed in it.  Every
    case has a folder of its own, as ``tmp_path`` and as that of ``cli``, and what it does to
    ``monkeypatch`` is undone after it.  Not for tests that take another fixture which must be
    fresh for every case.

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
            for number, case in enumerate(cases):
                try:
                    with _fresh(given, f"case-{number}") as own:
                        function(**own, **dict(zip(names, case, strict=True)))
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


@contextlib.contextmanager
def _fresh(given, name):
    """The fixtures of a test, those that are fresh for every case replaced."""
    own = dict(given)
    with contextlib.ExitStack() as undone:
        if "tmp_path" in own:
            own["tmp_path"] = own["tmp_path"] / name
            own["tmp_path"].mkdir()
        if "cli" in own:
            folder = own["cli"].folder / name
            folder.mkdir(exist_ok="tmp_path" in own)
            own["cli"] = dataclasses.replace(own["cli"], folder=folder)
        if "monkeypatch" in own:
            own["monkeypatch"] = undone.enter_context(own["monkeypatch"].context())
        yield own
