"""wineglass blind make|run|baselines|score DIR"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wineglass.console import Console

if TYPE_CHECKING:
    from wineglass.blind.folders import Folders
    from wineglass.blind.scheduling import Spread

HELP = "the blind check: make recordings with labels under seal, diagnose them, open the labels and score"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from wineglass.blind.choices import PROTOCOLS, TIERS

    actions = parser.add_subparsers(dest="action", required=True, metavar="make|run|baselines|score")
    make = _action(actions, "make", "draw cases, make their recordings, seal their labels", _make)
    make.add_argument("--cases", type=int, default=400, metavar="N", help="how many (default 400)")
    make.add_argument("--seed", type=int, required=True, metavar="S", help="of the draw: whoever knows it can make the labels again")
    make.add_argument("--device", default="metal-fast", metavar="NAME|D.toml", help="device description (default metal-fast)")
    make.add_argument("--protocol", action="append", choices=PROTOCOLS, help="only this protocol; may be repeated")
    make.add_argument("--tier", action="append", choices=TIERS, help="only cases of this kind; may be repeated")
    run = _action(actions, "run", "diagnose the recordings; the labels stay shut", _run)
    run.add_argument("--engine", default="diagnose", metavar="NAME", help="who answers: diagnose, as the command does, or twin, the twin level alone (default diagnose)")
    baselines = _action(actions, "baselines", "simpler methods answer, too, taught by a set with open labels", _baselines)
    baselines.add_argument("--train", type=Path, required=True, metavar="DIR", help="a set of another seed, its labels in DIR/sealed")
    score = _action(actions, "score", "check the seal, open the labels, score the answers", _score)
    make.add_argument("--allowances", type=Path, metavar="DIR", help="keep here, for other sets too, what tolerances do to each kind of recording (default with the labels)")
    for one in (make, run, baselines):
        one.add_argument("--jobs", type=int, default=2, metavar="N", help="processes of this machine, 0: none but this (default 2)")
        one.add_argument("--scheduler", default="", metavar="ADDRESS", help="of a running Dask scheduler, tcp://HOST:PORT, in place of this machine")
    for one in (make, score):
        one.add_argument("--labels", type=Path, metavar="SEALED", help="folder of the labels (default DIR/sealed)")


def _action(actions: Any, name: str, text: str, function: Callable[..., int]) -> argparse.ArgumentParser:
    parser = actions.add_parser(name, help=text, description=text)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.set_defaults(function=function)
    return parser


def run(args: argparse.Namespace, console: Console) -> int:
    return args.function(args, console)


def _folders(args: argparse.Namespace) -> Folders:
    from wineglass.blind.folders import Folders

    return Folders(args.folder, getattr(args, "labels", None), getattr(args, "allowances", None))


def _spread(args: argparse.Namespace) -> Spread:
    from wineglass.blind.scheduling import Spread
    from wineglass.errors import BadInput

    if args.jobs < 0:
        raise BadInput(f"{args.jobs} processes", "--jobs", "give 0 or more")
    return Spread(args.jobs, args.scheduler)


def _make(args: argparse.Namespace, console: Console) -> int:
    from wineglass.blind.draw import Wishes, draw
    from wineglass.blind.making import make, steps, unmade
    from wineglass.errors import BadInput

    if args.cases < 1:
        raise BadInput(f"{args.cases} cases", "--cases", "give 1 or more")
    chosen = {name: tuple(value) for name, value in (("tiers", args.tier), ("protocols", args.protocol)) if value}
    wishes = Wishes(args.cases, args.seed, args.device, **chosen)
    _goes_on(args.cases - len(unmade(draw(wishes), _folders(args))), args.cases, "recordings", console)
    with console.progress("making", total=steps(wishes, _folders(args))) as bar:
        seal = make(wishes, _folders(args), _spread(args), bar.advance)
    console.print(f"{args.cases} recordings in {args.folder / 'recordings'}, their labels in {_folders(args).sealed}")
    console.print(f"seal: {seal}")
    console.json({"cases": args.cases, "seal": seal})
    return 0


def _goes_on(done: int, total: int, what: str, console: Console) -> None:
    """After an interruption, or where there is nothing to do."""
    if done:
        console.print(f"{done} of {total} {what} are there already" + (", going on" if done < total else ""))


def _run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.blind import engines, running, sealing
    from wineglass.errors import BadInput

    folders = _folders(args)
    if args.engine not in engines.ENGINES:
        raise BadInput(f"no engine '{args.engine}'", "--engine", f"choose one of {', '.join(engines.ENGINES)}")
    folders.need_root()
    cases = sealing.manifest(folders.recordings)
    _goes_on(len(cases) - len(running.unanswered(folders, args.engine, cases)), len(cases), "answers", console)
    with console.progress("diagnosing", total=len(cases)) as bar:
        table = running.run(folders, args.engine, _spread(args), bar.advance)
    failed = _failed(table.parent, console)
    console.print(f"written: {table}")
    console.json({"results": table, "failed": failed})
    return 0


def _failed(folder: Path, console: Console) -> dict[str, str]:
    from wineglass.blind import results

    failed = {name: one["error"] for name, one in results.read(folder).items() if "error" in one}
    if failed:
        name, error = next(iter(failed.items()))
        console.warn(f"{len(failed)} cases ended without an answer, {name} first: {error}; they count as wrong, and `blind run` asks them again")
    return failed


def _baselines(args: argparse.Namespace, console: Console) -> int:
    from wineglass.blind import sealing
    from wineglass.blind.baselines import running
    from wineglass.blind.folders import Folders
    from wineglass.errors import BadInput

    folders, taught_by = _folders(args), Folders(args.train)
    for one in (folders, taught_by):
        one.need_root()
    if folders.root.resolve() == taught_by.root.resolve():
        raise BadInput("is the exam itself", args.train, "make a set with another seed to learn from")
    total = sum(len(sealing.manifest(one.recordings)) for one in (folders, taught_by))
    with console.progress("features", total=total) as bar:
        names = running.run(folders, taught_by, _spread(args), bar.advance)
    console.print(f"answered: {', '.join(names)}")
    console.json({"engines": names})
    return 0


def _score(args: argparse.Namespace, console: Console) -> int:
    import json

    from wineglass.atomic import write_text
    from wineglass.blind import scoreboard, scoring
    from wineglass.console import plain

    folders = _folders(args)
    marks = scoring.marked(folders)
    found = scoring.scores(folders, marks)
    target = folders.root / scoring.SCORES
    page = scoreboard.render(found, scoring.main_of(found))
    write_text(target, json.dumps(plain(found), indent=1, allow_nan=False) + "\n")
    write_text(target.with_suffix(".html"), page)
    for engine, scores in found["engines"].items():
        _print(engine, scores, console)
    _print_bars(found, scoring.main_of(found), console)
    console.print(f"written: {target}, {target.with_suffix('.html')}")
    console.json(found)
    return 0


def _print(engine: str, scores: dict[str, Any], console: Console) -> None:
    clear, total = scores["clear"], scores["all"]
    rows = [[name.replace("_", " "), _text(clear[name]), _text(total[name])] for name in clear]
    console.table(f"{engine}: {scores['cases']} cases", ["score", "nulls and SNR from 10", "all"], rows)


def _print_bars(found: dict[str, Any], main: str, console: Console) -> None:
    from wineglass.blind import bars
    from wineglass.blind.scoreboard import limit

    lines = [*found["engines"][main]["bars"], *bars.beside(found["engines"], main)]
    says = {True: "reached", False: "missed", None: "no case"}
    console.table(f"{main}: what it must reach", ["score", "measured", "bar", ""], [[line["name"], _text(line["measured"]), limit(line), says[line["reached"]]] for line in lines])


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if not isinstance(value, dict):
        return f"{value:.3f}"
    if not value["n"]:
        return "-"
    low, high = value["interval"]
    return f"{value['k']}/{value['n']}  {100 * value['value']:.1f} % ({100 * low:.1f} .. {100 * high:.1f})"
