"""`wineglass device --port PORT`: identity and status; settings, calibration."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wineglass.console import Console

HELP = "read a device's identity and status; change its mode and set-points; read and write its calibration"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", required=True, metavar="PORT", help="serial device, tcp://HOST:PORT or unix socket")
    parser.add_argument("--baud", type=int, default=921600, metavar="BIT/S", help="speed of a serial device")
    mode = parser.add_argument_group("mode, in force until the next start")
    mode.add_argument("--compensation", choices=("none", "static", "g2"), help="bias compensation")
    mode.add_argument("--loop", choices=("open", "rebalance"), help="open loop or force-to-rebalance")
    mode.add_argument("--filter", choices=("none", "0.01", "0.025", "0.05", "0.1"), help="corner of the output filter, of the slow tick's rate")
    mode.add_argument("--amplitude", type=float, metavar="FS", help="set-point of the primary amplitude, of ADC full scale")
    mode.add_argument("--phase", type=float, metavar="DEG", help="set-point of the drive loop's phase")
    mode.add_argument("--pll", type=float, nargs=2, metavar=("KP", "KI"), help="phase loop [1/s, 1/s^2]")
    mode.add_argument("--agc", type=float, nargs=2, metavar=("KP", "KI"), help="amplitude loop [FS/FS, 1/s]")
    mode.add_argument("--rebalance", type=float, nargs=4, metavar=("KP", "KI", "IN_PHASE", "QUADRATURE"),
                      help="rebalance loop [FS/FS, 1/s] and its force limits [FS]")
    mode.add_argument("--test-force", type=float, nargs=3, metavar=("IN_PHASE", "QUADRATURE", "HZ"), help="force on the secondary axis [FS, FS, Hz]")
    mode.add_argument("--drive", choices=("on", "off"), help="off: the shell rings down; on: driven again, without a cold start")
    mode.add_argument("--baseband-hz", type=float, metavar="HZ", help="rate of baseband frames, 0: off")
    mode.add_argument("--output-hz", type=float, metavar="HZ", help="rate of output frames, 0: off")
    mode.add_argument("--restart", action="store_true", help="acquisition from cold")
    calibration = parser.add_argument_group("calibration, kept in the device")
    calibration.add_argument("--write-calibration", type=Path, metavar="FILE", help="store and activate: .json, or the bytes of a block")
    calibration.add_argument("--read-calibration", type=Path, metavar="FILE", help="fetch the stored one: .json, or any other name for the bytes")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.link.ports import open_port
    from wineglass.link.session import Session

    block = _block(args.write_calibration) if args.write_calibration else None
    with open_port(args.port, args.baud) as port:
        session = Session(port)
        identity = session.identity()
        refusals = _settings(args, session, identity)
        if block is not None:
            refusals += _refusals(lambda: session.write_calibration(block, identity.unique_id))
            identity = session.identity()
        if args.read_calibration:
            refusals += _refusals(lambda: _keep(session.calibration(), args.read_calibration, args.port))
        status = session.status()
    _show(console, identity, status, [str(refusal) for refusal in refusals])
    for refusal in refusals:
        console.warn(str(refusal))
    return 1 if refusals else 0


def _settings(args: argparse.Namespace, session: Any, identity: Any) -> list[Any]:
    """Every wish in turn; returns what the device refused."""
    from wineglass.link.live import set_frame_rates

    encoder, loop_hz = session.encoder, identity.sample_rate_hz / identity.decimation
    wishes = {
        "amplitude": (encoder.amplitude, args.amplitude and (args.amplitude,)),
        "phase": (encoder.phase_set_point, None if args.phase is None else (args.phase,)),
        "pll": (encoder.pll_gains, args.pll and (*args.pll, identity.sample_rate_hz, identity.decimation)),
        "agc": (encoder.agc_gains, args.agc and (*args.agc, loop_hz)),
        "rebalance": (encoder.rebalance, args.rebalance and (*args.rebalance[:2], loop_hz, *args.rebalance[2:])),
        "loop": (encoder.loop, args.loop and (args.loop,)),
        "compensation": (encoder.compensation, args.compensation and (args.compensation,)),
        "filter": (encoder.output_filter, args.filter and (args.filter,)),
        "test force": (encoder.test_signal, args.test_force and (*args.test_force, loop_hz)),
        "drive": (encoder.drive, args.drive and (args.drive == "on",)),
        "restart": (encoder.restart, () if args.restart else None),
    }
    refusals = []
    for what, (build, arguments) in wishes.items():
        if arguments is not None:
            refusals += _refusals(lambda what=what, build=build, arguments=arguments: session.command(what, build, *arguments))
    return refusals + _refusals(lambda: set_frame_rates(session, identity, args.baseband_hz, args.output_hz))


def _refusals(action: Any) -> list[Any]:
    from wineglass.link.session import Refused

    try:
        action()
    except Refused as refused:
        return [refused]
    return []


def _block(path: Path) -> bytes:
    """A calibration block from its JSON or its bytes; BadInput when it is neither."""
    from wineglass import calibration_block

    if path.suffix == ".json":
        return calibration_block.to_binary(calibration_block.read_json(path))
    block = path.read_bytes()
    calibration_block.unpack(block, str(path))
    return block


def _keep(block: bytes, path: Path, source: str) -> None:
    from wineglass import atomic, calibration_block

    if path.suffix == ".json":
        atomic.write_text(path, calibration_block.to_json(calibration_block.from_binary(block, source)))
    else:
        atomic.write_bytes(path, block)


def _show(console: Console, identity: Any, status: Any, refusals: list[str]) -> None:
    from wineglass.calibration_block import COMPENSATIONS, LOOPS, OUTPUT_FILTERS
    from wineglass.wire import Status

    bits = [bit.name.lower().replace("_", " ") for bit in Status if int(status["status"]) & bit]
    slow_hz = identity.sample_rate_hz / identity.slow_period_samples
    rates = {tap: slow_hz / int(status[f"{tap}_divisor"]) if status[f"{tap}_divisor"] else 0.0 for tap in ("baseband", "output")}
    sources = ("compiled in", "stored", "stored, the predecessor of a damaged one")
    calibration = f"{sources[min(identity.calibration_source, 2)]}, number {identity.calibration_sequence}, CRC {identity.calibration_crc:08x}"
    names = {"loop": LOOPS, "compensation": COMPENSATIONS, "output_filter": OUTPUT_FILTERS}
    settings = {key: _choice(choices, int(status[key])) for key, choices in names.items()}
    counters = ("frames_lost", "records_lost", "bursts_cut", "commands_accepted", "commands_refused", "receive_errors", "store_errors")
    console.table("", ["identity", ""], [
        ("device", identity.device_name or "(unnamed)"), ("unique id", f"{identity.unique_id:016x}"), ("firmware", identity.firmware_version),
        ("sample rate [Hz]", f"{identity.sample_rate_hz:g}"), ("ADC, DAC [bit]", f"{identity.adc_bits}, {identity.dac_bits}"),
        ("calibration", calibration)])
    console.table("", ["status", ""], [
        ("time since power-up [s]", f"{int(status['time_us']) / 1e6:.3f}"), ("now", ", ".join(bits) or "-"),
        *((key.replace("_", " "), value) for key, value in settings.items()),
        ("baseband, output [Hz]", f"{rates['baseband']:g}, {rates['output']:g}"),
        *((name.replace("_", " "), int(status[name])) for name in counters)])
    console.json({"identity": identity, "status": {"bits": bits, "word": int(status["status"]), "time_s": int(status["time_us"]) / 1e6, **settings,
                                                   **{f"{tap}_hz": value for tap, value in rates.items()},
                                                   **{name: int(status[name]) for name in counters}}, "refused": refusals})


def _choice(choices: tuple[str, ...], index: int) -> str:
    return choices[index] if index < len(choices) else f"unknown ({index})"
