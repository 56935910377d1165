# SPDX-License-Identifier: Apache-2.0
"""The command line, `vega`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from vega_planner.cli.parser import make_parser
from vega_planner.errors import VegaError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: Words after `vega`; those of the process when absent.

    Returns:
        Exit status: 0 done; 2 bad usage or input; 3 planned, but some of it is not
        printable; 4 hardware or execution failed; 130 interrupted.
    """
    # Small matrices everywhere: a second BLAS thread only spins.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser = make_parser()
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(join_negative(words))
    from vega_planner.cli import commands

    try:
        return commands.COMMANDS[options.command](options)
    except VegaError as error:
        print(f"vega {options.command}: {one_line(error)}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print(f"vega {options.command}: interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0


def join_negative(words: Sequence[str]) -> list[str]:
    """Write `--pose -5,0,0,0` as `--pose=-5,0,0,0`, lest the value look like an option."""
    joined: list[str] = []
    for word in words:
        is_number = len(word) > 1 and word[0] == "-" and (word[1].isdigit() or word[1] == ".")
        if is_number and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def one_line(error: BaseException) -> str:
    """Put an error's text on one line."""
    return " ".join(str(error).split()) or type(error).__name__
