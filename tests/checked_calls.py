"""Checks of annotations that are not repeated: within a test, a call like an earlier one is not checked again.

Calls are alike if their arguments have the same types and shapes. Checking each call takes longer than many networks
of the tests.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any

import jaxtyping

_jaxtyped = jaxtyping.jaxtyped
_seen: set[tuple[Any, ...]] = set()
forget_calls = _seen.clear


def jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    """Decorator of functions and dataclasses, in place of `jaxtyping.jaxtyped`."""

    def decorated(target: Any) -> Any:
        if not inspect.isclass(target):
            return _once(target, _jaxtyped(target, typechecker=typechecker))
        unchecked = target.__init__
        if (checked := _jaxtyped(target, typechecker=typechecker).__init__) is not unchecked:
            target.__init__ = _once(unchecked, checked)
        return target

    return decorated


def _once(function: Callable[..., Any], checked: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        kinds = (function, *map(_kind, arguments), *((name, _kind(value)) for name, value in options.items()))
        if kinds in _seen:
            return function(*arguments, **options)
        found = checked(*arguments, **options)
        _seen.add(kinds)
        return found

    return call


def _kind(value: Any) -> Any:
    """What a check depends on: the type; of arrays the shape and numbers too, of lists their items."""
    kind = type(value)
    if kind.__name__ in ("Tensor", "Parameter", "ndarray"):
        return kind, value.shape, value.dtype
    if kind in (list, tuple):
        return kind, *map(_kind, value)
    return (kind, value) if kind in (str, bool) else kind
