"""A recording through the twin-level engine, from file to diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from wineglass.device import Device
from wineglass.diagnosis import channels, hypotheses, noise_level, soundness, twin_level, twin_verdict
from wineglass.diagnosis.evidence import file_hash
from wineglass.diagnosis.hypotheses import Hypotheses
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.twin_level import TwinAnalysis
from wineglass.diagnosis.twin_verdict import Source, Verdict
from wineglass.diagnosis.vocabulary import FLICKER
from wineglass.recording import Recording

STEPS = 6
NEEDED = ("drive_frequency", "drive_level")
LEAST_FRAMES = 120


@dataclass(frozen=True)
class Examined:
    """Everything that was found out about one recording."""

    analysis: TwinAnalysis
    noise: NoiseEvidence
    hypotheses: Hypotheses
    verdict: Verdict


def applies(recording: Recording, device: Device | None) -> bool:
    """The twin level needs a described device and its baseband, long enough for held-out stretches."""
    if device is None or "baseband" not in recording:
        return False
    tap = recording.tap("baseband")
    return all(name in tap for name in NEEDED) and channels.grid_of(recording).count >= LEAST_FRAMES


def examine(path: Path, device: str | Path | None = None, advance: Callable[[], None] = lambda: None,
            without: frozenset[str] = frozenset()) -> Examined | None:
    """None where the twin level does not apply. without: effects taken out of the catalogue (for tests of honesty)."""
    digest = file_hash(path)
    with Recording.open(path, tolerant=True) as recording:
        described = soundness.described(recording, device)
        if not applies(recording, described):
            return None
        notes = soundness.check(recording, described)
        noise = noise_level.examine(recording, described).forget(without)
        advance()
        source = Source(str(path), digest, recording.firmware_version or None, tuple(notes))

        def concluded(evidence: NoiseEvidence) -> Examined:
            found = twin_level.analyse(recording, described, without, advance if evidence is noise else lambda: None, evidence)
            weighed = hypotheses.weigh(found, evidence)
            return Examined(found, evidence, weighed, twin_verdict.diagnose(found, weighed, evidence, source))

        return wandering_or_lawful(noise, concluded)


def wandering_or_lawful(noise: NoiseEvidence, concluded: Callable[[NoiseEvidence], Examined]) -> Examined:
    """A bias that wanders is noise only if nothing foretells it: where it is all that is found, it is asked for a law, too."""
    found = concluded(noise)
    if FLICKER not in noise.named or found.verdict.outcome.chosen is not None:
        return found
    lawful = concluded(noise.forget(frozenset({FLICKER})))
    return lawful if lawful.verdict.foretold else found
