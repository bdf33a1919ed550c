"""The command line: ``dockloop COMMAND``, for the commands of `dockloop.commands`.

Thin on purpose: arguments in, one call into the package, text and exit status out. Exit status:
0 done, 1 the work failed, 2 bad usage or a bad file. Errors are one sentence on standard error;
only a defect of this program shows a traceback, and only with ``--debug``.
"""

import os
import signal
import sys
from argparse import SUPPRESS
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from dockloop.base.errors import DockloopError, UsageError, explain, naming_options
from dockloop.base.system import ENDING, handling
from dockloop.base.version import __version__
from dockloop.commands import COMMANDS, load_command
from dockloop.commands.arguments import Command
from dockloop.commands.console import ReaderGoneError, write, write_failure

_ALONE = "PYTHONSAFEPATH"  # set: processes of a command import nothing of the current folder


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: without the name of the program; default: those of the process.

    Returns:
        The exit status.
    """
    _check_streams()
    words = sys.argv[1:] if arguments is None else arguments
    options = _make_parser(words).parse_args(words)
    if hasattr(sys.stdout, "reconfigure"):  # names of files may hold what a terminal cannot show
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        # As after Ctrl-C, files that are not whole go.
        ended = handling(ENDING, signal.SIG_DFL, signal.default_int_handler)
        with ended, _alone(), naming_options():
            options.run(options)
        write("", end="")
    except DockloopError as error:
        write_failure(str(error))
        return error.exit_status
    except ReaderGoneError:
        return 0
    except KeyboardInterrupt:
        write_failure("interrupted")
        return 130
    except OSError as error:  # of a disk, a folder, a program: nothing that is wrong in here
        if options.debug:
            raise
        failure = explain(error)
        write_failure(str(failure))
        return failure.exit_status
    except Exception as error:
        if options.debug:
            raise
        write_failure(f"defect: {type(error).__name__}: {error}; --debug shows where")
        return 1
    return 0


@contextmanager
def _alone() -> Iterator[None]:
    """Let processes of a command import nothing of the current folder."""
    before = os.environ.get(_ALONE)
    os.environ[_ALONE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_ALONE]
        else:
            os.environ[_ALONE] = before


def _check_streams() -> None:
    """Refuse a closed standard output; no other file gets the number of a closed stream."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    if sys.stdout is None:
        write_failure("standard output is closed: let it go to a file, or to /dev/null")
        sys.exit(UsageError.exit_status)


def _make_parser(words: Sequence[str]) -> Command:
    """Describe all commands; those among the words with their options."""
    parser = Command(
        prog="dockloop",
        description="Spacecraft docking dynamics as FMUs: build them, run them, check mechanisms.",
        epilog="example: dockloop run idss_25t_350t --set friction.coefficient=0.2 --stop 12",
    )
    parser.add_argument("--version", action="version", version=f"dockloop {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text + ".")
        if name in words:
            module = load_command(name)
            command.epilog = module.EXAMPLE
            command.set_defaults(run=module.run)
            command.add_argument("--debug", action="store_true", help=SUPPRESS)
            module.add_options(command)
    return parser
