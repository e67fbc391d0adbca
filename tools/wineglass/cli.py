"""The command line. Commands are the modules of wineglass.commands; each one defines

    HELP: str                                  one line, a plain string literal
    add_arguments(parser) -> None
    run(args, console) -> int | None           status of the process, None is 0
    NEEDS_BUILD = False                        optional, when the command does not touch the C library

A module's name is the command's: a trailing underscore is dropped (import_.py is `import`), others become hyphens.
Only the chosen command is imported; this module itself needs nothing but the standard library of Python 3.9.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, NoReturn

from wineglass import __version__

PROGRAM = "wineglass"
COMMANDS_FOLDER = Path(__file__).parent / "commands"
GLOBAL_FLAGS = {"-h": "help", "--help": "help", "-q": "quiet", "--quiet": "quiet", "--json": "json",
                "--version": "version"}


class Request(NamedTuple):
    """The command line, split before anything heavy is loaded."""

    command: str | None
    flags: frozenset[str]  # global flags given before the command
    rest: list[str]  # everything after the command
    unknown_flag: str | None

    def wants(self, flag: str) -> bool:
        """Is the global flag given anywhere in front of a `--`?"""
        rest = self.rest[: self.rest.index("--")] if "--" in self.rest else self.rest
        return flag in self.flags or any(GLOBAL_FLAGS.get(word) == flag for word in rest)


class HelpText(argparse.ArgumentDefaultsHelpFormatter):
    """Defaults are named where there is one to name, once."""

    def _get_help_string(self, action: argparse.Action) -> str:
        told = action.help or ""
        empty = action.default is None or isinstance(action.default, bool) or action.default in ("", [], ())
        return told if empty or "default:" in told else str(super()._get_help_string(action))


class Parser(argparse.ArgumentParser):
    """One line per mistake, exit status 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())} (see {self.prog} --help)\n")


def main(argv: list[str] | None = None) -> int:
    """Runs one command; returns the exit status. Known errors are one line on stderr."""
    try:
        with _termination_raised():
            return _dispatch(split(sys.argv[1:] if argv is None else argv))
    except KeyboardInterrupt:
        return _complain("interrupted", 130, "")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except SystemExit as exit_request:
        return _status_of(exit_request)
    except Exception as error:
        return _report(error)


def split(argv: list[str]) -> Request:
    """Separates the global flags, the command and the command's own arguments."""
    flags: set[str] = set()
    for index, word in enumerate(argv):
        if word in GLOBAL_FLAGS or word == "help":
            flags.add(GLOBAL_FLAGS.get(word, word))
        elif word.startswith("-"):
            return Request(None, frozenset(flags), [], word)
        else:
            return Request(word, frozenset(flags), argv[index + 1 :], None)
    return Request(None, frozenset(flags), [], None)


def commands() -> dict[str, Path]:
    """Command name -> its module's file, in alphabetical order."""
    modules = sorted(path for path in COMMANDS_FOLDER.glob("*.py") if not path.stem.startswith("_"))
    return {path.stem.rstrip("_").replace("_", "-"): path for path in modules}


def is_bare(request: Request) -> bool:
    """Can the request be answered without environment and build?"""
    return request.command is None or request.command not in commands() or "version" in request.flags


def needs_build(request: Request) -> bool:
    """Does the command use the C library? (Read from the source: importing it would need the environment.)"""
    if is_bare(request) or request.wants("help"):
        return False
    source = commands()[request.command].read_text(encoding="utf-8")
    return not re.search(r"^NEEDS_BUILD(\s*:\s*bool)?\s*=\s*False\b", source, re.MULTILINE)


def help_line(path: Path) -> str:
    """HELP of a command module, without importing it."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for start, line in enumerate(lines):
        if re.match(r"HELP(\s*:\s*str)?\s*=", line):
            return _literal(lines[start : start + 12])
    return ""


def short_help() -> str:
    known = commands()
    width = max([len(name) for name in known] + [0])
    listed = "\n".join(f"  {name:{width}}  {help_line(path)}" for name, path in known.items())
    return (f"usage: {PROGRAM} COMMAND [arguments]\n\n"
            "Coriolis vibratory gyro: fixed-point processor, digital twin and the tools around both.\n\n"
            f"commands:\n{listed}\n\n"
            "options, before or after the command:\n"
            "  -h, --help   this text; after a command, that command's arguments (so does: help COMMAND)\n"
            "  -q, --quiet  print errors only\n"
            "  --json       print the result as JSON\n"
            "  --version    print the version\n")


@contextmanager
def _termination_raised() -> Iterator[None]:
    """SIGTERM ends a command as Ctrl-C does: half-written files go, and what it started ends with it."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _dispatch(request: Request) -> int:
    if request.unknown_flag:
        return _complain(f"unknown option {request.unknown_flag}", 2, f"see {PROGRAM} --help")
    if "version" in request.flags:
        print(f"{PROGRAM} {__version__}")
        return 0
    if request.command is None:
        print(short_help(), end="")
        return 0
    if request.command not in commands():
        return _complain(f"unknown command {request.command}", 2, _suggestion(request.command))
    return _run(request)


def _run(request: Request) -> int:
    from wineglass.console import Console

    module = _load(commands()[request.command])
    parser = Parser(prog=f"{PROGRAM} {request.command}", description=module.HELP,
                    formatter_class=HelpText)
    module.add_arguments(parser)
    options = parser.add_argument_group("global options")
    options.add_argument("-q", "--quiet", action="store_true", default="quiet" in request.flags,
                         help="print errors only")
    if not any("--json" in action.option_strings for action in parser._actions):  # a command may write it to a file instead
        options.add_argument("--json", action="store_true", default="json" in request.flags,
                             help="print the result as JSON")
    options.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}",
                         help="print the version")
    if "help" in request.flags:
        parser.print_help()
        return 0
    args = parser.parse_args(request.rest)
    status = module.run(args, Console(quiet=args.quiet, json_mode=args.json is True or "json" in request.flags))
    sys.stdout.flush()
    return int(status or 0)


def _load(path: Path):
    import importlib

    return importlib.import_module(f"wineglass.commands.{path.stem}")


def _literal(lines: list[str]) -> str:
    """The string assigned in the shortest run of lines that parses."""
    for end in range(1, len(lines) + 1):
        try:
            statement = ast.parse("\n".join(lines[:end])).body[0]
            return str(ast.literal_eval(statement.value))
        except (SyntaxError, ValueError):
            continue
    return ""


def _suggestion(command: str) -> str:
    near = difflib.get_close_matches(command, commands(), n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"see {PROGRAM} --help"


def _complain(what: str, status: int, todo: str) -> int:
    text = f"{what}; {todo}" if todo else what
    print(f"{PROGRAM}: error: {' '.join(text.split())}" if status != 130 else f"{PROGRAM}: {text}", file=sys.stderr)
    return status


def _status_of(exit_request: SystemExit) -> int:
    if exit_request.code is None or isinstance(exit_request.code, int):
        return exit_request.code or 0
    return _complain(str(exit_request.code), 1, "")


def _report(error: Exception) -> int:
    """Known errors become one line; anything else is a bug and keeps its traceback."""
    from wineglass.errors import WineglassError

    if "WINEGLASS_DEBUG" in os.environ:
        raise error
    if isinstance(error, WineglassError):
        return _complain(str(error), error.exit_status, "")
    if isinstance(error, (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)):
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"{where}{(error.strerror or str(error)).lower()}", 2, "check the path")
    if isinstance(error, OSError) and error.strerror and error.filename:
        return _complain(f"{error.filename}: {error.strerror.lower()}", 1, "")
    raise error
