"""`wineglass record --port PORT -o REC.h5`"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from wineglass.console import Console

HELP = "record a device's telemetry while it comes: serial device, TCP or unix socket, or a file of telemetry bytes"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", required=True, metavar="PORT", help="serial device, tcp://HOST:PORT, unix socket, or file of telemetry bytes")
    parser.add_argument("--baud", type=int, default=921600, metavar="BIT/S", help="speed of a serial device")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="REC.h5", help="recording to write")
    parser.add_argument("--seconds", type=float, metavar="S", help="device time to record; without it until Ctrl-C")
    parser.add_argument("--baseband-hz", type=float, metavar="HZ", help="set the device's rate of baseband frames, 0: off")
    parser.add_argument("--output-hz", type=float, metavar="HZ", help="set the device's rate of output frames, 0: off")
    parser.add_argument("--burst", type=int, default=0, metavar="SAMPLES", help="ask for a burst of raw samples at the start")
    parser.add_argument("--script", type=Path, metavar="FILE.toml", help="send its commands and bursts at their times and stop at its end; "
                                                                             "./wineglass protocol NAME --script writes one")
    parser.add_argument("--device", metavar="DEVICE", help="description to keep in the recording: a shipped device, or a .toml file")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import bench_script
    from wineglass import device as devices
    from wineglass.link.live import LiveOptions, record
    from wineglass.link.ports import FilePort, open_port
    from wineglass.telemetry import Decoder

    script = bench_script.load(args.script) if args.script else None
    device = devices.load(args.device or script.device) if args.device or script else None
    options = LiveOptions(args.seconds, args.baseband_hz, args.output_hz, args.burst, device.to_toml() if device else "")
    if script is not None:
        options = replace(options, seconds=args.seconds or script.duration_s, script=script, device=device,
                          baseband_hz=script.baseband_hz if args.baseband_hz is None else args.baseband_hz,
                          output_hz=script.output_hz if args.output_hz is None else args.output_hz)
    with open_port(args.port, args.baud) as port, console.progress(f"recording {args.port}", total=options.seconds) as bar:
        def show(seconds: float, decoder: Decoder) -> None:
            lost = decoder.statistics.lost_frames
            bar.update(seconds, description=f"recording {args.port}: {seconds:.1f} s, {decoder.statistics.frames} frames, {lost} lost")

        if not port.is_live and (args.script or args.burst or args.baseband_hz is not None or args.output_hz is not None):
            assert isinstance(port, FilePort)
            port.write(b"")  # says that a file takes no commands
        done = record(port, args.output, options, show)
    console.print(f"{args.output}: {done.duration_s:.3f} s of {done.device_name or 'an unnamed device'}, unique id {done.unique_id:016x}; "
                  f"{done.ended}")
    for name, tap in done.taps.items():
        console.print(f"  {name}: {tap['samples']} samples" + (f", {tap['lost']} of them lost" if tap["lost"] else ""))
    for warning in done.warnings:
        console.warn(warning)
    console.json(done)
    return 0
