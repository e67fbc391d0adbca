"""The port's own register header against an SVD file of the manufacturer, where one is at hand.

WINEGLASS_SVD names the file (STM32F405.svd or STM32F40x.svd); a `cmsis-svd` package that brings its data is found by itself."""

import importlib.util
import os
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

HEADER = Path(__file__).resolve().parents[2] / "hal/stm32f405/registers.h"
OF_THE_PROCESSOR = ("STK_", "NVIC_", "SCB_")  # not in the chip's file


def registers() -> dict[str, int]:
    """PERIPHERAL_REGISTER -> address, of the header."""
    text = HEADER.read_text(encoding="utf-8")
    bases = {name: int(value, 16) for name, value in re.findall(r"#define (\w+_BASE) +UINT32_C\((0x\w+)\)", text)}
    return {name: bases[base] + int(offset, 16)
            for name, base, offset in re.findall(r"#define (\w+) +REGISTER\((\w+_BASE), (0x\w+)\)", text)}


def fields() -> dict[str, tuple[int, int]]:
    """PERIPHERAL_REGISTER_FIELD -> (first bit, width), of the header."""
    text = HEADER.read_text(encoding="utf-8")
    single = {name: (int(bit), 1) for name, bit in re.findall(r"#define (\w+) +BIT\((\d+)\)", text)}
    wide = {name: (int(first), int(width)) for name, first, width in re.findall(r"#define (\w+)\(v\) +FIELD\(v, (\d+), (\d+)\)", text)}
    return {name: place for name, place in (single | wide).items() if not name.startswith(OF_THE_PROCESSOR)}


@pytest.fixture(scope="module")
def peripherals() -> dict[str, ElementTree.Element]:
    path = svd_file()
    if path is None:
        pytest.skip("no SVD file; WINEGLASS_SVD names one")
    return {item.findtext("name"): item for item in ElementTree.parse(path).iter("peripheral")}


def svd_file() -> Path | None:
    if "WINEGLASS_SVD" in os.environ:
        return Path(os.environ["WINEGLASS_SVD"])
    package = importlib.util.find_spec("cmsis_svd")
    folders = package.submodule_search_locations if package else None
    found = [path for folder in folders or () for path in Path(folder).rglob("STM32F40[5x].svd")]
    return found[0] if found else None


def registers_of(name: str, peripherals) -> dict[str, ElementTree.Element]:
    item = peripherals[name]
    base = item.get("derivedFrom")
    return {register.findtext("name"): register for register in (peripherals[base] if base else item).iter("register")}


def split(name: str) -> tuple[str, str]:
    of_all_adcs = "C_ADC_"
    if name.startswith(of_all_adcs):
        return of_all_adcs[:-1], name.removeprefix(of_all_adcs)
    peripheral, _, register = name.partition("_")
    return peripheral, register


def test_the_header_is_read():
    assert len(registers()) > 50 and len(fields()) > 120
    assert registers()["RCC_CR"] == 0x40023800 and fields()["RCC_PLLCFGR_PLLN"] == (6, 9)


def test_addresses(peripherals):
    for name, address in registers().items():
        peripheral, register = split(name)
        found = registers_of(peripheral, peripherals)[register]
        assert int(peripherals[peripheral].findtext("baseAddress"), 16) + int(found.findtext("addressOffset"), 16) == address, name


def test_fields(peripherals):
    """A wide field may stand in the file as single bits with numbers: PLLM0, PLLM1, ..."""
    for name, (first, width) in fields().items():
        register_name = max((known for known in registers() if name.startswith(known + "_")), key=len)
        peripheral, register = split(register_name)
        places = {item.findtext("name"): (int(item.findtext("bitOffset")), int(item.findtext("bitWidth")))
                  for item in registers_of(peripheral, peripherals)[register].iter("field")}
        field = name[len(register_name) + 1 :]
        field = f"{field}x" if f"{field}x" in places else field
        if field in places:
            assert places[field] == (first, width), name
        else:
            assert [places[f"{field}{bit}"] for bit in range(width)] == [(first + bit, 1) for bit in range(width)], name


def test_interrupts(peripherals):
    numbers = {item.findtext("name").removesuffix("_IRQ"): int(item.findtext("value"))
               for peripheral in peripherals.values() for item in peripheral.iter("interrupt")}
    found = {name: int(value) for name, value in re.findall(r"#define IRQ_(\w+) +(\d+)", HEADER.read_text()) if name != "COUNT"}
    assert found and {name: numbers[name] for name in found} == found
