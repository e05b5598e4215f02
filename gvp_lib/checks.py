"""Arguments held against their annotations, once, where they enter the library.

``@checked`` stands over what users call. It knows types alone; which numbers make sense, each function says itself,
where all that are finite do by ``finite``, and the fields of a class by ``check_fields``. A part that is of no class of
ours, such as a user's arm, is held against its protocol by ``check_part``.
"""

from __future__ import annotations

import builtins
import inspect
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from enum import Enum
from functools import cache, partial, wraps
from operator import index
from os import PathLike
from pathlib import Path
from reprlib import repr as brief
from types import FunctionType, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, overload

import numpy as np
from numpy.typing import ArrayLike

from gvp_lib.errors import GvpError, InvalidParameterError

__all__ = ["checked", "finite"]

_Call = TypeVar("_Call", bound=Callable[..., Any])
_LARGEST = 2**53  # of the whole numbers that every float and every size can be
_HUGE = 1e100  # a finite number beyond it is none of ours, and its square overflows
_Check = tuple[str, Callable[[Any], Any]]
"""What is expected, in words; and what gives the value as the library wants it, or raises."""


class _Names(dict[str, Any]):
    """Names in an annotation; a class that only a type checker imports is known by its name alone."""

    def __init__(self, function: Any) -> None:
        self._known = {**vars(builtins), **inspect.unwrap(function).__globals__}
        super().__init__(ArrayLike=_Numbers)

    def __missing__(self, name: str) -> Any:
        return self._known[name] if name in self._known else type(name, (_ByName,), {})


class _ByName:
    """Base of the classes that stand for such a one."""


class _Numbers:
    """Stands for ``ArrayLike``, whose own definition says neither what it is nor that numbers are meant."""


@overload
def checked(call: _Call) -> _Call: ...
@overload
def checked(*, poses: bool = False, own: bool | tuple[str, ...] = False) -> Callable[[_Call], _Call]: ...
def checked(call: Any = None, *, poses: bool = False, own: bool | tuple[str, ...] = False) -> Any:
    """Check arguments against their annotations: of a function, or of a class's constructor and public methods.

    What can mean only one thing is taken for it: a NumPy scalar for a number, a tensor for an array, a 4 x 4 matrix
    for a pose. Anything else is refused by the parameter's name.

    Parameters
    ----------
    call
        Function or class.
    poses
        Whether a pose may be several.
    own
        Whether what is called may refuse its arguments in its own words, which know more. It is then called in any
        case, so that it must change nothing, as what constructs an object does not. Of one that changes something, the
        names of the parameters that it checks itself.

    Examples
    --------
    >>> @checked
    ... def half(length: float) -> float:
    ...     return length / 2
    >>> half("abc")
    Traceback (most recent call last):
        ...
    gvp_lib.errors.InvalidParameterError: half: length is a number below 1e100; got a str, 'abc'
    """
    if call is None:
        return partial(checked, poses=poses, own=own)
    if not isinstance(call, type):
        return _wrapped(call, call.__qualname__, own, poses)
    for name, method in [*vars(call).items()]:
        if name in ("__init__", "__call__") or not name.startswith("_"):
            title = call.__name__ if name == "__init__" else f"{call.__name__}.{name}"
            if isinstance(method, FunctionType):
                setattr(call, name, _wrapped(method, title, own or name == "__init__"))
            elif isinstance(method, classmethod):
                setattr(call, name, classmethod(_wrapped(method.__func__, title, True)))
    return call


def finite(shape: tuple[int, ...] | None = None, /, **given: ArrayLike) -> None:
    """Refuse numbers that are not finite or, where a shape is given, have another.

    Parameters
    ----------
    shape
        Shape of each.
    **given
        Numbers by their names.

    Examples
    --------
    >>> finite((3,), eye=[0, 0, 1], target=[0, 0])
    Traceback (most recent call last):
        ...
    gvp_lib.errors.InvalidParameterError: target is finite, of shape (3,); got [0, 0]
    """
    for name, value in given.items():
        array = np.asarray(value, float)
        if not np.isfinite(array).all() or (shape is not None and array.shape != shape):
            expected = "finite" if shape is None else f"finite, of shape {shape}"
            raise InvalidParameterError(f"{name} is {expected}; got {brief(value)}")


def check_fields(
    owner: object, positive: Mapping[str, str], **others: tuple[bool | Callable[[Any], object], str]
) -> None:
    """Refuse the first field that isn't right: positive, in its unit, or (whether it is right, what it should be).

    Whether it is right may be a function of the field; what that cannot even look at is not right.
    """
    units = {name: (lambda x: 0 < x < np.inf, f"positive and finite, {unit}") for name, unit in positive.items()}
    for name, (right, expected) in {**units, **others}.items():
        value = getattr(owner, name)
        if not (is_right(right, value) if callable(right) else right):
            raise InvalidParameterError(f"{type(owner).__name__}.{name} is {expected}; got {value!r}")


def is_right(test: Callable[[Any], object], value: object) -> bool:
    """Whether a value passes a test; what that cannot even look at does not."""
    try:
        return bool(test(value))
    except (TypeError, ValueError, RuntimeError):  # no number; an array of several, NumPy's or torch's
        return False


def takes_a_picture(value: object) -> bool:
    """Whether something can be called with a picture."""
    return not isinstance(value, type) and _takes(value, "rgb")


A_SEGMENTER = takes_a_picture, "called with an RGB image and returns a mask, such as HsvThreshold(hue=(345, 15))"
"""How :func:`check_fields` checks one."""


def lacking(part: object, protocol: type) -> str:
    """What keeps a part from being what a protocol describes: a class for an object, a member missing; else empty."""
    if isinstance(part, type):
        return "it is a class, where one of its objects is meant"
    for name, member in vars(protocol).items():
        if name.startswith("_"):
            continue
        if not hasattr(part, name):
            return f"it has no {name}"
        wanted = list(inspect.signature(member).parameters)[1:] if isinstance(member, FunctionType) else []
        if isinstance(member, FunctionType) and not _takes(getattr(part, name), *wanted):
            return f"its {name} cannot be called as {name}({', '.join(wanted)})"
    return ""


def check_part(what: str, part: object, protocol: type, example: str) -> None:
    """Refuse a part that isn't what a protocol describes."""
    if trouble := lacking(part, protocol):
        raise InvalidParameterError(
            f"{what} has all that {protocol.__name__} has, as {example} does; got {part!r}: {trouble}"
        )


def _takes(function: Any, *arguments: str) -> bool:
    """Whether something can be called with these arguments, in this order."""
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        return False
    except ValueError:  # some that are written in C do not tell
        return callable(function)
    return True


def _wrapped(function: Any, title: str, own: bool | tuple[str, ...], poses: bool = False) -> Any:
    itself = own if isinstance(own, tuple) else ()

    @cache  # at the first call, when every name in the annotations is there
    def checks() -> dict[str, _Check | None]:
        several = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
        return {
            each.name: None
            if each.kind in several or each.name in itself
            else _check_of(each.name, each.annotation, function, poses)
            for each in inspect.signature(function).parameters.values()
        }

    @wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        """Check what is given, and call."""
        parameters = checks()
        refused: list[GvpError] = []

        def check(name: str, value: Any) -> Any:
            """The value as its parameter wants it; what is wrong with it is kept."""
            expected, convert = parameters.get(name) or ("", None)
            try:
                return convert(value) if convert else value
            except GvpError as error:
                refused.append(error)
            except Exception:  # whatever a foreign object does when it is looked at
                given = f"{_an(type(value).__name__)}, {brief(value)}"
                refused.append(InvalidParameterError(f"{title}: {name} is {expected}; got {given}"))
            return value

        rest = args[len(parameters) :]
        args = (*(check(name, value) for name, value in zip(parameters, args, strict=False)), *rest)
        kwargs = {name: check(name, value) for name, value in kwargs.items()}
        if not refused:
            return function(*args, **kwargs)
        if own is True:
            try:
                function(*args, **kwargs)
            except GvpError:
                raise
            except Exception:
                pass
        raise refused[0]

    return wrapper


def _check_of(name: str, annotation: Any, function: Any, poses: bool) -> _Check | None:
    """How a parameter is checked; None where anything goes."""
    if isinstance(annotation, str):
        try:
            annotation = eval(annotation, {}, _Names(function))
        except (AttributeError, TypeError):  # of a package that only a type checker imports
            return None
    seed = name == "seed" or np.random.Generator in get_args(annotation)
    return _expected(annotation, seed, poses)


def _expected(kind: Any, seed: bool = False, poses: bool = False) -> _Check | None:
    origin, inside = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        poses = poses or _Numbers in inside
        return _either([_expected(each, seed, poses) for each in inside if each is not str or Path not in inside])
    if origin is Literal:
        return _either([_expected(each) for each in {type(each) for each in inside}])
    if kind in (None, NoneType):
        return "None", lambda value: _kept(value, value is None)
    if kind is int and seed:
        return "a whole number, 0 or more", lambda value: _whole(value, 0, np.inf)
    if kind is int:
        return "a whole number", _whole
    if kind in _SCALARS:
        return _SCALARS[kind]
    if kind is _Numbers:
        return "numbers, in an array or in lists", _numbers
    if origin is np.ndarray:
        dtype: Any = get_args(inside[1])[0] if get_args(inside[1]) else None
        if dtype not in (np.float64, np.int64):
            return None  # pictures and masks have checks of their own
        kinds = "iuf" if dtype is np.float64 else "iu"
        return "an array of numbers", lambda value: _array(value, kinds).astype(dtype, copy=False)
    if origin is tuple:
        return _tuple(inside)
    if origin in (Sequence, Iterable, list):
        return _sequence(origin, _expected(inside[0]))
    if isinstance(kind, TypeVar) or kind in (Any, object, inspect.Parameter.empty):
        return None
    kind = origin or kind
    if kind is Callable or getattr(kind, "_is_protocol", False):
        # Methods alone: to look for a property is to read it, which may cost a real arm a motion's time.
        methods = [name for name, value in vars(kind).items() if isinstance(value, FunctionType) and name[0] != "_"]
        words = f"an object with {', '.join(f'{name}()' for name in methods)}"
        if not methods:
            methods, words = ["__call__"], (inspect.getdoc(kind) or "something to call").split(".")[0]
        return f"{_an(kind.__name__)} ({words})", lambda value: _kept(
            value, not isinstance(value, type) and all(callable(getattr(value, name, None)) for name in methods)
        )
    if kind.__name__ == "RigidTransform":
        count = "finite poses" if poses else "one finite pose"
        return f"{count} (a RigidTransform, in m, or a matrix of shape (4, 4))", lambda value: _pose(value, poses)
    if issubclass(kind, Enum):
        return f"{_an(kind.__name__)}, such as {next(iter(kind))}", kind
    if kind is Hashable:
        return "something that can be hashed", lambda value: _kept(value, isinstance(hash(value), int))
    if issubclass(kind, _ByName):
        return _an(kind.__name__), lambda value: _kept(
            value, kind.__name__ in [each.__name__ for each in type(value).__mro__]
        )
    return _an(kind.__name__), lambda value: _kept(value, isinstance(value, kind))


def _an(name: str) -> str:
    return f"an {name}" if name[0] in "AEIOUaeiou" else f"a {name}"


def _either(checks: list[_Check | None]) -> _Check | None:
    known = [check for check in checks if check is not None]
    if len(known) < len(checks):
        return None

    def convert(value: Any) -> Any:
        for _, attempt in known:
            try:
                return attempt(value)
            except Exception as error:
                last = error
        raise last

    return " or ".join(words for words, _ in known), convert


def _kept(value: Any, right: bool) -> Any:
    if not right:
        raise TypeError
    return value


def _number(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        number = value if abs(value) <= _LARGEST else float(value)  # as NumPy would not
        return _kept(number, not _HUGE < abs(number) < np.inf)
    dtype = getattr(value, "dtype", None)
    odd = isinstance(value, bool | str | bytes) or (isinstance(dtype, np.dtype) and dtype.kind not in "iuf")
    return float(_kept(value, not odd and not np.ndim(value)))


def _whole(value: Any, low: int = -_LARGEST, high: float = _LARGEST) -> int:
    if isinstance(value, float | np.floating) and value == int(value):
        value = int(value)
    whole: int = value if isinstance(value, int) else index(value)
    _kept(value, not isinstance(value, bool | np.bool_) and low <= whole <= high)
    return whole


def _flag(value: Any) -> bool:
    return bool(_kept(value, isinstance(value, bool | np.bool_) or (isinstance(value, int) and value in (0, 1))))


def _path(value: Any) -> Any:
    return _kept(value, isinstance(value, str | PathLike) and bool(str(value)) and "\0" not in str(value))


def _array(value: Any, kinds: str = "iuf") -> Any:
    array = np.asarray(value)
    _kept(array, array.dtype.kind in kinds and (type(value) is np.ndarray or not np.ma.is_masked(value)))
    wide = array.dtype.kind == "f" and array.dtype.itemsize > 4
    return _kept(array, not (wide and _HUGE < np.abs(array).max(initial=0) < np.inf))


def _numbers(value: Any) -> Any:
    array = _array(_kept(value, not isinstance(value, bool)), "biuf")
    # Lists stay lists, since some are kept as they were given.
    if isinstance(value, list | tuple | int | float):
        return value
    return array if array.flags.writeable else array.copy()  # SciPy's rotations want to be able to write


def _pose(value: Any, several: bool) -> Any:
    from scipy.spatial.transform import RigidTransform

    pose, matrix = value, None
    if isinstance(value, list | tuple) and value and all(isinstance(each, RigidTransform) for each in value):
        pose = RigidTransform.concatenate(value)
    elif not isinstance(value, RigidTransform):
        matrix = _array(value).astype(float)
        pose = RigidTransform.from_matrix(matrix)  # the nearest pose, also for a matrix that is none
    found = pose.as_matrix()
    _kept(pose, matrix is None or np.allclose(found, matrix, atol=1e-5))
    return _kept(pose, (several or pose.single) and np.isfinite(found).all())


def _tuple(kinds: tuple[Any, ...]) -> _Check:
    n = None if kinds[-1] is ... else len(kinds)
    checks = [_expected(kind) for kind in kinds if kind is not ...]
    words = next((check[0] for check in checks if check), "a value")

    def convert(value: Any) -> tuple[Any, ...]:
        """A tuple of it, each part checked."""
        given = value.tolist() if hasattr(value, "tolist") else value
        alone = n is None and isinstance(kinds[0], type) and kinds[0] not in _SCALARS
        if alone and not isinstance(given, list | tuple):
            given = [given]
        _kept(given, isinstance(given, list | tuple))
        each = checks * len(given) if n is None else checks
        found = [check[1](one) if check else one for one, check in zip(given, each, strict=True)]
        same = isinstance(value, tuple) and all(a is b for a, b in zip(found, value, strict=True))
        return value if same else tuple(found)

    return (f"a tuple, each {words}" if n is None else f"{n} values, each {words}"), convert


def _sequence(kind: Any, check: _Check | None) -> _Check:
    def convert(value: Any) -> Any:
        _kept(value, not isinstance(value, str | bytes | Mapping) and hasattr(value, "__iter__"))
        iter(value) if kind is Iterable else len(value)  # either refuses what has none
        if check is None or not hasattr(value, "__len__"):
            return value
        found = [check[1](one) for one in value]
        same = isinstance(value, list | tuple) and all(a is b for a, b in zip(found, value, strict=True))
        return value if same else found

    return "a sequence" + (f", each {check[0]}" if check else ""), convert


_SCALARS: dict[Any, _Check] = {
    float: ("a number below 1e100", _number),
    bool: ("True or False", _flag),
    str: ("text", lambda value: _kept(value, isinstance(value, str))),
    Path: ("a path", _path),
}
