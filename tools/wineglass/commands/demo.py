"""`wineglass demo`: the paper's two experiments and a calibration, with the firmware in the loop."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console

if TYPE_CHECKING:
    from wineglass.experiments import Figure2, Figure5

HELP = "run the paper's two experiments, calibrate a thermal sweep, and with --chamber a real one; saves plots"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="FOLDER", help="where plots and files go")
    parser.add_argument("--chamber", type=Path, metavar="FILE.csv",
                        help="climate-chamber sweep of a real gyro, compensated through the firmware's polynomial")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all noise")


def run(args: argparse.Namespace, console: Console) -> int:
    args.output.mkdir(parents=True, exist_ok=True)
    result = {
        "figure_5": _figure_5(args, console),
        "figure_2": _figure_2(args, console),
        "calibration": _calibration(args, console),
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
    return {"plot": path}


def _command(words: list[str], console: Console) -> None:
    """Runs another command as a person would, and shows what was typed."""
    from wineglass import cli

    console.print("$ ./wineglass " + " ".join(words))
    status = cli.main((["--quiet"] if console.silent else []) + words)
    console.print()
    if status:
        raise SystemExit(status)
