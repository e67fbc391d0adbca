"""`wineglass demo`: the paper's two experiments, a calibration, and the diagnosis of a fault under seal, with the firmware in the loop."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.experiments import Figure2, Figure5

AXES = ("gyro_a", "gyro_b")
HELP = "run the paper's two experiments, calibrate a thermal sweep, diagnose a hidden fault, and with --chamber a real sweep; saves plots and reports"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="FOLDER", help="where plots and files go")
    parser.add_argument("--chamber", type=Path, metavar="FILE.csv",
                        help="climate-chamber sweep of a real gyro, compensated through the firmware's polynomial, and both axes diagnosed")
    parser.add_argument("--seed", type=int, metavar="N", help="of all noise and of the hidden fault (default: 1, and a new fault every time)")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import hidden

    if args.seed is not None and args.seed < 0:
        raise BadInput(f"{args.seed} is no seed", "--seed", "give 0 or more")
    if args.output.exists() and not args.output.is_dir():
        raise BadInput("is no folder", args.output, "choose another one with -o")
    args.output.mkdir(parents=True, exist_ok=True)
    hidden_seed = hidden.new_seed() if args.seed is None else args.seed
    args.seed = 1 if args.seed is None else args.seed
    result = {
        "figure_5": _figure_5(args, console),
        "figure_2": _figure_2(args, console),
        "calibration": _calibration(args, console),
        "hidden": _hidden(args, hidden_seed, console),
    }
    if args.chamber is not None:
        result["chamber"] = _chamber(args, console)
    console.json(result)
    return 0


def _figure_5(args: argparse.Namespace, console: Console) -> dict[str, object]:
    from wineglass.experiments import run_fig5
    from wineglass.plots.experiments import draw_figure5

    with console.progress("temperature swing of 1 Hz under rate", total=1.0) as bar:
        figure = run_fig5(seed=args.seed, progress=lambda what, done: bar.update(completed=done, description=what))
    path = args.output / "fig5.png"
    draw_figure5(figure, path)
    console.table(f"Shell temperature 50 sin(2 pi t / 1 s) degC under rate, device {figure.device}: residual",
                  ["compensation", "ac [rad/s]", "ac [deg/h]", "mean [deg/h]", "of uncompensated"], _rows(figure, "none"))
    console.print(f"G2 leaves 1/{1 / figure.ratio('g2', 'static'):.0f} of what the static correction leaves; plot: {path}\n")
    return {"residual": figure.residual, "g2_over_static": figure.ratio("g2", "static"), "plot": path}


def _figure_2(args: argparse.Namespace, console: Console) -> dict[str, object]:
    from wineglass.experiments import run_fig2
    from wineglass.plots.experiments import draw_figure2

    with console.progress("slow chamber profile at zero rate", total=1.0) as bar:
        figure = run_fig2(seed=args.seed, progress=lambda what, done: bar.update(completed=done, description=what))
    path = args.output / "fig2.png"
    draw_figure2(figure, path)
    console.table(f"Slow chamber profile at zero rate, device {figure.device}: output",
                  ["compensation", "ac [rad/s]", "ac [deg/h]", "mean [deg/h]", "of uncompensated"], _rows(figure, "none"))
    console.print(f"plot: {path}\n")
    return {"residual": figure.residual, "plot": path}


def _rows(figure: Figure2 | Figure5, reference: str) -> list[tuple[str, ...]]:
    from wineglass.plots.style import DEG_H_PER_RAD_S, LABELS

    whole = figure.residual[reference].ac_rad_s
    return [(LABELS[name], f"{item.ac_rad_s:.3e}", f"{item.ac_rad_s * DEG_H_PER_RAD_S:.3f}",
             f"{item.mean_rad_s * DEG_H_PER_RAD_S:+.3f}", f"{item.ac_rad_s / whole:.2e}") for name, item in figure.residual.items()]


def _calibration(args: argparse.Namespace, console: Console) -> dict[str, object]:
    recording, calibration = args.output / "sweep.h5", args.output / "calibration.json"
    _command(["simulate", "thermal-sweep", "--seed", str(args.seed), "-o", str(recording)], console)
    _command(["calibrate", str(recording), "-o", str(calibration)], console)
    return {"recording": recording, "calibration": calibration}


def _chamber(args: argparse.Namespace, console: Console) -> dict[str, object]:
    path = args.output / "chamber.png"
    _command(["chamber", str(args.chamber), "--plot", str(path)], console)
    return {"plot": path, "reports": [_axis(axis, args, console) for axis in AXES]}


def _axis(axis: str, args: argparse.Namespace, console: Console) -> Path:
    """The table does not say its units: seconds, degC and rad/s, as `chamber` takes them."""
    report = args.output / f"chamber-{axis}.html"
    _command(["diagnose", str(args.chamber), "--column", f"rate={axis}", "--unit", f"{axis}=rad/s", "--unit", "t_s=s", "--unit", "temperature_degC=degC",
              "--drop-rows", "0,1", "--report", str(report)], console)
    return report


def _hidden(args: argparse.Namespace, seed: int, console: Console) -> dict[str, object]:
    """A fault is drawn and its label sealed; the recording is diagnosed by the public command; then the label is opened."""
    from wineglass import atomic, hidden
    from wineglass.diagnosis.contract import Diagnosis

    case = hidden.draw(seed)
    recording, result, report = (args.output / f"hidden.{ending}" for ending in ("h5", "json", "html"))
    run = case.run()
    with console.progress(f"protocol {case.protocol} on a device with a hidden fault", total=run.n_blocks) as bar:
        done = hidden.record(case, recording, bar.advance)
    if done.interrupted:
        raise KeyboardInterrupt
    console.print(f"{recording}: protocol {case.protocol} on {case.device}, {run.scenario.duration_s:g} s, with a fault drawn by seed {seed} (give it back with "
                  f"--seed {seed})\nlabel sealed, SHA-256 {case.digest}\n")
    _command(["diagnose", str(recording), "--json", str(result), "--report", str(report)], console)
    judgement = hidden.judge(case, Diagnosis.model_validate_json(result.read_text(encoding="utf-8")))
    atomic.write_text(args.output / "hidden-label.json", case.label + "\n")
    console.print(f"the label: {judgement.truth}; {judgement.in_words}\n")
    return {"seed": seed, "recording": recording, "diagnosis": result, "report": report, "judgement": judgement}


def _command(words: list[str], console: Console) -> None:
    """Runs another command as a person would, and shows what was typed."""
    from wineglass import cli

    console.print("$ ./wineglass " + " ".join(words))
    status = cli.main((["--quiet"] if console.silent else []) + words)
    console.print()
    if status:
        raise SystemExit(status)
