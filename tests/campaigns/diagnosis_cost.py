"""What a diagnosis at twin level costs, in processor time by stage: a recording of the protocol `full` in each loop, with an effect and without.

    OMP_NUM_THREADS=1 PYTHONPATH=tools python tests/campaigns/diagnosis_cost.py --minutes 10

Every figure is the stage's own, without the stages that it calls; what has no stage of its own stands with its caller. A busy machine makes all of them
up to twice as large.
"""

from __future__ import annotations

import argparse
import functools
import importlib
import resource
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

BEGIN_S = time.process_time()

from wineglass import effects, protocols, scenario  # noqa: E402
from wineglass.diagnosis import twin_engine  # noqa: E402
from wineglass.simulation import simulate  # noqa: E402

IMPORTS_S = time.process_time() - BEGIN_S
STAGES = {
    "full twin, C": "wineglass.twin:Twin.step_with",
    "full twin, telemetry": "wineglass.telemetry:Decoder.feed",
    "envelope twin, C": "wineglass.envelope:Envelope.run",
    "floors": "wineglass.diagnosis.floors:at_rest",
    "noise in telemetry and raw codes": "wineglass.diagnosis.noise_level:examine",
    "responses": "wineglass.diagnosis.responses:respond",
    "unit, and effects with it": "wineglass.diagnosis.standing:_moved",
    "whitening": "wineglass.diagnosis.system:System.whiten",
    "products": "wineglass.diagnosis.system:products",
    "explanations": "wineglass.diagnosis.explain:explained",
    "closure": "wineglass.diagnosis.closure:Closer._search",
    "confirmation": "wineglass.diagnosis.confirmation:confirm",
    "rest": "wineglass.diagnosis.twin_engine:examine",
}


class Clock:
    """Processor time by stage; a stage that is entered stops the one around it."""

    def __init__(self) -> None:
        self.spent_s: defaultdict[str, float] = defaultdict(float)
        self.calls: defaultdict[str, int] = defaultdict(int)
        self._open: list[str] = []
        self._since_s = 0.0

    def _turn(self) -> None:
        now = time.process_time()
        if self._open:
            self.spent_s[self._open[-1]] += now - self._since_s
        self._since_s = now

    def around(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*args: Any, **options: Any) -> Any:
            self._turn()
            self._open.append(stage)
            self.calls[stage] += 1
            try:
                return function(*args, **options)
            finally:
                self._turn()
                self._open.pop()

        return timed

    def watch(self) -> None:
        """Puts itself around every stage, wherever its function has been imported."""
        for stage, place in STAGES.items():
            module, _, path = place.partition(":")
            *holders, name = path.split(".")
            holder = functools.reduce(getattr, holders, importlib.import_module(module))
            function = getattr(holder, name)
            timed = self.around(stage, function)
            setattr(holder, name, timed)
            for other in [m for key, m in sys.modules.items() if key.startswith("wineglass")]:
                for key in [key for key, value in vars(other).items() if value is function]:
                    setattr(other, key, timed)


def recorded(folder: Path, loop: str, effect: str, minutes: float, seed: int) -> Path:
    """After the protocol's end everything stays as it is."""
    made = protocols.scenario("full", device="metal-fast", loop=loop, seed=seed)  # type: ignore[arg-type]
    made = made.model_copy(update={"duration_s": max(made.duration_s, 60.0 * minutes)})
    path = folder / "case.h5"
    simulate(scenario.prepare(made), path, effects=[effects.typical(effect, 2.0)] if effect else [])
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of the recordings")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--effect", default="cross_damping")
    args = parser.parse_args()
    clock = Clock()
    clock.watch()
    for loop in ("open", "rebalance"):
        for effect in ("", args.effect):
            with tempfile.TemporaryDirectory() as folder:
                path = recorded(Path(folder), loop, effect, args.minutes, args.seed)
                clock.spent_s.clear()
                clock.calls.clear()
                examined = twin_engine.examine(path)
            verdict = "not applicable" if examined is None else examined.verdict.diagnosis.verdict
            print(f"\n{loop}, {effect or 'healthy'}: {verdict}, {IMPORTS_S + sum(clock.spent_s.values()):.1f} s, of it {IMPORTS_S:.1f} s of imports; "
                  f"largest memory so far {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
            for stage, spent_s in sorted(clock.spent_s.items(), key=lambda item: -item[1]):
                print(f"  {stage:34s} {spent_s:6.2f} s in {clock.calls[stage]} calls", flush=True)


if __name__ == "__main__":
    main()
