# SPDX-License-Identifier: Apache-2.0
"""Kernels as machine code that is built once, at set-up.

A function marked with `kernel` is compiled by numba. Set-up builds the signatures listed in
`compiled_signatures.txt` into libraries beside this file; a call that fits one of them goes
there, and numba itself is never imported (which takes longer than most plans' geometry).
Any other call, and every call where nothing is built or a kernel has changed since, is
compiled by numba when it happens, and cached.
"""

from __future__ import annotations

import hashlib
import importlib.machinery
import importlib.util
import json
import os
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SIGNATURES = Path(__file__).with_name("compiled_signatures.txt")
LIBRARIES = Path(__file__).with_name("compiled")
#: Names a file to which the signatures of calls are written.
LOG_VARIABLE = "VEGA_KERNEL_LOG"

#: What numba is told besides when it compiles a kernel; set-up calls none from Python.
extra_options: dict[str, Any] = {}

#: How each element type is written in a signature.
_LETTERS = {np.dtype(t): t for t in ("f8", "f4", "i8", "i4", "i2", "i1", "u8", "u4", "u2", "u1")}
_LETTERS[np.dtype(bool)] = "b1"
_SCALARS = {float: "f8", int: "i8", bool: "b1"}
#: Flags of an array, as numpy numbers them: in C order and aligned; writeable.
_ORDERED, _WRITEABLE = 0x101, 0x400
_FLAGS = _ORDERED | _WRITEABLE

_lock = threading.RLock()


def kernel(function: Any = None, **options: Any) -> Any:
    """Mark a function as a kernel: compiled, serial, and free of the interpreter lock.

    Args:
        function: Of arrays, numbers and tuples of these, all by position.
        options: What `numba.njit` is told besides `nogil` and `cache`.

    Returns:
        The `Kernel`.
    """
    if function is None:
        return lambda function: Kernel(function, options)
    return Kernel(function, options)


def inner_kernel(function: Any = None, **options: Any) -> Any:
    """Mark a kernel that other kernels call often and that makes no arrays.

    It does without counting the references to the arrays it is given, which costs as much
    as many a small kernel does.
    """
    return kernel(function, _nrt=False, **options)


class Kernel:
    """A compiled function; kernels may call each other."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func = function
        self.targetoptions = {"nogil": True, "cache": True, **options}
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__module__ = function.__module__
        self._known: dict[tuple[Any, ...], Callable[..., Any]] = {}
        self._dispatcher: Any = None

    def __call__(self, *values: Any) -> Any:
        """Run the machine code that fits the types of the values."""
        shape = tuple([
            (v.dtype, v.ndim, v.flags.num & _FLAGS) if type(v) is np.ndarray else _shape(v)
            for v in values
        ])  # fmt: skip
        code = self._known.get(shape)
        if code is None:
            code = self._known[shape] = self._find(shape)
        return code(*values)

    def _find(self, shape: tuple[Any, ...]) -> Callable[..., Any]:
        given = [_written(kind) for kind in shape]
        if log := os.environ.get(LOG_VARIABLE):
            with Path(log).open("a", encoding="utf-8") as file:
                file.write(" ".join([self.__module__, self.__name__, *map(str, given)]) + "\n")
        with _lock:  # two threads must not open the libraries at once
            built = _built()
        for words, code in built.get((self.__module__, self.__name__), ()):
            if len(words) == len(given) and all(map(_fits, given, words)):
                return code
        return self.dispatcher

    @property
    def dispatcher(self) -> Any:
        """What numba makes of the function; compiles when it is called."""
        with _lock:
            if self._dispatcher is None:
                from numba import njit

                options = {**self.targetoptions, **extra_options}
                self._dispatcher = njit(**options)(self.py_func)
            return self._dispatcher

    @property
    def _numba_type_(self) -> Any:  # how numba asks what a name in a kernel is
        from numba import types

        return types.Dispatcher(self.dispatcher)


def _shape(value: Any) -> Any:
    """What the choice of machine code depends on, for all but plain arrays."""
    if isinstance(value, tuple):
        return tuple([_shape(v) for v in value])
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num & _FLAGS
    return type(value)


def _written(kind: Any) -> str | None:
    """Write what `_shape` returned as a word of a signature; None for what has none."""
    if isinstance(kind, type):
        if kind in _SCALARS:
            return _SCALARS[kind]
        return _LETTERS.get(np.dtype(kind)) if issubclass(kind, np.generic) else None
    if kind and isinstance(kind[0], np.dtype):
        dtype, dimensions, flags = kind
        if dtype not in _LETTERS or flags & _ORDERED != _ORDERED:
            return None
        return f"{_LETTERS[dtype]}[{dimensions}]" + ("" if flags & _WRITEABLE else "r")
    words = [_written(part) for part in kind]
    return None if None in words else f"({','.join(map(str, words))})"


def _fits(given: str | None, word: str) -> bool:
    """Tell whether a value may go where `word` stands: code that only reads takes any."""
    return given is not None and (given == word or _read_only(given) == word)


def _read_only(word: str) -> str:
    return word.replace("]r", "]").replace("]", "]r")


def signatures() -> dict[tuple[str, str], list[tuple[str, ...]]]:
    """Read the listed signatures: (module, kernel) to the words of each.

    A word is an element type (`f8`, `i4`, `b1`), with the number of dimensions for an array
    in C order (`f8[2]`) and an `r` for one that is only read, or words in brackets for a tuple.
    """
    listed: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    for line in SIGNATURES.read_text(encoding="utf-8").splitlines():
        module, name, *words = line.split(" ")
        listed.setdefault((module, name), []).append(tuple(words))
    return listed


def exported_name(module: str, name: str, index: int) -> str:
    """Name of a kernel's signature in its library."""
    return f"{module.replace('.', '__')}__{name}__{index}"


def state() -> str:
    """Digest of all that the libraries depend on: kernels, signatures, and this processor."""
    total = hashlib.blake2b(digest_size=16)
    for source in (SIGNATURES, Path(__file__), *sorted(ROOT.glob("vega_*/**/*kernels.py"))):
        total.update(str(source.relative_to(ROOT)).encode())
        total.update(source.read_bytes())
    total.update(_processor())
    return total.hexdigest()


def _processor() -> bytes:
    """The instruction sets that code made for this processor may use."""
    try:
        with Path("/proc/cpuinfo").open("rb") as file:
            text = file.read(8192)
    except OSError:
        return b""
    return b"".join(
        line for line in text.splitlines()[:40] if line.startswith((b"flags", b"Features"))
    )


@cache
def _built() -> dict[tuple[str, str], list[tuple[tuple[str, ...], Callable[..., Any]]]]:
    """Open the libraries; empty where they do not belong to these kernels."""
    try:
        made = json.loads((LIBRARIES / "made.json").read_text())
        if made["state"] != state():
            return {}
        libraries = [_opened(LIBRARIES / name) for name in made["libraries"]]
    except (OSError, ImportError, ValueError, KeyError):
        return {}
    code: dict[str, Any] = {}
    for library in libraries:
        code.update(vars(library))
    found: dict[tuple[str, str], list[tuple[tuple[str, ...], Callable[..., Any]]]] = {}
    for (module, name), rows in signatures().items():
        for index, words in enumerate(rows):
            if function := code.get(exported_name(module, name, index)):
                found.setdefault((module, name), []).append((words, function))
    return found


def _opened(path: Path) -> Any:
    name = path.name.split(".")[0]
    loader = importlib.machinery.ExtensionFileLoader(name, str(path))
    spec = importlib.util.spec_from_loader(name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module
