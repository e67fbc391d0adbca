"""The command line itself, with commands made up here."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import wineglass
import wineglass.commands
from wineglass import cli

ROOT = Path(__file__).resolve().parents[2]

COMMANDS = {
    "measure_": '''
HELP: str = ("measure a thing, "
             "in two literals")
NEEDS_BUILD = False

def add_arguments(parser):
    parser.add_argument("n", type=int)

def run(args, console):
    console.print("value [rad/s]", args.n)
    console.json({"n": args.n, "bad": float("nan")})
''',
    "two_words": 'HELP = "fails"\ndef add_arguments(parser):\n    pass\ndef run(args, console):\n    return 7\n',
    "refuse": '''
HELP = "refuses its input"
def add_arguments(parser):
    pass
def run(args, console):
    from wineglass.errors import BadInput
    raise BadInput("no\\nunit", "x.csv, line 3", "add --unit rate=rad/s")
''',
    "interrupt": 'HELP = "h"\ndef add_arguments(p):\n    pass\ndef run(a, c):\n    raise KeyboardInterrupt\n',
    "asks": '''
HELP = "h"
def add_arguments(parser):
    parser.add_argument("--given", type=int, default=3, help="how many")
    parser.add_argument("--none", help="what")
    parser.add_argument("--list", action="append", default=[], help="which")
    parser.add_argument("--said", default="x", help="who (default: as recorded)")
def run(args, console):
    pass
''',
    "waits": '''
HELP = "h"
def add_arguments(parser):
    parser.add_argument("folder")
def run(args, console):
    import subprocess, sys
    from pathlib import Path
    from wineglass.atomic import atomic_path
    with atomic_path(Path(args.folder) / "result.txt") as half:
        half.write_text("half")
        subprocess.run([sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(60)"])
''',
    "absent": 'HELP = "h"\ndef add_arguments(p):\n    pass\ndef run(a, c):\n    open("/no/such/file")\n',
    "buggy": 'HELP = "h"\ndef add_arguments(p):\n    pass\ndef run(a, c):\n    return 1 // 0\n',
    "broken_import": 'HELP = "still listed"\nimport no_such_module_at_all\n',
}


@pytest.fixture(autouse=True)
def made_up_commands(tmp_path, monkeypatch):
    for name, source in COMMANDS.items():
        (tmp_path / f"{name}.py").write_text(source)
        monkeypatch.delitem(sys.modules, f"wineglass.commands.{name}", raising=False)
    monkeypatch.setattr(cli, "COMMANDS_FOLDER", tmp_path)
    monkeypatch.setattr(wineglass.commands, "__path__", [str(tmp_path)])
    yield
    for name in COMMANDS:
        sys.modules.pop(f"wineglass.commands.{name}", None)


def one_error_line(capsys):
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1 and captured.err.startswith("wineglass")
    return captured.err


@pytest.mark.parametrize("argv", [[], ["--help"], ["-h"], ["help"], ["--json", "--help"]])
def test_help_lists_every_command_without_importing_any(argv, capsys):
    assert cli.main(argv) == 0
    text = capsys.readouterr().out
    assert "measure" in text and "measure a thing, in two literals" in text
    assert "two-words" in text and "still listed" in text


def test_version(capsys):
    for argv in (["--version"], ["measure", "--version"], ["--quiet", "--version"]):
        assert cli.main(argv) == 0
        assert capsys.readouterr().out == f"wineglass {wineglass.__version__}\n"


def test_a_command_prints_text_as_it_is(capsys):
    assert cli.main(["measure", "3"]) == 0
    assert capsys.readouterr().out == "value [rad/s] 3\n"


@pytest.mark.parametrize("argv", [["--json", "measure", "3"], ["measure", "--json", "3"], ["measure", "3", "--json"],
                                  ["--quiet", "measure", "3", "--json"]])
def test_json_before_or_after_the_command(argv, capsys):
    assert cli.main(argv) == 0
    assert json.loads(capsys.readouterr().out) == {"n": 3, "bad": None}


@pytest.mark.parametrize("argv", [["-q", "measure", "3"], ["measure", "3", "--quiet"]])
def test_quiet_before_or_after_the_command(argv, capsys):
    assert cli.main(argv) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("argv", [["measure", "--help"], ["--help", "measure"], ["help", "measure"]])
def test_help_of_one_command(argv, capsys):
    assert cli.main(argv) == 0
    assert capsys.readouterr().out.startswith("usage: wineglass measure")


def test_help_names_a_default_where_there_is_one_and_once(capsys):
    assert cli.main(["asks", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "how many (default: 3)" in text and "who (default: as recorded)" in text
    assert text.count("default:") == 2


def test_status_of_the_command_is_the_exit_status():
    assert cli.main(["two-words"]) == 7


def test_unknown_command_names_the_nearest(capsys):
    assert cli.main(["mesure"]) == 2
    assert "did you mean measure?" in one_error_line(capsys)
    assert cli.main(["zzzz"]) == 2
    assert "--help" in one_error_line(capsys)


@pytest.mark.parametrize("argv", [["--wrong"], ["measure"], ["measure", "x"], ["measure", "3", "--wrong"]])
def test_wrong_arguments_are_one_line_and_status_2(argv, capsys):
    assert cli.main(argv) == 2
    assert "--help" in one_error_line(capsys)


def test_bad_input_is_one_line_and_status_2(capsys):
    assert cli.main(["refuse"]) == 2
    assert one_error_line(capsys) == "wineglass: error: x.csv, line 3: no unit; add --unit rate=rad/s\n"


def test_interrupt_is_one_line_and_status_130(capsys):
    assert cli.main(["interrupt"]) == 130
    assert one_error_line(capsys) == "wineglass: interrupted\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_one_line_and_leaves_nothing(number, tmp_path):
    """The command runs in a process of its own, with a half-written file and a child of its own."""
    (tmp_path / "out").mkdir()
    start = (f"import sys, wineglass.commands as c; from wineglass import cli; from pathlib import Path; c.__path__ = [{str(tmp_path)!r}]; "
             f"cli.COMMANDS_FOLDER = Path({str(tmp_path)!r}); sys.exit(cli.main(['waits', {str(tmp_path / 'out')!r}]))")
    process = subprocess.Popen([sys.executable, "-c", start], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env={**os.environ, "PYTHONPATH": str(ROOT / "tools")}, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    process.send_signal(number)
    error = process.communicate(timeout=30)[1]  # returns when the child has closed its end too
    assert (process.returncode, error) == (130, "wineglass: interrupted\n")
    assert list((tmp_path / "out").iterdir()) == []


def test_missing_file_is_one_line_and_status_2(capsys):
    assert cli.main(["absent"]) == 2
    assert "/no/such/file: no such file" in one_error_line(capsys)


def test_a_bug_keeps_its_traceback():
    with pytest.raises(ZeroDivisionError):
        cli.main(["buggy"])


def test_what_needs_environment_and_build():
    def answers(*argv):
        request = cli.split(list(argv))
        return cli.is_bare(request), cli.needs_build(request)

    assert answers() == (True, False)
    assert answers("nothing-like-it") == (True, False)
    assert answers("measure", "--version") == (False, False)
    assert answers("measure", "3") == (False, False)
    assert answers("two-words") == (False, True)
    assert answers("two-words", "--help") == (False, False)


def test_help_of_the_real_tools_needs_no_package():
    """As on a machine with nothing but python3: no site packages, no environment."""
    variables = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT / "tools")}
    answer = subprocess.run([sys.executable, "-S", "-m", "wineglass", "--help"], env=variables, text=True,
                            capture_output=True, check=False)
    assert answer.returncode == 0 and answer.stderr == ""
    assert "test" in answer.stdout


def test_every_real_command_has_its_three_parts():
    for path in sorted((ROOT / "tools/wineglass/commands").glob("[a-z]*.py")):
        source = path.read_text(encoding="utf-8")
        assert cli.help_line(path), f"{path.name}: HELP must be a plain string at the top level"
        assert "def add_arguments(" in source and "def run(" in source, path.name
