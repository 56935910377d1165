# SPDX-License-Identifier: Apache-2.0
"""Build the listed kernels into libraries, so that no plan waits for a compiler.

    build_kernels.py            build where something has changed
    build_kernels.py --check    1 where something has changed
    build_kernels.py --list     list anew what planning small parts calls; add --log FILE
                                for calls logged elsewhere (VEGA_KERNEL_LOG)

Modules are shared out to as many processes as there are cores, each with a library.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from vega_planner import compiled  # noqa: E402

MADE = compiled.LIBRARIES / "made.json"


def main() -> int:
    """Do what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--log", type=Path, action="append", default=[])
    parser.add_argument("--library", nargs=2, metavar=("NAME", "MODULES"))
    words = parser.parse_args()
    if words.library:
        return build(words.library[0], words.library[1].split(","))
    if words.list:
        return list_signatures(words.log)
    if current():
        return 0
    return 1 if words.check else build_all()


def current() -> bool:
    """Tell whether the libraries belong to the kernels as they are."""
    try:
        made = json.loads(MADE.read_text())
    except (OSError, ValueError):
        return False
    return made["state"] == compiled.state() and all(
        (compiled.LIBRARIES / name).exists() for name in made["libraries"]
    )


def build_all() -> int:
    """Build every library; those of other kernels, and numba's own caches, go first."""
    shutil.rmtree(compiled.LIBRARIES, ignore_errors=True)
    compiled.LIBRARIES.mkdir()
    for stale in (path for room in ROOT.glob("vega_*") for path in room.rglob("*.nb[ic]")):
        stale.unlink()  # numba does not see that a kernel which it calls has changed
    state = compiled.state()
    builders = [
        subprocess.Popen([sys.executable, __file__, "--library", f"vega_kernels_{i}", share])
        for i, share in enumerate(shares(len(os.sched_getaffinity(0))))
    ]
    if any([builder.wait() for builder in builders]):
        return 1
    libraries = sorted(path.name for path in compiled.LIBRARIES.glob("vega_kernels_*"))
    scratch = MADE.with_suffix(".new")
    scratch.write_text(json.dumps({"state": state, "libraries": libraries}) + "\n")
    scratch.replace(MADE)
    return 0


def shares(count: int) -> list[str]:
    """Share the modules out, the longest first, each to the one that has least."""
    length = {
        module: len(ROOT.joinpath(*module.split(".")).with_suffix(".py").read_bytes())
        for module, _ in compiled.signatures()
    }
    rows: list[list[str]] = [[] for _ in range(min(count, len(length)))]
    for module in sorted(length, key=lambda m: (-length[m], m)):
        min(rows, key=lambda row: sum(length[m] for m in row)).append(module)
    return [",".join(row) for row in rows]


def build(name: str, modules: Iterable[str]) -> int:
    """Compile the signatures of some modules into one extension module.

    It is `numba.pycc` that does it; each kernel keeps its own options, and lets go of
    the interpreter lock, which pycc would not do.
    """
    import warnings

    warnings.simplefilter("ignore")  # pycc is pending deprecation without a successor
    from numba.core import typing
    from numba.core.compiler import Flags
    from numba.core.errors import NumbaError
    from numba.core.registry import cpu_target
    from numba.pycc import CC, compiler

    compile_extra, options = compiler.compile_extra, {}
    compiled.extra_options.update(no_cpython_wrapper=True, no_cfunc_wrapper=True, cache=False)

    def compile_kernel(
        typer: Any,
        target: Any,
        function: Any,
        arguments: Any,
        returned: Any,
        flags: Any,
        **rest: Any,
    ) -> Any:
        flags = Flags()
        cpu_target.options.parse_as_flags(flags, options[function])
        flags.no_compile = flags.nrt = flags.release_gil = flags.no_cfunc_wrapper = True
        flags.enable_pyobject = flags.enable_looplift = False
        return compile_extra(typer, target, function, arguments, returned, flags, **rest)

    compiler.compile_extra = compile_kernel
    library = CC(name, source_module=compiled)
    library.output_dir = str(compiled.LIBRARIES)
    library.target_cpu = "host"
    wanted = set(modules)
    for (module, kernel), rows in compiled.signatures().items():
        if module not in wanted:
            continue
        found = getattr(import_module(module), kernel, None)
        if not isinstance(found, compiled.Kernel):
            print(f"kernels: {module} has no kernel {kernel}", file=sys.stderr)
            continue
        options[found.py_func] = {
            key: value for key, value in found.targetoptions.items() if key != "cache"
        }
        for index, words in enumerate(rows):
            symbol = compiled.exported_name(module, kernel, index)
            arguments = [numba_type(word) for word in words]
            if not fits(found, arguments):
                print(f"kernels: {kernel} of {module} takes no {words}", file=sys.stderr)
                continue
            library._exported_functions[symbol] = compiler.ExportEntry(
                symbol, typing.signature(None, *arguments), found.py_func
            )
    try:
        library.compile()
    except NumbaError as error:
        print(f"kernels: {error}", file=sys.stderr)
        return 1
    return 0


def fits(kernel: compiled.Kernel, arguments: list[Any]) -> bool:
    """Tell whether a kernel has so many arguments."""
    return kernel.py_func.__code__.co_argcount == len(arguments)


def numba_type(word: str) -> Any:
    """The numba type that a word of a signature stands for."""
    from numba import from_dtype, types
    from numpy import dtype

    if word.startswith("("):
        inner, depth, start, parts = word[1:-1], 0, 0, []
        for place, letter in enumerate(inner):
            depth += (letter == "(") - (letter == ")")
            if letter == "," and depth == 0:
                parts.append(inner[start:place])
                start = place + 1
        return types.Tuple([numba_type(part) for part in [*parts, inner[start:]]])
    element, bracket, rest = word.partition("[")
    scalar = types.boolean if element == "b1" else from_dtype(dtype(element))
    if not bracket:
        return scalar
    dimensions, _, read_only = rest.partition("]")
    return types.Array(scalar, int(dimensions), "C", readonly=bool(read_only))


def list_signatures(logs: list[Path]) -> int:
    """Write the signatures that planning needs, and those logged elsewhere, to their file."""
    listed: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        command = [sys.executable, ROOT / "tools" / "kernel_cases.py"]
        environment = {**os.environ, compiled.LOG_VARIABLE: str(log)}
        subprocess.run(command, check=True, env=environment)
        lines = [line for path in (log, *logs) for line in path.read_text().splitlines()]
    for line in sorted(set(lines)):
        module, name, *words = line.split(" ")
        found = getattr(import_module(module), name, None)
        if "None" not in words and isinstance(found, compiled.Kernel) and fits(found, words):
            rows = listed.setdefault((module, name), [])
            rows[:] = joined(rows, tuple(words))
    compiled.SIGNATURES.write_text(
        "".join(" ".join([*key, *words]) + "\n" for key in sorted(listed) for words in listed[key])
    )
    return 0


def joined(rows: list[tuple[str, ...]], words: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Add a signature; code that only reads an array takes one that may be written, too."""
    for index, row in enumerate(rows):
        if len(row) == len(words) and all(
            a.replace("]r", "]") == b.replace("]r", "]") for a, b in zip(row, words, strict=True)
        ):
            both = tuple(max(pair, key=len) for pair in zip(row, words, strict=True))
            return [*rows[:index], both, *rows[index + 1 :]]
    return [*rows, words]


if __name__ == "__main__":
    raise SystemExit(main())
