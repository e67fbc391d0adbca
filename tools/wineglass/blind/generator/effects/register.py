"""The register of effects and their variants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wineglass.blind.generator.world import World
from wineglass.errors import BadInput

Law = Callable[[World, float], None]


@dataclass(frozen=True)
class Variant:
    """One functional form of an effect.

    typical: a strength, in `unit`, that a protocol with every excitation shows clearly; scale it from there
    channels: where the difference shows first, of the recording's channels ("noise of X" where only the noise differs)
    imitates: id of the catalogue's effect that an effect outside the catalogue is made to look like
    loop: the only loop in which it shows; empty: both
    """

    id: str
    name: str
    stage: str
    unit: str
    typical: float
    channels: tuple[str, ...]
    meaning: str
    law: Law
    in_catalogue: bool = True
    imitates: str = ""
    loop: str = ""


_register: dict[tuple[str, str], Variant] = {}


def effect(id: str, name: str, *, stage: str, unit: str, typical: float, channels: tuple[str, ...] = ("rate",), imitates: str = "",
           in_catalogue: bool = True, loop: str = "") -> Callable[[Law], Law]:
    """Registers a law under an effect's id and a variant's name; its docstring says what it is."""

    def put(law: Law) -> Law:
        if (id, name) in _register:
            raise ValueError(f"{id}/{name} is there twice")
        meaning = (law.__doc__ or "").strip().splitlines()[0]
        _register[id, name] = Variant(id, name, stage, unit, typical, channels, meaning, law, in_catalogue, imitates, loop)
        return law

    return put


def ids(in_catalogue: bool | None = None) -> list[str]:
    """Effect ids: of the catalogue, outside of it, or (None) all."""
    return sorted({one.id for one in _register.values() if in_catalogue is None or one.in_catalogue == in_catalogue})


def variants(id: str | None = None) -> list[Variant]:
    """All variants, or those of one effect."""
    return [one for one in _register.values() if id is None or one.id == id]


def find(id: str, name: str) -> Variant:
    try:
        return _register[id, name]
    except KeyError:
        known = [one.name for one in variants(id)]
        todo = f"choose one of {', '.join(known)}" if known else f"choose an effect of {', '.join(ids())}"
        raise BadInput(f"no effect '{id}' in a variant '{name}'", "case", todo) from None
